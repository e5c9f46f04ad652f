"""The phase field in small time steps: solved only around the cells where it can change.

The cells are kept in square blocks. Blocks with a cell whose phase field would change by more than a tolerance make the
window, together with four rings of blocks around them; outside it the phase field stays, and it is held at nodes that
cells outside the window share. What a change leaves out has decayed by exp(-RINGS BLOCK / 2). Where cells are larger than
that, blocks are so large that the rings hold every neighbour of a cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from .lanes import LANES, apart, load, same, store
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
#: diagonal over source, as a multiple of its lower quartile, from which a row is heavy: scaled by the diagonal alone,
#: conjugate gradients took a thousand steps for functions that meet in heavy rows and are held by what lies beside
HEAVY = 6.0
#: iterations by the diagonal alone, which are symmetric where the equations are, before patches around heavy rows help
PATIENCE = 100
#: numbers behind arrays that may be read, several at once, and do not count
SPARE = 2 * LANES
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
        self._block_of_members = self._block[self._members]
        self._nodes = nodes
        self._shared_by = np.bincount(nodes[breakable].ravel(), minlength=n_nodes)

    def around(self, change: NDArray, tolerance: float) -> Window | None:
        """The window for expected changes of the phase field (n_cells,), None where all are within the tolerance."""
        changing = change > tolerance
        if not changing.any():
            return None
        blocks = np.zeros(self._shape, bool)
        blocks.ravel()[self._block[changing]] = True
        near = binary_dilation(blocks, np.ones((3, 3), bool), iterations=RINGS).ravel()
        cells = self._members[near[self._block_of_members]]
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
    patched: bool = False,
) -> tuple[NDArray, int]:
    """Correction (n,) of the phase field and the number of iterations.

    neighbours : (n, s) row of each entry, n for none. values : (n, s) entries. diagonal : (n,) which of them is that of
    the diagonal. right_side : (n,). sources : (n,) sums of the rows without history field. share : of them that may be
    left over. patched : whether heavy rows are solved with those around them beside; for points of order 2, which may be
    torn one by one: elements are by all of theirs, the bends of order 4 make all rows heavy alike.

    Beside the diagonal a residual could be small that belongs to a large correction: the history field of few broken
    points makes rows heavy, and with them the diagonal, but holds the phase field only at these points; at order 4 the
    bends do.
    """
    correction = np.zeros(len(right_side))
    if not len(correction):
        return correction, 0
    pull = PULL * sources.max(initial=0.0)
    weight, seen = values[np.arange(len(diagonal)), diagonal] / (sources + pull), sources > pull
    heavy = weight > (HEAVY * np.quantile(weight[seen], 0.25) if seen.any() and patched else np.inf)
    iterations = _solve_rows(neighbours, values, diagonal, heavy, right_side, pull, share * (sources + pull), correction)
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
def _mirrors(neighbours, starts, away):
    """For neighbours (m, s) of stretches that come before their rows, in which entry of theirs all rows of the stretch
    stand, -1 where that is not so: by symmetry that entry is the same, and was read not long ago."""
    n, s = neighbours.shape
    mirrors = np.full(away.shape, -1)
    for stretch in range(len(away)):
        for entry in range(s):
            far = away[stretch, entry]
            if far >= 0:  # or nowhere
                continue
            for other in range(s):
                fits = True
                for i in range(starts[stretch], starts[stretch + 1]):
                    mirrored = neighbours[i + far, other] if i + far >= 0 else n
                    fits &= mirrored == (i if neighbours[i, entry] < n else n)
                    if not fits:
                        break
                if fits:
                    mirrors[stretch, entry] = other
                    break
    return mirrors


@njit(cache=True, parallel=True)
def _products(starts, away, mirrors, entries, margin, vector, product):
    """Products (n,) of rows, whose ``entries`` (s, margin + n + SPARE) are kept by columns, with a vector between two
    margins of zeros, ``SPARE`` more behind it."""
    columns = entries.shape[1]
    flat = entries.reshape(-1)
    for stretch in prange(len(away)):
        first, last = starts[stretch], starts[stretch + 1]
        there, of_entry, count = np.empty(len(entries), np.int64), np.empty(len(entries), np.int64), 0
        for entry in range(len(entries)):
            if away[stretch, entry] != NOWHERE:
                there[count], of_entry[count] = margin + away[stretch, entry], entry * columns + margin
                if mirrors[stretch, entry] >= 0:
                    of_entry[count] = mirrors[stretch, entry] * columns + there[count]
                count += 1
        for i in range(first, last, 2 * LANES):
            one, two = same(0.0), same(0.0)
            for n in range(count):
                at, beside = of_entry[n] + i, there[n] + i
                one = one + load(flat, at, LANES) * load(vector, beside, LANES)
                two = two + load(flat, at + LANES, LANES) * load(vector, beside + LANES, LANES)
            if i + 2 * LANES <= last:
                store(product, i, LANES, one)
                store(product, i + LANES, LANES, two)
            else:
                store(product, i, last - i, one)
                store(product, i + LANES, last - i - LANES, two)


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
def _entries(neighbours, values, margin):
    """Entries (s, margin + n + SPARE) by columns; zero where there is no neighbour."""
    n, s = values.shape
    entries = np.zeros((s, margin + n + SPARE))
    for i in range(n):
        for entry in range(s):
            entries[entry, margin + i] = values[i, entry] if neighbours[i, entry] < n else 0.0
    return entries


@njit(forceinline=True)
def _go_on_at(i, left, step, direction, product, scale, solution, residual, scaled):
    store(solution, i, left, load(solution, i, left) + step * load(direction, i, left))
    rest = load(residual, i, left) - step * load(product, i, left)
    store(residual, i, left, rest)
    of_scale = rest * load(scale, i, left)
    store(scaled, i, left, of_scale)
    return rest * of_scale


@njit(cache=True)
def _go_on(step, direction, product, scale, solution, residual, scaled):
    """A step of the solution; the residual, and the same scaled, after it; the sum of products of these two."""
    total, fours = same(0.0), len(solution) // LANES * LANES
    for i in range(0, fours, LANES):
        total = total + _go_on_at(i, LANES, step, direction, product, scale, solution, residual, scaled)
    total = total + _go_on_at(fours, len(solution) - fours, step, direction, product, scale, solution, residual, scaled)
    a, b, c, d = apart(total)
    return (a + b) + (c + d)


@njit(cache=True)
def _invert(matrix, size):
    """Invert the first rows and columns of a positive definite matrix in place."""
    for p in range(size):
        pivot = 1.0 / matrix[p, p]
        matrix[p, p] = 1.0
        for j in range(size):
            matrix[p, j] *= pivot
        for i in range(size):
            if i != p:
                factor = matrix[i, p]
                matrix[i, p] = 0.0
                for j in range(size):
                    matrix[i, j] -= factor * matrix[p, j]


@njit(cache=True)
def _patches(neighbours, entries, heavy):
    """Rows (m, s) near heavy ones, n behind the last, that cover all of these; inverses (m, s, s) of their equations."""
    n, s = neighbours.shape
    centres, covered, count = np.empty(n, np.int64), np.zeros(n + 1, np.bool_), 0
    for i in range(n):
        if heavy[i] and not covered[i]:
            centres[count] = i
            count += 1
            for entry in range(s):
                covered[neighbours[i, entry]] = True
    rows, inverses, place = np.full((count, s), n), np.zeros((count, s, s)), np.full(n + 1, -1)
    for patch in range(count):
        size = 0
        for entry in range(s):
            near = neighbours[centres[patch], entry]
            if near < n:
                rows[patch, size], place[near] = near, size
                size += 1
        for a in range(size):
            for entry in range(s):
                b = place[neighbours[rows[patch, a], entry]]
                if b >= 0:
                    inverses[patch, a, b] = entries[entry, rows[patch, a]]
        _invert(inverses[patch], size)
        for a in range(size):
            place[rows[patch, a]] = -1
    return rows, inverses


@njit(cache=True)
def _add_of_patches(rows, inverses, residual, scaled):
    """Add what the patches make of a residual (n,) to the scaled one (n,), and return the product of the two."""
    n, s = residual.size, rows.shape[1]
    total = np.empty(s)
    for patch in range(len(rows)):
        total[:] = 0.0
        for b in range(s):
            if rows[patch, b] < n:
                left = residual[rows[patch, b]]
                for a in range(s):
                    total[a] += inverses[patch, b, a] * left
        for a in range(s):
            if rows[patch, a] < n:
                scaled[rows[patch, a]] += total[a]
    return _dot(residual, scaled)


@njit(cache=True)
def _solve_rows(neighbours, values, diagonal, heavy, right_side, pull, allowed, solution):
    """Conjugate gradients, preconditioned by the diagonal, and where that takes long by the inverses of patches around
    heavy rows beside (additive Schwarz method); the number of iterations, -1 without convergence."""
    n = solution.size
    starts, away = _stretches(neighbours)
    margin = 0
    for far in away.reshape(-1):
        if far != NOWHERE:
            margin = max(margin, abs(far))
    entries, mirrors = _entries(neighbours, values, margin), _mirrors(neighbours, starts, away)
    rows_of_entries = entries[:, margin:]
    padded, product = np.zeros(n + 2 * margin + SPARE), np.empty(n)
    direction = padded[margin : margin + n]
    residual, scale, scaled = right_side.copy(), np.empty(n), np.empty(n)
    for i in range(n):
        # what hardly any point sees, a node or a combination of them, would grow without bound
        own = rows_of_entries[diagonal[i], i]
        own += pull + PULL_OF_DIAGONAL * own
        rows_of_entries[diagonal[i], i] = own
        scale[i] = 1.0 / own
        scaled[i] = residual[i] * scale[i]
        direction[i] = scaled[i]
    rows, inverses = _patches(neighbours, rows_of_entries, np.zeros_like(heavy))
    old = _dot(residual, scaled)
    for iteration in range(10 * n + 10):
        if _within(residual, allowed):
            return iteration
        if iteration == PATIENCE and heavy.any():
            rows, inverses = _patches(neighbours, rows_of_entries, heavy)
            old = _add_of_patches(rows, inverses, residual, scaled)
            direction[:] = scaled
        _products(starts, away, mirrors, entries, margin, padded, product)
        # a sum of the linear algebra's library would depend on its number of threads
        step = old / _dot(direction, product)
        if not np.isfinite(step):
            return -1
        new = _go_on(step, direction, product, scale, solution, residual, scaled)
        if len(rows):
            new = _add_of_patches(rows, inverses, residual, scaled)
        ratio, old = new / old, new
        for i in range(n):
            direction[i] = scaled[i] + ratio * direction[i]
    return -1
