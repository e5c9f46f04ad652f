"""The reference: phase-field finite elements on scikit-fem meshes, quasi-static."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from cases import Case
from fem_reference.boundary import NodeConstraints
from fem_reference.element_basis import ElementBasis
from fem_reference.quasi_static import kernels
from fem_reference.smooth_basis import SmoothBasis
from numerics.costs import Costs
from numerics.element_quality import scaled_jacobian
from numerics.exact_errors import exact_errors
from numerics.fields import Fields
from numerics.linear_solvers import lift_empty_diagonal, linear_solver
from numerics.newton import TORN_STIFFNESS, load_ratio, newton
from numerics.refinement import carried
from numerics.sparse_pattern import SymmetricPattern, gather_vector
from numerics.staggered import NewtonError
from physics.elasticity import MaterialTable
from physics.exact import SOLUTIONS
from physics.phase_field import PhaseFieldCoefficients, crack_density, degradation, initial_history


class FiniteElements:
    """Bilinear quads with 2x2 Gauss points, or linear triangles with 3; implements ``Discretisation``.

    Where a material is of order 4 the phase field, with 3x3 Gauss points, has the basis of ``SmoothBasis``.
    Displacement ``(n_nodes, 2)`` and the phase field's unknowns ``(n_unknowns,)`` are the trial state.
    """

    def __init__(self, case: Case) -> None:
        self.case, self.costs = case, Costs()
        materials = MaterialTable(case)
        self._fourth_order = bool(materials.fourth_order.any())
        basis = ElementBasis(case, self._fourth_order)
        self.nodes, self.elements, self.gauss_points = basis.nodes, basis.elements, basis.gauss_points
        self.shape, self.slope, self.volume = basis.shape, basis.slope, basis.volume
        self._first_slope, self._first_volume = basis.slope, basis.volume
        self._set_materials(materials, basis)
        self._set_equations()
        self._set_initial_state()

    # ---------------------------------------------------------------- set-up

    def _set_materials(self, materials: MaterialTable, basis: ElementBasis) -> None:
        body = basis.body
        self._body, self._law = body, (materials.law, body.astype(np.uint32))
        self._breaks = bool(materials.breakable.any())
        # one value per element, as a column so that it spreads over the Gauss points
        self._coefficients = PhaseFieldCoefficients(materials, body[:, None])
        if self._fourth_order:
            self._smooth = SmoothBasis.of(self.case, basis, materials.curvature[body])
            self._forms = self._smooth.forms(basis.volume)

    def _set_equations(self) -> None:
        self.constraints = NodeConstraints(self.case, self.nodes)
        self._unknowns = (2 * self.elements[:, :, None] + np.arange(2)).reshape(len(self.elements), -1)
        pattern = SymmetricPattern(self.constraints.equations[self._unknowns], self.constraints.size)
        self._solver = linear_solver(pattern, self.costs)
        self._pattern = pattern
        self._local = kernels.packed(self._unknowns.shape[1], len(self.elements))
        self._external = self._body_forces()
        if self._breaks:
            self._set_phase_equations()

    def _set_phase_equations(self) -> None:
        self._phase_cells, self._phase_equations = self.elements, self.constraints.phase_equations
        if self._fourth_order:
            self._phase_cells = self._smooth.unknowns
            self._phase_equations = self._smooth.number(self.constraints.phase_equations)
        size = int(self._phase_equations.max()) + 1
        self._phase_pattern = SymmetricPattern(self._phase_equations[self._phase_cells], size)
        self._phase_solver = linear_solver(self._phase_pattern, self.costs, "well_conditioned")
        self._phase_local = kernels.packed(self._phase_cells.shape[1], len(self.elements))
        self._out_of_balance = np.empty(self._phase_cells.shape)

    def _body_forces(self) -> NDArray:
        """Nodal forces (2 n_nodes,) of the exact solution's body force at unit load."""
        size = 2 * len(self.nodes)
        solution = SOLUTIONS.get(self.case.exact or "")
        if solution is None or solution.body_force is None:
            return np.zeros(size)
        density = solution.body_force(self.case, self.gauss_points.reshape(-1, 2), 1.0)
        density = density.reshape(self.gauss_points.shape) * self.volume[..., None]
        local = np.einsum("qa,eqi->eai", self.shape, density)
        return gather_vector(self._unknowns, local, size)

    def _set_initial_state(self) -> None:
        n_elements, n_gauss = self.volume.shape
        self.displacement = np.zeros((len(self.nodes), 2))
        self.nodal_phase_field = self.constraints.phase_value.copy()
        if self._fourth_order:
            self.nodal_phase_field = self._smooth.spread(self.nodal_phase_field)
        self._gradient = np.zeros((n_elements, n_gauss, 4))
        self._stress, self._psi = np.zeros((n_elements, n_gauss, 3)), np.zeros((n_elements, n_gauss, 2))
        self._forces = np.zeros((n_elements, self._unknowns.shape[1]))
        self._c, self._slope_squared = np.ones((n_elements, n_gauss)), np.zeros((n_elements, n_gauss))
        self._curvature_squared = np.zeros((n_elements, n_gauss))
        #: strain is measured from here on: from the start, or from the last state where the geometry is updated
        self._measured_from = (np.zeros_like(self.displacement), np.zeros_like(self._gradient))
        self._force_scale = self._applied = 0.0
        self.history_field = self._initial_history()
        self._load = self.case.load.path[0]
        self._committed = (self.displacement.copy(), self.nodal_phase_field, self._load, self._gradient.copy())
        self.costs.count.update(
            unknowns_displacement=self.constraints.size,
            unknowns_phase_field=self._phase_pattern.size if self._breaks else 0,
            points=self.volume.size,
            cells=n_elements,
        )

    def _initial_history(self) -> NDArray:
        toughness = np.broadcast_to(self._coefficients.toughness, self.volume.shape)
        length_scale = np.broadcast_to(self._coefficients.length_scale, self.volume.shape)
        return initial_history(self.case, self.gauss_points, toughness, length_scale).ravel()

    # ---------------------------------------------------------------- staggered scheme

    def warm_up(self) -> None:
        """Compile every kernel, so that the clock times the work alone."""
        self.solve_phase_field(self.history_field)
        self._g = degradation(self._c, self._coefficients.residual_stiffness)
        unknowns = np.zeros(self.constraints.size)
        self.correction(unknowns, self.residual(unknowns)[0])
        self.costs.forget()

    @property
    def phase_field(self) -> NDArray:
        """Phase field (n_points,) at the Gauss points, trial state."""
        return self._c.ravel()

    def begin_step(self) -> None:
        """Measure on the mesh as it has moved, where the case asks for it; else the mesh is the mesh.

        Raises NewtonError where an element has turned inside out.
        """
        if self.case.mesh.geometry == "initial":
            return
        displacement = self._committed[0]
        total = np.empty_like(self._gradient)
        nothing = np.zeros_like(total)
        kernels.displacement_gradients(self.elements, self._first_slope, displacement, nothing, total)
        deformation = np.eye(2) + total.reshape(*total.shape[:2], 2, 2)
        stretch = np.linalg.det(deformation)
        if stretch.min() <= 0.0:
            element = int(np.unravel_index(stretch.argmin(), stretch.shape)[0])
            raise NewtonError(f"element {element} has turned inside out")
        self.slope = self._first_slope @ np.linalg.inv(deformation)
        self.volume = self._first_volume * stretch
        self._measured_from = (displacement, self._committed[3])

    def solve_phase_field(self, history_field: NDArray) -> NDArray:
        """Phase field at the Gauss points for a history field (n_points,), Eq. 4.16."""
        if not self._breaks:
            return self.phase_field
        with self.costs.timed("phase_field"):
            self._assemble_phase_field(history_field.reshape(self.volume.shape))
            equations = self._phase_equations
            residual = gather_vector(equations[self._phase_cells], self._out_of_balance, self._phase_pattern.size)
            values = self._phase_pattern.gather(self._phase_local)
            free = equations >= 0
            nodal = self.nodal_phase_field.copy()
            nodal[free] += self._phase_solver.solve(values, residual)[equations[free]]
            return self.set_phase_field(nodal)

    def _assemble_phase_field(self, history_field: NDArray) -> None:
        coefficients = self._coefficients
        reaction, resistance = coefficients.reaction(history_field), coefficients.resistance[:, 0]
        diffusion, bending = coefficients.diffusion[:, 0], coefficients.bending[:, 0]
        if self._fourth_order:
            smooth = self._smooth
            kernels.fourth_order_matrices(
                smooth.unknowns, smooth.kind, smooth.value, *self._forms, self.volume, reaction, resistance,
                diffusion, bending, self.nodal_phase_field, self._phase_local, self._out_of_balance,
            )  # fmt: skip
        else:
            kernels.phase_field_matrices(
                self.elements, self.shape, self.slope, self.volume, reaction, resistance, diffusion,
                self.nodal_phase_field, self._phase_local, self._out_of_balance,
            )  # fmt: skip

    def set_phase_field(self, nodal: NDArray) -> NDArray:
        """Phase field at the Gauss points for given unknowns (n_unknowns,)."""
        self.nodal_phase_field = nodal
        self._map_phase_field()
        return self.phase_field.copy()

    def _map_phase_field(self) -> None:
        if self._fourth_order:
            smooth = self._smooth
            kernels.smooth_scalar_at_points(
                smooth.unknowns, smooth.kind, smooth.value, smooth.slope, smooth.curvature, self.nodal_phase_field,
                self._c, self._slope_squared, self._curvature_squared,
            )  # fmt: skip
        else:
            kernels.scalar_at_points(
                self.elements, self.shape, self.slope, self.nodal_phase_field, self._c, self._slope_squared
            )

    def solve_displacement(self, load: float, tolerance: float) -> NDArray:
        """Tensile energy density (n_points,) in equilibrium at the load, Eq. 4.18."""
        if load != self._load:
            self.displacement *= load_ratio(load, self._load)
            self._load = load
        self._g = degradation(self._c, self._coefficients.residual_stiffness)
        prescribed = self.constraints.prescribed
        flat = self.displacement.reshape(-1)
        flat[prescribed] = self.constraints.prescribed_values(load)[prescribed]
        start = np.zeros(self.constraints.size)
        start[self.constraints.equations[~prescribed]] = flat[~prescribed]
        newton(self, start, tolerance, self.case.staggered.residual_tolerance, self.costs)
        return self._psi[..., 0].ravel().copy()

    def residual(self, unknowns: NDArray) -> tuple[NDArray, float]:
        """Out-of-balance forces of the free unknowns and the scale of the forces."""
        with self.costs.timed("assembly"):
            free = ~self.constraints.prescribed
            self.displacement.reshape(-1)[free] = unknowns[self.constraints.equations[free]]
            self._evaluate_forces()
            size = 2 * len(self.nodes)
            self._nodal_forces = gather_vector(self._unknowns, self._forces, size) - self._load * self._external
            fixed = self._nodal_forces[self.constraints.prescribed]
            applied = float(np.linalg.norm(fixed) + np.linalg.norm(self._load * self._external))
            self._applied = applied
            equations = self.constraints.equations
            residual = gather_vector(equations, self._nodal_forces, self.constraints.size)
            return residual, max(self._force_scale, applied)

    def _evaluate_forces(self) -> None:
        since, before = self._measured_from
        kernels.displacement_gradients(
            self.elements, self.slope, self.displacement - since, before, self._gradient
        )
        kernels.internal_forces(
            self.slope, self.volume, self._gradient, self._g, *self._law,
            self._forces, self._stress, self._psi,
        )  # fmt: skip

    def correction(self, unknowns: NDArray, residual: NDArray) -> NDArray:
        """Newton step -K^-1 R with the consistent tangent (Eq. 3.59)."""
        with self.costs.timed("assembly"):
            kernels.tangents(
                self.slope, self.volume, self._gradient, np.maximum(self._g, TORN_STIFFNESS),
                *self._law, self._local,
            )  # fmt: skip
            values = lift_empty_diagonal(self._pattern, self._pattern.gather(self._local))
        return self._solver.solve(values, -residual)

    def commit(self, history_field: NDArray) -> None:
        """Make the trial state the state."""
        self._force_scale = max(self._force_scale, self._applied)
        self.history_field = history_field
        self._committed = (self.displacement.copy(), self.nodal_phase_field, self._load, self._gradient.copy())

    def undo(self) -> None:
        """Back to the last committed state."""
        self.displacement[:], self.nodal_phase_field, self._load, self._gradient[:] = self._committed
        self._map_phase_field()
        self._g = degradation(self._c, self._coefficients.residual_stiffness)
        self._evaluate_forces()

    def checkpoint(self) -> dict[str, NDArray]:
        """Arrays from which `restore` makes the last committed state again."""
        displacement, nodal_phase_field, load, gradient = self._committed
        return {
            "displacement": displacement,
            "nodal_phase_field": nodal_phase_field,
            "history_field": self.history_field,
            "load": np.array(load),
            "gradient": gradient,
            "force_scale": np.array(self._force_scale),
        }

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to the state of a checkpoint of the same case."""
        self.history_field, self._force_scale = saved["history_field"], float(saved["force_scale"])
        load, gradient = float(saved["load"]), saved["gradient"]
        self._committed = (saved["displacement"], saved["nodal_phase_field"], load, gradient)
        # a state turned inside out is reported when the next step begins
        with suppress(NewtonError):
            self.begin_step()
        self.undo()

    def take_over(self, other: FiniteElements) -> None:
        """Begin with the committed state of ``other``, whose mesh is another one of the same bodies."""
        before = other.fields()
        of_points, _ = carried(
            self.gauss_points.reshape(-1, 2), before.reference, before.displacement, before.gradient
        )
        _, displacement = carried(self.nodes, before.reference, before.displacement, before.gradient)
        self.history_field = other.history_field[of_points]
        gradient = before.gradient[of_points].reshape(self._gradient.shape)
        self._committed = (displacement, self.nodal_phase_field, other._committed[2], gradient)
        self._force_scale = other._force_scale
        self.undo()

    # ---------------------------------------------------------------- what can be seen

    def reaction_force(self) -> float:
        """Force conjugate to the load parameter, from the residual at the prescribed unknowns."""
        return float(self._nodal_forces @ self.constraints.prescribed_rates(self._load))

    def energies(self) -> tuple[float, float]:
        """Elastic and fracture energy [energy] (Eq. 2.49)."""
        elastic = float((self.energy_density * self.volume).sum())
        if not self._breaks:
            return elastic, 0.0
        length_scale = self._coefficients.length_scale
        density = crack_density(self._c, self._slope_squared, length_scale, self._curvature_squared)
        return elastic, float((self._coefficients.toughness * density * self.volume).sum())

    @property
    def energy_density(self) -> NDArray:
        """Degraded elastic energy density (n_elements, n_gauss) [stress]."""
        g = degradation(self._c, self._coefficients.residual_stiffness)
        return g * self._psi[..., 0] + self._psi[..., 1]

    def fields(self) -> Fields:
        """Gauss points and nodes as they stand."""
        n_points = self.volume.size
        displacement = np.einsum("qa,eai->eqi", self.shape, self.displacement[self.elements]).reshape(-1, 2)
        reference = self.gauss_points.reshape(-1, 2)
        return Fields(
            points=reference + displacement,
            reference=reference,
            volume=self.volume.ravel(),
            displacement=displacement,
            gradient=self._gradient.reshape(n_points, 4).copy(),
            phase_field=self.phase_field.copy(),
            history_field=self.history_field.copy(),
            stress=self._stress.reshape(n_points, 3).copy(),
            energy_density=self.energy_density.ravel(),
            body=np.repeat(self._body, self.volume.shape[1]),
            grid_points=self.nodes,
            grid_cells=self.elements,
            grid_displacement=self.displacement.copy(),
            grid_phase_field=self._phase_field_at_nodes(),
        )

    def _phase_field_at_nodes(self) -> NDArray:
        nodal = self.nodal_phase_field
        return self._smooth.at_nodes(nodal) if self._fourth_order else nodal.copy()

    def measures(self) -> dict[str, float]:
        """Least quality of the moved elements, and errors against the exact solution where the case has one."""
        quality = float(scaled_jacobian(self.nodes + self.displacement, self.elements).min())
        return exact_errors(self.case, self.fields(), self._load) | {"element_quality": quality}
