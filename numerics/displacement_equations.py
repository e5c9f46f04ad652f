"""Equilibrium's equations of a discretisation: numbers, pattern and solver of the displacement's unknowns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .costs import Costs
from .linear_solvers import lift_empty_diagonal, linear_solver
from .sparse_pattern import LocalSystems, SymmetricPattern, gather_vector


class DisplacementEquations:
    """Equations of unknowns 2 node + component.

    Parameters
    ----------
    cells : (n_cells, k) nodes of each cell.
    equations : (2 n_nodes,) number of each unknown's equation, -1 where it has none; tied ones share theirs.
    size : number of equations. extra : (m, 2) pairs of them that couple beyond the cells.
    solver : name of the linear solver.
    """

    def __init__(
        self, cells: NDArray, equations: NDArray, size: int, costs: Costs, solver: str, extra: NDArray | None = None
    ) -> None:
        self.equations, self.size = equations, size
        self.unknowns = (2 * cells[:, :, None] + np.arange(2)).reshape(len(cells), -1)
        self.pattern = SymmetricPattern(equations[self.unknowns], size, extra)
        #: of the equations' matrix
        self.solver = linear_solver(self.pattern, costs, solver)
        #: tangents and internal forces of the cells, to be filled by compiled loops
        self.local = LocalSystems.empty(*self.unknowns.shape)

    def unknowns_of(self, displacement: NDArray) -> NDArray:
        """Free unknowns (size,) of a displacement (n_nodes, 2)."""
        unknowns, free = np.zeros(self.size), self.equations >= 0
        unknowns[self.equations[free]] = displacement.reshape(-1)[free]
        return unknowns

    def spread(self, unknowns: NDArray, displacement: NDArray) -> None:
        """Set what is free of a displacement (n_nodes, 2), in place."""
        free = self.equations >= 0
        displacement.reshape(-1)[free] = unknowns[self.equations[free]]

    def internal_forces(self) -> NDArray:
        """Forces (2 n_nodes,) of the local ones."""
        return gather_vector(self.unknowns, self.local.vectors, len(self.equations))

    def residual(self, nodal_forces: NDArray) -> NDArray:
        """Forces (2 n_nodes,) as those on the equations (size,)."""
        return gather_vector(self.equations, nodal_forces, self.size)

    def tangent(self) -> NDArray:
        """Stored entries of the matrix of the local tangents."""
        return lift_empty_diagonal(self.pattern, self.pattern.gather(self.local.matrices))

    def solve(self, values: NDArray, right_side: NDArray) -> NDArray:
        """Solution (size,) for stored entries of the matrix."""
        return self.solver.solve(values, right_side)
