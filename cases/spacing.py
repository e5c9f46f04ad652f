"""Graded grid lines: fine where the crack can go, growing outside."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cases.notches import CellsNotch, HistoryNotch, Notch
from cases.schema import Case

Array = NDArray[np.float64]

# Spacings may exceed what was asked for by this share, so that rounding adds no cell.
STRETCH = 1e-3
# Lines nearer to each other than this share of h are one line.
SAME_LINE = 1e-3


def grid_lines(case: Case) -> tuple[Array, Array]:
    """Coordinates of the lines of a tensor-product grid over the bounding box of all bodies.

    The spacing is h inside the fine box (everywhere without one). Outside, neighbouring spacings grow by
    `mesh.growth` up to `mesh.coarse`. The bounding box, the fine box, the straight axis-parallel edges of the
    bodies, boundary points, boundary boxes that are at least h wide, tips of notches, slits along an axis and the
    outlines of cells-notches along an axis are lines; between two of them the spacings shrink a little to fit, and
    never exceed 1.001 h in the fine box.

    Returns
    -------
    x_lines, y_lines : ascending coordinates [length]
    """
    return _lines_along(case, 0), _lines_along(case, 1)


def _lines_along(case: Case, axis: int) -> Array:
    lower, upper = (float(corner[axis]) for corner in case.bounding_box())
    fine = _fine_interval(case, axis, lower, upper)
    wanted = [lower, upper, *_feature_lines(case, axis), *fine]
    fixed = _merge_near(wanted, case.mesh.h * SAME_LINE, lower, upper)
    pieces = [_subdivide(case, a, b, fine) for a, b in pairwise(fixed)]
    return np.array([*(x for piece in pieces for x in piece[:-1]), fixed[-1]])


def _fine_interval(case: Case, axis: int, lower: float, upper: float) -> tuple[float, float]:
    if case.mesh.fine is None:
        return lower, upper
    return max(lower, case.mesh.fine.lower[axis]), min(upper, case.mesh.fine.upper[axis])


def _feature_lines(case: Case, axis: int) -> list[float]:
    """Coordinates that must be lines because a notch, a body's edge, a held point or a held box ends there."""
    lines = [line for notch in case.notches for line in _notch_lines(notch, axis)]
    for boundary in case.boundaries.values():
        lines += [boundary.point[axis]] if boundary.point else []
        if boundary.box and boundary.box.upper[axis] - boundary.box.lower[axis] >= case.mesh.h * (1 - STRETCH):
            lines += [boundary.box.lower[axis], boundary.box.upper[axis]]
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


def _subdivide(case: Case, a: float, b: float, fine: tuple[float, float]) -> Array:
    """Lines from a to b, both included: equal steps of the number of cells passed since a."""
    middle = (a + b) / 2
    if fine[0] <= middle <= fine[1]:
        return np.linspace(a, b, _cells((b - a) / case.mesh.h) + 1)
    outwards = middle > fine[1]
    edge = fine[1] if outwards else fine[0]
    passed, place = _grading(case)
    near, far = sorted((passed(abs(a - edge)), passed(abs(b - edge))))
    distances = np.array([place(n) for n in np.linspace(near, far, _cells(far - near) + 1)])
    lines = edge + distances if outwards else (edge - distances)[::-1]
    lines[0], lines[-1] = a, b
    return lines


def _cells(number: float) -> int:
    return max(1, math.ceil(number / (1 + STRETCH)))


def _grading(case: Case) -> tuple[Callable[[float], float], Callable[[float], float]]:
    """Cells passed up to a distance d from the fine box, and the distance at a number of cells passed.

    With the spacing s(d) = min(h + d ln(growth), coarse), successive cells, over each of which the integral
    of 1/s is one, have spacings in the ratio `growth` until `coarse` is reached.
    """
    h, rate = case.mesh.h, math.log(case.mesh.growth)
    coarse = case.mesh.coarse or math.inf
    cells_graded = math.log(coarse / h) / rate
    reach = (coarse - h) / rate

    def passed(distance: float) -> float:
        """Cells up to a distance."""
        if distance <= reach:
            return math.log1p(rate * distance / h) / rate
        return cells_graded + (distance - reach) / coarse

    def place(cells: float) -> float:
        """Distance at a number of cells."""
        if cells <= cells_graded:
            return h * math.expm1(rate * cells) / rate
        return reach + (cells - cells_graded) * coarse

    return passed, place
