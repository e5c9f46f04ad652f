"""The phase field of explicit finite elements."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cases import Case
from numerics.costs import Costs
from numerics.phase_field_window import BLOCK, RESIDUAL, Blocks, Window, conjugate_gradients, fold
from physics.elasticity import MaterialTable
from physics.phase_field import BROKEN, PhaseFieldCoefficients, crack_density

from . import kernels
from .boundary import NodeConstraints
from .element_basis import ElementBasis


class ElementPhaseField:
    """Nodal phase field (n_nodes,), its values ``at_points`` (n_el, n_gauss) and when these broke.

    Solved around the elements where it would change by more than ``staggered.tolerance``, and never in a body that
    cannot break.
    """

    def __init__(
        self, case: Case, basis: ElementBasis, materials: MaterialTable, constraints: NodeConstraints, costs: Costs
    ) -> None:
        self._basis, self._costs, self._tolerance = basis, costs, case.staggered.tolerance
        self._held = constraints.phase_prescribed
        self._coefficients = PhaseFieldCoefficients(materials, basis.body)
        breakable = materials.breakable[basis.body]
        self.is_solved = bool(breakable.any())
        shape = basis.volume.shape
        self.nodal = constraints.phase_value.copy()
        self.at_points, self._slope_squared = np.ones(shape), np.zeros(shape)
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
        costs.count["unknowns_phase_field"] = len(basis.nodes) if self.is_solved else 0

    def solve(self, history_field: NDArray, change: NDArray, now: float) -> None:
        """Follow the history field (n_el, n_gauss) where a change (n_el,) of the phase field is expected, Eq. 4.16."""
        window = self._blocks.around(change, self._tolerance) if self.is_solved else None
        if window is not None:
            with self._costs.timed("phase_field"):
                self._solve_in(window, history_field, now)

    def _solve_in(self, window: Window, history_field: NDArray, now: float) -> None:
        local, out_of_balance = self._equations(window, history_field)
        nodes = window.nodes[~self._held[window.nodes]]
        # one row more stands for all nodes that do not take part
        rows = np.full(len(self.nodal) + 1, len(nodes), np.int32)
        rows[nodes] = np.arange(len(nodes), dtype=np.int32)
        values, right_side = np.zeros((len(nodes) + 1, self._near.shape[1])), np.zeros(len(nodes) + 1)
        cells = window.cells
        fold(rows[self._basis.elements[cells]], self._slots[cells], local, out_of_balance, values, right_side)
        near = rows[self._near[nodes]]
        correction, iterations = conjugate_gradients(
            near, values[:-1], self._own[nodes], right_side[:-1], self._sources[nodes], RESIDUAL
        )
        self.nodal[nodes] += correction
        self._map(window.cells)
        self.solved_for[window.cells] = history_field[window.cells]
        broken_at = self.broken_at[window.cells]
        broken_at[np.isnan(broken_at) & (self.at_points[window.cells] < BROKEN)] = now
        self.broken_at[window.cells] = broken_at
        self._costs.count.update(phase_field_solves=1, cg_iterations=iterations, window_cells=len(window.cells))

    def _equations(self, window: Window, history_field: NDArray) -> tuple[NDArray, NDArray]:
        """Matrices (m, k (k + 1) / 2) and residuals with their sign turned (m, k) of the window's elements."""
        cells, basis, coefficients = window.cells, self._basis, self._coefficients
        local = kernels.packed(basis.elements.shape[1], len(cells))
        out_of_balance = np.empty((len(cells), basis.elements.shape[1]))
        reaction = coefficients.drive[cells, None] * history_field[cells] + coefficients.resistance[cells, None]
        kernels.phase_field_matrices(
            basis.elements[cells], basis.shape, basis.slope[cells], basis.volume[cells], reaction,
            coefficients.resistance[cells], coefficients.diffusion[cells], self.nodal, local, out_of_balance,
        )  # fmt: skip
        return local, out_of_balance

    def _map(self, cells: NDArray | slice) -> None:
        value, slope_squared = self.at_points[cells], self._slope_squared[cells]
        basis = self._basis
        kernels.scalar_at_points(
            basis.elements[cells], basis.shape, basis.slope[cells], self.nodal, value, slope_squared
        )
        self.at_points[cells], self._slope_squared[cells] = value, slope_squared

    def energy(self) -> float:
        """Fracture energy [energy] (Eq. 2.49)."""
        if not self.is_solved:
            return 0.0
        coefficients = self._coefficients
        density = crack_density(self.at_points, self._slope_squared, coefficients.length_scale[:, None])
        return float((coefficients.toughness[:, None] * density * self._basis.volume).sum())

    def checkpoint(self) -> dict[str, NDArray]:
        """Arrays from which `restore` makes the state again."""
        return {"nodal_phase_field": self.nodal, "solved_for": self.solved_for, "broken_at": self.broken_at}

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to a checkpoint."""
        self.nodal, self.solved_for = saved["nodal_phase_field"].copy(), saved["solved_for"].copy()
        self.broken_at = saved["broken_at"].copy()
        self._map(slice(None))


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
