"""The phase field of quasi-static finite elements."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cases import Case
from fem_reference.boundary import NodeConstraints
from fem_reference.element_basis import ElementBasis
from fem_reference.phase_field_kernels import (
    ElementValues,
    fourth_order_systems,
    phase_field_systems,
    scalar_at_points,
    smooth_scalar_at_points,
)
from fem_reference.smooth_basis import SmoothBasis
from numerics.costs import Costs
from numerics.phase_field_equation import PhaseFieldEquation, PhaseFieldTerms, ScalarAtPoints
from numerics.sparse_pattern import LocalSystems
from physics.elasticity import MaterialTable
from physics.phase_field import PhaseFieldCoefficients


class MeshPhaseField:
    """Phase field of the elements of bodies that can break: one unknown for a node, or four of ``SmoothBasis``.

    It ends where such a body ends, without flux, whatever the body is bonded to; elsewhere it is 1.
    """

    def __init__(
        self, case: Case, basis: ElementBasis, materials: MaterialTable, constraints: NodeConstraints, costs: Costs
    ) -> None:
        breakable = materials.breakable[basis.body]
        self._elements: NDArray | slice = slice(None) if breakable.all() else np.flatnonzero(breakable)
        self._nodes, self._shape = basis.elements[self._elements], basis.shape
        # one value per element, as a column so that it spreads over the Gauss points
        self._coefficients = PhaseFieldCoefficients(materials, basis.body[self._elements, None])
        self.measure_on(basis.slope, basis.volume)
        free = np.zeros(len(basis.nodes), bool)
        free[self._nodes] = True
        free &= ~constraints.phase_prescribed
        self._smooth: SmoothBasis | None = None
        cells, self._first = self._nodes, constraints.phase_value
        if materials.fourth_order.any():
            self._smooth = smooth = SmoothBasis.of(case, basis, materials.curvature[basis.body])
            self._forms, self._smooth_values = smooth.forms(basis.volume), smooth.values(self._elements)
            cells, free, self._first = self._smooth_values.unknowns, smooth.spread(free), smooth.spread(self._first)
        self.equation = PhaseFieldEquation(cells, free, costs, bool(materials.is_linear.any()))

    def measure_on(self, slope: NDArray, volume: NDArray) -> None:
        """Take slopes (n_el, n_gauss, k, 2) and volumes (n_el, n_gauss) of the mesh as it stands."""
        self._values = ElementValues(self._nodes, self._shape, slope[self._elements], volume[self._elements])

    def first(self) -> NDArray:
        """Unknowns (n_unknowns,) of whole material with what is prescribed."""
        return self._first.copy()

    def assemble(self, history_field: NDArray, nodal: NDArray) -> None:
        """Fill the equation's systems for a history field (n_points,) at unknowns (n_unknowns,), Eq. 4.16."""
        self._fill(history_field, nodal, self.equation.systems)

    def assemble_residual(self, history_field: NDArray, nodal: NDArray) -> None:
        """The same without the matrices."""
        self._fill(history_field, nodal, self.equation.systems.without_matrices)

    def _fill(self, history_field: NDArray, nodal: NDArray, systems: LocalSystems) -> None:
        history_field = history_field.reshape(-1, self._values.volume.shape[1])
        coefficients = self._coefficients
        columns = coefficients.resistance, coefficients.diffusion, coefficients.bending
        reaction = coefficients.reaction(history_field[self._elements])
        terms = PhaseFieldTerms(reaction, *(column[:, 0] for column in columns))
        if self._smooth:
            fourth_order_systems(self._smooth_values, self._forms, self._values.volume, terms, nodal, *systems)
        else:
            phase_field_systems(self._values, terms, nodal, *systems)

    def map(self, nodal: NDArray, at_points: ScalarAtPoints) -> None:
        """Fill in the values at the Gauss points (n_el, n_gauss) of the elements that can break."""
        parts = ScalarAtPoints(*(whole[self._elements] for whole in at_points))
        if self._smooth:
            smooth_scalar_at_points(self._smooth_values, nodal, *parts)
        else:
            scalar_at_points(self._values, nodal, parts.value, parts.slope_squared)
        for whole, part in zip(at_points, parts, strict=True):
            whole[self._elements] = part

    def energy(self, at_points: ScalarAtPoints) -> float:
        """Fracture energy [energy] (Eq. 2.49)."""
        value, slope_squared, curvature_squared = (whole[self._elements] for whole in at_points)
        density = self._coefficients.energy_density(value, slope_squared, curvature_squared)
        return float((density * self._values.volume).sum())

    def at_nodes(self, nodal: NDArray) -> NDArray:
        """Phase field (n_nodes,) at the nodes."""
        return self._smooth.at_nodes(nodal) if self._smooth else nodal.copy()
