"""Explicit phase-field finite elements: central differences with row-sum lumped mass on scikit-fem meshes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cases import Case, CaseError
from fem_reference.boundary import NodeConstraints
from fem_reference.element_basis import ElementBasis
from fem_reference.explicit.moving_nodes import MovingNodes, NodalMotion
from fem_reference.explicit.phase_field import ElementPhaseField
from fem_reference.explicit.strain_and_forces import ElementLaw, Strain, evaluate_strain, raise_history
from fem_reference.tractions import check_held_edges
from numerics.costs import Costs
from numerics.explicit import Balance, BlewUpError
from numerics.fields import Fields
from numerics.surface import loaded_lengths
from numerics.time_steps import courant_step
from physics.elasticity import MaterialTable
from physics.exact import SOLUTIONS
from physics.phase_field import PhaseFieldCoefficients, degradation, initial_history


@dataclass
class PointState:
    """Strain and history field (n_el, n_gauss) at the Gauss points at one time."""

    strain: Strain
    history_field: NDArray


class ExplicitFiniteElements:
    """Bilinear quads or linear triangles in motion; implements ``DynamicDiscretisation``.

    Where the material is of order 4 the phase field, with 3x3 Gauss points, has the basis of ``SmoothBasis``. Strains
    are small and measured on the first geometry, so that the material's axes do not turn.

    The velocity is kept between the times of the displacement. The phase field of a time follows from the history
    field of the same time before the bodies move on; each further of the ``staggered.passes`` repeats the step with the
    phase field of the history field that it led to.
    """

    def __init__(self, case: Case) -> None:
        assert case.dynamics is not None
        if len(case.bodies) > 1:
            raise CaseError(f"{case.source}: bodies: explicit finite elements know no contact; run several bodies with"
                            ' solver = "mpm".')  # fmt: skip
        (name, body), = case.bodies.items()
        if body.unbreakable:
            raise CaseError(f"{case.source}: bodies.{name}.unbreakable: explicit finite elements break anywhere;"
                            ' remove it or run the case with solver = "mpm".')  # fmt: skip
        self.case, self.costs = case, Costs()
        materials = MaterialTable(case)
        self.basis = basis = ElementBasis(case, bool(materials.fourth_order.any()))
        self._law = ElementLaw.of(materials)
        self._coefficients = PhaseFieldCoefficients(materials, basis.body)
        constraints = NodeConstraints(case, basis.nodes)
        check_held_edges(case, basis)
        self._density = materials.density[basis.body]
        self._nodes = MovingNodes(case, basis, self._density, constraints)
        self._phase_field = ElementPhaseField(case, basis, materials, constraints, self.costs)
        self._set_initial_state()

    # ---------------------------------------------------------------- set-up

    def _set_initial_state(self) -> None:
        basis, points, still = self.basis, self.basis.volume.shape, np.zeros((len(self.basis.nodes), 2))
        velocity = np.where(self._nodes.held, self._nodes.held_velocity, self._first_velocity())
        self.motion = NodalMotion(still, velocity, np.zeros_like(still))
        self._present = PointState(Strain.zero(points), self._initial_history())
        self._next = PointState(Strain.zero(points), np.empty(points))
        self._change = np.empty(len(basis.elements))
        self._time, self._work = self.case.dynamics.start_time, 0.0  # type: ignore[union-attr]
        self._is_current = False
        self._evaluate_strain(still, self._present)
        self._change[:] = np.inf  # the phase field of the notches is found everywhere
        self.costs.count.update(points=basis.volume.size, cells=len(basis.elements), unknowns_displacement=still.size)

    def _first_velocity(self) -> NDArray:
        """Velocity (n_nodes, 2) that the case gives, or its exact solution."""
        nodes, solution = self.basis.nodes, SOLUTIONS.get(self.case.exact or "")
        if solution is not None and solution.strain is not None:
            raise CaseError(
                f"{self.case.source}: exact = '{self.case.exact}': it starts strained, while finite elements measure"
                ' strain from the start; run it with solver = "mpm".'
            )
        if solution is not None and solution.velocity is not None:
            return solution.velocity(self.case, nodes, 0.0)
        return next(iter(self.case.bodies.values())).initial_velocity(nodes)

    def _initial_history(self) -> NDArray:
        shape, coefficients = self.basis.volume.shape, self._coefficients
        toughness = np.broadcast_to(coefficients.toughness[:, None], shape)
        length_scale = np.broadcast_to(coefficients.length_scale[:, None], shape)
        return initial_history(self.case, self.basis.gauss_points, toughness, length_scale)

    def warm_up(self) -> None:
        """Compile every kernel, so that the clock times the work alone."""
        self.balance()
        start = {name: np.array(array) for name, array in self.checkpoint().items()}
        self.step(self._time, 1e-12 * courant_step(self.case))
        self.restore(start)
        self.costs.forget()

    # ---------------------------------------------------------------- time

    def stable_step(self) -> float:
        """h / c, or 2 over a bound of the highest frequency: that of the stiffest element alone [time]."""
        assert self.case.dynamics is not None
        if self.case.dynamics.time_step_rule == "courant":
            return courant_step(self.case)
        return self.basis.stable_step(MaterialTable(self.case))

    def steps(self, times: NDArray, size: float) -> int:
        """Take the first of the steps that begin at times (n,); raises BlewUpError."""
        self.step(float(times[0]), size)
        return 1

    def step(self, now: float, size: float) -> None:
        """Go from time `now` to `now + size`; raises BlewUpError."""
        self._bring_up_to_date()
        motion = self.motion
        motion.velocity, work = self._nodes.with_held(motion.velocity, now, now + size)
        self._work += work
        for further in range(self.case.staggered.passes):
            if further:
                self._phase_field.solve(self._next.history_field, self._change, now)
                self._evaluate_forces()
            velocity = self._nodes.velocity_after(motion.velocity, motion.ahead + 0.5 * size)
            motion.moved = size * velocity
            self._evaluate_strain(motion.displacement + motion.moved, self._next)
        motion.velocity, motion.ahead = velocity, 0.5 * size
        self._add_work()
        motion.displacement = motion.displacement + motion.moved
        self._present, self._next = self._next, self._present
        self._time, self._is_current = now + size, False
        if not np.isfinite(motion.displacement.sum()):
            raise BlewUpError("a displacement is not finite; shorten the time step")

    def _bring_up_to_date(self) -> None:
        """Phase field and forces at the time of the displacement."""
        if self._is_current:
            return
        self._phase_field.solve(self._present.history_field, self._change, self._time)
        self._evaluate_forces()
        self._add_work()
        self._is_current = True

    def _evaluate_strain(self, displacement: NDArray, state: PointState) -> None:
        """Strain and history field of a displacement, and the change of the phase field that they let expect."""
        basis, coefficients, points = self.basis, self._coefficients, self._phase_field.points
        with self.costs.timed("strain"):
            evaluate_strain(basis.elements, basis.slope, displacement, self._law, state.strain)
            raise_history(
                state.strain.psi, self._present.history_field, points.value, points.solved_for, coefficients.drive,
                coefficients.resistance, self.case.staggered.irreversible, state.history_field, self._change,
            )  # fmt: skip

    def _evaluate_forces(self) -> None:
        """Forces and acceleration of the nodes at the time of the displacement."""
        value, residual_stiffness = self._phase_field.points.value, self._coefficients.residual_stiffness
        with self.costs.timed("forces"):
            self._nodes.evaluate_forces(self._present.strain, value, residual_stiffness, self._time)

    def _add_work(self) -> None:
        """Half of the work of the last step, by the outer forces at one of its ends."""
        self._work += 0.5 * float((self._nodes.outer_forces(self.motion.velocity) * self.motion.moved).sum())

    # ---------------------------------------------------------------- what can be seen

    def balance(self) -> Balance:
        """Energies and momentum at the time of the displacement."""
        self._bring_up_to_date()
        nodes, motion = self._nodes, self.motion
        velocity = nodes.velocity_after(motion.velocity, motion.ahead)
        momentum = (nodes.mass[:, None] * velocity).sum(axis=0)
        return Balance(
            elastic=float((self._energy_density() * self.basis.volume).sum()),
            fracture=self._phase_field.energy(),
            kinetic=0.5 * float((nodes.mass[:, None] * velocity**2).sum()),
            external_work=self._work,
            external_power=float((nodes.outer_forces(velocity) * velocity).sum()),
            contact_work=0.0,
            momentum=(float(momentum[0]), float(momentum[1])),
        )

    def _degradation(self) -> NDArray:
        return degradation(self._phase_field.points.value, self._coefficients.residual_stiffness[:, None])

    def _energy_density(self) -> NDArray:
        return self._degradation() * self._present.strain.psi[..., 0] + self._present.strain.psi[..., 1]

    def least_phase_field(self) -> float:
        """Smallest phase field."""
        return float(self._phase_field.points.value.min())

    def monitored(self) -> dict[str, float]:
        """Motion of the body as a whole."""
        self._bring_up_to_date()
        return self._nodes.as_a_whole(
            self.motion.displacement, self._nodes.velocity_after(self.motion.velocity, self.motion.ahead)
        )

    def measures(self) -> dict[str, float]:
        """Lengths of the edges that tractions act on, and how far the body has turned, as its small strains see it."""
        self._bring_up_to_date()
        _, ux_y, uy_x, _ = np.moveaxis(self._present.strain.gradient, -1, 0)
        turned = abs(float(np.average(0.5 * (uy_x - ux_y), weights=self.basis.volume)))
        return loaded_lengths(edge.length for edge in self._nodes.loaded_edges) | {"turned": turned}

    def fields(self) -> Fields:
        """Gauss points and nodes as they stand."""
        self._bring_up_to_date()
        basis, strain, points = self.basis, self._present.strain, self._phase_field.points
        displacement = np.einsum("qa,eai->eqi", basis.shape, self.motion.displacement[basis.elements]).reshape(-1, 2)
        reference = basis.gauss_points.reshape(-1, 2)
        stress = self._degradation()[..., None] * strain.plus + strain.minus
        return Fields(
            points=reference + displacement,
            reference=reference,
            volume=basis.volume.ravel(),
            displacement=displacement,
            gradient=strain.gradient.reshape(-1, 4).copy(),
            phase_field=points.value.ravel().copy(),
            history_field=self._present.history_field.ravel().copy(),
            stress=stress.reshape(-1, 3),
            energy_density=self._energy_density().ravel(),
            body=np.repeat(basis.body, basis.volume.shape[1]),
            grid_points=basis.nodes,
            grid_cells=basis.elements,
            grid_displacement=self.motion.displacement.copy(),
            grid_phase_field=self._phase_field.at_nodes(),
            broken_at=points.broken_at.ravel().copy(),
        )

    def checkpoint(self) -> dict[str, NDArray]:
        """Arrays from which `restore` makes the state again."""
        scalars = np.array([self.motion.ahead, self._time, self._work, self._is_current])
        history = {"history_field": self._present.history_field, "scalars": scalars}
        return self.motion.arrays() | history | self._phase_field.checkpoint()

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to the state of a checkpoint of the same case."""
        ahead, self._time, self._work, is_current = map(float, saved["scalars"])
        self.motion, self._is_current = NodalMotion.of(saved, ahead), bool(is_current)
        self._present.history_field = saved["history_field"].copy()
        self._phase_field.restore(saved)
        self._evaluate_strain(self.motion.displacement, PointState(self._present.strain, self._next.history_field))
        self._evaluate_forces()
