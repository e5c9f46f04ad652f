"""Graded grid lines: fine where the crack can go, growing outside."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cases.case import Case
from cases.geometry import SAME_LINE
from cases.notches import CellsNotch, HistoryNotch, Notch

Array = NDArray[np.float64]

# Spacings may exceed what was asked for by this share, so that rounding adds no cell.
STRETCH = 1e-3


def grid_lines(case: Case) -> tuple[Array, Array]:
    """Coordinates of the lines of a tensor-product grid over the bounding box of all bodies.

    The spacing is h inside the fine box (everywhere without one) and that of each box of `mesh.refine` inside it.
    Outside, neighbouring spacings grow by `mesh.growth` up to `mesh.coarse`. The bounding box, the fine box, the
    straight axis-parallel edges of the bodies, boundary points, boundary boxes that are at least h wide, the ends of
    segments along an axis that are held and as long, tips of notches, slits along an axis and the outlines of
    cells-notches along an axis are lines; between two of them the spacings shrink a little to fit, and never exceed
    1.001 h in the fine box.

    Returns
    -------
    x_lines, y_lines : ascending coordinates [length]
    """
    return _lines_along(case, 0), _lines_along(case, 1)


def cell_sizes(case: Case, points: Array) -> Array:
    """Extents (n, 2) of the grid's cell around each of the points (n, 2) [length]."""
    sizes = []
    for lines, x in zip(grid_lines(case), points.T, strict=True):
        cell = np.clip(np.searchsorted(lines, x, side="right") - 1, 0, len(lines) - 2)
        sizes.append(np.diff(lines)[cell])
    return np.stack(sizes, axis=1)


def count_cells(case: Case) -> int:
    """Cells of the grid of `grid_lines`, in bodies and beside them, without making any."""
    return math.prod(sum(_cells_between(*_fixed_lines(case, axis))) for axis in (0, 1))


def grid_blocks(case: Case, most: int) -> Blocks:
    """The grid of `grid_lines` as no more than `most` blocks along each axis, however many cells it has."""
    widths, middles, cells = zip(*(_blocks_along(case, axis, most) for axis in (0, 1)), strict=True)
    centres = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 2)
    return Blocks(centres, np.outer(*widths).ravel(), np.full(len(centres), math.prod(cells)))


@dataclass(frozen=True)
class Blocks:
    """Rectangles of the grid: centres (n, 2) [length], areas (n,) [length²] and the cells in each of them (n,)."""

    centres: Array
    areas: Array
    cells: Array


def _blocks_along(case: Case, axis: int, most: int) -> tuple[Array, Array, float]:
    """Widths and middles (n,) of blocks of equally many cells, and this number of cells."""
    spacing, fixed = _fixed_lines(case, axis)
    cells = sum(_cells_between(spacing, fixed))
    number = min(cells, most)
    lines = np.array([spacing.place(n) for n in np.linspace(0.0, spacing.passed[-1], number + 1)])
    return np.diff(lines), 0.5 * (lines[1:] + lines[:-1]), cells / number


def _cells_between(spacing: _Spacing, fixed: list[float]) -> list[int]:
    """Cells between each two of the lines that must be."""
    return [spacing.cells_between(a, b) for a, b in pairwise(fixed)]


def _lines_along(case: Case, axis: int) -> Array:
    spacing, fixed = _fixed_lines(case, axis)
    pieces = [spacing.subdivided(a, b) for a, b in pairwise(fixed)]
    return np.array([*(x for piece in pieces for x in piece[:-1]), fixed[-1]])


def _fixed_lines(case: Case, axis: int) -> tuple[_Spacing, list[float]]:
    """The spacing along an axis, and the lines that it must have."""
    lower, upper = (float(corner[axis]) for corner in case.bounding_box())
    fine = _fine_interval(case, axis, lower, upper)
    wanted = [lower, upper, *_feature_lines(case, axis), *fine]
    fixed = _merge_near(wanted, case.mesh.h * SAME_LINE, lower, upper)
    return _Spacing.along(case, axis, fine, lower, upper), fixed


def _fine_interval(case: Case, axis: int, lower: float, upper: float) -> tuple[float, float]:
    if case.mesh.fine is None:
        return lower, upper
    return max(lower, case.mesh.fine.lower[axis]), min(upper, case.mesh.fine.upper[axis])


def _feature_lines(case: Case, axis: int) -> list[float]:
    """Coordinates that must be lines because a notch, a body's edge, a held point or a held box ends there."""
    lines = [line for notch in case.all_notches for line in _notch_lines(notch, axis)]
    held = {constraint.on for constraint in case.constraints}
    for name, boundary in case.boundaries.items():
        lines += [boundary.point[axis]] if boundary.point else []
        ends = (boundary.box.lower, boundary.box.upper) if boundary.box else boundary.segment if name in held else None
        level = boundary.box or (ends and ends[0][1 - axis] == ends[1][1 - axis])
        if ends and level and abs(ends[1][axis] - ends[0][axis]) >= case.mesh.h * (1 - STRETCH):
            lines += [ends[0][axis], ends[1][axis]]
    for body in case.bodies.values():
        if body.shape:
            lines += body.shape.straight_lines()[axis]
    return lines


def _notch_lines(notch: Notch, axis: int) -> list[float]:
    if isinstance(notch, HistoryNotch):
        return []
    if isinstance(notch, CellsNotch) and notch.level_axis == axis:
        return [notch.start[axis] - notch.width / 2, notch.start[axis] + notch.width / 2]
    return [notch.start[axis], notch.end[axis]]


def _merge_near(lines: list[float], tolerance: float, lower: float, upper: float) -> list[float]:
    """Sorted lines within [lower, upper]; of lines within the tolerance of each other the first one stays."""
    kept: list[float] = []
    for line in lines:
        if lower <= line <= upper and all(abs(line - other) > tolerance for other in kept):
            kept.append(line)
    return sorted(kept)


def _cells(number: float) -> int:
    return max(1, math.ceil(number / (1 + STRETCH)))


@dataclass(frozen=True)
class _Spacing:
    """Wanted spacing along an axis, linear between knots (n,), and the cells passed up to each of them.

    From a box the spacing grows as h + d ln(growth) with the distance d, so that successive cells, over each of which
    the integral of 1 / spacing is one, have sizes in the ratio `growth`; the smallest spacing that a box wants counts.
    """

    knots: Array
    sizes: Array
    passed: Array

    @classmethod
    def along(cls, case: Case, axis: int, fine: tuple[float, float], lower: float, upper: float) -> _Spacing:
        """The spacing between the bounds of the bodies, from the fine box and the refined ones."""
        mesh, rate = case.mesh, math.log(case.mesh.growth)
        boxes = [(*fine, mesh.h), *((box.lower[axis], box.upper[axis], box.h) for box in mesh.refine)]
        starts, ends, sizes = (np.array(column) for column in zip(*boxes, strict=True))
        coarse = mesh.coarse or max(upper - lower, mesh.h)

        def wanted(x: Array) -> Array:
            """The spacing at places (n,)."""
            away = np.maximum(0.0, np.maximum(starts - x[:, None], x[:, None] - ends))
            return np.minimum(coarse, (sizes + rate * away).min(axis=1))

        # where one box takes over from another, or from the coarse spacing
        steps = np.array([(size - sizes) / rate for size in (*sizes, coarse)])
        between = (ends[:, None] + starts + (sizes - sizes[:, None]) / rate) / 2
        places = np.concatenate([x.ravel() for x in (starts, ends, starts - steps, ends + steps, between)])
        knots = np.unique([lower, upper, *places[(places > lower) & (places < upper)]])
        at_knots = wanted(knots)
        return cls(knots, at_knots, np.cumsum([0.0, *_passed(np.diff(knots), at_knots[:-1], at_knots[1:])]))

    def subdivided(self, a: float, b: float) -> Array:
        """Lines from a to b, both included: equal steps of the number of cells passed."""
        inside = (self.knots > a) & (self.knots < b)
        sizes = np.interp([a, *self.knots[inside], b], self.knots, self.sizes)
        number = self.cells_between(a, b)
        if np.ptp(sizes) <= SAME_LINE * sizes.min():
            return np.linspace(a, b, number + 1)
        places = np.linspace(self._cells_up_to(a), self._cells_up_to(b), number + 1)[1:-1]
        return np.array([a, *(self.place(n) for n in places), b])

    def cells_between(self, a: float, b: float) -> int:
        """Equal steps of the number of cells passed from a to b, no larger than they may be."""
        return _cells(self._cells_up_to(b) - self._cells_up_to(a))

    def _cells_up_to(self, x: float) -> float:
        k = self._piece(self.knots, x)
        size = float(np.interp(x, self.knots, self.sizes))
        return float(self.passed[k] + _passed(x - self.knots[k], self.sizes[k], size))

    def place(self, cells: float) -> float:
        """Where so many cells have been passed."""
        k = self._piece(self.passed, cells)
        step, size = cells - self.passed[k], self.sizes[k]
        rate = (self.sizes[k + 1] - size) / (self.knots[k + 1] - self.knots[k])
        return float(self.knots[k] + size * (math.expm1(rate * step) / rate if rate else step))

    @staticmethod
    def _piece(bounds: Array, value: float) -> int:
        return min(max(int(np.searchsorted(bounds, value, side="right")) - 1, 0), len(bounds) - 2)


def _passed(distance: ArrayLike, first: ArrayLike, last: ArrayLike) -> Array:
    """Cells over a distance along which the spacing goes linearly from first to last."""
    ratio = np.subtract(last, first) / np.asarray(first)
    # log(1 + r) / r, whose quotient is lost where r is small
    share = np.where(np.abs(ratio) > 1e-8, np.log1p(ratio) / np.where(ratio == 0.0, 1.0, ratio), 1.0 - ratio / 2)
    return np.asarray(distance) / np.asarray(first) * share
