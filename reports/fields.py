"""Figures of fields: phase field, hydrostatic stress, distorted mesh and points, crack paths."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib.collections import PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from numerics.element_quality import scaled_jacobian

from . import style
from .outlines import cells_in, draw_outlines, fit_axes, shade_bodies
from .words import listed, number

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cases import Case
    from verify.runs.frames import Frame

    from .results import CaseResults, GridState, PointState, RunResults

LARGEST_SNAPSHOTS = 4
LARGEST_ROWS = 4
PIXELS = 400  # along the longer side of a field that is drawn as an image
ELEMENT, BROKEN_ELEMENT = ("#dfe9f2", style.OKABE_ITO[0]), ("#f6cfae", style.OKABE_ITO[1])  # face, edge
EXTREME_PERCENTILE = 99.0  # of the stresses, at which colours are cut
SHARE_OF_BODY_TO_MOVE = 0.06  # displacements are drawn this large, relative to the body


# ---------------------------------------------------------------- painting


def paint_points(axes: Axes, case: Case | None, places: np.ndarray, values: np.ndarray, **colours: Any) -> Any:
    """Paint the bodies with the value of the nearest point, and return what a colour bar needs.

    places : (n, 2) [length]; values : (n,), NaN where nothing is to be seen. Points may stand for long rectangles, where
    the grid is graded: the nearest point fills them without gaps.
    """
    assert case is not None  # a field comes with its case
    image, extent = point_image(case, places, values)
    return axes.imshow(image, extent=extent, **style.IMAGE, **colours)


def point_image(
    case: Case, places: np.ndarray, values: np.ndarray
) -> tuple[np.ma.MaskedArray, tuple[float, float, float, float]]:
    """Return points as an image (rows, columns), masked outside the bodies, and its extent."""
    from scipy.spatial import cKDTree

    lower, upper = (np.asarray(corner, dtype=float) for corner in case.bounding_box())
    pixel = (upper - lower).max() / PIXELS
    columns, rows = np.maximum(np.round((upper - lower) / pixel).astype(int), 1)
    x = lower[0] + (np.arange(columns) + 0.5) / columns * (upper[0] - lower[0])
    y = lower[1] + (np.arange(rows) + 0.5) / rows * (upper[1] - lower[1])
    pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    nearest = values[cKDTree(places).query(pixels)[1]]
    hidden = (case.inside(pixels) < 0) | np.isnan(nearest)
    image = np.ma.masked_array(np.nan_to_num(nearest), mask=hidden).reshape(rows, columns)
    return image, (lower[0], upper[0], lower[1], upper[1])


def paint_mesh(axes: Any, grid: GridState, **colours: Any) -> Any:
    """Paint the nodal phase field of a mesh, interpolated in each cell."""
    return axes.tripcolor(
        grid.points[:, 0], grid.points[:, 1], grid.triangles(), grid.phase_field,
        shading="gouraud", rasterized=True, **colours,
    )  # fmt: skip


# ---------------------------------------------------------------- panels over snapshots


def shown_displacements(results: CaseResults) -> list[float]:
    """Return the displacements to show: the case's snapshots, else the stored states of its runs."""
    wanted = list(results.case.output.snapshots) if results.case else []
    runs = results.main_runs(LARGEST_ROWS)
    stored = sorted({float(f"{u:.4g}") for run in runs for u in run.stored})
    chosen = [u for u in wanted if any(run.nearest_stored(u) is not None for run in runs)] or stored
    if len(chosen) > LARGEST_SNAPSHOTS:
        chosen = [chosen[i] for i in np.linspace(0, len(chosen) - 1, LARGEST_SNAPSHOTS).round().astype(int)]
    return chosen


def _broke(runs: Sequence[RunResults]) -> bool:
    return any(run.history["c_min"].min() < 0.999 for run in runs)


def _panel_grid(results: CaseResults, rows: int, columns: int) -> tuple[Figure, np.ndarray]:
    lower, upper = extent_of(results)
    aspect = float(np.clip((upper - lower)[1] / (upper - lower)[0], 0.15, 2.5))
    width = min(8.4, 3.1 * columns + 0.9)
    height = rows * (0.88 * (width - 0.9) / columns * aspect + 0.42) + 0.3
    return style.panels(rows, columns, width, height, sharex=True, sharey=True)


def extent_of(results: CaseResults) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the bounding box of all bodies, from the case or else from a grid."""
    if results.case:
        lower, upper = results.case.bounding_box()
        return np.asarray(lower, float), np.asarray(upper, float)
    run = next(run for run in results.main_runs() if run.stored.size)
    reference = run.points(float(run.stored[0])).reference
    return reference.min(axis=0), reference.max(axis=0)


def _snapshot_panels(
    results: CaseResults, draw: Callable[[Axes, RunResults, float], Any], colour_label: str
) -> tuple[Figure, list[RunResults], list[float]] | None:
    """Draw one row for each run and one column for each displacement, with one colour bar."""
    wanted = shown_displacements(results)
    runs = [run for run in results.main_runs(LARGEST_ROWS) if run.stored.size]
    if not wanted or not runs or not _broke(runs):
        return None
    figure, grid = _panel_grid(results, len(runs), len(wanted))
    painted = None
    for row, run in zip(grid, runs, strict=True):
        for axes, u in zip(row, wanted, strict=True):
            painted = _draw_panel(axes, results, run, u, draw) or painted
    _label_outer(grid, results)
    if painted is not None:
        bar = figure.colorbar(painted, ax=grid, shrink=0.85, aspect=30, pad=0.015, label=colour_label)
        bar.outline.set_linewidth(0.5)
    return figure, runs, wanted


def _draw_panel(
    axes: Axes,
    results: CaseResults,
    run: RunResults,
    u: float,
    draw: Callable[[Axes, RunResults, float], Any],
) -> Any:
    stored = run.nearest_stored(u)
    axes.set_aspect("equal")
    fit_axes(axes, *extent_of(results))
    if stored is None:
        said = f"no state stored\nnear u = {number(u)}"
        axes.text(0.5, 0.5, said, transform=axes.transAxes, ha="center", va="center")
        axes.set_title(run.label)
        return None
    painted = draw(axes, run, stored)
    axes.set_aspect("equal")
    fit_axes(axes, *extent_of(results))
    draw_outlines(axes, results.case)
    axes.set_title(f"{run.label}, u = {number(stored)} {results.unit('displacement')}")
    return painted


def _label_outer(grid: np.ndarray, results: CaseResults) -> None:
    for axes in grid[-1]:
        axes.set_xlabel(f"x [{results.unit('length')}]")
    for axes in grid[:, 0]:
        axes.set_ylabel(f"y [{results.unit('length')}]")


def phase_field(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Draw the phase field of the runs at the case's snapshot displacements in one colour scale."""

    def draw(axes: Axes, run: RunResults, u: float) -> Any:
        if not run.method.by_points:
            return paint_mesh(axes, run.grid(u), **style.PHASE_FIELD)
        points = run.points(u)
        return paint_points(axes, results.case, points.reference, points.phase_field, **style.PHASE_FIELD)

    drawn = _snapshot_panels(results, draw, style.PHASE_FIELD_LABEL)
    if drawn is None:
        return None
    figure, runs, _ = drawn
    caption = (
        f"Phase field of {listed(run.label for run in runs)} in reference coordinates, one colour scale: "
        "nodal values of a mesh, or each place as the nearest material point."
    )
    return style.drawing(figure, folder, "phase-field", "Phase field", caption)


def hydrostatic_stress(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Draw the in-plane mean stress (s_xx + s_yy)/2 at the integration points, broken points removed."""
    runs = [run for run in results.main_runs(LARGEST_ROWS) if run.stored.size]
    wanted = shown_displacements(results)
    limit = largest_stress(run.points(u) for run in runs for u in map(run.nearest_stored, wanted) if u)
    if not limit:
        return None

    def draw(axes: Axes, run: RunResults, u: float) -> Any:
        points = run.points(u)
        places = points.reference + points.displacement
        shade_bodies(axes, results.case, style.GREY)  # shows through where points are removed
        colours = {"cmap": style.SIGNED_COLOURS, "clim": (-limit, limit)}
        return paint_points(axes, results.case, places, unbroken_stress(points), **colours)

    drawn = _snapshot_panels(results, draw, f"(σxx + σyy)/2 [{results.unit('stress')}]")
    if drawn is None:
        return None
    caption = (
        f"In-plane mean stress at the integration points (Fig. 4.9 of the thesis); points with "
        f"c < {style.BROKEN_BELOW:g} are removed (grey shows through), displacements "
        f"are not magnified. Colours are cut at the {EXTREME_PERCENTILE:g}th percentile, "
        f"±{number(limit, 3)} {results.unit('stress')}."
    )
    name = "hydrostatic-stress"
    return style.drawing(drawn[0], folder, name, "Hydrostatic stress", caption)


def unbroken_stress(state: PointState | Frame) -> np.ndarray:
    """Return the in-plane mean stress (n,) of the points of a state, NaN at broken ones."""
    return np.where(state.phase_field >= style.BROKEN_BELOW, state.hydrostatic_stress, np.nan)


def largest_stress(states: Iterable[PointState | Frame]) -> float:
    """Return the largest stress of unbroken points over the states, a few extreme points apart; 0 without any."""
    stresses = (np.abs(stress[np.isfinite(stress)]) for stress in map(unbroken_stress, states))
    return max((float(np.percentile(s, EXTREME_PERCENTILE)) for s in stresses if s.size), default=0.0)


# ---------------------------------------------------------------- distorted mesh beside points


def element_quality(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Draw the quality of the moved elements over displacement, where strain is measured on them."""
    run = next((r for r in results.main_runs() if not r.method.by_points and len(r.stored) > 1), None)
    if run is None or results.case is None or results.case.mesh.geometry == "initial":
        return None
    rows = []
    for u in run.stored:
        grid = run.grid(float(u))
        quality = scaled_jacobian(grid.points + grid.displacement, grid.cells)
        rows.append((float(u), quality.min(), np.percentile(quality, 1), np.median(quality)))
    table = pd.DataFrame(rows, columns=["u", "least", "one_percent", "median"])
    figure, axes = style.curve_axes(
        7.2, 3.2, results.load_label, "scaled Jacobian [–]"
    )
    for column, label in (("median", "median"), ("one_percent", "worst 1 %"), ("least", "worst element")):
        axes.plot(table["u"], table[column], marker="o", label=label)
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.legend()
    caption = (
        "Quality of the moved finite elements: 1 for a square, 0 where two sides fall together, negative where an "
        f"element is turned inside out (Fig. 4.22 of the thesis). The last stored state is at u = {number(rows[-1][0])} "
        f"{results.unit('displacement')}."
    )
    return style.drawing(figure, folder, "element-quality", "Element quality", caption, table)


def distortion(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Draw a deformed mesh beside material points: whole body above, the crack close up below."""
    mesh, cloud = [
        next((r for r in results.main_runs() if r.method.by_points is points and r.stored.size), None)
        for points in (False, True)
    ]
    if mesh is None or cloud is None or not _broke([mesh, cloud]):
        return None
    at = _largest_common(results, mesh, cloud)
    grid, points = mesh.grid(at[0]), cloud.points(at[1])
    factor = _magnification(extent_of(results), grid.displacement)
    window = _window(results, grid, factor)
    figure, axes = style.panels(2, 2, 8.2, 7.8)
    for row, part in enumerate((None, window)):
        _draw_deformed_mesh(axes[row, 0], grid, factor, part)
        _draw_moved_points(axes[row, 1], points, factor, part)
    moved = grid.points + factor * grid.displacement
    _frame_distortion(axes, (moved.min(axis=0), moved.max(axis=0)), window)
    _title_distortion(axes, results, (mesh, cloud), at)
    figure.legend(handles=_distortion_key(), loc="outside lower center", ncols=3)
    caption = (
        f"Deformed mesh (left) beside the material points (right), displacements magnified "
        f"{number(factor)} times; the frame above is shown enlarged below. Elements with a corner below "
        f"c = {style.BROKEN_BELOW:g} are coloured, material points below it are removed "
        "(Figs. 4.8 and 4.9 of the thesis)."
    )
    return style.drawing(figure, folder, "distortion", "Distorted mesh and material points", caption)


def _largest_common(results: CaseResults, one: RunResults, other: RunResults) -> tuple[float, float]:
    """Return the stored displacements of both runs at the last displacement that both have."""
    for u in reversed(shown_displacements(results)):
        found = one.nearest_stored(u), other.nearest_stored(u)
        if found[0] is not None and found[1] is not None:
            return found[0], found[1]
    return float(one.stored[-1]), float(other.stored[-1])


def _magnification(extent: tuple[np.ndarray, np.ndarray], displacement: np.ndarray) -> float:
    largest = float(np.abs(displacement).max())
    size = float((extent[1] - extent[0]).max())
    return max(style.nice_number(SHARE_OF_BODY_TO_MOVE * size / largest), 1.0) if largest > 0 else 1.0


def _window(results: CaseResults, grid: GridState, factor: float) -> np.ndarray:
    """Return the corners (2, 2) of a close-up of the deformed crack about twenty elements wide."""
    least = grid.least_phase_field()
    broken = np.flatnonzero(least < style.BROKEN_BELOW)
    cell = grid.cells[broken[len(broken) // 2] if broken.size else int(least.argmin())]
    centre = (grid.points + factor * grid.displacement)[cell].mean(axis=0)
    lower, upper = extent_of(results)
    half = min(10 * float(np.ptp(grid.points[cell], axis=0).max()), float((upper - lower).min()) / 3)
    return np.array([centre - half, centre + half])


def _draw_deformed_mesh(axes: Axes, grid: GridState, factor: float, window: np.ndarray | None = None) -> None:
    """Draw the deformed elements, in the window only where there is one."""
    corners = (grid.points + factor * grid.displacement)[grid.cells]
    broken = grid.least_phase_field() < style.BROKEN_BELOW
    if window is not None:
        near = cells_in(window, corners)
        corners, broken = corners[near], broken[near]
    many = len(corners) > style.RASTER_ABOVE
    look: Any = {"linewidths": 0.15 if many else 0.5, "rasterized": many}
    for shown, (face, edge) in ((corners[~broken], ELEMENT), (corners[broken], BROKEN_ELEMENT)):
        axes.add_collection(PolyCollection(shown, facecolors=face, edgecolors=edge, **look))


def _draw_moved_points(
    axes: Axes, points: PointState, factor: float, window: np.ndarray | None = None
) -> None:
    """Draw the unbroken points at their magnified places, in the window only where there is one."""
    places = (points.reference + factor * points.displacement)[points.phase_field >= style.BROKEN_BELOW]
    if window is not None:
        places = places[np.all((places >= window[0]) & (places <= window[1]), axis=1)]
    many = len(places) > style.RASTER_ABOVE
    axes.plot(
        places[:, 0], places[:, 1], linestyle="none", marker="o", markersize=0.8 if many else 2.4,
        markeredgewidth=0, color=style.OKABE_ITO[0], rasterized=many,
    )  # fmt: skip


def _frame_distortion(axes: np.ndarray, moved: tuple[np.ndarray, np.ndarray], window: np.ndarray) -> None:
    for whole, close_up in axes.T:
        whole.set_aspect("equal")
        fit_axes(whole, *moved)
        frame: Any = {"fill": False, "edgecolor": "black", "linewidth": 0.9}
        whole.add_patch(Rectangle(tuple(window[0]), *(window[1] - window[0]), **frame))
        close_up.set(xlim=window[:, 0], ylim=window[:, 1], aspect="equal")


def _title_distortion(
    axes: np.ndarray, results: CaseResults, pair: tuple[RunResults, RunResults], at: tuple[float, float]
) -> None:
    unit = results.unit("displacement")
    for panel, run, u in zip(axes[0], pair, at, strict=True):
        panel.set_title(f"{run.method.shown}, u = {number(u)} {unit}")
    _label_outer(axes, results)


def _distortion_key() -> list[Any]:
    broken = f"element with c < {style.BROKEN_BELOW:g}"
    return [
        Rectangle((0, 0), 1, 1, facecolor=ELEMENT[0], edgecolor=ELEMENT[1], label="element"),
        Rectangle((0, 0), 1, 1, facecolor=BROKEN_ELEMENT[0], edgecolor=BROKEN_ELEMENT[1], label=broken),
        Line2D([], [], linestyle="none", marker="o", markersize=3, color=style.OKABE_ITO[0], label="material point"),
    ]


# ---------------------------------------------------------------- crack paths


def crack_paths(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Overlay the crack paths of all runs on the body, whole and close up; None when nothing broke."""
    runs = [run for run in results.shown_runs() if len(run.crack_path) > 1]
    if not runs:
        return None
    figure, (axes,) = style.panels(1, 2, 8.4, 4.3)
    colours = style.colours_of([run.name for run in results.shown_runs()])
    for panel in axes:
        draw_outlines(panel, results.case)
        for run in runs:
            look = {"color": colours[run.name], "linewidth": 1.6, "label": run.label}
            panel.plot(*run.crack_path.T, linestyle=run.method.line, **look)
        panel.set_aspect("equal")
    lower, upper = extent_of(results)
    fit_axes(axes[0], lower, upper)
    window = _path_window(np.vstack([run.crack_path for run in runs]))
    axes[1].set(xlim=window[:, 0], ylim=window[:, 1], aspect="auto", title="crack paths, axes stretched")
    axes[0].set_title("whole body")
    _label_outer(axes[None, :], results)
    axes[1].set_ylabel(f"y [{results.unit('length')}]")
    style.legend_below(figure, [axes[0]])
    table = pd.concat([pd.DataFrame(run.crack_path, columns=["x", "y"]).assign(run=run.name) for run in runs])
    caption = f"Crack paths of {listed(run.label for run in runs)} in reference coordinates. "
    return style.drawing(figure, folder, "crack-paths", "Crack paths", caption + distances_in_words(results), table)


def _path_window(paths: np.ndarray) -> np.ndarray:
    """Return the corners (2, 2) around the paths; thin paths are given a twentieth of their length."""
    lower, upper = paths.min(axis=0), paths.max(axis=0)
    length = float((upper - lower).max())
    half = np.maximum((upper - lower) * 0.55, 0.025 * length)
    centre = (lower + upper) / 2
    return np.array([centre - half, centre + half])


def distances_in_words(results: CaseResults) -> str:
    """Return the distances between crack paths of the summary as a sentence."""
    unit, said = results.unit("length"), []
    stored = results.entry.get("crack_paths") or []
    for paths in stored if isinstance(stored, list) else [stored]:
        if paths.get("hausdorff") is not None:
            said.append(
                f"{paths['pair']}: Hausdorff distance {number(paths['hausdorff'], 3)} {unit}, "
                f"mean distance {number(paths.get('mean'), 3)} {unit}"
            )
    return "; ".join(said) + "." if said else ""
