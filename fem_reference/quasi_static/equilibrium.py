"""Equilibrium of quasi-static finite elements."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.mesh_arrays import MeshArrays
from cases.notches import SlitNotch
from fem_reference.boundary import NodeConstraints
from fem_reference.element_basis import ElementBasis
from fem_reference.mesh.slits import face_pairs
from fem_reference.tractions import check_held_edges, traction_forces
from numerics.closing import ClosingFaces, Faces
from numerics.costs import Costs
from numerics.displacement_equations import DisplacementEquations
from numerics.sparse_pattern import gather_vector
from physics.acting import Acts, body_forces
from physics.elasticity import MaterialTable
from physics.exact import SOLUTIONS


class MeshEquilibrium(DisplacementEquations):
    """Equations of a mesh with its ``constraints`` and body forces."""

    def __init__(self, case: Case, basis: ElementBasis, costs: Costs) -> None:
        self.constraints = NodeConstraints(case, basis.nodes)
        check_held_edges(case, basis)
        self._closing = _closing_faces(case, basis)
        equations = self.constraints.equations
        extra = self._closing.coupling(equations)
        super().__init__(basis.elements, equations, self.constraints.size, costs, "direct", extra)
        self.external = self._external_forces(case, basis)

    def _external_forces(self, case: Case, basis: ElementBasis) -> Acts:
        """Nodal forces (2 n_nodes,) of tractions and body forces, that of the exact solution among these."""
        size, acts = 2 * len(basis.nodes), Acts(*(density[basis.body, None] for density in body_forces(case)))
        solution, following = SOLUTIONS.get(case.exact or ""), acts.following
        if solution is not None and solution.body_force is not None:
            exact = solution.body_force(case, basis.gauss_points.reshape(-1, 2), 1.0)
            following = following + exact.reshape(basis.gauss_points.shape)
        local = (np.einsum("qa,eq,eqi->eai", basis.shape, basis.volume, b + np.zeros_like(basis.gauss_points))
                 for b in (acts.constant, following))  # fmt: skip
        forces = Acts(*(gather_vector(self.unknowns, part, size) for part in local))
        self.loaded_edges = traction_forces(case, basis)
        for edge in self.loaded_edges:
            part = forces.following if edge.traction.follows_load else forces.constant
            part += edge.forces.reshape(-1)
        return forces

    def prescribe(self, displacement: NDArray, load: float) -> None:
        """Set what is prescribed of a displacement (n_nodes, 2), in place."""
        prescribed = self.constraints.prescribed
        displacement.reshape(-1)[prescribed] = self.constraints.prescribed_values(load)[prescribed]

    def nodal_forces(self, load: float, displacement: NDArray) -> tuple[NDArray, float]:
        """Out-of-balance forces (2 n_nodes,) of the local ones and of closed slits, and the norm of what is applied."""
        external = self.external.at(load)
        forces = self.internal_forces() + self._closing.forces(displacement) - external
        return forces, float(np.linalg.norm(forces[self.constraints.prescribed]) + np.linalg.norm(external))

    def norm_of_forces(self, basis: ElementBasis, stress: NDArray) -> float:
        """Norm of the nodal forces of stresses (n_el, 1, 3) of the elements: a scale where nothing else acts."""
        tensor = stress[..., [[0, 2], [2, 1]]]
        local = np.einsum("eq,eqai,ezij->eaj", basis.volume, basis.slope, tensor)
        return float(np.linalg.norm(gather_vector(self.unknowns, local, len(self.equations))))

    def tangent_at(self, displacement: NDArray) -> NDArray:
        """Stored entries of the matrix of the local tangents and of closed slits at a displacement (n_nodes, 2)."""
        values = self.tangent()
        self._closing.add_stiffness(self.pattern, values, self.equations, displacement)
        return values


def _closing_faces(case: Case, basis: ElementBasis) -> ClosingFaces:
    mesh = MeshArrays(basis.nodes, basis.elements.astype(np.int64), basis.body)
    slits = [notch for notch in case.all_notches if isinstance(notch, SlitNotch) and notch.contact]
    pairs = [face_pairs(mesh, slit) for slit in slits]
    faces = [
        Faces(nodes[:, :, None], np.ones((len(nodes), 1)), np.array([-slit.direction[1], slit.direction[0]]))
        for nodes, slit in zip(pairs, slits, strict=True)
    ]
    return ClosingFaces.of(case, faces, float(MaterialTable(case).stiffness.max()))
