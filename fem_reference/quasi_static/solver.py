"""The reference: quasi-static phase-field finite elements on scikit-fem meshes (thesis Algorithm 1)."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.errors import MeshError
from fem_reference.boundary import NodeConstraints
from fem_reference.element_basis import ElementBasis
from fem_reference.quasi_static import displacement_kernels as kernels
from fem_reference.quasi_static.equilibrium import MeshEquilibrium
from fem_reference.quasi_static.phase_field import MeshPhaseField
from numerics.built import check_support, parts_of_nodes
from numerics.costs import Costs
from numerics.element_quality import scaled_jacobian
from numerics.exact_errors import exact_errors
from numerics.fields import Fields
from numerics.newton import TORN_STIFFNESS, least_forces, load_ratio, newton
from numerics.phase_field_equation import ScalarAtPoints
from numerics.refinement import carried
from numerics.staggered import LoadWork, NewtonError
from numerics.surface import loaded_lengths
from physics.acting import Acts, EigenstrainAtPoints
from physics.elasticity import MaterialTable
from physics.phase_field import PhaseFieldCoefficients, degradation, initial_history


@dataclass
class CommittedState:
    """What elements and nodes carry from step to step.

    displacement : (n_nodes, 2). gradient : (n_el, n_gauss, 4) of it. nodal_phase_field : (n_unknowns,).
    history_field : (n_points,) [stress]. force_scale : largest forces applied so far.
    """

    displacement: NDArray
    gradient: NDArray
    nodal_phase_field: NDArray
    history_field: NDArray
    load: float
    force_scale: float = 0.0

    @classmethod
    def first(
        cls, case: Case, basis: ElementBasis, coefficients: PhaseFieldCoefficients, fracture: MeshPhaseField | None
    ) -> CommittedState:
        """Unloaded material, whole but for its notches."""
        shape = basis.volume.shape
        toughness, length_scale = (
            np.broadcast_to(values, shape) for values in (coefficients.toughness, coefficients.length_scale)
        )
        return cls(
            displacement=np.zeros((len(basis.nodes), 2)),
            gradient=np.zeros((*shape, 4)),
            nodal_phase_field=fracture.first() if fracture else np.ones(len(basis.nodes)),
            history_field=initial_history(case, basis.gauss_points, toughness, length_scale).ravel(),
            load=case.load.path[0],
        )


@dataclass
class TrialState:
    """What a step works on.

    displacement : (n_nodes, 2). gradient, stress : (n_el, n_gauss, 4 and 3). energy : (n_el, n_gauss, 2) psi_plus and
    psi_minus [stress]. at_points : the phase field there. degradation : (n_el, n_gauss).
    nodal_forces : (2 n_nodes,) out of balance. applied : norm of the forces applied.
    """

    displacement: NDArray
    gradient: NDArray
    stress: NDArray
    energy: NDArray
    nodal_phase_field: NDArray
    at_points: ScalarAtPoints
    degradation: NDArray
    nodal_forces: NDArray
    load: float
    applied: float = 0.0

    @classmethod
    def of(cls, committed: CommittedState) -> TrialState:
        """The trial state from which nothing has moved yet."""
        shape = committed.gradient.shape[:2]
        return cls(
            displacement=committed.displacement.copy(),
            gradient=committed.gradient.copy(),
            stress=np.zeros((*shape, 3)),
            energy=np.zeros((*shape, 2)),
            nodal_phase_field=committed.nodal_phase_field,
            at_points=ScalarAtPoints.intact(shape),
            degradation=np.ones(shape),
            nodal_forces=np.zeros(committed.displacement.size),
            load=committed.load,
        )


@dataclass(frozen=True)
class Geometry:
    """What strain is measured on: slopes, volumes, and the displacement and its gradient that were there before.

    dilation : (n_el, n_gauss, k, 2) of B-bar, of no elements without it
    """

    slope: NDArray
    volume: NDArray
    displacement: NDArray
    gradient: NDArray
    dilation: NDArray

    @classmethod
    def of(cls, case: Case, slope: NDArray, volume: NDArray, displacement: NDArray, gradient: NDArray) -> Geometry:
        """With the dilation, where the case asks for elements that do not lock."""
        dilation = kernels.WITHOUT_DILATION
        if case.mesh.locking_free:
            mean = np.einsum("eq,eqai->eai", volume, slope) / volume.sum(axis=1)[:, None, None]
            dilation = 0.5 * (mean[:, None] - slope)
        return cls(slope, volume, displacement, gradient, dilation)


class FiniteElements:
    """Bilinear quads with 2x2 Gauss points, or linear triangles with 3; implements ``QuasiStaticDiscretisation``.

    Where a material is of order 4 the phase field, with 3x3 Gauss points, has the basis of ``SmoothBasis``.
    """

    def __init__(self, case: Case) -> None:
        self.case, self.costs = case, Costs()
        materials = MaterialTable(case)
        self.basis = basis = ElementBasis(case, bool(materials.fourth_order.any()))
        self._law = materials.law, basis.body.astype(np.uint32)
        self._least_forces = least_forces(case, materials.stiffness)
        self.equilibrium = MeshEquilibrium(case, basis, self.costs)
        constraints, breaks = self.equilibrium.constraints, bool(materials.breakable.any())
        _check_built(case, basis, constraints)
        self.fracture = MeshPhaseField(case, basis, materials, constraints, self.costs) if breaks else None
        self._eigenstrain = EigenstrainAtPoints(case, materials, basis.body[:, None])
        self._held_back = Acts(*(self.equilibrium.norm_of_forces(basis, stress) for stress in self._eigenstrain.stress))
        coefficients = PhaseFieldCoefficients(materials, basis.body[:, None])
        self._residual_stiffness = coefficients.residual_stiffness
        self.committed = CommittedState.first(case, basis, coefficients, self.fracture)
        self.trial = TrialState.of(self.committed)
        gradient = self.committed.gradient
        self.geometry = Geometry.of(case, basis.slope, basis.volume, self.committed.displacement, gradient)
        self.costs.count.update(
            unknowns_displacement=self.equilibrium.size,
            unknowns_phase_field=0,
            points=basis.volume.size,
            cells=len(basis.elements),
        )

    # ---------------------------------------------------------------- staggered scheme

    def warm_up(self) -> None:
        """Compile every kernel, so that the clock times the work alone."""
        self.solve_phase_field(self.history_field)
        unknowns = np.zeros(self.equilibrium.size)
        self.correction(unknowns, self.residual(unknowns)[0])
        self.costs.forget()

    @property
    def history_field(self) -> NDArray:
        """History field (n_points,) of the committed state [stress]."""
        return self.committed.history_field

    @property
    def phase_field(self) -> NDArray:
        """Phase field (n_points,) at the Gauss points, trial state."""
        return self.trial.at_points.value.ravel()

    @property
    def nodal_phase_field(self) -> NDArray:
        """Its unknowns (n_unknowns,)."""
        return self.trial.nodal_phase_field

    def begin_step(self) -> None:
        """Measure on the mesh as it has moved, where the case asks for it; else the mesh is the mesh.

        Raises NewtonError where an element has turned inside out.
        """
        if self.case.mesh.geometry == "initial":
            return
        basis, committed = self.basis, self.committed
        total = np.empty_like(committed.gradient)
        nothing = np.zeros_like(total)
        kernels.displacement_gradients(basis.elements, basis.slope, committed.displacement, nothing, total)
        deformation = np.eye(2) + total.reshape(*total.shape[:2], 2, 2)
        stretch = np.linalg.det(deformation)
        if stretch.min() <= 0.0:
            element = int(np.unravel_index(stretch.argmin(), stretch.shape)[0])
            raise NewtonError(f"element {element} has turned inside out")
        slope, volume = basis.slope @ np.linalg.inv(deformation), basis.volume * stretch
        self.geometry = Geometry.of(self.case, slope, volume, committed.displacement, committed.gradient)
        if self.fracture:
            self.fracture.measure_on(slope, volume)

    def solve_phase_field(self, history_field: NDArray) -> NDArray:
        """Phase field at the Gauss points for a history field (n_points,), Eq. 4.16."""
        if not self.fracture:
            return self.phase_field
        with self.costs.timed("phase_field"):
            self.fracture.assemble(history_field, self.trial.nodal_phase_field)
            return self.set_phase_field(self.fracture.equation.corrected(self.trial.nodal_phase_field))

    def set_phase_field(self, nodal: NDArray) -> NDArray:
        """Phase field at the Gauss points for given unknowns (n_unknowns,)."""
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
        if load != trial.load:
            trial.displacement *= load_ratio(load, trial.load)
            trial.load = load
        self.equilibrium.prescribe(trial.displacement, load)
        return self.equilibrium.unknowns_of(trial.displacement)

    def tensile_energy(self) -> NDArray:
        """Tensile energy density (n_points,) of the trial state [stress]."""
        return self.trial.energy[..., 0].ravel().copy()

    def residual(self, unknowns: NDArray) -> tuple[NDArray, float]:
        """Out-of-balance forces of the free unknowns and the scale of the forces."""
        with self.costs.timed("assembly"):
            trial = self.trial
            self.equilibrium.spread(unknowns, trial.displacement)
            self._evaluate_forces()
            trial.nodal_forces, applied = self.equilibrium.nodal_forces(trial.load, trial.displacement)
            trial.applied = applied + self._held_back.at(abs(trial.load))
            least = self._least_forces * np.abs(trial.displacement).max()
            return self.equilibrium.residual(trial.nodal_forces), max(self.committed.force_scale, trial.applied, least)

    def _evaluate_forces(self) -> None:
        trial, geometry = self.trial, self.geometry
        moved = trial.displacement - geometry.displacement
        kernels.displacement_gradients(self.basis.elements, geometry.slope, moved, geometry.gradient, trial.gradient)
        kernels.even_dilation(self.basis.elements, geometry.dilation, moved, trial.gradient)
        elastic = self._eigenstrain.elastic(trial.gradient, trial.load)
        kernels.internal_forces(
            geometry.slope, geometry.dilation, geometry.volume, elastic, trial.degradation, *self._law,
            self.equilibrium.local.vectors, trial.stress, trial.energy,
        )  # fmt: skip

    def correction(self, unknowns: NDArray, residual: NDArray) -> NDArray:
        """Newton step -K^-1 R."""
        return self.equilibrium.solve(self.tangent(), -residual)

    def tangent(self) -> NDArray:
        """Stored entries of the consistent tangent K of the trial state (Eq. 3.59)."""
        with self.costs.timed("assembly"):
            stiffness = np.maximum(self.trial.degradation, TORN_STIFFNESS)
            geometry, elastic = self.geometry, self._eigenstrain.elastic(self.trial.gradient, self.trial.load)
            kernels.tangents(
                geometry.slope, geometry.dilation, geometry.volume, elastic, stiffness, *self._law,
                self.equilibrium.local.matrices,
            )  # fmt: skip
            return self.equilibrium.tangent_at(self.trial.displacement)

    def commit(self, history_field: NDArray) -> None:
        """Make the trial state the state."""
        trial = self.trial
        self.committed = CommittedState(
            displacement=trial.displacement.copy(),
            gradient=trial.gradient.copy(),
            nodal_phase_field=trial.nodal_phase_field,
            history_field=history_field,
            load=trial.load,
            force_scale=max(self.committed.force_scale, trial.applied),
        )

    def undo(self) -> None:
        """Back to the last committed state."""
        trial, committed = self.trial, self.committed
        trial.displacement[:], trial.load = committed.displacement, committed.load
        self.set_phase_field(committed.nodal_phase_field)
        self._evaluate_forces()

    def checkpoint(self) -> dict[str, NDArray]:
        """Arrays from which `restore` makes the last committed state again."""
        return {name: np.array(value) for name, value in vars(self.committed).items()}

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to the state of a checkpoint of the same case."""
        arrays = {name: saved[name] for name in vars(self.committed)}
        values: dict[str, Any] = {name: array if array.ndim else float(array) for name, array in arrays.items()}
        self.committed = CommittedState(**values)
        # a state turned inside out is reported when the next step begins
        with suppress(NewtonError):
            self.begin_step()
        self.undo()

    def take_over(self, other: FiniteElements) -> None:
        """Begin with the committed state of ``other``, whose mesh is another one of the same bodies."""
        before = other.fields()
        places = self.basis.gauss_points.reshape(-1, 2)
        of_points, _ = carried(places, before.reference, before.displacement, before.gradient)
        _, displacement = carried(self.basis.nodes, before.reference, before.displacement, before.gradient)
        self.committed = CommittedState(
            displacement=displacement,
            gradient=before.gradient[of_points].reshape(self.trial.gradient.shape),
            nodal_phase_field=self.trial.nodal_phase_field,
            history_field=other.history_field[of_points],
            load=other.committed.load,
            force_scale=other.committed.force_scale,
        )
        self.undo()

    # ---------------------------------------------------------------- what can be seen

    def reaction_force(self, towards: float) -> float:
        """Force conjugate to the load parameter on its way, from the residual at the prescribed unknowns."""
        rates = self.equilibrium.constraints.prescribed_rates(self.trial.load, towards)
        return float(self.trial.nodal_forces @ rates)

    def work_of_loads(self) -> LoadWork:
        """Of tractions, body forces and eigenstrains since the last committed state."""
        moved = (self.trial.displacement - self.committed.displacement).reshape(-1)
        constant, following = (float(forces @ moved) for forces in self.equilibrium.external)
        return LoadWork(constant, following, self._eigenstrain.heat(self.trial.stress, self.geometry.volume))

    def energies(self) -> tuple[float, float]:
        """Elastic and fracture energy [energy] (Eq. 2.49)."""
        elastic = float((self.energy_density * self.geometry.volume).sum())
        return elastic, self.fracture.energy(self.trial.at_points) if self.fracture else 0.0

    @property
    def energy_density(self) -> NDArray:
        """Degraded elastic energy density (n_elements, n_gauss) [stress]."""
        g = degradation(self.trial.at_points.value, self._residual_stiffness)
        return g * self.trial.energy[..., 0] + self.trial.energy[..., 1]

    def fields(self) -> Fields:
        """Gauss points and nodes as they stand."""
        basis, trial, volume = self.basis, self.trial, self.geometry.volume
        displacement = np.einsum("qa,eai->eqi", basis.shape, trial.displacement[basis.elements]).reshape(-1, 2)
        reference = basis.gauss_points.reshape(-1, 2)
        nodal = trial.nodal_phase_field
        return Fields(
            points=reference + displacement,
            reference=reference,
            volume=volume.ravel(),
            displacement=displacement,
            gradient=trial.gradient.reshape(volume.size, 4).copy(),
            phase_field=self.phase_field.copy(),
            history_field=self.history_field.copy(),
            stress=trial.stress.reshape(volume.size, 3).copy(),
            energy_density=self.energy_density.ravel(),
            body=np.repeat(basis.body, volume.shape[1]),
            grid_points=basis.nodes,
            grid_cells=basis.elements,
            grid_displacement=trial.displacement.copy(),
            grid_phase_field=self.fracture.at_nodes(nodal) if self.fracture else nodal.copy(),
        )

    def measures(self) -> dict[str, float]:
        """Least quality of the moved elements, and errors against the exact solution where the case has one."""
        quality = float(scaled_jacobian(self.basis.nodes + self.trial.displacement, self.basis.elements).min())
        lengths = loaded_lengths(edge.length for edge in self.equilibrium.loaded_edges)
        return exact_errors(self.case, self.fields(), self.trial.load) | {"element_quality": quality} | lengths


def _check_built(case: Case, basis: ElementBasis, constraints: NodeConstraints) -> None:
    """Raise MeshError or BuiltError where a body can move freely, or elements would lock although the case forbids it."""
    if case.mesh.locking_free and basis.elements.shape[1] == 3:
        raise MeshError(f"{case.source}: mesh.locking_free: linear triangles have no B-bar; mesh with quadrilaterals")
    part = parts_of_nodes(basis.elements, len(basis.nodes))
    check_support(case, constraints.holds(part), part[basis.elements[:, 0]], basis.body)
