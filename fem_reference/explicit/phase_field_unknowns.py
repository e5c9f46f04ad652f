"""Unknowns of the phase field of explicit finite elements, and how the rows of its equations meet.

A node has one unknown, or four of ``SmoothBasis`` where the material is of order 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fem_reference.element_basis import ElementBasis
from fem_reference.quasi_static import kernels
from fem_reference.smooth_basis import SmoothBasis
from numerics.phase_field_window import fold
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


class Unknowns(Protocol):
    """``places`` unknowns (places n_nodes,) for each node."""

    places: int

    def spread(self, at_nodes: NDArray) -> NDArray:
        """Unknowns of values at the nodes (n_nodes,)."""

    def at_nodes(self, nodal: NDArray) -> NDArray:
        """Values (n_nodes,) at the nodes."""

    def equations(self, cells: NDArray, reaction: NDArray, nodal: NDArray) -> Equations:
        """Matrices (m, k (k + 1) / 2) and residuals with their sign turned (m, k) of elements (m,)."""

    def map(self, cells: NDArray | slice, nodal: NDArray, points: PointValues) -> None:
        """Write the phase field at the Gauss points of elements."""


class BilinearUnknowns:
    """One unknown for each node: the shape functions of the displacement."""

    places = 1

    def __init__(self, basis: ElementBasis, coefficients: PhaseFieldCoefficients) -> None:
        self._basis, self._coefficients = basis, coefficients

    def spread(self, at_nodes: NDArray) -> NDArray:
        """The values themselves."""
        return at_nodes.copy()

    def at_nodes(self, nodal: NDArray) -> NDArray:
        """The unknowns themselves."""
        return nodal.copy()

    def equations(self, cells: NDArray, reaction: NDArray, nodal: NDArray) -> Equations:
        """As of `Unknowns`."""
        basis, coefficients, nodes = self._basis, self._coefficients, self._basis.elements[cells]
        local, out_of_balance = kernels.packed(nodes.shape[1], len(cells)), np.empty(nodes.shape)
        kernels.phase_field_matrices(
            nodes, basis.shape, basis.slope[cells], basis.volume[cells], reaction, coefficients.resistance[cells],
            coefficients.diffusion[cells], nodal, local, out_of_balance,
        )  # fmt: skip
        return local, out_of_balance

    def map(self, cells: NDArray | slice, nodal: NDArray, points: PointValues) -> None:
        """As of `Unknowns`."""
        basis, value, slope_squared = self._basis, points.value[cells], points.slope_squared[cells]
        kernels.scalar_at_points(basis.elements[cells], basis.shape, basis.slope[cells], nodal, value, slope_squared)
        points.value[cells], points.slope_squared[cells] = value, slope_squared


class SmoothUnknowns:
    """Four unknowns for each node: a basis with continuous slopes."""

    places = SmoothBasis.PLACES

    def __init__(self, basis: ElementBasis, coefficients: PhaseFieldCoefficients, smooth: SmoothBasis) -> None:
        self._volume, self._coefficients, self._smooth = basis.volume, coefficients, smooth
        self._forms = smooth.forms(basis.volume)

    def spread(self, at_nodes: NDArray) -> NDArray:
        """Unknowns of values with no slope at the nodes."""
        return self._smooth.spread(at_nodes)

    def at_nodes(self, nodal: NDArray) -> NDArray:
        """As of `Unknowns`."""
        return self._smooth.at_nodes(nodal)

    def equations(self, cells: NDArray, reaction: NDArray, nodal: NDArray) -> Equations:
        """As of `Unknowns`."""
        smooth, coefficients, unknowns = self._smooth, self._coefficients, self._smooth.unknowns[cells]
        local, out_of_balance = kernels.packed(unknowns.shape[1], len(cells)), np.empty(unknowns.shape)
        kernels.fourth_order_matrices(
            unknowns, smooth.kind[cells], smooth.value, *self._forms, self._volume[cells], reaction,
            coefficients.resistance[cells], coefficients.diffusion[cells], coefficients.bending[cells], nodal, local,
            out_of_balance,
        )  # fmt: skip
        return local, out_of_balance

    def map(self, cells: NDArray | slice, nodal: NDArray, points: PointValues) -> None:
        """As of `Unknowns`."""
        smooth, parts = self._smooth, (points.value, points.slope_squared, points.curvature_squared)
        found = [part[cells] for part in parts]
        kernels.smooth_scalar_at_points(
            smooth.unknowns[cells], smooth.kind[cells], smooth.value, smooth.slope, smooth.curvature, nodal, *found
        )
        for part, values in zip(parts, found, strict=True):
            part[cells] = values


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
