"""The part of the grid that the points need, and which points lie in which of its cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from mpm.grid import Grid

#: rings of empty cells kept around the occupied ones, so that points can wander before equations are renumbered
RINGS = 2


class ActiveGrid:
    """Cells that hold points, with rings of empty ones around them.

    Attributes
    ----------
    nodes : (n_cells, k) nodes of each cell.
    cell : (n_points,) cell of each point.
    x, y : (n_cells,) place of each cell in the grid.
    number : (nx, ny) number of each cell of the grid, -1 where it is not in use.
    starts, members : points of cell e are ``members[starts[e]:starts[e + 1]]``.
    n_occupied : cells that hold points.
    shift : (2,) where the grid stands in this step, from its first place.
    """

    def __init__(self, grid: Grid, cells: tuple[NDArray, NDArray]) -> None:
        self._grid = grid
        occupied = np.zeros(grid.shape, bool)
        occupied[cells] = True
        used = binary_dilation(occupied, np.ones((3, 3), bool), iterations=RINGS)
        self.x, self.y = np.nonzero(used)
        self.number = np.full(grid.shape, -1, dtype=np.int64)
        self.number[self.x, self.y] = np.arange(len(self.x))
        self.nodes = grid.cell_nodes(self.x, self.y)
        self.shift = np.zeros(2)

    def holds(self, cells: tuple[NDArray, NDArray]) -> bool:
        """Whether all points' cells are among these."""
        return bool((self.number[cells] >= 0).all())

    def sort_points(self, cells: tuple[NDArray, NDArray]) -> None:
        """List the points of each cell, in the points' order."""
        self.cell = self.number[cells]
        counts = np.bincount(self.cell, minlength=len(self.nodes))
        self.starts = np.concatenate([[0], np.cumsum(counts)])
        self.members = np.argsort(self.cell, kind="stable")
        self.n_occupied = int(np.count_nonzero(counts))

    def corner_values(self, nodal: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Corners (4 n, 2), quads (n, 4) and a nodal scalar at the corners (4 n,) of the occupied cells.

        Each cell has its own corners, because the fields may jump across slits.
        """
        occupied = np.flatnonzero(np.diff(self.starts))
        x, y = self.x[occupied], self.y[occupied]
        lines = [axis.breakpoints for axis in self._grid.axes]
        steps = ((0, 0), (1, 0), (1, 1), (0, 1))
        corners = np.stack([np.stack([lines[0][x + i], lines[1][y + j]], -1) for i, j in steps], axis=1)
        values = np.empty((len(occupied), 4))
        for corner in range(4):
            basis, _ = self._grid.evaluate(corners[:, corner], x, y)
            values[:, corner] = (basis * nodal[self.nodes[occupied]]).sum(axis=1)
        cells = np.arange(values.size).reshape(-1, 4)
        return corners.reshape(-1, 2) + self.shift, cells, values.ravel()
