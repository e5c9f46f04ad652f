"""Material points as quadrature points: how much of its cell each of them integrates, and where in it.

Moving points leave some cells too full and some too empty, and stand in them off the places of a good quadrature. What
the body covers of a cell is known better from the rectangles that the points stand for, because they tile the body.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mpm.grid import Grid, Sides
from mpm.quasi_static.active_grid import ActiveGrid

#: points of a cell closer together than this share of the covered part's variance are not spread apart
CLOSEST = 1e-3


class Rectangles(NamedTuple):
    """What material points cover: ``lower`` and ``upper`` corners (n_points, 2) and ``area`` (n_points,)."""

    lower: NDArray
    upper: NDArray
    area: NDArray


def integrate_cells(
    grid: Grid, active: ActiveGrid, positions: NDArray, rectangles: Rectangles, sides: Sides
) -> tuple[NDArray, NDArray]:
    """Factors (n_points,) on the points' areas, and places (n_points, 2), that integrate each cell as it is covered.

    The factors give each cell the area covered. The places, moved and spread in the points' own cells, give the first
    and second moments of that area in x and in y; four points on Gauss points of a full cell stay where they are.
    Parts of rectangles in cells without points, or across a slit, count for the point's own cell, and so do whole
    rectangles in cells that an inclined slit cuts.
    """
    counts, cell = active.counts, active.cells.cell
    moments = np.zeros((len(counts), 5))
    lines = grid.axes[0].breakpoints, grid.axes[1].breakpoints
    own = (active.places.x[cell], active.places.y[cell])
    closed = _closed_sides(grid, own, sides.of_lines)
    _add_moments(own, rectangles, lines, closed, (active.number, grid.cut_by, sides.above), counts, moments)
    held = np.bincount(cell, weights=rectangles.area, minlength=len(counts))[cell]
    covered = moments[cell, 0]
    places = np.empty_like(positions)
    for d in (0, 1):
        start, width = lines[d][own[d]], np.diff(lines[d])[own[d]]
        mean = moments[cell, 1 + 2 * d] / covered
        variance = moments[cell, 2 + 2 * d] / covered - mean**2
        local = _fit(cell, (positions[:, d] - start) / width, rectangles.area / held, mean, variance)
        places[:, d] = start + width * local
    return covered / held, places


def _fit(cell: NDArray, local: NDArray, share: NDArray, mean: NDArray, variance: NDArray) -> NDArray:
    """Places (n_points,) in their cells, moved so that each cell has a mean, and spread as far as they stay in it to
    have a variance.
    """
    away = local - np.bincount(cell, weights=share * local)[cell]
    spread = np.bincount(cell, weights=share * away**2)[cell]
    apart = spread > CLOSEST * variance
    factor = np.sqrt(np.divide(variance, spread, out=np.zeros_like(spread), where=apart))
    to_edge = np.where(away > 0.0, 1.0 - mean, mean)
    room = np.divide(to_edge, np.abs(away), out=np.full_like(away, np.inf), where=away != 0.0)
    least = np.full(cell.max() + 1, np.inf)
    np.minimum.at(least, cell, room)
    return np.clip(mean + np.minimum(factor, np.maximum(least[cell], 0.0)) * away, 0.0, 1.0)


def _closed_sides(grid: Grid, own: tuple[NDArray, NDArray], sides: list[NDArray]) -> NDArray:
    """Which neighbours (n_points, 4) - left, right, below, above - lie across a slit."""
    closed = np.zeros((len(own[0]), 4), bool)
    for slit, side in zip(grid.slits, sides, strict=True):
        line = grid.line_of(slit)
        closed[:, 2 * slit.normal + 1] |= (side < 0) & (own[slit.normal] == line - 1)
        closed[:, 2 * slit.normal] |= (side > 0) & (own[slit.normal] == line)
    closed[grid.cut_by[own] >= 0] = True
    return closed


@njit(cache=True)
def _add_moments(own, rectangles, lines, closed, copies, counts, moments):
    """Add the parts of each rectangle to the cells that they lie in: area, then first and second moments in x and y.

    Moments are in units of the cell that takes the part. ``own`` and ``lines`` are in x and in y.
    """
    (cells_x, cells_y), (lines_x, lines_y), (number, _, _) = own, lines, copies
    lower, upper, _ = rectangles
    for p in range(len(cells_x)):
        i, j = cells_x[p], cells_y[p]
        edges_x = _cuts(lower[p, 0], upper[p, 0], lines_x[i], lines_x[i + 1], closed[p, 0], closed[p, 1])
        edges_y = _cuts(lower[p, 1], upper[p, 1], lines_y[j], lines_y[j + 1], closed[p, 2], closed[p, 3])
        for a in range(3):
            for b in range(3):
                area = (edges_x[a + 1] - edges_x[a]) * (edges_y[b + 1] - edges_y[b])
                if area == 0.0:
                    continue
                ia, jb = i + a - 1, j + b - 1
                inside = 0 <= ia < number.shape[1] and 0 <= jb < number.shape[2]
                if not inside or _seen_from(p, ia, jb, copies) < 0 or counts[_seen_from(p, ia, jb, copies)] == 0:
                    ia, jb = i, j
                cell = _seen_from(p, ia, jb, copies)
                x, xx = _moments(edges_x[a], edges_x[a + 1], lines_x[ia], lines_x[ia + 1])
                y, yy = _moments(edges_y[b], edges_y[b + 1], lines_y[jb], lines_y[jb + 1])
                moments[cell, 0] += area
                moments[cell, 1] += area * x
                moments[cell, 2] += area * xx
                moments[cell, 3] += area * y
                moments[cell, 4] += area * yy


@njit(cache=True)
def _seen_from(p, i, j, copies):
    """Number of the copy of a cell of the grid that a point sees."""
    number, cut_by, above = copies
    slit = cut_by[i, j]
    return number[1 if slit >= 0 and above[slit, p] else 0, i, j]


@njit(cache=True)
def _cuts(lower, upper, start, end, closed_before, closed_behind):
    """An interval's ends with the places between where a cell from ``start`` to ``end`` cuts it."""
    first = lower if closed_before else min(max(start, lower), upper)
    second = upper if closed_behind else max(min(end, upper), first)
    return lower, first, second, upper


@njit(cache=True)
def _moments(lower, upper, start, end):
    """Mean of t and of t^2 over an interval, t running from 0 to 1 along a cell."""
    t0, t1 = (lower - start) / (end - start), (upper - start) / (end - start)
    return 0.5 * (t0 + t1), (t0 * t0 + t0 * t1 + t1 * t1) / 3.0
