"""The part of the grid that the points need, and which points lie in which of its cells."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from mpm.grid import Grid, GridCells

#: rings of empty cells kept around the occupied ones, so that points can wander before equations are renumbered
RINGS = 2


class Cells(NamedTuple):
    """Cells with their points, as compiled loops take them.

    nodes : (n_cells, k) of each cell. cell : (n_points,) of each point.
    starts, members : points of cell e are ``members[starts[e]:starts[e + 1]]``.
    """

    nodes: NDArray
    cell: NDArray
    starts: NDArray
    members: NDArray

    def only(self, chosen: NDArray) -> Cells:
        """The same cells with the chosen points (n_points,) alone as their members."""
        kept = chosen[self.members]
        starts = np.concatenate([[0], np.cumsum(kept)])[self.starts]
        return self._replace(starts=starts, members=self.members[kept])


class ActiveGrid:
    """Cells that hold points, with rings of empty ones around them.

    Attributes
    ----------
    cells : with the points in them. n_nodes : nodes of the whole grid.
    places : of each cell in the grid (n_cells,).
    number : (2, nx, ny) number of the copies of each cell of the grid, -1 where it is not in use.
    numbered_for : (3, n_points) cells of the points when the cells were chosen.
    near_breaking : (n_cells,) cells that hold points which can break, and rings around them.
    shift : (2,) where the grid stands in this step, from its first place.
    """

    def __init__(self, grid: Grid, of_points: GridCells, breaking: NDArray) -> None:
        """For points in these cells, of which those of ``breaking`` (n_points,) can break."""
        self._grid, self._breaking, self.numbered_for = grid, breaking, np.array(of_points)
        around = _with_rings(grid, of_points.x, of_points.y)
        copy, x, y = np.nonzero([around, around & (grid.cut_by >= 0)])
        self.places = GridCells(x, y, copy)
        self.number = np.full((2, *grid.shape), -1, dtype=np.int64)
        self.number[copy, x, y] = np.arange(len(x))
        self.near_breaking = _with_rings(grid, of_points.x[breaking], of_points.y[breaking])[x, y]
        self._nodes, self.n_nodes = grid.cell_nodes(self.places), grid.n_nodes
        self.shift = np.zeros(2)
        self.sort_points(of_points)

    def holds(self, of_points: GridCells) -> bool:
        """Whether all points' cells are among these, and those of points that can break near where such points were."""
        cell = self._numbers(of_points)
        return bool((cell >= 0).all() and self.near_breaking[cell[self._breaking]].all())

    def sort_points(self, of_points: GridCells) -> None:
        """List the points of each cell, in the points' order."""
        cell = self._numbers(of_points)
        counts = np.bincount(cell, minlength=len(self._nodes))
        starts = np.concatenate([[0], np.cumsum(counts)])
        self.cells = Cells(self._nodes, cell, starts, np.argsort(cell, kind="stable"))

    def _numbers(self, of_points: GridCells) -> NDArray:
        return self.number[of_points.copy, of_points.x, of_points.y]

    @property
    def counts(self) -> NDArray:
        """Number of points (n_cells,) in each cell."""
        return np.diff(self.cells.starts)

    def nodes_of_points(self) -> NDArray:
        """Nodes (n_points, k) of each point's cell."""
        return self.cells.nodes[self.cells.cell]

    def corner_values(self, nodal: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Corners (4 n, 2), quads (n, 4) and a nodal scalar at the corners (4 n,) of the occupied cells.

        Each cell has its own corners, because the fields may jump across slits.
        """
        occupied = np.flatnonzero(self.counts)
        places = GridCells(*(part[occupied] for part in self.places))
        lines = [axis.breakpoints for axis in self._grid.axes]
        steps = ((0, 0), (1, 0), (1, 1), (0, 1))
        corners = np.stack([np.stack([lines[0][places.x + i], lines[1][places.y + j]], -1) for i, j in steps], axis=1)
        values = np.empty((len(occupied), 4))
        for corner in range(4):
            basis, _ = self._grid.evaluate(corners[:, corner], places)
            values[:, corner] = (basis * nodal[self._nodes[occupied]]).sum(axis=1)
        cells = np.arange(values.size).reshape(-1, 4)
        return corners.reshape(-1, 2) + self.shift, cells, values.ravel()


def _with_rings(grid: Grid, x: NDArray, y: NDArray) -> NDArray:
    """Mask (nx, ny) of the grid's cells at places in x and y, with rings around them."""
    occupied = np.zeros(grid.shape, bool)
    occupied[x, y] = True
    return binary_dilation(occupied, np.ones((3, 3), bool), iterations=RINGS)
