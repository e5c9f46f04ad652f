"""The phase field of explicit finite elements."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cases import Case
from fem_reference.boundary import NodeConstraints
from fem_reference.element_basis import ElementBasis
from fem_reference.explicit.phase_field_unknowns import NodeRows, PhaseFieldUnknowns, PointValues, WindowRows
from numerics.costs import Costs
from numerics.linear_solvers import DirectSolver, direct_solver
from numerics.phase_field_window import RESIDUAL, Blocks, Window, conjugate_gradients
from numerics.sparse_pattern import RowPattern
from physics.elasticity import MaterialTable
from physics.phase_field import PhaseFieldCoefficients, breaks_now, crack_density


class ElementPhaseField:
    """Phase field of a mesh in motion.

    Solved around the elements where it would change by more than ``staggered.tolerance``, and never in a body that
    cannot break.

    Attributes
    ----------
    points : its values at the Gauss points and when these broke.
    nodal : (places n_nodes,) its unknowns.
    """

    def __init__(
        self, case: Case, basis: ElementBasis, materials: MaterialTable, constraints: NodeConstraints, costs: Costs
    ) -> None:
        self._basis, self._costs, self._tolerance = basis, costs, case.staggered.tolerance
        self._held = constraints.phase_prescribed
        self._coefficients = PhaseFieldCoefficients(materials, basis.body)
        breakable = materials.breakable[basis.body]
        self._is_solved = bool(breakable.any())
        self.points = PointValues.intact(basis.volume.shape)
        self._unknowns = PhaseFieldUnknowns(case, basis, materials)
        self._direct = _DirectSolution(costs) if self._unknowns.is_smooth else None
        self.nodal = self._unknowns.spread(constraints.phase_value)
        if self._is_solved:
            length_scale = float(materials.length_scale[materials.breakable].max())
            centres, n_nodes = basis.gauss_points.mean(axis=1), len(basis.nodes)
            self._blocks = Blocks(centres, basis.elements, n_nodes, breakable, length_scale)
            sources = self._coefficients.resistance[:, None] * (basis.volume @ basis.shape)
            self._sources = np.bincount(basis.elements.ravel(), sources.ravel(), n_nodes)
            self._rows = NodeRows(basis.elements, n_nodes, self._unknowns.places)
        costs.count["unknowns_phase_field"] = len(self.nodal) if self._is_solved else 0

    def solve(self, history_field: NDArray, change: NDArray, now: float) -> None:
        """Follow the history field (n_el, n_gauss) where a change (n_el,) of the phase field is expected, Eq. 4.16."""
        window = self._blocks.around(change, self._tolerance) if self._is_solved else None
        if window is not None:
            with self._costs.timed("phase_field"):
                self._solve_in(window, history_field, now)

    def _solve_in(self, window: Window, history_field: NDArray, now: float) -> None:
        cells, points, coefficients = window.cells, self.points, self._coefficients
        reaction = coefficients.drive[cells, None] * history_field[cells] + coefficients.resistance[cells, None]
        equations = self._unknowns.equations(cells, reaction, self.nodal)
        nodes = window.nodes[~self._held[window.nodes]]
        correction, iterations = self._correction(nodes, self._rows.summed(cells, nodes, equations))
        places = self._unknowns.places
        self.nodal.reshape(-1, places)[nodes] += correction.reshape(-1, places)
        self._unknowns.map(cells, self.nodal, points)
        points.solved_for[cells] = history_field[cells]
        broken_at = points.broken_at[cells]
        broken_at[breaks_now(points.value[cells], broken_at)] = now
        points.broken_at[cells] = broken_at
        self._costs.count.update(phase_field_solves=1, cg_iterations=iterations, window_cells=len(cells))

    def _correction(self, nodes: NDArray, rows: WindowRows) -> tuple[NDArray, int]:
        """Correction (places n,) of the unknowns of nodes (n,), and the number of iterations."""
        if self._direct:
            return self._direct.of(rows), 0
        sources = self._sources[nodes]
        return conjugate_gradients(rows.near, rows.values, self._rows.own[nodes], rows.right_side, sources, RESIDUAL)

    def energy(self) -> float:
        """Fracture energy [energy] (Eq. 2.49)."""
        if not self._is_solved:
            return 0.0
        coefficients, points = self._coefficients, self.points
        length_scale = coefficients.length_scale[:, None]
        density = crack_density(points.value, points.slope_squared, length_scale, points.curvature_squared)
        return float((coefficients.toughness[:, None] * density * self._basis.volume).sum())

    def at_nodes(self) -> NDArray:
        """Phase field (n_nodes,) at the nodes."""
        return self._unknowns.at_nodes(self.nodal)

    def checkpoint(self) -> dict[str, NDArray]:
        """Arrays from which `restore` makes the state again."""
        points = self.points
        return {"nodal_phase_field": self.nodal, "solved_for": points.solved_for, "broken_at": points.broken_at}

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to a checkpoint."""
        self.nodal = saved["nodal_phase_field"].copy()
        self.points.solved_for, self.points.broken_at = saved["solved_for"].copy(), saved["broken_at"].copy()
        self._unknowns.map(slice(None), self.nodal, self.points)


class _DirectSolution:
    """Direct solution of the rows of windows, factored once more where other nodes take part.

    The bends make the matrix ill conditioned: iterations would be many, and a pull towards their start that bounds them
    would hold the phase field back.
    """

    def __init__(self, costs: Costs) -> None:
        self._costs = costs
        self._solver: DirectSolver | None = None
        self._near = np.zeros((0, 0), np.int32)

    def of(self, rows: WindowRows) -> NDArray:
        """Solution (n,) of the rows."""
        if self._solver is None:
            self._solver = direct_solver(RowPattern(rows.near), self._costs)
        elif not np.array_equal(rows.near, self._near):
            self._solver.take(RowPattern(rows.near))
        self._near = rows.near
        return self._solver.solve(rows.values, rows.right_side)
