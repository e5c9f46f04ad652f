"""The part of the grid that the points need, and which points lie in which of its cells."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from .grid import Grid

#: rings of empty cells kept around the occupied ones, so that points can wander before equations are renumbered
RINGS = 2


class ActiveGrid:
    """Cells that hold points, with rings of empty ones around them.

    Attributes
    ----------
    nodes : (n_cells, k) nodes of each cell.
    cell : (n_points,) cell of each point.
    starts, members : points of cell e are ``members[starts[e]:starts[e + 1]]``.
    n_occupied : cells that hold points.
    shift : (2,) where the grid stands in this step, from its first place.
    """

    def __init__(self, grid: Grid, cells: tuple[NDArray, NDArray]) -> None:
        self._grid = grid
        occupied = np.zeros(grid.shape, bool)
        occupied[cells] = True
        used = binary_dilation(occupied, np.ones((3, 3), bool), iterations=RINGS)
        self._x, self._y = np.nonzero(used)
        self._number = np.full(grid.shape, -1, dtype=np.int64)
        self._number[self._x, self._y] = np.arange(len(self._x))
        self.nodes = grid.cell_nodes(self._x, self._y)
        self.shift = np.zeros(2)

    def holds(self, cells: tuple[NDArray, NDArray]) -> bool:
        """Whether all points' cells are among these."""
        return bool((self._number[cells] >= 0).all())

    def sort_points(self, cells: tuple[NDArray, NDArray]) -> None:
        """List the points of each cell, in the points' order."""
        self.cell = self._number[cells]
        counts = np.bincount(self.cell, minlength=len(self.nodes))
        self.starts = np.concatenate([[0], np.cumsum(counts)])
        self.members = np.argsort(self.cell, kind="stable")
        self.n_occupied = int(np.count_nonzero(counts))

    def filling(self, lower: NDArray, upper: NDArray, area: NDArray, sides: list[NDArray]) -> NDArray:
        """Factor (n_points,) by which the points' areas fill each cell as far as the body covers it.

        Moving points leave some cells too full and some too empty. What the body covers of a cell is known better from
        the points' rectangles (``lower`` and ``upper`` corners (n_points, 2), areas (n_points,)), which tile the body;
        parts in cells without points, or across a slit, go to the point's own cell.
        """
        counts = np.diff(self.starts)
        covered = np.zeros(len(counts))
        x, y = self._x[self.cell], self._y[self.cell]
        lines_x, lines_y = (axis.breakpoints for axis in self._grid.axes)
        closed = self._closed_sides(sides)
        _cover(x, y, lower, upper, lines_x, lines_y, closed, self._number, counts, covered)
        held = np.bincount(self.cell, weights=area, minlength=len(counts))
        return covered[self.cell] / held[self.cell]

    def _closed_sides(self, sides: list[NDArray]) -> NDArray:
        """Which neighbours (n_points, 4) - left, right, below, above - lie across a slit."""
        closed = np.zeros((len(self.cell), 4), bool)
        place = (self._x[self.cell], self._y[self.cell])
        for slit, side in zip(self._grid.slits, sides, strict=True):
            line = self._grid.line_of(slit)
            closed[:, 2 * slit.normal + 1] |= (side < 0) & (place[slit.normal] == line - 1)
            closed[:, 2 * slit.normal] |= (side > 0) & (place[slit.normal] == line)
        return closed

    def corner_values(self, nodal: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Corners (4 n, 2), quads (n, 4) and a nodal scalar at the corners (4 n,) of the occupied cells.

        Each cell has its own corners, because the fields may jump across slits.
        """
        occupied = np.flatnonzero(np.diff(self.starts))
        x, y = self._x[occupied], self._y[occupied]
        lines = [axis.breakpoints for axis in self._grid.axes]
        steps = ((0, 0), (1, 0), (1, 1), (0, 1))
        corners = np.stack([np.stack([lines[0][x + i], lines[1][y + j]], -1) for i, j in steps], axis=1)
        values = np.empty((len(occupied), 4))
        for corner in range(4):
            basis, _ = self._grid.evaluate(corners[:, corner], x, y)
            values[:, corner] = (basis * nodal[self.nodes[occupied]]).sum(axis=1)
        cells = np.arange(values.size).reshape(-1, 4)
        return corners.reshape(-1, 2) + self.shift, cells, values.ravel()


@njit(cache=True)
def _cover(cells_x, cells_y, lower, upper, lines_x, lines_y, closed, number, counts, covered):
    """Add the parts of each point's rectangle to the cells they lie in."""
    for p in range(len(cells_x)):
        i, j = cells_x[p], cells_y[p]
        before = 0.0 if closed[p, 0] else max(0.0, min(lines_x[i], upper[p, 0]) - lower[p, 0])
        behind = 0.0 if closed[p, 1] else max(0.0, upper[p, 0] - max(lines_x[i + 1], lower[p, 0]))
        below = 0.0 if closed[p, 2] else max(0.0, min(lines_y[j], upper[p, 1]) - lower[p, 1])
        above = 0.0 if closed[p, 3] else max(0.0, upper[p, 1] - max(lines_y[j + 1], lower[p, 1]))
        parts_x = (before, upper[p, 0] - lower[p, 0] - before - behind, behind)
        parts_y = (below, upper[p, 1] - lower[p, 1] - below - above, above)
        own = number[i, j]
        for a in range(3):
            for b in range(3):
                area = parts_x[a] * parts_y[b]
                ia, jb = i + a - 1, j + b - 1
                inside = 0 <= ia < number.shape[0] and 0 <= jb < number.shape[1]
                cell = number[ia, jb] if inside else -1
                covered[cell if cell >= 0 and counts[cell] > 0 else own] += area
