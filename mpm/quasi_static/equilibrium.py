"""The displacement's equations of quasi-static material points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from cases import Case
from mpm.quasi_static.active_grid import ActiveGrid
from mpm.quasi_static.constraints import NodeMotions, PointPenalty
from mpm.quasi_static.point_basis import PointBasis
from numerics.costs import Costs
from numerics.linear_solvers import lift_empty_diagonal, linear_solver
from numerics.sparse_pattern import LocalSystems, SymmetricPattern, gather_vector
from physics.exact import SOLUTIONS


class GridEquilibrium:
    """Numbers, pattern and solver of the unknowns of the nodes in use, 2 node + component, and of tied places.

    Attributes
    ----------
    size : number of equations.
    equations : (2 n_nodes,) number of each unknown of the grid, -1 where there is none.
    prescribed : (2 n_nodes,) those held at nodes.
    local : tangents and internal forces of the cells, to be filled by compiled loops.
    """

    def __init__(self, case: Case, active: ActiveGrid, nodes: NodeMotions, springs: PointPenalty, costs: Costs) -> None:
        size = 2 * active.n_nodes
        used = np.zeros(active.n_nodes, bool)
        used[active.cells.nodes.ravel()] = True
        self.prescribed, master = nodes.bind(size)
        free = np.repeat(used, 2) & ~self.prescribed
        leading = free & (master == np.arange(size))
        numbers = np.where(leading, np.cumsum(leading) - 1, -1)
        self.equations = np.where(free, numbers[master], -1).astype(np.int32)
        grid_size = int(leading.sum())
        self.size, self._n_tied = grid_size + springs.n_tied, springs.n_tied
        self._unknowns = (2 * active.cells.nodes[:, :, None] + np.arange(2)).reshape(len(active.cells.nodes), -1)
        extra = springs.coupling(self.equations, grid_size)
        self._pattern = SymmetricPattern(self.equations[self._unknowns], self.size, extra)
        self._solver = linear_solver(self._pattern, costs, case.mpm.linear_solver)
        self.local = LocalSystems.empty(*self._unknowns.shape)
        costs.count["pattern_builds"] += 1
        costs.count["unknowns_displacement"], costs.count["cells"] = self.size, len(self._unknowns)

    def unknowns_of(self, increment: NDArray, tied: NDArray) -> NDArray:
        """Unknowns (size,) of an increment (n_nodes, 2) on the grid and of tied places (n_tied,)."""
        unknowns, free = np.zeros(self.size), self.equations >= 0
        unknowns[self.equations[free]] = increment.reshape(-1)[free]
        unknowns[self.size - self._n_tied :] = tied
        return unknowns

    def spread(self, unknowns: NDArray, increment: NDArray) -> NDArray:
        """Set what is free of an increment (n_nodes, 2), in place; the displacements (n_tied,) of tied places."""
        free = self.equations >= 0
        increment.reshape(-1)[free] = unknowns[self.equations[free]]
        return unknowns[self.size - self._n_tied :].copy()

    def body_forces(self, case: Case, positions: NDArray, basis: PointBasis) -> NDArray:
        """Forces (2 n_nodes,) of the exact solution's body force on points (n_points, 2) at unit load."""
        solution = SOLUTIONS.get(case.exact or "")
        if solution is None or solution.body_force is None:
            return np.zeros(len(self.equations))
        forces = solution.body_force(case, positions, 1.0) * basis.values.volume[:, None]
        local = basis.values.value[:, :, None] * forces[:, None, :]
        return gather_vector(self._unknowns[basis.active.cells.cell], local, len(self.equations))

    def internal_forces(self) -> NDArray:
        """Forces (2 n_nodes,) of the local ones."""
        return gather_vector(self._unknowns, self.local.vectors, len(self.equations))

    def residual(self, nodal_forces: NDArray) -> NDArray:
        """Forces (2 n_nodes,) as those on the equations (size,)."""
        return gather_vector(self.equations, nodal_forces, self.size)

    def tangent(self, springs: PointPenalty) -> NDArray:
        """Stored entries of the matrix of the local tangents and the springs."""
        values = lift_empty_diagonal(self._pattern, self._pattern.gather(self.local.matrices))
        springs.add_stiffness(self._pattern, values)
        return values

    def solve(self, values: NDArray, right_side: NDArray) -> NDArray:
        """Solution (size,) for stored entries of the matrix."""
        return self._solver.solve(values, right_side)

    def seen_part(self, values: NDArray, cell: NDArray) -> csr_matrix:
        """Matrix of the unknowns that points in some cells (n_points,) see, and of tied places."""
        tied = np.arange(self.size - self._n_tied, self.size)
        seen = np.union1d(self.equations[self._unknowns[cell]], tied)
        seen = seen[seen >= 0]
        return self._pattern.full(values)[seen][:, seen]
