"""The mesh of a case with the values of its basis at the Gauss points."""

from __future__ import annotations

import numpy as np
import skfem
from numpy.typing import NDArray

from cases import Case
from cases.mesh_arrays import kinds_of
from fem_reference.mesh.build import build_mesh
from physics.elasticity import MaterialTable


class ElementBasis:
    """Bilinear quads with 2x2 Gauss points, or linear triangles with 3; quads with 3x3 where ``fourth_order``.

    Attributes
    ----------
    mesh : of scikit-fem.
    nodes : (n_nodes, 2) [length]. elements : (n_el, k) corners.
    body : (n_el,) number of the body.
    shape : (n_gauss, k) shape functions; slope : (n_el, n_gauss, k, 2) their gradients [1/length].
    reference_points : (2, n_gauss) Gauss points in the unit element.
    volume : (n_el, n_gauss) weight times thickness. gauss_points : (n_el, n_gauss, 2) [length].
    """

    def __init__(self, case: Case, fourth_order: bool = False) -> None:
        built = build_mesh(case)
        self.mesh, self.body = built.mesh, built.body
        self.nodes = np.ascontiguousarray(built.mesh.p.T)
        self.elements = np.ascontiguousarray(built.mesh.t.T.astype(np.int32))
        element = skfem.ElementQuad1() if isinstance(built.mesh, skfem.MeshQuad) else skfem.ElementTriP1()
        basis = skfem.Basis(built.mesh, element, intorder=5 if fourth_order else 2)
        self.reference_points = basis.X
        fields = [local[0] for local in basis.basis]
        self.shape = np.array([np.asarray(f)[0] for f in fields]).T.copy()
        self.slope = np.ascontiguousarray(np.stack([f.grad for f in fields]).transpose(2, 3, 0, 1))
        self.volume = np.ascontiguousarray(basis.dx) * case.plane.thickness
        self.gauss_points = np.einsum("qa,eai->eqi", self.shape, self.nodes[self.elements])

    def stable_step(self, table: MaterialTable) -> float:
        """Largest step of explicit integration that no element alone makes unstable [time]."""
        body = self.body
        bounds = [self.largest_eigenvalue(lam[body], mu[body], table.density[body]) for lam, mu in table.stiffest]
        return 2.0 / float(np.sqrt(max(bounds)))

    def largest_eigenvalue(self, lam: NDArray, mu: NDArray, density: NDArray) -> float:
        """Bound of the largest eigenvalue of M^-1 K with row-sum mass: that of an element alone [1/time²].

        lam, mu : (n_el,) in-plane Lamé constants [stress]. density : (n_el,) [force time²/length⁴].
        """
        alike = np.column_stack([self.slope.reshape(len(self.slope), -1), self.volume, lam, mu, density])
        kinds, _ = kinds_of(alike, digits=9)
        mass = np.einsum("qa,eq->ea", self.shape, self.volume[kinds]) * density[kinds, None]
        root = 1.0 / np.sqrt(np.repeat(mass, 2, axis=1))
        stiffness = self._stiffness(kinds, lam[kinds], mu[kinds])
        return float(np.linalg.eigvalsh(root[:, :, None] * stiffness * root[:, None, :]).max())

    def _stiffness(self, chosen: NDArray, lam: NDArray, mu: NDArray) -> NDArray:
        """Intact element matrices (n, 2k, 2k) of the chosen elements."""
        slope, volume = self.slope[chosen], self.volume[chosen]
        n, n_gauss, k, _ = slope.shape
        strain = np.zeros((n, n_gauss, 3, k, 2))
        strain[:, :, 0, :, 0] = strain[:, :, 2, :, 1] = slope[..., 0]
        strain[:, :, 1, :, 1] = strain[:, :, 2, :, 0] = slope[..., 1]
        strain = strain.reshape(n, n_gauss, 3, 2 * k)
        law = np.zeros((n, 3, 3))
        law[:, 0, 0] = law[:, 1, 1] = lam + 2.0 * mu
        law[:, 0, 1] = law[:, 1, 0] = lam
        law[:, 2, 2] = mu
        return np.einsum("eqsi,est,eqtj,eq->eij", strain, law, strain, volume)
