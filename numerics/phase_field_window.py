"""The phase field in small time steps: solved only around the cells where it can change.

The cells are kept in square blocks. Blocks with a cell whose phase field would change by more than a tolerance make the
window, together with four rings of blocks around them (fewer where points carry the phase field along and the change is
small); outside it the phase field stays, and it is held at nodes that
cells outside the window share. What a change leaves out has decayed by exp(-RINGS BLOCK / 2). Where cells are larger than
that, blocks are so large that the rings hold every neighbour of a cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from .linear_solvers import LinearSolverError

#: side of a block in multiples of l0
BLOCK = 2.0
#: rings of blocks that a change reaches
RINGS = 4
#: residual over the sources; a change of the phase field of about this size is left out
RESIDUAL = 1e-4
#: the same at order 4; the correction left out is then below 1e-3
SMOOTH_RESIDUAL = 5e-3
#: stiffness of the pull towards the start of the solution, over the largest source and over the node's diagonal
PULL, PULL_OF_DIAGONAL = 1e-4, 1e-6
#: no row of a stretch has such a neighbour
NOWHERE = np.iinfo(np.int64).max
NOT_FOUND = "the phase field of a time step was not found; its equations are too stiff or hold a value that is not finite"


@dataclass(frozen=True)
class Window:
    """Cells (m,) to solve on and the nodes (n,) whose phase field is unknown: those of no other cell."""

    cells: NDArray
    nodes: NDArray


class Blocks:
    """Cells of a fixed mesh or grid in square blocks.

    Parameters
    ----------
    centres : (n_cells, 2) [length].
    nodes : (n_cells, k) of each cell.
    n_nodes : number of all nodes.
    breakable : (n_cells,) cells that take part.
    length_scale : l0 [length].
    """

    def __init__(self, centres: NDArray, nodes: NDArray, n_nodes: int, breakable: NDArray, length_scale: float) -> None:
        size = max(BLOCK * length_scale, _farthest_neighbour(centres, nodes, n_nodes) / (RINGS - 0.5))
        place = np.floor((centres - centres.min(axis=0)) / size).astype(np.int64)
        self._shape = tuple(place.max(axis=0) + 1)
        self._block = place[:, 0] * self._shape[1] + place[:, 1]
        taking_part = np.flatnonzero(breakable)
        self._members = taking_part[np.argsort(self._block[taking_part], kind="stable")]
        self._starts = np.searchsorted(self._block[self._members], np.arange(self._shape[0] * self._shape[1] + 1))
        self._nodes = nodes
        self._shared_by = np.bincount(nodes[breakable].ravel(), minlength=n_nodes)

    def around(self, change: NDArray, tolerance: float) -> Window | None:
        """The window for expected changes of the phase field (n_cells,), None where all are within the tolerance."""
        changing = change > tolerance
        if not changing.any():
            return None
        blocks = np.zeros(self._shape, bool)
        blocks.ravel()[self._block[changing]] = True
        chosen = np.flatnonzero(binary_dilation(blocks, np.ones((3, 3), bool), iterations=RINGS))
        cells = np.concatenate([self._members[self._starts[b] : self._starts[b + 1]] for b in chosen])
        shared_here = np.bincount(self._nodes[cells].ravel(), minlength=len(self._shared_by))
        return Window(cells, np.flatnonzero((shared_here > 0) & (shared_here == self._shared_by)))


def _farthest_neighbour(centres: NDArray, nodes: NDArray, n_nodes: int) -> float:
    """Largest distance in x or y between the centres (n_cells, 2) of cells that share one of their nodes (n_cells, k)."""
    lowest, highest = np.full((n_nodes, 2), np.inf), np.full((n_nodes, 2), -np.inf)
    np.minimum.at(lowest, nodes, centres[:, None])
    np.maximum.at(highest, nodes, centres[:, None])
    return float((highest - lowest).max())


@njit(cache=True)
def fold(rows_of_cells, slots, local, parts, values, right_side):
    """Add cells' equations to rows with a fixed number of entries, in the order of the cells.

    rows_of_cells : (m, k) row of each node, n_rows for none. slots : (m or 1, k, k) entry of its row in which a node
    couples with another one; both unsigned, so that no index is looked at for whether it counts from the end.
    local : (m, k (k + 1) / 2) upper halves. parts : (m, k) of the right side. values : (n_rows + 1, s) and
    right_side : (n_rows + 1,), the last row to be ignored.
    """
    k = rows_of_cells.shape[1]
    last = slots.shape[0] - 1
    for cell in range(rows_of_cells.shape[0]):
        slot = slots[min(cell, last)]
        entry = 0
        for a in range(k):
            row = rows_of_cells[cell, a]
            right_side[row] += parts[cell, a]
            values[row, slot[a, a]] += local[cell, entry]
            entry += 1
            for b in range(a + 1, k):
                values[row, slot[a, b]] += local[cell, entry]
                values[rows_of_cells[cell, b], slot[b, a]] += local[cell, entry]
                entry += 1


def conjugate_gradients(
    neighbours: NDArray,
    values: NDArray,
    diagonal: NDArray,
    right_side: NDArray,
    sources: NDArray,
    share: float,
    holds: NDArray | float = 0.0,
) -> tuple[NDArray, int]:
    """Correction (n,) of the phase field and the number of iterations.

    neighbours : (n, s) row of each entry, n for none. values : (n, s) entries. diagonal : (n,) which of them is that of
    the diagonal. right_side : (n,). sources : (n,) sums of the rows without history field. share : of them that may be
    left over, and of the weights ``holds`` (n,) of what is known of the phase field beforehand. Beside the diagonal a
    residual could be small that belongs to a large correction: the history field of few broken points makes rows heavy,
    and with them the diagonal, but holds the phase field only at these points; at order 4 the bends do.
    """
    correction = np.zeros(len(right_side))
    if not len(correction):
        return correction, 0
    pull = PULL * sources.max(initial=0.0)
    iterations = _solve_rows(neighbours, values, diagonal, right_side, pull, share * (sources + holds + pull), correction)
    if iterations < 0:
        raise LinearSolverError(NOT_FOUND)
    return correction, iterations


@njit(cache=True)
def _stretches(neighbours):
    """Starts (m + 1,) of stretches of rows in which neighbours are as far away in every row that has them, and how far
    (m, s)."""
    n, s = neighbours.shape
    starts, away, count = np.empty(n + 1, np.int64), np.full((n, s), NOWHERE), 0
    for i in range(n):
        others = 0
        for entry in range(s):
            so_far = away[max(count - 1, 0), entry]
            others += (neighbours[i, entry] < n) & (so_far != NOWHERE) & (so_far != neighbours[i, entry] - i)
        if others or count == 0:
            starts[count], away[count] = i, NOWHERE
            count += 1
        for entry in range(s):
            if neighbours[i, entry] < n:
                away[count - 1, entry] = neighbours[i, entry] - i
    starts[count] = n
    return starts[: count + 1].copy(), away[:count].copy()


@njit(cache=True)
def _add_products(one, other, total):
    for i in range(len(total)):
        total[i] += one[i] * other[i]


@njit(cache=True, parallel=True)
def _products(starts, away, entries, margin, vector, product):
    """Products (n,) of rows, whose ``entries`` (s, n) are kept by columns, with a vector between two margins of zeros."""
    for stretch in prange(len(away)):
        first, last = starts[stretch], starts[stretch + 1]
        total = product[first:last]
        total[:] = 0.0
        for entry in range(len(entries)):
            if away[stretch, entry] != NOWHERE:
                there = margin + first + away[stretch, entry]
                _add_products(entries[entry, first:last], vector[there : there + last - first], total)


@njit(cache=True)
def _dot(one, other):
    """Sum of products, in four parts that do not wait for one another."""
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    fours = len(one) // 4 * 4
    for i in range(0, fours, 4):
        a += one[i] * other[i]
        b += one[i + 1] * other[i + 1]
        c += one[i + 2] * other[i + 2]
        d += one[i + 3] * other[i + 3]
    for i in range(fours, len(one)):
        a += one[i] * other[i]
    return (a + b) + (c + d)


@njit(cache=True)
def _within(residual, allowed):
    beyond = 0
    for i in range(len(residual)):
        beyond += not abs(residual[i]) <= allowed[i]
    return beyond == 0


@njit(cache=True)
def _entries(neighbours, values, scale):
    """Entries (s, n) by columns, times the scales (n,) of their row and column; zero where there is no neighbour."""
    n, s = values.shape
    entries = np.empty((s, n))
    for i in range(n):
        for entry in range(s):
            column = neighbours[i, entry]
            entries[entry, i] = values[i, entry] * scale[i] * scale[column] if column < n else 0.0
    return entries


@njit(cache=True)
def _subtract_products(one, other, total):
    for i in range(len(total)):
        total[i] -= one[i] * other[i]


@njit(cache=True)
def _follow(first, last, margin, entries, near, steps, found, ahead):
    """The part of a sweep in which each row of a stretch waits for the one before it."""
    begin, way = (last - 1, -1) if ahead else (first, 1)
    if len(near) == 2:  # as with quadratic splines; the nearest neighbour, the last to be known, comes last
        far, close = (1, 0) if ahead else (0, 1)
        one, two, away_one, away_two = entries[near[far]], entries[near[close]], steps[far], steps[close]
        for place in range(last - first):
            i = begin + way * place
            here = found[margin + i] - one[i] * found[margin + i + away_one]
            found[margin + i] = here - two[i] * found[margin + i + away_two]
        return
    for place in range(last - first):
        i = begin + way * place
        here = found[margin + i]
        for other in range(len(near)):
            here -= entries[near[other], i] * found[margin + i + steps[other]]
        found[margin + i] = here


@njit(cache=True)
def _sweep(starts, away, entries, margin, right_side, found, ahead):
    """Solve the rows without what is left of the diagonal, where ``ahead``, or right of it; the diagonal is one.

    ``found`` has a margin of zeros on both sides. Only neighbours within a stretch wait for one another.
    """
    near, steps = np.empty(len(entries), np.uintp), np.empty(len(entries), np.int64)
    for number in range(len(away)):
        stretch = len(away) - 1 - number if ahead else number
        first, last, count = starts[stretch], starts[stretch + 1], 0
        total = found[margin + first : margin + last]
        total[:] = right_side[first:last]
        for entry in range(len(entries)):
            step = away[stretch, entry]
            if step == NOWHERE or step == 0 or (step > 0) != ahead:
                continue
            if abs(step) < last - first:
                near[count], steps[count] = entry, step
                count += 1
            else:
                there = margin + first + step
                _subtract_products(entries[entry, first:last], found[there : there + last - first], total)
        _follow(first, last, margin, entries, near[:count], steps[:count], found, ahead)


@njit(cache=True)
def _solve_rows(neighbours, values, diagonal, right_side, pull, allowed, solution):
    """Conjugate gradients preconditioned by a symmetric Gauss-Seidel sweep, in the form that needs no further products
    (Eisenstat 1981)."""
    n = solution.size
    starts, away = _stretches(neighbours)
    margin = max(0, np.where(away == NOWHERE, 0, np.abs(away)).max())
    scale = np.empty(n)
    for i in range(n):
        # what hardly any point sees, a node or a combination of them, would grow without bound
        scale[i] = 1.0 / np.sqrt(values[i, diagonal[i]] * (1.0 + PULL_OF_DIAGONAL) + pull)
    entries = _entries(neighbours, values, scale)
    for i in range(n):
        entries[diagonal[i], i] = 1.0
    right_side, allowed = right_side * scale, allowed * scale
    moved, swept = np.zeros(n + 2 * margin), np.zeros(n + 2 * margin)
    found, product, rest = np.zeros(n + 2 * margin), np.empty(n), np.empty(n)
    inner, outer = slice(margin, margin + n), swept[margin : margin + n]
    _sweep(starts, away, entries, margin, right_side, swept, False)
    residual = outer.copy()
    direction, old = residual.copy(), _dot(residual, residual)
    for iteration in range(10 * n + 10):
        if _within(residual, allowed):
            _products(starts, away, entries, margin, found, product)
            if _within(right_side - product, allowed):
                solution[:] = scale * found[inner]
                return iteration
        _sweep(starts, away, entries, margin, direction, moved, True)
        step_of = moved[inner]
        for i in range(n):
            rest[i] = direction[i] - step_of[i]
        _sweep(starts, away, entries, margin, rest, swept, False)
        for i in range(n):
            product[i] = step_of[i] + outer[i]
        # a sum of the linear algebra's library would depend on its number of threads
        step = old / _dot(direction, product)
        if not np.isfinite(step):
            return -1
        for i in range(n):
            found[margin + i] += step * step_of[i]
            residual[i] -= step * product[i]
        new = _dot(residual, residual)
        ratio, old = new / old, new
        for i in range(n):
            direction[i] = residual[i] + ratio * direction[i]
    return -1
