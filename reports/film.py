"""Pictures of moving bodies, where the material is at the time: a film, and a figure that stands still."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from . import style
from .arch import hinges_with_places
from .fields import largest_stress, unbroken_stress
from .words import listed, number

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.image import AxesImage

    from verify.runs.frames import Frame

    from .results import CaseResults, RunResults

PIXELS = 420  # along the longer side of a picture
FILM_DPI = 110
PRINTED = 4  # frames in the figure that stands still
LARGEST_ROWS = 2
#: a pixel farther from every point than this many of their spacings lies outside the bodies
REACH = 1.6


class _View:
    """What part of the plane is shown, and the pixels in it."""

    def __init__(self, frames: list[Frame]) -> None:
        places = [frame.reference + frame.displacement for frame in frames]
        lower = np.array([p.min(axis=0) for p in places]).min(axis=0, keepdims=True)[0]
        upper = np.array([p.max(axis=0) for p in places]).max(axis=0, keepdims=True)[0]
        margin = 0.02 * (upper - lower).max()
        self.lower: np.ndarray = np.asarray(lower - margin)
        self.upper: np.ndarray = np.asarray(upper + margin)
        extent: np.ndarray = np.asarray(self.upper - self.lower)
        self.shape: np.ndarray = np.asarray(np.maximum(np.round(PIXELS * extent / extent.max()).astype(int), 1))
        self.aspect = float(extent[1] / extent[0])

    def nearest(self, places: np.ndarray) -> np.ndarray:
        """Number of the point nearest to each pixel (rows, columns), -1 where there is none near."""
        from scipy.spatial import cKDTree

        from numerics.nearest_points import nearest_to_pixels

        tree = cKDTree(places, compact_nodes=False, balanced_tree=False)
        to_neighbours, _ = tree.query(places[:: max(1, len(places) // 500)], k=[2])
        extent = self.upper - self.lower
        reach = max(REACH * float(np.median(to_neighbours)), float(extent.max()) / PIXELS)
        return nearest_to_pixels(places.astype(float), self.lower, extent / self.shape, tuple(self.shape), reach)

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Extent as matplotlib wants it."""
        return self.lower[0], self.upper[0], self.lower[1], self.upper[1]


def _frames_of(results: CaseResults) -> list[tuple[RunResults, list[Frame]]]:
    """Runs with frames, and their frames."""
    return [(run, run.frames) for run in results.main_runs(LARGEST_ROWS) if run.frames]


def _paint(nearest: np.ndarray, values: np.ndarray) -> np.ma.MaskedArray:
    """Image (rows, columns): the value of the nearest point, masked where there is none near or it is NaN."""
    return np.ma.masked_invalid(np.where(nearest >= 0, values[nearest], np.nan))


def _broke(all_frames: list[Frame]) -> bool:
    return any(frame.phase_field.min() < 0.999 for frame in all_frames)


# ---------------------------------------------------------------- the film


def film(results: CaseResults, folder: Path) -> style.Film | None:
    """Draw one picture per frame: a row for each run, phase field and mean stress beside each other."""
    shown = _frames_of(results)
    if not shown:
        return None
    count = min(len(frames) for _, frames in shown)
    every = [frame for _, frames in shown for frame in frames[:count]]
    view, limit, broke = _View(every), largest_stress(every) or 1.0, _broke(every)
    figure, images, title = _film_figure(results, [run for run, _ in shown], view, limit, broke)
    marks = [row[0].axes.plot([], [], "o", ms=6, mfc="white", mec=style.INK, mew=1.2)[0] for row in images]
    hinges = [hinges_with_places(results, run) for run, _ in shown]
    files, times = [], []
    moving = [artist for row, mark in zip(images, marks, strict=True) for artist in (*row, mark)]
    edges = [spine for row in images for image in row for spine in image.axes.spines.values()]
    pictures = style.Pictures(figure, [*moving, *edges, title], FILM_DPI)
    for step in range(count):
        for row, mark, of_run, (_, frames) in zip(images, marks, hinges, shown, strict=True):
            mark.set_data(*moved(frames[step], [place for hinge, place in of_run if hinge.time <= frames[step].time]).T)
            for image, picture in zip(row, _pictures(view, frames[step], broke), strict=True):
                image.set_data(picture)
        times.append(float(shown[0][1][step].time))
        title.set_text(f"t = {number(times[-1])} {results.unit('time')}")
        files.append(pictures.save(folder, f"film-{step:03d}"))
    caption = (
        f"{listed(run.label for run, _ in shown)} at {count} times, where the material is at the time. Mean stress: "
        f"(σxx + σyy)/2, colours cut at ±{number(limit, 3)} {results.unit('stress')}; points with "
        f"c < {style.BROKEN_BELOW:g} are removed from it."
    )
    if any(hinges):
        caption += " Circles: hinges of the vault that have opened."
    return style.Film("film", "Motion", caption, files, times, results.unit("time"))


def moved(frame: Frame, places: list[np.ndarray]) -> np.ndarray:
    """Where places of the start (n, 2) are in a frame, carried by the nearest point."""
    nearest = [int(np.linalg.norm(frame.reference - place, axis=1).argmin()) for place in places]
    return np.reshape(places, (-1, 2)) + frame.displacement[nearest]


def _pictures(view: _View, frame: Frame, broke: bool) -> list[np.ma.MaskedArray]:
    nearest = view.nearest(frame.reference + frame.displacement)
    values = [frame.phase_field, unbroken_stress(frame)] if broke else [unbroken_stress(frame)]
    return [_paint(nearest, each) for each in values]


def _film_figure(
    results: CaseResults, runs: list[RunResults], view: _View, limit: float, broke: bool
) -> tuple[Figure, list[list[AxesImage]], Any]:
    kinds: list[tuple[str, dict[str, Any]]] = [
        (f"(σxx + σyy)/2 [{results.unit('stress')}]", {"cmap": style.SIGNED_COLOURS, "clim": (-limit, limit)})
    ]
    if broke:
        kinds.insert(0, ("phase field c", style.PHASE_FIELD))
    width = 8.6
    height = float(np.clip(len(runs) * (0.92 * width / len(kinds) * view.aspect + 0.3) + 1.1, 2.5, 11.0))
    figure, grid = style.panels(len(runs), len(kinds), width, height, sharex=True, sharey=True)
    empty = np.zeros((view.shape[1], view.shape[0]))
    images = [
        [
            axes.imshow(empty, extent=view.box, **style.IMAGE, **colours)
            for axes, (_, colours) in zip(row, kinds, strict=True)
        ]
        for row in grid
    ]
    for row, run in zip(grid, runs, strict=True):
        row[0].set_ylabel(f"{run.label}\ny [{results.unit('length')}]")
    for axes, image, (label, _) in zip(grid[-1], images[-1], kinds, strict=True):
        axes.set_xlabel(f"x [{results.unit('length')}]")
        figure.colorbar(image, ax=axes, location="bottom", shrink=0.8, aspect=40, label=label)
    return figure, images, figure.suptitle(" ", fontsize=10)


# ---------------------------------------------------------------- the figure that stands still


def phase_field(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Draw the phase field of the runs at a few times, where the material is at the time."""
    shown = _frames_of(results)
    every = [frame for _, frames in shown for frame in frames]
    if not shown or not _broke(every):
        return None
    view = _View(every)
    chosen = np.unique(np.linspace(0, min(len(f) for _, f in shown) - 1, PRINTED + 1).round().astype(int)[1:])
    width = 8.4
    height = len(shown) * (0.9 * width / len(chosen) * min(view.aspect, 2.5) + 0.4) + 0.3
    figure, grid = style.panels(len(shown), len(chosen), width, height, sharex=True, sharey=True)
    for row, (run, frames) in zip(grid, shown, strict=True):
        for axes, step in zip(row, chosen, strict=True):
            painted = axes.imshow(
                _pictures(view, frames[step], True)[0], extent=view.box, **style.IMAGE, **style.PHASE_FIELD
            )
            axes.set_title(f"{run.label}, t = {number(frames[step].time, 3)} {results.unit('time')}", fontsize=8)
        row[0].set_ylabel(f"y [{results.unit('length')}]")
    for axes in grid[-1]:
        axes.set_xlabel(f"x [{results.unit('length')}]")
    figure.colorbar(painted, ax=grid, shrink=0.85, aspect=30, pad=0.015, label=style.PHASE_FIELD_LABEL)
    caption = "Phase field where the material is at the time; displacements are not magnified."
    return style.drawing(figure, folder, "phase-field", "Phase field", caption)
