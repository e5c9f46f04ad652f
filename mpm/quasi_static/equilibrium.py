"""Equilibrium of quasi-static material points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from cases import Case
from mpm.quasi_static.active_grid import ActiveGrid
from mpm.quasi_static.constraints import Supports
from mpm.quasi_static.displacement_kernels import internal_forces
from mpm.quasi_static.point_basis import PointBasis
from numerics.costs import Costs
from numerics.displacement_equations import DisplacementEquations


class GridEquilibrium(DisplacementEquations):
    """Equations of the nodes in use, and behind them those of the displacements of tied places.

    ``prescribed`` (2 n_nodes,) are the unknowns held at nodes.
    """

    def __init__(self, case: Case, active: ActiveGrid, supports: Supports, costs: Costs) -> None:
        springs = supports.springs
        n_unknowns = 2 * active.n_nodes
        used = np.zeros(active.n_nodes, bool)
        used[active.cells.nodes.ravel()] = True
        self.prescribed, master = supports.nodes.bind(n_unknowns)
        free = np.repeat(used, 2) & ~self.prescribed
        leading = free & (master == np.arange(n_unknowns))
        numbers = np.where(leading, np.cumsum(leading) - 1, -1)
        equations = np.where(free, numbers[master], -1).astype(np.int32)
        grid_size = int(leading.sum())
        pairs = (springs.coupling(equations, grid_size), supports.faces.coupling(equations))
        coupled = [pair for pair in pairs if pair is not None]
        extra = np.concatenate(coupled) if coupled else None
        #: equations of tied places
        self.tied = slice(grid_size, grid_size + springs.n_tied)
        super().__init__(active.cells.nodes, equations, self.tied.stop, costs, case.mpm.linear_solver, extra)
        costs.count["pattern_builds"] += 1
        costs.count["unknowns_displacement"], costs.count["cells"] = self.size, len(self.unknowns)

    def norm_of_forces(self, basis: PointBasis, stress: NDArray) -> float:
        """Norm of the nodal forces of stresses (n_points, 3): a scale where nothing else acts."""
        if not stress.any():
            return 0.0
        internal_forces(basis.active.cells, basis.values, stress, self.local.vectors)
        return float(np.linalg.norm(self.internal_forces()))

    def seen_part(self, values: NDArray, cell: NDArray) -> csr_matrix:
        """Matrix of the unknowns that points in some cells (n_points,) see, and of tied places."""
        seen = np.union1d(self.equations[self.unknowns[cell]], np.arange(self.size)[self.tied])
        seen = seen[seen >= 0]
        return self.pattern.full(values)[seen][:, seen]
