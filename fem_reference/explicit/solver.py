"""Explicit phase-field finite elements: central differences with row-sum lumped mass on scikit-fem meshes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cases import Case, CaseError
from fem_reference.boundary import NodeConstraints
from fem_reference.element_basis import ElementBasis
from fem_reference.explicit import kernels as kernels
from fem_reference.explicit.loads import traction_forces
from fem_reference.explicit.phase_field import ElementPhaseField
from numerics.costs import Costs
from numerics.explicit import Balance, BlewUpError
from numerics.fields import Fields
from numerics.time_steps import courant_step
from physics.elasticity import MaterialTable
from physics.exact import SOLUTIONS
from physics.phase_field import PhaseFieldCoefficients, degradation, initial_history


@dataclass
class Strain:
    """What follows from the displacement alone: parts of stress (n_el, n_gauss, 3) and energy (n_el, n_gauss, 2)."""

    gradient: NDArray
    plus: NDArray
    minus: NDArray
    psi: NDArray

    @classmethod
    def zero(cls, shape: tuple[int, int]) -> Strain:
        """No strain at points (n_el, n_gauss)."""
        return cls(*(np.zeros((*shape, n)) for n in (4, 3, 3, 2)))


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
        self.case, self.costs = case, Costs()
        materials = MaterialTable(case)
        self.basis = basis = ElementBasis(case, bool(materials.fourth_order.any()))
        self._split, self._density = materials.law.split[basis.body], materials.density[basis.body]
        self._lam, self._mu = materials.lame_lambda[basis.body], materials.shear_modulus[basis.body]
        self._coefficients = PhaseFieldCoefficients(materials, basis.body)
        self._set_nodes()
        self._phase_field = ElementPhaseField(case, basis, materials, self.constraints, self.costs)
        self._set_initial_state()

    # ---------------------------------------------------------------- set-up

    def _set_nodes(self) -> None:
        """Mass, constraints and external forces of the nodes."""
        basis, n_nodes = self.basis, len(self.basis.nodes)
        corners = basis.elements.ravel()
        self._corners = np.argsort(corners, kind="stable")
        self._starts = np.searchsorted(corners[self._corners], np.arange(n_nodes + 1))
        share = np.einsum("qa,eq->ea", basis.shape, basis.volume) * self._density[:, None]
        self.mass = np.bincount(corners, weights=share.ravel(), minlength=n_nodes)
        self.constraints = NodeConstraints(self.case, basis.nodes)
        self._held = self.constraints.prescribed.reshape(-1, 2)
        self._held_velocity = self.constraints.prescribed_velocity().reshape(-1, 2)
        self._tractions = traction_forces(self.case, basis)
        assert self.case.dynamics is not None
        self._damping = self.case.dynamics.damping
        self._gravity = self.mass[:, None] * np.asarray(self.case.dynamics.gravity)

    def _set_initial_state(self) -> None:
        basis, n_nodes, points = self.basis, len(self.basis.nodes), self.basis.volume.shape
        self.displacement, self._moved = np.zeros((n_nodes, 2)), np.zeros((n_nodes, 2))
        self.velocity = np.where(self._held, self._held_velocity, self._first_velocity())
        #: from the time of the velocity to that of the displacement
        self._ahead = 0.0
        self._strain, self._next_strain = Strain.zero(points), Strain.zero(points)
        self._inner_forces, self._applied = np.zeros((n_nodes, 2)), np.zeros((n_nodes, 2))
        self._element_forces = np.empty((len(basis.elements), 2 * basis.elements.shape[1]))
        self.history_field = self._initial_history()
        self._next_history, self._change = np.empty(points), np.empty(len(basis.elements))
        self._time, self._work = 0.0, 0.0
        self._is_current = False
        self._evaluate_strain(self.displacement, self._strain, self.history_field)
        self._change[:] = np.inf  # the phase field of the notches is found everywhere
        self.costs.count.update(points=basis.volume.size, cells=len(basis.elements), unknowns_displacement=2 * n_nodes)

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
        self.step(0.0, 1e-12 * courant_step(self.case))
        self.restore(start)
        self.costs.forget()

    # ---------------------------------------------------------------- time

    def stable_step(self) -> float:
        """h / c, or 2 over a bound of the highest frequency: that of the stiffest element alone [time]."""
        assert self.case.dynamics is not None
        if self.case.dynamics.time_step_rule == "courant":
            return courant_step(self.case)
        return 2.0 / float(np.sqrt(self.basis.largest_eigenvalue(self._lam, self._mu, self._density)))

    def step(self, now: float, size: float) -> None:
        """Go from time `now` to `now + size`; raises BlewUpError."""
        self._bring_up_to_date()
        for further in range(self.case.staggered.passes):
            if further:
                self._phase_field.solve(self._next_history, self._change, now)
                self._evaluate_forces()
            velocity = self._velocity_after(self._ahead + 0.5 * size)
            self._moved = size * velocity
            self._evaluate_strain(self.displacement + self._moved, self._next_strain, self._next_history)
        self.velocity, self._ahead = velocity, 0.5 * size
        self._add_work()
        self.displacement = self.displacement + self._moved
        self._strain, self._next_strain = self._next_strain, self._strain
        self.history_field, self._next_history = self._next_history, self.history_field
        self._time, self._is_current = now + size, False
        if not np.isfinite(self.displacement.sum()):
            raise BlewUpError("a displacement is not finite; shorten the time step")

    def _velocity_after(self, interval: float) -> NDArray:
        """Velocity (n_nodes, 2) an interval after the present one, damped by the mean of both."""
        loss = 0.5 * self._damping * interval
        kept, gained = (1.0 - loss) / (1.0 + loss), interval / (1.0 + loss)
        velocity = kept * self.velocity + gained * self._acceleration
        return np.where(self._held, self._held_velocity, velocity)

    def _bring_up_to_date(self) -> None:
        """Phase field and forces at the time of the displacement."""
        if self._is_current:
            return
        self._phase_field.solve(self.history_field, self._change, self._time)
        self._evaluate_forces()
        self._add_work()
        self._is_current = True

    def _evaluate_strain(self, displacement: NDArray, strain: Strain, history_field: NDArray) -> None:
        """Strain and history field of a displacement, and the change of the phase field that they let expect."""
        basis, coefficients = self.basis, self._coefficients
        with self.costs.timed("strain"):
            kernels.evaluate_strain(
                basis.elements, basis.slope, displacement, self._split, self._lam, self._mu,
                strain.gradient, strain.plus, strain.minus, strain.psi,
            )  # fmt: skip
            kernels.raise_history(
                strain.psi, self.history_field, self._phase_field.at_points, self._phase_field.solved_for,
                coefficients.drive, coefficients.resistance, self.case.staggered.irreversible,
                history_field, self._change,
            )  # fmt: skip

    def _evaluate_forces(self) -> None:
        """Internal and external forces and the acceleration of the nodes at the time of the displacement."""
        basis, strain = self.basis, self._strain
        with self.costs.timed("forces"):
            kernels.element_forces(
                basis.slope, basis.volume, self._phase_field.at_points, self._coefficients.residual_stiffness,
                strain.plus, strain.minus, self._element_forces,
            )  # fmt: skip
            kernels.gather_at_nodes(self._starts, self._corners, self._element_forces, self._inner_forces)
            pulls = sum(traction.share(self._time) * forces for traction, forces in self._tractions)
            self._applied = self._gravity + pulls
            self._acceleration = (self._applied - self._inner_forces) / self.mass[:, None]
            self._acceleration[self._held] = 0.0

    def _add_work(self) -> None:
        """Half of the work of the last step, by the outer forces at one of its ends."""
        self._work += 0.5 * float((self._outer_forces(self.velocity) * self._moved).sum())

    def _outer_forces(self, velocity: NDArray) -> NDArray:
        """External forces, damping and reactions included (n_nodes, 2); what is held moves at constant velocity."""
        free = self._applied
        if self._damping:
            free = free - self._damping * self.mass[:, None] * velocity
        return np.where(self._held, self._inner_forces, free)

    # ---------------------------------------------------------------- what can be seen

    def balance(self) -> Balance:
        """Energies and momentum at the time of the displacement."""
        self._bring_up_to_date()
        velocity = self._velocity_after(self._ahead)
        momentum = (self.mass[:, None] * velocity).sum(axis=0)
        return Balance(
            elastic=float((self._energy_density() * self.basis.volume).sum()),
            fracture=self._phase_field.energy(),
            kinetic=0.5 * float((self.mass[:, None] * velocity**2).sum()),
            external_work=self._work,
            external_power=float((self._outer_forces(velocity) * velocity).sum()),
            contact_work=0.0,
            momentum=(float(momentum[0]), float(momentum[1])),
        )

    def _degradation(self) -> NDArray:
        return degradation(self._phase_field.at_points, self._coefficients.residual_stiffness[:, None])

    def _energy_density(self) -> NDArray:
        return self._degradation() * self._strain.psi[..., 0] + self._strain.psi[..., 1]

    def least_phase_field(self) -> float:
        """Smallest phase field."""
        return float(self._phase_field.at_points.min())

    def monitored(self) -> dict[str, float]:
        """Nothing beyond what every dynamic run records."""
        return {}

    def measures(self) -> dict[str, float]:
        """Nothing that only the finite elements can tell."""
        return {}

    def fields(self) -> Fields:
        """Gauss points and nodes as they stand."""
        self._bring_up_to_date()
        basis, strain = self.basis, self._strain
        displacement = np.einsum("qa,eai->eqi", basis.shape, self.displacement[basis.elements]).reshape(-1, 2)
        reference = basis.gauss_points.reshape(-1, 2)
        stress = self._degradation()[..., None] * strain.plus + strain.minus
        return Fields(
            points=reference + displacement,
            reference=reference,
            volume=basis.volume.ravel(),
            displacement=displacement,
            gradient=strain.gradient.reshape(-1, 4).copy(),
            phase_field=self._phase_field.at_points.ravel().copy(),
            history_field=self.history_field.ravel().copy(),
            stress=stress.reshape(-1, 3),
            energy_density=self._energy_density().ravel(),
            body=np.repeat(basis.body, basis.volume.shape[1]),
            grid_points=basis.nodes,
            grid_cells=basis.elements,
            grid_displacement=self.displacement.copy(),
            grid_phase_field=self._phase_field.at_nodes(),
            broken_at=self._phase_field.broken_at.ravel().copy(),
        )

    def checkpoint(self) -> dict[str, NDArray]:
        """Arrays from which `restore` makes the state again."""
        scalars = np.array([self._ahead, self._time, self._work, self._is_current])
        return {
            "displacement": self.displacement, "velocity": self.velocity, "moved": self._moved,
            "history_field": self.history_field, "scalars": scalars, **self._phase_field.checkpoint(),
        }  # fmt: skip

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to the state of a checkpoint of the same case."""
        self.displacement, self.velocity = saved["displacement"].copy(), saved["velocity"].copy()
        self._moved, self.history_field = saved["moved"].copy(), saved["history_field"].copy()
        self._ahead, self._time, self._work, is_current = map(float, saved["scalars"])
        self._is_current = bool(is_current)
        self._phase_field.restore(saved)
        self._evaluate_strain(self.displacement, self._strain, self._next_history)
        self._evaluate_forces()
