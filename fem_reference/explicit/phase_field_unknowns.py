"""Unknowns of the phase field of explicit finite elements, and how the rows of its equations meet.

A node has one unknown, or four of ``SmoothBasis`` where the material is of order 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cases import Case
from fem_reference.element_basis import ElementBasis
from fem_reference.phase_field_kernels import (
    ElementValues,
    fourth_order_systems,
    phase_field_systems,
    scalar_at_points,
    smooth_scalar_at_points,
)
from fem_reference.smooth_basis import SmoothBasis
from numerics.phase_field_equation import PhaseFieldTerms
from numerics.phase_field_window import fold
from numerics.sparse_pattern import LocalSystems
from physics.elasticity import MaterialTable
from physics.phase_field import PhaseFieldCoefficients


@dataclass
class PointValues:
    """The phase field at the Gauss points, all (n_el, n_gauss).

    ``value``, square of its gradient, and quadratic form of gamma with its second derivatives; ``solved_for`` is the
    history field that it was solved for, ``broken_at`` the time at which a point broke, NaN where it has not.
    """

    value: NDArray
    slope_squared: NDArray
    curvature_squared: NDArray
    solved_for: NDArray
    broken_at: NDArray

    @classmethod
    def intact(cls, shape: tuple[int, int]) -> PointValues:
        """Nothing is broken."""
        return cls(np.ones(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape), np.full(shape, np.nan))


class PhaseFieldUnknowns:
    """``places`` unknowns for each node, (places n_nodes,) in all: of the basis of the displacement, or of a smooth one
    where ``is_smooth``."""

    def __init__(self, case: Case, basis: ElementBasis, materials: MaterialTable) -> None:
        self._basis, self._coefficients = basis, PhaseFieldCoefficients(materials, basis.body)
        self.is_smooth, self.places, self._of_elements = bool(materials.fourth_order.any()), 1, basis.elements
        if self.is_smooth:
            self._smooth = SmoothBasis.of(case, basis, materials.curvature[basis.body])
            self._forms = self._smooth.forms(basis.volume)
            self.places, self._of_elements = SmoothBasis.PLACES, self._smooth.unknowns

    def spread(self, at_nodes: NDArray) -> NDArray:
        """Unknowns of values at the nodes (n_nodes,), with no slope there."""
        return self._smooth.spread(at_nodes) if self.is_smooth else at_nodes.copy()

    def at_nodes(self, nodal: NDArray) -> NDArray:
        """Values (n_nodes,) at the nodes."""
        return self._smooth.at_nodes(nodal) if self.is_smooth else nodal.copy()

    def equations(self, cells: NDArray, reaction: NDArray, nodal: NDArray) -> LocalSystems:
        """Matrices and residuals with their sign turned of the elements (m,), from the factor of c at their Gauss points
        (m, n_gauss)."""
        coefficients = self._coefficients
        systems = LocalSystems.empty(len(cells), self._of_elements.shape[1])
        terms = PhaseFieldTerms(
            reaction, coefficients.resistance[cells], coefficients.diffusion[cells], coefficients.bending[cells]
        )
        if self.is_smooth:
            volume = self._basis.volume[cells]
            fourth_order_systems(self._smooth.values(cells), self._forms, volume, terms, nodal, *systems)
        else:
            phase_field_systems(self._values(cells), terms, nodal, *systems)
        return systems

    def _values(self, cells: NDArray | slice) -> ElementValues:
        basis = self._basis
        return ElementValues(basis.elements[cells], basis.shape, basis.slope[cells], basis.volume[cells])

    def map(self, cells: NDArray | slice, nodal: NDArray, points: PointValues) -> None:
        """Write the phase field at the Gauss points of elements."""
        wholes = points.value, points.slope_squared, points.curvature_squared
        parts = [whole[cells] for whole in wholes]
        if self.is_smooth:
            smooth_scalar_at_points(self._smooth.values(cells), nodal, *parts)
        else:
            scalar_at_points(self._values(cells), nodal, *parts[:2])
        for whole, part in zip(wholes, parts, strict=True):
            whole[cells] = part


@dataclass
class WindowRows:
    """Equations of a window's nodes (n,), ``places`` rows for each node.

    near : (places n, s) row of each entry, places n for none. values : (places n, s). right_side : (places n,).
    """

    near: NDArray
    values: NDArray
    right_side: NDArray


class NodeRows:
    """Which nodes each node shares an element with, and where these stand in its rows.

    Attributes
    ----------
    own : (n_nodes,) where the node itself stands among its neighbours.
    """

    def __init__(self, elements: NDArray, n_nodes: int, places: int) -> None:
        self._elements, self._n_nodes, self._places = elements, n_nodes, places
        self._near, self.own, slots = _neighbours(elements, n_nodes)
        if places > 1:
            slots = np.repeat(_each_place(slots, places), places, axis=1)
        self._slots = slots.astype(np.uint16)

    def summed(self, cells: NDArray, nodes: NDArray, equations: LocalSystems) -> WindowRows:
        """Sum up the equations of elements (m,) for the nodes (n,) that they are solved for."""
        places, size = self._places, self._places * len(nodes)
        rows = np.full(self._n_nodes + 1, len(nodes), np.int32)
        rows[nodes] = np.arange(len(nodes), dtype=np.int32)
        near = np.repeat(np.minimum(_each_place(rows[self._near[nodes]], places), size), places, axis=0)
        rows_of_cells = np.minimum(_each_place(rows[self._elements[cells]], places), size).astype(np.uint32)
        # one row more stands for all nodes that do not take part
        values, right_side = np.zeros((size + 1, near.shape[1])), np.zeros(size + 1)
        fold(rows_of_cells, self._slots[cells], *equations, values, right_side)
        return WindowRows(near, values[:-1], right_side[:-1])


def _each_place(numbers: NDArray, places: int) -> NDArray:
    """Numbers (..., s) of nodes as those of their unknowns (..., places s)."""
    if places == 1:
        return numbers
    each = places * numbers[..., None] + np.arange(places, dtype=numbers.dtype)
    return each.reshape(*numbers.shape[:-1], -1)


def _neighbours(elements: NDArray, n_nodes: int) -> tuple[NDArray, NDArray, NDArray]:
    """Nodes (n_nodes, s) that share an element with each node, n_nodes where there are fewer; which of them is the node
    itself (n_nodes,); and which of them each corner is to each corner of an element (n_el, k, k)."""
    k = elements.shape[1]
    pairs = np.stack([np.repeat(elements, k, axis=1), np.tile(elements, k)], axis=-1).reshape(-1, 2).astype(np.int64)
    keys, entry = np.unique(pairs[:, 0] * n_nodes + pairs[:, 1], return_inverse=True)
    node, neighbour = np.divmod(keys, n_nodes)
    place = np.arange(len(keys)) - np.searchsorted(node, node)
    near = np.full((n_nodes, place.max() + 1), n_nodes, np.int32)
    near[node, place] = neighbour
    own = np.zeros(n_nodes, np.int64)
    own[node[node == neighbour]] = place[node == neighbour]
    return near, own, place[entry].reshape(-1, k, k)
