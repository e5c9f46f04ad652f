"""Quasi-static phase-field Material Point Method (thesis Algorithm 1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from cases import Case
from mpm.grid import Grid, GridError
from mpm.placement import place_points
from mpm.quasi_static import kernels
from mpm.quasi_static.active_grid import ActiveGrid
from mpm.quasi_static.constraints import Motion, PointPenalty, PointsOn, displacement_motions, nodes_on
from mpm.quasi_static.integration import Rectangles, integrate_cells
from numerics.costs import Costs
from numerics.exact_errors import exact_errors
from numerics.fields import Fields
from numerics.linear_solvers import keep_barely_seen, lift_empty_diagonal, linear_solver
from numerics.newton import TORN_STIFFNESS, load_ratio, newton
from numerics.refinement import carried
from numerics.sparse_pattern import SymmetricPattern, gather_vector
from physics.elasticity import MaterialTable
from physics.exact import SOLUTIONS
from physics.phase_field import PhaseFieldCoefficients, crack_density, degradation, initial_history

#: below this phase field, material tears: its own deformation means less and less
TORN_PHASE_FIELD = 0.4
#: and no more than this much of it is taken, so that nothing turns inside out
LARGEST_GRADIENT = 0.5


@dataclass
class PointState:
    """What the material points carry from step to step."""

    positions: NDArray
    displacement: NDArray
    gradient: NDArray
    phase_field: NDArray
    history_field: NDArray
    load: float = 0.0
    tied: NDArray = field(default_factory=lambda: np.zeros(0))


class MaterialPoints:
    """Material points on a B-spline grid that is reset in every step; implements ``Discretisation``.

    Equilibrium is that of the whole stress at the points' present places, not of its increment, so that
    nothing is left unbalanced from step to step. The trial state is the increment of the grid's displacement.
    """

    def __init__(self, case: Case) -> None:
        self.case, self.costs = case, Costs()
        self.grid, self.cloud = Grid(case), place_points(case)
        self._set_materials(MaterialTable(case))
        self._set_constraints()
        n_points = len(self.cloud.positions)
        self.state = PointState(
            positions=self.cloud.positions.copy(),
            displacement=np.zeros((n_points, 2)),
            gradient=np.zeros((n_points, 4)),
            phase_field=np.ones(n_points),
            history_field=self._initial_history(),
            load=case.load.path[0],
            tied=np.zeros(self._penalties.n_tied),
        )
        self._tip_points = self.grid.points_at_tips(self.cloud.positions)
        self._sides = [slit.sides(self.cloud.positions) for slit in self.grid.slits]
        self.nodal_phase_field = np.where(self._phase_fixed, self._phase_value, 1.0)
        self._c, self._slope_squared, self._curvature_squared = np.ones(n_points), np.zeros(n_points), np.zeros(n_points)
        self._gradient, self._stress = np.zeros((n_points, 4)), np.zeros((n_points, 3))
        self._psi = np.zeros((n_points, 2))
        self._force_scale = self._applied = self._constraint_error = 0.0
        self._active: ActiveGrid  # from the first step on
        self._basis_is_current = False
        self._load = self.state.load
        #: displacement that the grid's nodes have given so far: roughly the material's there, for a first guess
        self._so_far = np.zeros((self.grid.n_nodes, 2))

    # ---------------------------------------------------------------- set-up

    def _set_materials(self, materials: MaterialTable) -> None:
        body = self.cloud.body
        self._law = materials.law, body.astype(np.uint32)
        self._uniaxial_modulus = materials.stiffness[:, [0, 1], [0, 1]].max(axis=1)[body]
        self._breaks = bool(materials.breakable.any())
        self._coefficients = PhaseFieldCoefficients(materials, body)
        self._fourth_order = bool(materials.fourth_order.any())
        self._curvature_operator = materials.curvature[body] if self._fourth_order else np.zeros((0, 3, 3))

        if self._fourth_order and self.grid.slits:
            raise GridError(
                f"{self.case.source}: notches: the grid is not smooth on the line of a slit, as fracture.order = 4 needs;"
                ' use kind = "cells" or "history" instead'
            )

    def _set_constraints(self) -> None:
        case, grid = self.case, self.grid
        self._node_motions: list[Motion] = []
        self._point_motions: list[Motion] = []
        if case.mpm.constraints_on == "nodes":
            grid.check_edges_interpolate()
            self._node_motions = displacement_motions(case, nodes_on(case, grid.nodes), grid.nodes)
        else:
            on_points = PointsOn(case, self.cloud, at_edges=case.mpm.constraints_on == "edges")
            self._point_motions = displacement_motions(case, on_points, self.cloud.positions)
        self._penalties = PointPenalty(case, self._point_motions, self._stiffness())
        self._phase_fixed, self._phase_value = np.zeros(grid.n_nodes, bool), np.zeros(grid.n_nodes)
        for constraint in case.constraints:
            if constraint.direction == "phase":
                grid.check_edges_interpolate()
                nodes, _ = nodes_on(case, grid.nodes)(case.boundaries[constraint.on])
                # the slope is held at zero with the value, Eq. 5.11
                nodes = grid.beside(nodes) if self._fourth_order else nodes
                self._phase_fixed[nodes], self._phase_value[nodes] = True, constraint.value

    def _initial_history(self) -> NDArray:
        coefficients = self._coefficients
        return initial_history(self.case, self.cloud.positions, coefficients.toughness, coefficients.length_scale)

    # ---------------------------------------------------------------- staggered scheme

    def warm_up(self) -> None:
        """Compile every kernel, so that the clock times the work alone."""
        self.begin_step()
        self.solve_phase_field(self.history_field)
        self._g = degradation(self._c, self._coefficients.residual_stiffness)
        unknowns = np.zeros(self._size)
        self.correction(unknowns, self.residual(unknowns)[0])
        self.costs.forget()

    @property
    def history_field(self) -> NDArray:
        """History field (n_points,) of the committed state [stress]."""
        return self.state.history_field

    @property
    def phase_field(self) -> NDArray:
        """Phase field (n_points,) of the trial state."""
        return self._c

    def begin_step(self) -> None:
        """Reset the grid: active cells, basis at the points' present places, equations."""
        if not self._basis_is_current:
            with self.costs.timed("basis"):
                self._find_points_in_grid()
            self._basis_is_current = True
        self._increment = np.zeros((self.grid.n_nodes, 2))
        self._tied = self.state.tied.copy()

    def _find_points_in_grid(self) -> None:
        shift = self._grid_shift()
        positions = self.state.positions - shift
        cells = self.grid.locate(positions, self._sides)
        if not hasattr(self, "_active") or not self._active.holds(cells):
            self._use_cells(cells)
        self._active.sort_points(cells)
        self._active.shift = shift
        self._value_at_points, _ = self.grid.evaluate(positions, *cells)
        intact = self._intact()
        deformation = self._deformation(intact)
        filling, places = self._integration(positions, intact, deformation)
        self._value, slope = self.grid.evaluate(places, *cells)
        self._slope, self._volume = self._measure_on(slope, filling, deformation)
        if self._fourth_order:
            second = self.grid.second_derivatives(places, *cells)
            self._curvature = second @ self._material_axes(deformation).transpose(0, 2, 1)
        springs = self._penalties
        held = springs.places
        value, _ = self.grid.evaluate(positions[held] + springs.offset, cells[0][held], cells[1][held])
        springs.find_in_grid(self._active.nodes[self._active.cell[held]], value, self._equations, self._size)
        self._external = self._body_forces()
        self.costs.count["active_cells"] = self._active.n_occupied

    def _use_cells(self, cells: tuple[NDArray, NDArray]) -> None:
        """Number the equations for points in these cells and around them."""
        self._numbered_for = cells
        self._active = ActiveGrid(self.grid, cells)
        self._set_equations(self._active)

    def _grid_shift(self) -> NDArray:
        """Where the grid is put in this step, as a shift (2,): it goes with the material at the slits' tips.

        A slit is part of the grid but must stay in the material. Grids without slits, or held at nodes, stay.
        """
        if not len(self._tip_points) or self.case.mpm.constraints_on == "nodes":
            return np.zeros(2)
        return self.state.displacement[self._tip_points].mean(axis=0)

    def _integration(
        self, positions: NDArray, intact: NDArray, deformation: NDArray
    ) -> tuple[NDArray, NDArray]:
        """Factors (n_points,) on the points' volumes and places (n_points, 2) where they integrate.

        Torn material (c -> 0) keeps its own.
        """
        if not self.case.mpm.fill_cells:
            return np.ones(len(positions)), positions
        stretches = deformation[:, [0, 1], [0, 1]]
        lower = positions + stretches * self.cloud.corner
        area = _determinant(deformation) * self.cloud.volume / self.case.plane.thickness
        rectangles = Rectangles(lower, lower + stretches * self.cloud.size, area)
        filling, places = integrate_cells(self.grid, self._active, positions, rectangles, self._sides)
        return 1.0 + intact * (filling - 1.0), positions + intact[:, None] * (places - positions)

    def _measure_on(
        self, slope: NDArray, filling: NDArray, deformation: NDArray
    ) -> tuple[NDArray, NDArray]:
        """Slopes (n_points, k, 2) and volumes (n_points,) by which strains and integrals are measured.

        Torn material (c -> 0) keeps the grid's own slopes and its own volume.
        """
        volume = self.cloud.volume * filling
        if self.case.mpm.strain == "initial":
            return slope @ deformation, volume
        return slope, volume * _determinant(deformation)

    def _material_axes(self, deformation: NDArray) -> NDArray:
        """Matrices (n_points, 3, 3) from second derivatives xx, yy, xy on the grid to those that gamma weighs."""
        if self.case.mpm.strain == "updated":
            return self._curvature_operator
        return self._curvature_operator @ _pulled_back(deformation)

    def _intact(self) -> NDArray:
        """1 for material that still holds together, falling to 0 as it tears (n_points,)."""
        return np.clip(self.state.phase_field / TORN_PHASE_FIELD, 0.0, 1.0) ** 2

    def _deformation(self, intact: NDArray) -> NDArray:
        """Deformation gradient (n_points, 2, 2), as far as the material is intact (n_points,)."""
        size = np.linalg.norm(self.state.gradient, axis=1)
        share = intact * np.minimum(1.0, LARGEST_GRADIENT / np.maximum(size, LARGEST_GRADIENT))
        return np.eye(2) + (self.state.gradient * share[:, None]).reshape(-1, 2, 2)

    def _stiffness(self) -> NDArray:
        """Penalty (n_points,) [force / length]: a multiple of the uniaxial modulus times thickness."""
        return self.case.mpm.penalty * self._uniaxial_modulus * self.case.plane.thickness

    def _set_equations(self, active: ActiveGrid) -> None:
        """Number the unknowns of the nodes in use and build the patterns."""
        n_nodes = self.grid.n_nodes
        used = np.zeros(n_nodes, bool)
        used[active.nodes.ravel()] = True
        free = np.repeat(used, 2)
        master, tied = np.arange(2 * n_nodes), np.zeros(2 * n_nodes, bool)
        self._prescribed = np.zeros(2 * n_nodes, bool)
        for motion in self._node_motions:
            unknowns = 2 * motion.places + motion.component
            if motion.tied:
                master[unknowns], tied[unknowns] = unknowns[0], True
            else:
                self._prescribed[unknowns] = True
        if (tied & self._prescribed).any():
            raise GridError(
                f"{self.case.source}: constraints: a node is both tied and prescribed in the same direction; leave it out"
                " of one of the two boundary sets"
            )
        free &= ~self._prescribed
        leading = free & (master == np.arange(2 * n_nodes))
        numbers = np.where(leading, np.cumsum(leading) - 1, -1)
        self._equations = np.where(free, numbers[master], -1).astype(np.int32)
        grid_size = int(leading.sum())
        self._size = grid_size + len(self.state.tied)
        self._unknowns = (2 * active.nodes[:, :, None] + np.arange(2)).reshape(len(active.nodes), -1)
        extra = PointPenalty.coupling(self._point_motions, self._equations, grid_size)
        self._pattern = SymmetricPattern(self._equations[self._unknowns], self._size, extra)
        self._solver = linear_solver(self._pattern, self.costs, self.case.mpm.linear_solver)
        k = self._unknowns.shape[1]
        self._local = np.empty((len(active.nodes), k * (k + 1) // 2))
        self._local_forces = np.empty((len(active.nodes), k))
        self.costs.count.update(pattern_builds=1)
        self.costs.count["unknowns_displacement"] = self._size
        self.costs.count["cells"], self.costs.count["points"] = len(active.nodes), len(self._c)
        if self._breaks:
            self._set_phase_equations(active, used)

    def _set_phase_equations(self, active: ActiveGrid, used: NDArray) -> None:
        free = used & ~self._phase_fixed
        self._phase_equations = np.where(free, np.cumsum(free) - 1, -1).astype(np.int32)
        self._phase_pattern = SymmetricPattern(self._phase_equations[active.nodes], int(free.sum()))
        self._phase_solver = linear_solver(self._phase_pattern, self.costs, "well_conditioned")
        k = active.nodes.shape[1]
        self._phase_local = np.empty((len(active.nodes), k * (k + 1) // 2))
        self._phase_rest = np.empty((len(active.nodes), k))
        self.costs.count["unknowns_phase_field"] = int(free.sum())

    def _body_forces(self) -> NDArray:
        """Grid forces (2 n_nodes,) of the exact solution's body force at unit load."""
        size = 2 * self.grid.n_nodes
        solution = SOLUTIONS.get(self.case.exact or "")
        if solution is None or solution.body_force is None:
            return np.zeros(size)
        density = solution.body_force(self.case, self.state.positions, 1.0) * self._volume[:, None]
        local = self._value[:, :, None] * density[:, None, :]
        return gather_vector(self._unknowns[self._active.cell], local, size)

    def solve_phase_field(self, history_field: NDArray) -> NDArray:
        """Phase field at the points for a history field (n_points,), Eq. 4.16."""
        if not self._breaks:
            return self._c
        with self.costs.timed("phase_field"):
            active, coefficients = self._active, self._coefficients
            kernels.phase_field_systems(
                active.nodes, active.starts, active.members, self._value, self._slope, self._volume,
                coefficients.reaction(history_field), coefficients.resistance, coefficients.diffusion,
                self.nodal_phase_field, self._phase_local, self._phase_rest,
            )  # fmt: skip
            if self._fourth_order:
                kernels.add_curvature_terms(
                    active.nodes, active.starts, active.members, self._curvature, self._volume, coefficients.bending,
                    self.nodal_phase_field, self._phase_local, self._phase_rest,
                )  # fmt: skip
            equations = self._phase_equations
            rest = gather_vector(equations[active.nodes], self._phase_rest, self._phase_pattern.size)
            # cells of the pattern that hold no points leave empty rows
            values = keep_barely_seen(self._phase_pattern, self._phase_pattern.gather(self._phase_local))
            free = equations >= 0
            nodal = self.nodal_phase_field.copy()
            nodal[free] += self._phase_solver.solve(values, rest)[equations[free]]
            return self.set_phase_field(nodal)

    def set_phase_field(self, nodal: NDArray) -> NDArray:
        """Phase field at the points for one at the grid's nodes (n_nodes,)."""
        self.nodal_phase_field = nodal
        self._map_phase_field()
        return self._c.copy()

    def _map_phase_field(self) -> None:
        kernels.scalar_at_points(
            self._active.nodes, self._active.cell, self._value, self._slope, self.nodal_phase_field,
            self._c, self._slope_squared,
        )  # fmt: skip
        if self._fourth_order:
            kernels.curvature_at_points(
                self._active.nodes, self._active.cell, self._curvature, self.nodal_phase_field, self._curvature_squared
            )

    def solve_displacement(self, load: float, tolerance: float) -> NDArray:
        """Tensile energy density (n_points,) in equilibrium at the load, Eq. 4.18."""
        if load != self._load:
            further = load_ratio(load, self._load) - 1.0
            self._increment += further * self._so_far
            self._tied = (1.0 + further) * self._tied
            self._load = load
        self._g = degradation(self._c, self._coefficients.residual_stiffness)
        flat = self._increment.reshape(-1)
        for motion in self._node_motions:
            if not motion.tied:
                change = motion.displacement(self.case, load) - motion.displacement(self.case, self.state.load)
                flat[2 * motion.places + motion.component] = change
        start = np.zeros(self._size)
        free = self._equations >= 0
        start[self._equations[free]] = flat[free]
        start[self._size - len(self._tied) :] = self._tied
        newton(self, start, tolerance, self.case.staggered.residual_tolerance, self.costs)
        return self._psi[:, 0].copy()

    def residual(self, unknowns: NDArray) -> tuple[NDArray, float]:
        """Out-of-balance forces of the free unknowns and the scale of the forces."""
        with self.costs.timed("assembly"):
            free = self._equations >= 0
            self._increment.reshape(-1)[free] = unknowns[self._equations[free]]
            self._tied = unknowns[self._size - len(self._tied) :].copy()
            self._evaluate_stresses()
            active = self._active
            kernels.internal_forces(
                active.starts, active.members, self._slope, self._volume, self._stress, self._local_forces
            )
            forces = gather_vector(self._unknowns, self._local_forces, 2 * self.grid.n_nodes)
            self._nodal_forces = forces - self._load * self._external
            residual = gather_vector(self._equations, self._nodal_forces, self._size)
            penalty_forces = self._penalties.forces(self._penalties.displaced(self._increment), self._load, self._tied)
            residual += self._penalties.residual(penalty_forces)
            applied = np.linalg.norm(self._nodal_forces[self._prescribed]) + np.linalg.norm(penalty_forces)
            applied += np.linalg.norm(self._load * self._external)
            self._applied = float(applied)
            return residual, max(self._force_scale, self._applied)

    def _evaluate_stresses(self) -> None:
        active = self._active
        kernels.add_gradients(
            active.nodes, active.cell, self._slope, self._increment, self.state.gradient, self._gradient
        )
        kernels.stresses(self._gradient, self._g, *self._law, self._stress, self._psi)

    def _point_displacement(self) -> NDArray:
        """Displacement (n_points, 2) after the trial increment."""
        nodes = self._active.nodes[self._active.cell]
        return self.state.displacement + np.einsum("pa,pai->pi", self._value_at_points, self._increment[nodes])

    def correction(self, unknowns: NDArray, residual: NDArray) -> NDArray:
        """Newton step -K^-1 R."""
        with self.costs.timed("assembly"):
            values = self._tangent()
        return self._solver.solve(values, -residual)

    def _tangent(self) -> NDArray:
        """Stored entries of the consistent tangent K of the trial state (Eqs. 3.59, A.6)."""
        active = self._active
        kernels.tangents(
            active.starts, active.members, self._slope, self._volume,
            self._gradient, np.maximum(self._g, TORN_STIFFNESS), *self._law, self._local,
        )  # fmt: skip
        values = lift_empty_diagonal(self._pattern, self._pattern.gather(self._local))
        self._penalties.add_stiffness(self._pattern, values)
        return values

    def first_stiffness(self) -> csr_matrix:
        """Stiffness (n, n) [force/length] of the whole, unloaded body with its constraints, where points see the grid."""
        self.begin_step()
        self._g = np.ones(len(self._c))
        self.residual(np.zeros(self._size))
        tied = np.arange(self._size - len(self._tied), self._size)
        seen = np.union1d(self._equations[self._unknowns[self._active.cell]], tied)
        seen = seen[seen >= 0]
        return self._pattern.full(self._tangent())[seen][:, seen]

    def commit(self, history_field: NDArray) -> None:
        """Make the trial state the state and carry the points with it."""
        # not before: a load step starts from a jump whose forces say nothing
        self._force_scale = max(self._force_scale, self._applied)
        displacement = self._point_displacement()
        springs = self._penalties
        springs.displacement = springs.displaced(self._increment)
        error = springs.constraint_error(springs.displacement, self._load, self._tied)
        self._constraint_error = max(self._constraint_error, error)
        state = self.state
        if self.case.mpm.move_points:
            state.positions = state.positions + displacement - state.displacement
            self._basis_is_current = False
        state.displacement, state.gradient = displacement, self._gradient.copy()
        state.phase_field, state.history_field = self._c.copy(), history_field
        state.load, state.tied = self._load, self._tied
        self._committed_phase_field = self.nodal_phase_field
        self._so_far += self._increment
        self._increment[:] = 0.0

    def undo(self) -> None:
        """Back to the last committed state."""
        self._increment[:] = 0.0
        self._tied, self._load = self.state.tied.copy(), self.state.load
        self.nodal_phase_field = self._committed_phase_field
        self._map_phase_field()
        self._g = degradation(self._c, self._coefficients.residual_stiffness)
        self._evaluate_stresses()

    def checkpoint(self) -> dict[str, NDArray]:
        """Arrays from which `restore` makes the last committed state again."""
        return {
            **{name: np.array(value) for name, value in vars(self.state).items()},
            "nodal_phase_field": self._committed_phase_field,
            "so_far": self._so_far,
            "held": self._penalties.displacement,
            "force_scale": np.array(self._force_scale),
            "constraint_error": np.array(self._constraint_error),
            "numbered_for": np.array(self._numbered_for),
        }

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to the state of a checkpoint of the same case."""
        arrays = {name: saved[name].copy() for name in vars(self.state) if name != "load"}
        self.state = PointState(**arrays, load=float(saved["load"]))
        self._committed_phase_field, self._so_far = saved["nodal_phase_field"], saved["so_far"].copy()
        self._penalties.displacement = saved["held"]
        self._force_scale, self._constraint_error = float(saved["force_scale"]), float(saved["constraint_error"])
        self._use_cells((saved["numbered_for"][0], saved["numbered_for"][1]))
        self._basis_is_current = False
        self.begin_step()
        self.undo()

    def take_over(self, other: MaterialPoints) -> None:
        """Begin with the committed state of ``other``, whose grid and points are others of the same bodies."""
        before, old = other.state, other.cloud.positions
        nearest, displacement = carried(self.cloud.positions, old, before.displacement, before.gradient)
        self.state = PointState(
            positions=self.cloud.positions + displacement if self.case.mpm.move_points else self.state.positions,
            displacement=displacement,
            gradient=before.gradient[nearest],
            phase_field=before.phase_field[nearest],
            history_field=before.history_field[nearest],
            load=before.load,
            tied=before.tied.copy(),
        )
        springs = self._penalties
        held = self.cloud.positions[springs.places] + springs.offset
        moved = carried(held, old, before.displacement, before.gradient)[1]
        springs.displacement = moved[np.arange(len(moved)), springs.component]
        self._so_far = carried(self.grid.nodes, old, before.displacement, before.gradient)[1]
        self._force_scale, self._constraint_error = other._force_scale, other._constraint_error
        self._committed_phase_field = self.nodal_phase_field
        self._basis_is_current = False
        self.begin_step()
        self.undo()

    # ---------------------------------------------------------------- what can be seen

    def reaction_force(self) -> float:
        """Force conjugate to the load parameter: from the residual at prescribed nodes or from the penalty."""
        forces = self._penalties.forces(self._penalties.displaced(self._increment), self._load, self._tied)
        total = -float(forces @ self._penalties.rates(self._load))
        for motion in self._node_motions:
            if not motion.tied:
                nodal = self._nodal_forces[2 * motion.places + motion.component]
                total += float(nodal @ motion.rate(self.case, self._load))
        return total

    def energies(self) -> tuple[float, float]:
        """Elastic and fracture energy [energy] (Eq. 2.49)."""
        elastic = float(self.energy_density @ self._volume)
        if not self._breaks:
            return elastic, 0.0
        length_scale = self._coefficients.length_scale
        density = crack_density(self._c, self._slope_squared, length_scale, self._curvature_squared)
        return elastic, float((self._coefficients.toughness * density) @ self._volume)

    @property
    def energy_density(self) -> NDArray:
        """Degraded elastic energy density (n_points,) [stress]."""
        g = degradation(self._c, self._coefficients.residual_stiffness)
        return g * self._psi[:, 0] + self._psi[:, 1]

    def fields(self) -> Fields:
        """Points as they stand and the occupied cells of the grid."""
        state = self.state
        corners, cells, phase_field = self._active.corner_values(self.nodal_phase_field)
        return Fields(
            points=state.positions.copy(),
            reference=self.cloud.positions,
            volume=self.cloud.volume,
            displacement=state.displacement.copy(),
            gradient=state.gradient.copy(),
            phase_field=self._c.copy(),
            history_field=state.history_field.copy(),
            stress=self._stress.copy(),
            energy_density=self.energy_density,
            body=self.cloud.body,
            grid_points=corners,
            grid_cells=cells,
            grid_displacement=np.zeros_like(corners),
            grid_phase_field=phase_field,
        )

    def measures(self) -> dict[str, float]:
        """Largest violation of the constraints, and errors against the exact solution where there is one."""
        errors = exact_errors(self.case, self.fields(), self.state.load)
        if self._point_motions:
            errors["constraint_error"] = self._constraint_error
        return errors


def _determinant(matrices: NDArray) -> NDArray:
    """Determinants (n,) of matrices (n, 2, 2)."""
    return matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0]


def _pulled_back(deformation: NDArray) -> NDArray:
    """Matrices (n, 3, 3) that take second derivatives xx, yy, xy to coordinates before a deformation F (n, 2, 2).

    H -> F^T H F; that F varies in space is left out, as small strains allow.
    """
    (a, b), (c, d) = deformation.transpose(1, 2, 0)
    rows = [[a * a, c * c, 2 * a * c], [b * b, d * d, 2 * b * d], [a * b, c * d, a * d + b * c]]
    return np.array(rows).transpose(2, 0, 1)
