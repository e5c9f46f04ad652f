"""Unknowns of the phase field of explicit finite elements, and how the rows of its equations meet.

A node has one unknown, or four of ``SmoothBasis`` where the material is of order 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cases import Case
from fem_reference.element_basis import ElementBasis
from fem_reference.quasi_static import kernels
from fem_reference.smooth_basis import SmoothBasis
from numerics.phase_field_window import fold
from physics.elasticity import MaterialTable
from physics.phase_field import PhaseFieldCoefficients

#: matrices (m, k (k + 1) / 2), upper halves, and residuals with their sign turned (m, k) of elements
Equations = tuple[NDArray, NDArray]


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

    def equations(self, cells: NDArray, reaction: NDArray, nodal: NDArray) -> Equations:
        """Of the elements (m,), from the factor of c at their Gauss points (m, n_gauss)."""
        basis, of_elements = self._basis, self._of_elements[cells]
        resistance, diffusion = self._coefficients.resistance[cells], self._coefficients.diffusion[cells]
        local, out_of_balance = kernels.packed(of_elements.shape[1], len(cells)), np.empty(of_elements.shape)
        if self.is_smooth:
            kernels.fourth_order_matrices(
                of_elements, self._smooth.kind[cells], self._smooth.value, *self._forms, basis.volume[cells], reaction,
                resistance, diffusion, self._coefficients.bending[cells], nodal, local, out_of_balance,
            )  # fmt: skip
        else:
            kernels.phase_field_matrices(
                of_elements, basis.shape, basis.slope[cells], basis.volume[cells], reaction, resistance, diffusion, nodal,
                local, out_of_balance,
            )  # fmt: skip
        return local, out_of_balance

    def map(self, cells: NDArray | slice, nodal: NDArray, points: PointValues) -> None:
        """Write the phase field at the Gauss points of elements."""
        wholes = points.value, points.slope_squared, points.curvature_squared
        parts, basis = [whole[cells] for whole in wholes], self._basis
        if self.is_smooth:
            smooth = self._smooth
            kernels.smooth_scalar_at_points(
                smooth.unknowns[cells], smooth.kind[cells], smooth.value, smooth.slope, smooth.curvature, nodal, *parts
            )
        else:
            kernels.scalar_at_points(basis.elements[cells], basis.shape, basis.slope[cells], nodal, *parts[:2])
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
            slots = np.repeat(_each_place(slots, places), places, axis=1).astype(np.int8)
        self._slots = slots

    def summed(self, cells: NDArray, nodes: NDArray, equations: Equations) -> WindowRows:
        """Sum up the equations of elements (m,) for the nodes (n,) that they are solved for."""
        places, size = self._places, self._places * len(nodes)
        rows = np.full(self._n_nodes + 1, len(nodes), np.int32)
        rows[nodes] = np.arange(len(nodes), dtype=np.int32)
        near = np.repeat(np.minimum(_each_place(rows[self._near[nodes]], places), size), places, axis=0)
        rows_of_cells = np.minimum(_each_place(rows[self._elements[cells]], places), size)
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
