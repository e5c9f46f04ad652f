"""Gaps in bodies and between them that functions of the grid reach across: what is drawn apart hangs together there."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import find_objects, label
from shapely.geometry.base import BaseGeometry

from cases import Case
from cases.geometry import slack_of
from mpm.grid import Grid

#: a part of the material counts where it fills more than this share of a function's support
_SEEN = 1e-3
#: functions beside each other, corner to corner too
_BESIDE = np.ones((3, 3), bool)

Ends = tuple[NDArray, NDArray]


def gap_health(case: Case, grid: Grid) -> dict[str, float]:
    """The indicator `bridged_gap` of the health record, for bodies that share a grid; those that touch are one."""
    slack = slack_of(case.bounding_box())
    material = shapely.union_all([outline.buffer(slack) for outline in case.outlines()])
    supports = grid.axes[0].support(), grid.axes[1].support()
    return {"bridged_gap": _bridged_length(material, *supports, grid.order + 1)}


def gap_health_in_bodies(case: Case) -> dict[str, float]:
    """The same for bodies that move, each on functions of its own, of which two cells about a node do nearly all."""
    h, lengths = case.mesh.h, [0.0]
    for outline in case.outlines():
        x_0, y_0, x_1, y_1 = outline.bounds
        left, low = (np.arange(start - 2.0 * h, end + h, h) for start, end in ((x_0, x_1), (y_0, y_1)))
        lengths.append(_bridged_length(outline, (left, left + 2.0 * h), (low, low + 2.0 * h), 2))
    return {"bridged_gap": max(lengths)}


def _bridged_length(material: BaseGeometry, x: Ends, y: Ends, cells: int) -> float:
    """Longest way along a gap on which functions see material on both of its sides, in cells.

    x, y : ends (n,) of the functions' supports. cells : across a support.
    """
    lower, upper = (np.stack(np.meshgrid(*end, indexing="ij"), -1) for end in zip(x, y, strict=True))
    supports = shapely.box(*np.moveaxis(lower, -1, 0), *np.moveaxis(upper, -1, 0))
    shapely.prepare(material)
    on_edge = shapely.intersects(material, supports) & ~shapely.covers(material, supports)
    bridging = np.zeros(on_edge.shape, bool)
    least = _SEEN * shapely.area(supports[on_edge])
    bridging[on_edge] = [
        np.count_nonzero(shapely.area(shapely.get_parts(seen)) > enough) > 1
        for seen, enough in zip(shapely.intersection(material, supports[on_edge]), least, strict=True)
    ]
    numbers, _ = label(bridging, _BESIDE)
    longest, middles, widths = 0.0, 0.5 * (lower + upper), (upper - lower) / cells
    for number, window in enumerate(find_objects(numbers), 1):
        gap = numbers[window] == number
        longest = max(longest, float((np.ptp(middles[window][gap], axis=0) / widths[window][gap].mean(axis=0)).max()))
    return longest
