"""How every figure of the report looks, and how it is written so that equal results give equal bytes."""

from __future__ import annotations

import re
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, LogLocator
from PIL import Image

from verify.runs.atomic import write_file, write_text

from .remembering import remembered_layout

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from matplotlib.artist import Artist
    from matplotlib.axis import Axis
    from matplotlib.transforms import Bbox

    from .interactive import Curves
    from .results import RunResults

# Okabe and Ito's palette; black is kept for published points, yellow is too pale for lines on white.
OKABE_ITO = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
GREY, INK, PALE = "#8a8f98", "#22262b", "#eceef1"
MARKERS = ("o", "s", "^", "D", "v", "P")
# numbers find their places before they get colours: one array instead of four
IMAGE: Any = {"origin": "lower", "interpolation": "nearest", "interpolation_stage": "data"}
PHASE_FIELD: Any = {"cmap": "magma", "clim": (0.0, 1.0)}
PHASE_FIELD_LABEL = "phase field c (0 broken, 1 intact)"
SIGNED_COLOURS = "RdBu_r"
RASTER_DPI = 200
RASTER_ABOVE = 5000  # more cells or points than this are drawn as pixels inside the SVG
PICTURE_COMPRESSION = 3  # of a film's pictures
BROKEN_BELOW = 0.08  # phase field under which the thesis removes material points (Fig. 4.9)

SETTINGS: Any = {
    "svg.hashsalt": "fracture-verify",  # identifiers inside the SVG are the same in every run
    "svg.fonttype": "path",
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9.0,
    "axes.edgecolor": "#5c6168",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.limits": (-4, 5),
    "xtick.color": "#3b4046",
    "ytick.color": "#3b4046",
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "text.color": INK,
    "grid.color": "#e3e5e8",
    "grid.linewidth": 0.6,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "lines.linewidth": 1.5,
}


@dataclass(frozen=True)
class Drawing:
    """A figure on a page: ``file`` and ``data`` are names inside the page's figure folder, ``curves`` its numbers."""

    name: str
    title: str
    caption: str
    file: str
    data: str | None = None
    curves: Curves | None = None


@dataclass(frozen=True)
class Film:
    """Pictures ``files`` of a page's figure folder at ``times``, shown one at a time with a slider."""

    name: str
    title: str
    caption: str
    files: list[str]
    times: list[float]
    unit: str


@contextmanager
def drawing_style() -> Iterator[None]:
    """Use the report's settings, whatever the user's matplotlibrc says; figures here need no display."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(SETTINGS)
        yield


def save(figure: Figure, folder: Path, name: str) -> str:
    """Write ``folder/name.svg`` without date or program version; return the file's name."""
    file = folder / f"{name}.svg"
    with remembered_layout():
        box, metadata = _lay_out(figure), {"Date": None, "Creator": None}
        write_file(file, lambda path: figure.savefig(path, bbox_inches=box, dpi=RASTER_DPI, metadata=metadata))
    return file.name


def _lay_out(figure: Figure) -> Bbox:
    """Put everything in its place for good; return the box [inches] that holds it, with a margin.

    ``savefig`` with a layout or a tight box draws the whole figure once more before.
    """
    FigureCanvasSVG(figure)
    figure.set_dpi(FigureCanvasSVG.fixed_dpi)
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
    figure.set_layout_engine(None)
    return figure.get_tightbbox().padded(matplotlib.rcParams["savefig.pad_inches"])


class Pictures:
    """Pictures of one figure in which few artists change: all others are drawn and put in their places once."""

    def __init__(self, figure: Figure, changing: Sequence[Artist], dpi: int) -> None:
        """changing : artists in the order in which they are drawn over the others."""
        figure.set_dpi(dpi)
        self._figure, self._changing, self._canvas = figure, changing, FigureCanvasAgg(figure)
        self._still: Any = None

    def save(self, folder: Path, name: str) -> str:
        """Write ``folder/name.png`` of the artists as they are now, without program version; return the file's name."""
        if self._still is None:
            for artist in self._changing:
                artist.set_animated(True)
            with remembered_layout():
                self._canvas.draw()
            self._still = self._canvas.copy_from_bbox(self._figure.bbox)
        self._canvas.restore_region(self._still)
        for artist in self._changing:
            artist.draw(self._canvas.get_renderer())
        picture = Image.fromarray(np.asarray(self._canvas.buffer_rgba())).convert("RGB")
        write_file(folder / f"{name}.png", lambda path: picture.save(path, compress_level=PICTURE_COMPRESSION))
        return f"{name}.png"


def save_data(table: pd.DataFrame, folder: Path, name: str) -> str:
    """Write the numbers behind a figure as ``folder/name.csv``; return the file's name."""
    write_text(folder / f"{name}.csv", table.to_csv(index=False, float_format="%.10g", lineterminator="\n"))
    return f"{name}.csv"


def drawing(
    figure: Figure, folder: Path, name: str, title: str, caption: str, data: pd.DataFrame | None = None
) -> Drawing:
    """Write a figure and the numbers behind it to ``folder``; return what a page shows of them."""
    file = save(figure, folder, name)
    return Drawing(name, title, caption, file, None if data is None else save_data(data, folder, name))


def table_of(runs: Sequence[RunResults], columns: Sequence[str]) -> pd.DataFrame:
    """Return the columns that the histories of the runs have, with the run's name before them."""
    tables = [run.history[[column for column in columns if column in run.history]] for run in runs]
    together = pd.concat([table.assign(run=run.name) for run, table in zip(runs, tables, strict=True)])
    return together[["run", *(column for column in columns if column in together)]]


def panels(
    rows: int, columns: int, width: float, height: float, grid: bool = False, **share: Any
) -> tuple[Figure, np.ndarray]:
    """Return a figure of ``width`` by ``height`` inches and its axes as a (rows, columns) array, with a grid if asked."""
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **share)
    for each in axes.flat if grid else ():
        each.grid(True)
        each.set_axisbelow(True)
    return figure, axes


def curve_axes(width: float, height: float, xlabel: str, ylabel: str) -> tuple[Figure, Any]:
    """Return a figure of ``width`` by ``height`` inches and its one pair of axes, with a light grid and labels."""
    figure, axes = panels(1, 1, width, height, grid=True)
    axes[0, 0].set(xlabel=xlabel, ylabel=ylabel)
    return figure, axes[0, 0]


def legend_below(
    figure: Figure, axes: Iterable[Any], columns: int = 3, last: str = "", place: Any = "outside lower center"
) -> None:
    """Put one legend below the panels: each label of any of the axes once, the one called ``last`` at the end."""
    labelled = [pair for each in axes for pair in zip(*each.get_legend_handles_labels(), strict=True)]
    handles = {label: handle for handle, label in labelled}
    if last in handles:
        handles[last] = handles.pop(last)
    if handles:
        figure.legend(handles.values(), handles.keys(), loc=place, ncols=min(len(handles), columns))


def legend_above(figure: Figure, axes: Iterable[Any], columns: int = 4) -> None:
    """Put one legend above the panels, from the left, where the eye begins: for figures of many kinds of lines."""
    legend_below(figure, axes, columns, place="outside upper left")


def colours_of(names: Sequence[str]) -> dict[str, str]:
    """Give each run its colour: the palette for few runs, an ordered map for many."""
    if len(names) <= len(OKABE_ITO):
        return dict(zip(names, OKABE_ITO, strict=False))
    shades = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.85, len(names)))
    return {name: matplotlib.colors.to_hex(shade) for name, shade in zip(names, shades, strict=True)}


def slug(text: str) -> str:
    """Return a name that is safe as a file name and as an anchor."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", text).strip("-") or "unnamed"


def page_name(case: str, tier: str) -> str:
    """Return the name of a case's page, one of its own where signs are left out that tell it from another case's."""
    safe = slug(case)
    own = safe if safe == case else f"{safe}-{sha256(case.encode()).hexdigest()[:6]}"
    return f"{own}-{tier}" if tier else own


class _PlainNumbers(LogFormatter):
    """Ticks of a logarithmic axis as plain numbers, times a scale; minor ones where there are few of the others."""

    def __init__(self, scale: float, **settings: Any) -> None:
        super().__init__(**settings)
        self._scale = scale

    def __call__(self, value: float, position: int | None = None) -> str:
        shown = f"{self._scale * value:.9f}".rstrip("0").rstrip(".")
        return shown if super().__call__(value, position) else ""


def plain_numbers(axis: Axis, scale: float = 1.0) -> None:
    """Show the numbers of a logarithmic axis times ``scale`` in full, shares as percent with a scale of 100."""
    axis.set_major_formatter(_PlainNumbers(scale))
    axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))  # each tick costs time to draw
    axis.set_minor_formatter(_PlainNumbers(scale, minor_thresholds=(1.5, 1.5)))


def nice_number(value: float) -> float:
    """Return the number 1, 2 or 5 times a power of ten that is nearest below ``value``."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step for step in (1.0, 2.0, 5.0) if step <= value / power * (1 + 1e-9)) * power)
