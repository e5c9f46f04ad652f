"""The phase field of explicit finite elements."""

from __future__ import annotations

from collections.abc import Mapping

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
from numerics.linear_solvers import DirectSolver, direct_solver
from numerics.phase_field_equation import PhaseFieldTerms, ScalarAtPoints
from numerics.phase_field_window import BLOCK, RESIDUAL, Blocks, Window, conjugate_gradients, fold
from numerics.sparse_pattern import LocalSystems, RowPattern
from physics.elasticity import MaterialTable
from physics.phase_field import BROKEN, PhaseFieldCoefficients, crack_density


class ElementPhaseField:
    """Phase field of the nodes, its values ``at_points`` (n_el, n_gauss) and when these broke.

    Solved around the elements where it would change by more than ``staggered.tolerance``, and never in a body that
    cannot break. A node has one unknown, or four of ``SmoothBasis`` where the material is of order 4: ``nodal``
    (places n_nodes,).
    """

    def __init__(
        self, case: Case, basis: ElementBasis, materials: MaterialTable, constraints: NodeConstraints, costs: Costs
    ) -> None:
        self._basis, self._costs, self._tolerance = basis, costs, case.staggered.tolerance
        self._held = constraints.phase_prescribed
        self._coefficients = PhaseFieldCoefficients(materials, basis.body)
        breakable = materials.breakable[basis.body]
        self.is_solved = bool(breakable.any())
        self._set_unknowns(case, materials, constraints.phase_value)
        shape = basis.volume.shape
        self.at_points, self._slope_squared = np.ones(shape), np.zeros(shape)
        self._curvature_squared = np.zeros(shape)
        #: history field that the phase field was solved for (n_el, n_gauss)
        self.solved_for = np.zeros(shape)
        #: (n_el, n_gauss) time at which a point broke, NaN where it has not
        self.broken_at = np.full(shape, np.nan)
        if self.is_solved:
            size = BLOCK * float(materials.length_scale[materials.breakable].max())
            centres = basis.gauss_points.mean(axis=1)
            self._blocks = Blocks(centres, basis.elements, len(basis.nodes), breakable, size)
            sources = self._coefficients.resistance[:, None] * (basis.volume @ basis.shape)
            self._sources = np.bincount(basis.elements.ravel(), sources.ravel(), len(basis.nodes))
            self._near, self._own, self._slots = _neighbours(basis.elements, len(basis.nodes))
            if self._smooth:
                slots = _each_place(self._slots, self._places)
                self._slots = np.repeat(slots, self._places, axis=1).astype(np.int8)
        costs.count["unknowns_phase_field"] = len(self.nodal) if self.is_solved else 0

    def _set_unknowns(self, case: Case, materials: MaterialTable, phase_value: NDArray) -> None:
        """Unknowns of each element and their first values, from those of the nodes (n_nodes,)."""
        basis = self._basis
        self._smooth: SmoothBasis | None = None
        self._solver: DirectSolver | None = None
        self._solved_near = np.zeros((0, 0), np.int32)
        self._cells, self._places, self.nodal = basis.elements, 1, phase_value.copy()
        if materials.fourth_order.any():
            smooth = self._smooth = SmoothBasis.of(case, basis, materials.curvature[basis.body])
            self._forms = smooth.forms(basis.volume)
            self._cells, self._places, self.nodal = smooth.unknowns, smooth.PLACES, smooth.spread(phase_value)

    def solve(self, history_field: NDArray, change: NDArray, now: float) -> None:
        """Follow the history field (n_el, n_gauss) where a change (n_el,) of the phase field is expected, Eq. 4.16."""
        window = self._blocks.around(change, self._tolerance) if self.is_solved else None
        if window is not None:
            with self._costs.timed("phase_field"):
                self._solve_in(window, history_field, now)

    def _solve_in(self, window: Window, history_field: NDArray, now: float) -> None:
        systems = self._equations(window, history_field)
        nodes = window.nodes[~self._held[window.nodes]]
        correction, iterations = self._correction(window.cells, nodes, systems)
        self.nodal.reshape(-1, self._places)[nodes] += correction.reshape(-1, self._places)
        self._map(window.cells)
        self.solved_for[window.cells] = history_field[window.cells]
        broken_at = self.broken_at[window.cells]
        broken_at[np.isnan(broken_at) & (self.at_points[window.cells] < BROKEN)] = now
        self.broken_at[window.cells] = broken_at
        self._costs.count.update(phase_field_solves=1, cg_iterations=iterations, window_cells=len(window.cells))

    def _correction(self, cells: NDArray, nodes: NDArray, systems: LocalSystems) -> tuple[NDArray, int]:
        """Correction (places n,) at nodes (n,) from the equations of cells, and the number of iterations."""
        places, size = self._places, self._places * len(nodes)
        # one row more stands for all nodes that do not take part
        rows = np.full(len(self._held) + 1, len(nodes), np.int32)
        rows[nodes] = np.arange(len(nodes), dtype=np.int32)
        near = np.repeat(np.minimum(_each_place(rows[self._near[nodes]], places), size), places, axis=0)
        rows_of_cells = np.minimum(_each_place(rows[self._basis.elements[cells]], places), size)
        values, right_side = np.zeros((size + 1, near.shape[1])), np.zeros(size + 1)
        fold(rows_of_cells, self._slots[cells], *systems, values, right_side)
        if self._smooth:
            return self._direct(near).solve(values[:-1], right_side[:-1]), 0
        return conjugate_gradients(near, values[:-1], self._own[nodes], right_side[:-1], self._sources[nodes], RESIDUAL)

    def _direct(self, near: NDArray) -> DirectSolver:
        """Direct solver for rows (n, s). The bends make the matrix ill conditioned: iterations would be many, and a pull
        towards their start that bounds them would hold the phase field back."""
        if self._solver is None:
            self._solver = direct_solver(RowPattern(near), self._costs)
        elif not np.array_equal(near, self._solved_near):
            self._solver.take(RowPattern(near))
        self._solved_near = near
        return self._solver

    def _equations(self, window: Window, history_field: NDArray) -> LocalSystems:
        """Matrices and residuals with their sign turned of the window's elements."""
        cells, basis, coefficients = window.cells, self._basis, self._coefficients
        resistance = coefficients.resistance[cells]
        systems = LocalSystems.empty(len(cells), self._cells.shape[1])
        reaction = coefficients.drive[cells, None] * history_field[cells] + resistance[:, None]
        terms = PhaseFieldTerms(reaction, resistance, coefficients.diffusion[cells], coefficients.bending[cells])
        if self._smooth:
            smooth = self._smooth.values(cells)
            fourth_order_systems(smooth, self._forms, basis.volume[cells], terms, self.nodal, *systems)
        else:
            phase_field_systems(self._values(cells), terms, self.nodal, *systems)
        return systems

    def _values(self, cells: NDArray | slice) -> ElementValues:
        basis = self._basis
        return ElementValues(basis.elements[cells], basis.shape, basis.slope[cells], basis.volume[cells])

    def _map(self, cells: NDArray | slice) -> None:
        wholes = self.at_points, self._slope_squared, self._curvature_squared
        parts = ScalarAtPoints(*(whole[cells] for whole in wholes))
        if self._smooth:
            smooth_scalar_at_points(self._smooth.values(cells), self.nodal, *parts)
        else:
            scalar_at_points(self._values(cells), self.nodal, parts.value, parts.slope_squared)
        for whole, part in zip(wholes, parts, strict=True):
            whole[cells] = part

    def energy(self) -> float:
        """Fracture energy [energy] (Eq. 2.49)."""
        if not self.is_solved:
            return 0.0
        coefficients = self._coefficients
        length_scale = coefficients.length_scale[:, None]
        density = crack_density(self.at_points, self._slope_squared, length_scale, self._curvature_squared)
        return float((coefficients.toughness[:, None] * density * self._basis.volume).sum())

    def at_nodes(self) -> NDArray:
        """Phase field (n_nodes,) at the nodes."""
        return self._smooth.at_nodes(self.nodal) if self._smooth else self.nodal.copy()

    def checkpoint(self) -> dict[str, NDArray]:
        """Arrays from which `restore` makes the state again."""
        return {"nodal_phase_field": self.nodal, "solved_for": self.solved_for, "broken_at": self.broken_at}

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to a checkpoint."""
        self.nodal, self.solved_for = saved["nodal_phase_field"].copy(), saved["solved_for"].copy()
        self.broken_at = saved["broken_at"].copy()
        self._map(slice(None))


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
