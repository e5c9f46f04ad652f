"""The displacement's equations of quasi-static finite elements."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cases import Case
from fem_reference.boundary import NodeConstraints
from fem_reference.element_basis import ElementBasis
from numerics.costs import Costs
from numerics.linear_solvers import lift_empty_diagonal, linear_solver
from numerics.sparse_pattern import LocalSystems, SymmetricPattern, gather_vector
from physics.exact import SOLUTIONS


class MeshEquilibrium:
    """Numbers, pattern and solver of the displacement's unknowns, 2 node + component.

    Attributes
    ----------
    constraints : which are prescribed or tied.
    local : tangents and internal forces of the elements, to be filled by compiled loops.
    external : (2 n_nodes,) body forces at unit load.
    """

    def __init__(self, case: Case, basis: ElementBasis, costs: Costs) -> None:
        self.constraints = NodeConstraints(case, basis.nodes)
        self._unknowns = (2 * basis.elements[:, :, None] + np.arange(2)).reshape(len(basis.elements), -1)
        self._pattern = SymmetricPattern(self.constraints.equations[self._unknowns], self.constraints.size)
        self._solver = linear_solver(self._pattern, costs)
        self.local = LocalSystems.empty(*self._unknowns.shape)
        self.external = self._body_forces(case, basis)

    @property
    def size(self) -> int:
        """Number of equations."""
        return self.constraints.size

    def _body_forces(self, case: Case, basis: ElementBasis) -> NDArray:
        """Nodal forces (2 n_nodes,) of the exact solution's body force at unit load."""
        size = 2 * len(basis.nodes)
        solution = SOLUTIONS.get(case.exact or "")
        if solution is None or solution.body_force is None:
            return np.zeros(size)
        density = solution.body_force(case, basis.gauss_points.reshape(-1, 2), 1.0)
        density = density.reshape(basis.gauss_points.shape) * basis.volume[..., None]
        return gather_vector(self._unknowns, np.einsum("qa,eqi->eai", basis.shape, density), size)

    def prescribe(self, displacement: NDArray, load: float) -> None:
        """Set what is prescribed of a displacement (n_nodes, 2), in place."""
        prescribed = self.constraints.prescribed
        displacement.reshape(-1)[prescribed] = self.constraints.prescribed_values(load)[prescribed]

    def unknowns_of(self, displacement: NDArray) -> NDArray:
        """Free unknowns (size,) of a displacement (n_nodes, 2)."""
        free = ~self.constraints.prescribed
        unknowns = np.zeros(self.size)
        unknowns[self.constraints.equations[free]] = displacement.reshape(-1)[free]
        return unknowns

    def spread(self, unknowns: NDArray, displacement: NDArray) -> None:
        """Set what is free of a displacement (n_nodes, 2), in place."""
        free = ~self.constraints.prescribed
        displacement.reshape(-1)[free] = unknowns[self.constraints.equations[free]]

    def nodal_forces(self, load: float) -> tuple[NDArray, float]:
        """Out-of-balance forces (2 n_nodes,) of the local ones, and the norm of what is applied."""
        external = load * self.external
        forces = gather_vector(self._unknowns, self.local.vectors, len(self.external)) - external
        return forces, float(np.linalg.norm(forces[self.constraints.prescribed]) + np.linalg.norm(external))

    def residual(self, nodal_forces: NDArray) -> NDArray:
        """Out-of-balance forces of the free unknowns (size,)."""
        return gather_vector(self.constraints.equations, nodal_forces, self.size)

    def tangent(self) -> NDArray:
        """Stored entries of the matrix of the local tangents."""
        return lift_empty_diagonal(self._pattern, self._pattern.gather(self.local.matrices))

    def solve(self, values: NDArray, right_side: NDArray) -> NDArray:
        """Solution (size,) for stored entries of the matrix."""
        return self._solver.solve(values, right_side)
