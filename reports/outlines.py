"""Outlines of a case's bodies and notches, drawn in every figure of a field."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from cases.mesh_files import mesh_outline

from . import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cases import Case

NOTCH_LINES: dict[str, dict[str, Any]] = {
    "slit": {"color": style.INK, "linewidth": 1.4},
    "cells": {"color": style.INK, "linewidth": 0.8},
    "history": {"color": style.OKABE_ITO[1], "linewidth": 1.6, "linestyle": (0, (2, 1.5))},
}


def fit_axes(axes: Axes, lower: np.ndarray, upper: np.ndarray) -> None:
    """Show the box with a narrow margin."""
    margin = 0.03 * float((upper - lower).max())
    axes.set(xlim=(lower[0] - margin, upper[0] + margin), ylim=(lower[1] - margin, upper[1] + margin))


def cells_in(window: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the mask (k,) of the cells, corners (k, 3 or 4, 2), that reach into a window (2, 2)."""
    return np.all((corners.max(axis=1) >= window[0]) & (corners.min(axis=1) <= window[1]), axis=1)


def body_polygons(body: Any) -> list[shapely.Polygon]:
    """Return the polygons that a body covers, holes included as interior rings."""
    outline = body.shape.outline() if body.shape else mesh_outline(body.mesh)
    return [part for part in getattr(outline, "geoms", [outline]) if isinstance(part, shapely.Polygon)]


def polygon_patch(polygon: shapely.Polygon, **look: Any) -> PathPatch:
    """Return a polygon with its holes as one patch."""
    rings = [np.asarray(ring.coords) for ring in (polygon.exterior, *polygon.interiors)]
    codes = [[Outline.MOVETO] + [Outline.LINETO] * (len(r) - 2) + [Outline.CLOSEPOLY] for r in rings]
    return PathPatch(Outline(np.vstack(rings), np.concatenate(codes)), **look)


def notch_corners(notch: Any) -> np.ndarray:
    """Return the line of a notch (2, 2), or the corners (5, 2) of the strip of cells that it leaves out."""
    start, end = np.asarray(notch.start, float), np.asarray(notch.end, float)
    if notch.kind != "cells":
        return np.array([start, end])
    along = (end - start) / np.hypot(*(end - start))
    across = np.array([-along[1], along[0]]) * notch.width / 2
    return np.array([start - across, end - across, end + across, start + across, start - across])


def draw_notches(axes: Axes, case: Case, widen: float = 1.0) -> None:
    """Draw the notches, lines ``widen`` times as wide as in a small picture."""
    for notch in case.all_notches:
        corners = notch_corners(notch)
        look = {**NOTCH_LINES[notch.kind], "linewidth": NOTCH_LINES[notch.kind]["linewidth"] * widen}
        if notch.kind == "cells":
            axes.fill(*corners.T, facecolor="white", zorder=2.8)
        axes.plot(*corners.T, zorder=2.9, solid_capstyle="butt", **look)


def draw_outlines(axes: Axes, case: Case | None, notches: bool = True) -> None:
    """Draw the edges of all bodies, and the notches, as thin lines; nothing without a case."""
    if case is None:
        return
    for body in case.bodies.values():
        for polygon in body_polygons(body):
            axes.add_patch(polygon_patch(polygon, fill=False, edgecolor=style.INK, linewidth=0.7, zorder=2.9))
    if notches:
        draw_notches(axes, case)


def shade_bodies(axes: Axes, case: Case | None, colour: str) -> None:
    """Fill the bodies below everything else; nothing without a case."""
    for body in case.bodies.values() if case else ():
        for polygon in body_polygons(body):
            axes.add_patch(polygon_patch(polygon, facecolor=colour, edgecolor="none", zorder=-2))
