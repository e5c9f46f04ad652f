"""The phase field in small time steps: solved only around the cells where it can change.

The cells are kept in square blocks. Blocks with a cell whose phase field would change by more than a tolerance make the
window, together with two rings of blocks around them; outside it the phase field stays, and it is held at nodes that
cells outside the window share. What a change leaves out has decayed by exp(-RINGS BLOCK / 2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from .linear_solvers import LinearSolverError

#: side of a block in multiples of l0
BLOCK = 4.0
#: rings of blocks that a change reaches
RINGS = 2
#: largest change of the phase field that the solution may leave out
RESIDUAL = 1e-5
NOT_FOUND = "the phase field of a time step was not found; its equation holds a value that is not finite"


@dataclass(frozen=True)
class Window:
    """Cells to solve on.

    Attributes
    ----------
    cells : (m,) their numbers.
    nodes : (n,) numbers of the nodes that they have.
    corners : (m, k) their nodes as places in ``nodes``.
    free : (n,) nodes whose phase field is unknown.
    """

    cells: NDArray
    nodes: NDArray
    corners: NDArray
    free: NDArray


class Blocks:
    """Cells of a fixed mesh or grid in square blocks.

    Parameters
    ----------
    centres : (n_cells, 2) [length].
    nodes : (n_cells, k) of each cell.
    n_nodes : number of all nodes.
    breakable : (n_cells,) cells that take part.
    size : side of a block [length].
    """

    def __init__(self, centres: NDArray, nodes: NDArray, n_nodes: int, breakable: NDArray, size: float) -> None:
        place = np.floor((centres - centres.min(axis=0)) / size).astype(np.int64)
        self._shape = tuple(place.max(axis=0) + 1)
        self._block = place[:, 0] * self._shape[1] + place[:, 1]
        taking_part = np.flatnonzero(breakable)
        self._members = taking_part[np.argsort(self._block[taking_part], kind="stable")]
        self._starts = np.searchsorted(self._block[self._members], np.arange(self._shape[0] * self._shape[1] + 1))
        self._nodes = nodes
        self._shared_by = np.bincount(nodes[breakable].ravel(), minlength=n_nodes)
        self._place = np.full(n_nodes, -1, dtype=np.int32)

    def around(self, change: NDArray, tolerance: float) -> Window | None:
        """The window for expected changes of the phase field (n_cells,), None where all are within the tolerance."""
        changing = change > tolerance
        if not changing.any():
            return None
        blocks = np.zeros(self._shape, bool)
        blocks.ravel()[self._block[changing]] = True
        chosen = np.flatnonzero(binary_dilation(blocks, np.ones((3, 3), bool), iterations=RINGS))
        cells = np.concatenate([self._members[self._starts[b] : self._starts[b + 1]] for b in chosen])
        corners = self._nodes[cells]
        nodes, corners, count = _compact(corners, self._place)
        return Window(cells, nodes, corners, count == self._shared_by[nodes])


@njit(cache=True)
def _compact(corners, place):
    """Nodes in order of first appearance, corners as places among them, and how many cells of the window share each."""
    nodes = np.empty(corners.size, np.int64)
    count = np.zeros(corners.size, np.int32)
    local = np.empty_like(corners)
    n = 0
    for e in range(corners.shape[0]):
        for a in range(corners.shape[1]):
            node = corners[e, a]
            if place[node] < 0:
                place[node], nodes[n] = n, node
                n += 1
            local[e, a] = place[node]
            count[place[node]] += 1
    for i in range(n):
        place[nodes[i]] = -1
    return nodes[:n], local, count[:n]


def correction(window: Window, local: NDArray, out_of_balance: NDArray) -> tuple[NDArray, int]:
    """Solve for the change of the nodal phase field in a window, zero where it is held.

    Conjugate gradients with the diagonal as preconditioner, cell by cell, from zero: the change is small in a time step.

    Parameters
    ----------
    local : (m, k (k + 1) / 2) upper halves of the cells' matrices.
    out_of_balance : (m, k) the cells' residuals with their sign turned.

    Returns
    -------
    change (n,) of the window's nodes, and the number of iterations.
    """
    change = np.zeros(len(window.nodes))
    iterations = _conjugate_gradients(window.corners, window.free, local, out_of_balance, RESIDUAL, change)
    if iterations < 0:
        raise LinearSolverError(
            "the phase field of a time step was not found; its equation holds a value that is not finite"
        )
    return change, iterations


@njit(cache=True, parallel=True)
def _cell_products(corners, local, vector, products):
    k = corners.shape[1]
    for e in prange(corners.shape[0]):
        for a in range(k):
            products[e, a] = 0.0
        entry = 0
        for a in range(k):
            xa = vector[corners[e, a]]
            total = local[e, entry] * xa
            entry += 1
            for b in range(a + 1, k):
                total += local[e, entry] * vector[corners[e, b]]
                products[e, b] += local[e, entry] * xa
                entry += 1
            products[e, a] += total


@njit(cache=True)
def _add_up(corners, parts, free, total):
    """Sum of the cells' vectors at the free nodes, in the order of the cells."""
    total[:] = 0.0
    for e in range(corners.shape[0]):
        for a in range(corners.shape[1]):
            total[corners[e, a]] += parts[e, a]
    for i in range(total.size):
        if not free[i]:
            total[i] = 0.0


@njit(cache=True)
def _diagonal(corners, local, free, diagonal):
    diagonal[:] = 0.0
    k = corners.shape[1]
    for e in range(corners.shape[0]):
        entry = 0
        for a in range(k):
            diagonal[corners[e, a]] += local[e, entry]
            entry += k - a
    for i in range(diagonal.size):
        # nodes that are held, and those without stiffness, do not take part
        if not free[i] or diagonal[i] <= 0.0:
            diagonal[i] = np.inf


@njit(cache=True)
def _conjugate_gradients(corners, free, local, parts, tolerance, solution):
    """From zero, in place; returns the iterations, or -1 without convergence.

    A residual weighted by the diagonal is a change of the phase field: the largest one stops the iteration.
    """
    size = solution.size
    residual, diagonal, product = np.empty(size), np.empty(size), np.empty(size)
    products = np.empty(corners.shape)
    _add_up(corners, parts, free, residual)
    _diagonal(corners, local, free, diagonal)
    direction = residual / diagonal
    old = np.dot(residual, direction)
    for iteration in range(10 * size + 10):
        largest = 0.0
        for i in range(size):
            largest = max(largest, abs(residual[i] / diagonal[i]))
        if largest <= tolerance:
            return iteration
        _cell_products(corners, local, direction, products)
        _add_up(corners, products, free, product)
        step = old / np.dot(direction, product)
        if not np.isfinite(step):
            return -1
        new = 0.0
        for i in range(size):
            solution[i] += step * direction[i]
            residual[i] -= step * product[i]
            new += residual[i] * residual[i] / diagonal[i]
        ratio = new / old
        for i in range(size):
            direction[i] = residual[i] / diagonal[i] + ratio * direction[i]
        old = new
    return -1


def conjugate_gradients(
    neighbours: NDArray, values: NDArray, diagonal: int, right_side: NDArray, solution: NDArray
) -> int:
    """Solve for the phase field in place, from what is in ``solution`` (n,); returns the number of iterations.

    neighbours : (n, s) row of each entry, n for none. values : (n, s) entries. diagonal : their column of the diagonal.
    right_side : (n,). Rows without a diagonal entry keep their value.
    """
    iterations = _solve_rows(neighbours, values, diagonal, right_side, RESIDUAL, solution)
    if iterations < 0:
        raise LinearSolverError(NOT_FOUND)
    return iterations


@njit(cache=True, parallel=True)
def _row_products(neighbours, values, vector, product):
    """``vector`` has one entry more, which is zero."""
    for i in prange(neighbours.shape[0]):
        total = 0.0
        for s in range(neighbours.shape[1]):
            total += values[i, s] * vector[neighbours[i, s]]
        product[i] = total


@njit(cache=True)
def _solve_rows(neighbours, values, diagonal, right_side, tolerance, solution):
    n = solution.size
    direction, product = np.zeros(n + 1), np.empty(n)
    direction[:n] = solution
    _row_products(neighbours, values, direction, product)
    residual, scale = right_side - product, np.empty(n)
    old = 0.0
    for i in range(n):
        d = values[i, diagonal]
        scale[i] = 1.0 / d if d > 0.0 else 0.0
        direction[i] = residual[i] * scale[i]
        old += residual[i] * direction[i]
    for iteration in range(10 * n + 10):
        largest = 0.0
        for i in range(n):
            largest = max(largest, abs(residual[i] * scale[i]))
        if largest <= tolerance:
            return iteration
        _row_products(neighbours, values, direction, product)
        step = old / np.dot(direction[:n], product)
        if not np.isfinite(step):
            return -1
        new = 0.0
        for i in range(n):
            solution[i] += step * direction[i]
            residual[i] -= step * product[i]
            new += residual[i] * residual[i] * scale[i]
        ratio = new / old
        for i in range(n):
            direction[i] = residual[i] * scale[i] + ratio * direction[i]
        old = new
    return -1
