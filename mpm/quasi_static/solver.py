"""Quasi-static phase-field Material Point Method (thesis Algorithm 1)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from cases import Case
from mpm.gaps import gap_health
from mpm.grid import Grid, GridCells
from mpm.placement import place_points, placement_health
from mpm.quasi_static import displacement_kernels as kernels
from mpm.quasi_static.active_grid import ActiveGrid
from mpm.quasi_static.built import check_built
from mpm.quasi_static.constraints import Supports, closing_faces, node_motions, point_penalty
from mpm.quasi_static.equilibrium import GridEquilibrium
from mpm.quasi_static.loads import PointLoads
from mpm.quasi_static.phase_field import GridPhaseField
from mpm.quasi_static.point_basis import PointBasis
from mpm.quasi_static.point_fields import fields_of
from mpm.quasi_static.point_state import Places, PointState, TrialState
from numerics.costs import Costs
from numerics.exact_errors import exact_errors
from numerics.fields import Fields
from numerics.newton import TORN_STIFFNESS, least_forces, newton
from numerics.staggered import LoadWork
from physics.acting import Acts, EigenstrainAtPoints
from physics.elasticity import MaterialTable
from physics.phase_field import PhaseFieldCoefficients, degradation, initial_history


class MaterialPoints:
    """Material points on a B-spline grid that is reset in every step; implements ``QuasiStaticDiscretisation``.

    Equilibrium is that of the whole stress at the points' present places, not of its increment, so that
    nothing is left unbalanced from step to step. The trial state is the increment of the grid's displacement.
    """

    def __init__(self, case: Case) -> None:
        self.case, self.costs = case, Costs()
        grid, cloud, materials = Grid(case), place_points(case), MaterialTable(case)
        self._law = materials.law, cloud.body.astype(np.uint32)
        self._least_forces = least_forces(case, materials.stiffness)
        self.basis = PointBasis(case, grid, cloud, materials)
        breaks = bool(materials.breakable.any())
        self.fracture = GridPhaseField(case, grid, materials, cloud.body, self.costs) if breaks else None
        self._supports = Supports(
            node_motions(case, grid), point_penalty(case, cloud, materials), closing_faces(case, grid, materials)
        )
        check_built(case, grid, cloud, self._supports)
        self._loads = PointLoads(case, grid, cloud)
        self._eigenstrain = EigenstrainAtPoints(case, materials, cloud.body)
        coefficients = PhaseFieldCoefficients(materials, cloud.body)
        self._residual_stiffness = coefficients.residual_stiffness
        self.state = PointState.first(
            cloud.positions,
            initial_history(case, cloud.positions, coefficients.toughness, coefficients.length_scale),
            self.fracture.first() if self.fracture else np.ones(grid.n_nodes),
            (len(self._supports.springs.places), self._supports.springs.n_tied),
            case.load.path[0],
        )
        self.trial = TrialState.of(self.state)
        self.costs.count["points"] = len(cloud.positions)

    def warm_up(self) -> None:
        """Compile every kernel, so that the clock times the work alone."""
        self.begin_step()
        self.solve_phase_field(self.history_field)
        unknowns = np.zeros(self.equilibrium.size)
        self.correction(unknowns, self.residual(unknowns)[0])
        self.costs.forget()

    @property
    def history_field(self) -> NDArray:
        """History field (n_points,) of the committed state [stress]."""
        return self.state.history_field

    @property
    def phase_field(self) -> NDArray:
        """Phase field (n_points,) of the trial state."""
        return self.trial.at_points.value

    @property
    def nodal_phase_field(self) -> NDArray:
        """The same at the grid's nodes (n_nodes,)."""
        return self.trial.nodal_phase_field

    def begin_step(self) -> None:
        """Reset the grid: active cells, basis at the points' present places, equations."""
        if not self.basis.is_current:
            with self.costs.timed("basis"):
                self._find_points_in_grid()
        self.trial.increment = np.zeros_like(self.state.so_far)
        self.trial.tied = self.state.tied.copy()

    def _find_points_in_grid(self) -> None:
        basis = self.basis
        if basis.find_points(self.state):
            self._use_cells(basis.active)
        if self.fracture:
            self.fracture.find_points(basis.active, basis.values)
        self._supports.springs.find_in_grid(basis, self.equilibrium.equations, self.equilibrium.size)
        self._external = self._loads.on_nodes(basis, self.equilibrium, self.state.positions)
        self._held_back = Acts(*(self.equilibrium.norm_of_forces(basis, stress) for stress in self._eigenstrain.stress))
        self.costs.count["active_cells"] = int(np.count_nonzero(basis.active.counts))

    def _use_cells(self, active: ActiveGrid) -> None:
        """Number the equations of the cells in use."""
        self.equilibrium = GridEquilibrium(self.case, active, self._supports, self.costs)
        if self.fracture:
            self.fracture.use_cells(active)

    def solve_phase_field(self, history_field: NDArray) -> NDArray:
        """Phase field at the points for a history field (n_points,), Eq. 4.16."""
        if not self.fracture:
            return self.phase_field
        with self.costs.timed("phase_field"):
            self.fracture.assemble(history_field, self.trial.nodal_phase_field)
            return self.set_phase_field(self.fracture.equation.corrected(self.trial.nodal_phase_field))

    def set_phase_field(self, nodal: NDArray) -> NDArray:
        """Phase field at the points for one at the grid's nodes (n_nodes,)."""
        self.trial.nodal_phase_field = nodal
        if self.fracture:
            self.fracture.map(nodal, self.trial.at_points)
        self.trial.degradation = degradation(self.trial.at_points.value, self._residual_stiffness)
        return self.phase_field.copy()

    def solve_displacement(self, load: float, tolerance: float) -> NDArray:
        """Tensile energy density (n_points,) in equilibrium at the load, Eq. 4.18."""
        newton(self, self.go_to(load), tolerance, self.case.staggered.residual_tolerance, self.costs)
        return self.tensile_energy()

    def go_to(self, load: float) -> NDArray:
        """Prescribe what a load does; unknowns (n,) of the displacement to begin with."""
        trial = self.trial
        trial.go_to(load, self.state.so_far)
        self._supports.nodes.prescribe(trial.increment, load, self.state.load)
        start = self.equilibrium.unknowns_of(trial.increment)
        start[self.equilibrium.tied] = trial.tied
        return start

    def tensile_energy(self) -> NDArray:
        """Tensile energy density (n_points,) of the trial state [stress]."""
        return self.trial.energy[:, 0].copy()

    def residual(self, unknowns: NDArray) -> tuple[NDArray, float]:
        """Out-of-balance forces of the free unknowns and the scale of the forces."""
        with self.costs.timed("assembly"):
            trial, equilibrium = self.trial, self.equilibrium
            equilibrium.spread(unknowns, trial.increment)
            trial.tied = unknowns[equilibrium.tied].copy()
            self._evaluate_stresses()
            kernels.internal_forces(self.basis.active.cells, self.basis.values, trial.stress, equilibrium.local.vectors)
            external, of_springs = self._external.at(trial.load), self._spring_forces()
            of_faces = self._supports.faces.forces(self.state.so_far + trial.increment)
            trial.nodal_forces = equilibrium.internal_forces() + of_faces - external
            residual = equilibrium.residual(trial.nodal_forces) + self._supports.springs.residual(of_springs)
            applied = np.linalg.norm(trial.nodal_forces[equilibrium.prescribed]) + np.linalg.norm(of_springs)
            trial.applied = float(applied + np.linalg.norm(external) + self._held_back.at(abs(trial.load)))
            least = self._least_forces * np.abs(trial.increment).max()
            return residual, max(self.state.force_scale, trial.applied, least)

    def _evaluate_stresses(self) -> None:
        trial, basis = self.trial, self.basis
        kernels.add_gradients(basis.active.cells, basis.values, trial.increment, self.state.gradient, trial.gradient)
        elastic = self._eigenstrain.elastic(trial.gradient, trial.load)
        kernels.stresses(elastic, trial.degradation, *self._law, trial.stress, trial.energy)

    def _spring_forces(self) -> NDArray:
        """Forces (n_springs,) of the penalty."""
        displacement = self._supports.springs.displaced(self.state.held, self.trial.increment)
        return self._supports.springs.forces(displacement, self.trial.load, self.trial.tied)

    def correction(self, unknowns: NDArray, residual: NDArray) -> NDArray:
        """Newton step -K^-1 R."""
        return self.equilibrium.solve(self.tangent(), -residual)

    def tangent(self) -> NDArray:
        """Stored entries of the consistent tangent K of the trial state (Eqs. 3.59, A.6)."""
        with self.costs.timed("assembly"):
            trial, basis, equilibrium = self.trial, self.basis, self.equilibrium
            stiffness = np.maximum(trial.degradation, TORN_STIFFNESS)
            elastic = self._eigenstrain.elastic(trial.gradient, trial.load)
            local = equilibrium.local.matrices
            kernels.tangents(basis.active.cells, basis.values, elastic, stiffness, *self._law, local)
            values, moved = equilibrium.tangent(), self.state.so_far + trial.increment
            self._supports.springs.add_stiffness(equilibrium.pattern, values)
            self._supports.faces.add_stiffness(equilibrium.pattern, values, equilibrium.equations, moved)
            return values

    def first_stiffness(self) -> csr_matrix:
        """Stiffness (n, n) [force/length] of the whole, unloaded body with its constraints, where points see the grid."""
        self.begin_step()
        self.trial.degradation = np.ones(len(self.phase_field))
        self.residual(np.zeros(self.equilibrium.size))
        return self.equilibrium.seen_part(self.tangent(), self.basis.active.cells.cell)

    def commit(self, history_field: NDArray) -> None:
        """Make the trial state the state and carry the points with it."""
        state, trial, springs = self.state, self.trial, self._supports.springs
        displacement = state.displacement + self.basis.displacement(trial.increment)
        held = springs.displaced(state.held, trial.increment)
        error = max(state.constraint_error, springs.constraint_error(held, trial.load, trial.tied))
        self.state = trial.committed(state, displacement, held)
        self.state.history_field, self.state.constraint_error = history_field, error
        if self.case.mpm.move_points:
            self.state.positions = state.positions + displacement - state.displacement
            self.basis.is_current = False
        trial.increment[:] = 0.0

    def undo(self) -> None:
        """Back to the last committed state."""
        trial, state = self.trial, self.state
        trial.increment[:] = 0.0
        trial.tied, trial.load = state.tied.copy(), state.load
        self.set_phase_field(state.nodal_phase_field)
        self._evaluate_stresses()

    def checkpoint(self) -> dict[str, NDArray]:
        """Arrays from which `restore` makes the last committed state again."""
        saved = {name: np.array(value) for name, value in vars(self.state).items()}
        return saved | {"numbered_for": self.basis.active.numbered_for}

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to the state of a checkpoint of the same case."""
        arrays = {name: saved[name] for name in vars(self.state)}
        values: dict[str, Any] = {name: array.copy() if array.ndim else float(array) for name, array in arrays.items()}
        self.basis.use_cells(GridCells(*saved["numbered_for"]))
        self._use_cells(self.basis.active)
        self._begin_with(PointState(**values))

    def take_over(self, other: MaterialPoints) -> None:
        """Begin with the committed state of ``other``, whose grid and points are others of the same bodies."""
        springs, places = self._supports.springs, self.basis.cloud.positions
        held = Places(places[springs.places] + springs.offset, springs.component)
        state = other.state.carried(other.basis.cloud.positions, self.state, held, self.basis.grid.nodes)
        if self.case.mpm.move_points:
            state.positions = places + state.displacement
        self._begin_with(state)

    def _begin_with(self, state: PointState) -> None:
        self.state, self.basis.is_current = state, False
        self.begin_step()
        self.undo()

    # ---------------------------------------------------------------- what can be seen

    def reaction_force(self, towards: float) -> float:
        """Force conjugate to the load parameter on its way: from the residual at prescribed nodes or the penalty."""
        load = self.trial.load
        of_springs = -float(self._spring_forces() @ self._supports.springs.rates(load, towards))
        return of_springs + self._supports.nodes.conjugate_force(self.trial.nodal_forces, load, towards)

    def work_of_loads(self) -> LoadWork:
        """Of tractions, body forces and eigenstrains since the last committed state."""
        moved = self.trial.increment.reshape(-1)
        constant, following = (float(forces @ moved) for forces in self._external)
        return LoadWork(constant, following, self._eigenstrain.heat(self.trial.stress, self.basis.values.volume))

    def energies(self) -> tuple[float, float]:
        """Elastic and fracture energy [energy] (Eq. 2.49)."""
        volume, fracture = self.basis.values.volume, self.fracture
        return float(self.energy_density @ volume), fracture.energy(self.trial.at_points, volume) if fracture else 0.0

    @property
    def energy_density(self) -> NDArray:
        """Degraded elastic energy density (n_points,) [stress]."""
        g = degradation(self.trial.at_points.value, self._residual_stiffness)
        return g * self.trial.energy[:, 0] + self.trial.energy[:, 1]

    def fields(self) -> Fields:
        """Points as they stand and the occupied cells of the grid."""
        return fields_of(self.state, self.trial, self.basis, self.energy_density)

    def measures(self) -> dict[str, float]:
        """Largest violation of the constraints, and errors against the exact solution where there is one."""
        errors = exact_errors(self.case, self.fields(), self.state.load) | self._loads.measures(self.basis, self.state)
        if len(self._supports.springs.places):
            errors["constraint_error"] = self.state.constraint_error
        return errors | placement_health(self.case, self.basis.cloud) | gap_health(self.case, self.basis.grid)
