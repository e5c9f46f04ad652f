"""Explicit phase-field Material Point Method for bodies that move, collide and break (thesis Algorithm 3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cases import Case
from mpm.explicit.body_fields import fields_of
from mpm.explicit.body_motion import body_angle, regions_of
from mpm.explicit.contact import Contact
from mpm.explicit.march import March
from mpm.explicit.moving_body import Carried, MovingBody
from mpm.explicit.phase_field import PointPhaseField
from mpm.explicit.prescribed import Tractions, held_lines
from mpm.explicit.rigid_body import FreeRigidBody, make_body
from mpm.explicit.step_bound import stable_step
from mpm.gaps import gap_health_in_bodies
from mpm.grid import GridError
from mpm.placement import PointCloud, place_in_bodies, placement_health_in_bodies
from numerics.built import check_notches_part
from numerics.costs import Costs
from numerics.exact_errors import moving_errors
from numerics.explicit import Balance
from numerics.fields import Fields
from numerics.surface import loaded_lengths
from physics.elasticity import MaterialTable
from physics.exact import SOLUTIONS
from physics.moving_frame import MovingFrame
from physics.phase_field import initial_history

#: columns of the history for each body
MOTION_COLUMNS = ("x", "y", "momentum_x", "momentum_y", "spin")


class ExplicitMaterialPoints:
    """Bodies with a field of velocity each on one uniform grid; implements ``DynamicDiscretisation``.

    Attributes
    ----------
    bodies : the bodies of the case, in its order.
    phase_fields : of the bodies that can break.
    """

    def __init__(self, case: Case, cloud: PointCloud | None = None) -> None:
        assert case.dynamics is not None
        self.case, self.costs = case, Costs()
        _refuse_what_needs_a_grid_that_stays(case)
        stable_step(case)  # a rule that gives none is told before anything is made
        self._frame, self._now = MovingFrame(case), case.dynamics.start_time
        self.cloud = cloud or place_in_bodies(case)
        self.bodies = [make_body(case, number, self.cloud) for number in range(len(case.bodies))]
        self._moving = [body for body in self.bodies if not body.keeps_velocity]
        self._deforming = [body for body in self.bodies if body.deforms]
        _check_notches(case, self.cloud)
        _start_from_exact(case, self._deforming)
        _start_notches(case, self.bodies)
        self.contact = Contact(case, self.bodies)
        self._regions = regions_of(case, self.bodies, self.cloud)
        self._lines = held_lines(case, self.bodies, self.cloud)
        self._tractions = Tractions(case, self.bodies, self.cloud)
        self.phase_fields = [
            PointPhaseField(case, number, body, self.costs) for number, body in enumerate(self.bodies) if body.breakable
        ]
        self._break_notches()
        self._work, self._kinetic_at_start = np.zeros(3), self._kinetic_energy_of_points()
        breaks = bool(self.phase_fields) or any(body.has_axes for body in self.bodies)
        can_march = case.staggered.passes == 1 and not breaks and not self._tractions.lengths
        self._march = March(case, self.bodies, self.contact, self._lines, self._frame) if can_march else None
        self._updates_last = case.dynamics.order_of_update == "musl"
        self.costs.count["points"] = len(self.cloud.positions)

    def _break_notches(self) -> None:
        """Phase field and stresses at the start."""
        for phase_field in self.phase_fields:
            phase_field.solve(0.0, everywhere=True)
        for body in self._deforming:
            body.evaluate_stresses()

    def warm_up(self) -> None:
        """Compile every kernel, so that the clock times the work alone."""
        saved = self._copies()
        self.step(0.0, 1e-9 * self.stable_step())
        if len(self.bodies) > 1 and self._march is None:
            self.contact.warm_up()
        self.restore(saved)
        self.costs.forget()

    # ---------------------------------------------------------------- time integration

    def stable_step(self) -> float:
        """Largest time step by the case's rule [time]."""
        return stable_step(self.case)

    def steps(self, times: NDArray, size: float) -> int:
        """Take some of the steps that begin at times (n,), at least one, and tell how many; raises BlewUpError.

        Bodies that neither break nor are pulled at go many steps in one compiled call.
        """
        done = 1
        if self._march is None:
            self._step(float(times[0]), size)
        else:
            with self.costs.timed("steps"):
                done = self._march.go(times, size, self._work)
            self.costs.count["compiled_steps"] += done
        self._now = float(times[done - 1]) + size
        return done

    def step(self, now: float, size: float) -> None:
        """Go from time ``now`` to ``now + size``; raises BlewUpError."""
        self.steps(np.array([now]), size)

    def _step(self, now: float, size: float) -> None:
        """Algorithm 3; raises what its bodies raise.

        The first pass solves the phase field of the time ``now``; each further one of ``staggered.passes`` goes back and
        repeats the step, from the same internal forces, with the phase field of the history field that the pass before
        it led to: stresses at the end of the step are then those of their own phase field.
        """
        for body in self.bodies:
            body.keep_sorted(size)
        passes = self.case.staggered.passes
        start = self._copies() if passes > 1 else {}
        self._map_to_grid(now)
        self._solve_phase_fields(now)
        self._move(now, size)
        for _ in range(passes - 1):
            self._go_back_with_phase_field_ahead(start, now)
            self._map_to_grid(now)
            self._move(now, size)

    def _copies(self) -> dict[str, NDArray]:
        return {name: array.copy() for name, array in self.checkpoint().items()}

    def _map_to_grid(self, now: float) -> None:
        with self.costs.timed("to_grid"):
            for body in self.bodies:
                body.map_to_grid()
            self._tractions.add(now)

    def _solve_phase_fields(self, now: float) -> None:
        with self.costs.timed("phase_field"):
            for phase_field in self.phase_fields:
                phase_field.solve(now)

    def _go_back_with_phase_field_ahead(self, start: Mapping[str, NDArray], now: float) -> None:
        """The state at the start of the step, its stresses too, but for the phase field."""
        ahead = [body.points.crack.history for body in self.bodies]
        self.restore(start)
        committed = [body.points.crack for body in self.bodies]
        for body, history in zip(self.bodies, ahead, strict=True):
            body.points.crack = body.points.crack._replace(history=history)
        self._solve_phase_fields(now)
        for body, crack in zip(self.bodies, committed, strict=True):
            body.points.crack = crack

    def _move(self, now: float, size: float) -> None:
        """Trial velocities, contact, and the points' motion from what is mapped to the grid."""
        for line in self._lines:
            line.begin_step(now, size)
        with self.costs.timed("grid"):
            acceleration, damping = self._frame.acceleration(now + 0.5 * size), self._frame.damping(now)
            for body in self.bodies:
                body.find_trial_velocities(size, acceleration, damping)
            impulses = self._hold()
        with self.costs.timed("contact"):
            self.contact.detect()
            self.contact.exchange(size)
        with self.costs.timed("grid"):
            impulses += self._hold()
            carried = [] if self._frame.at_rest and not damping else [body.carried() for body in self._moving]
            self._count_boundary_work(impulses, size, damping, carried)
        if not self._frame.at_rest:
            self._go_with_mean_velocities(acceleration, size, carried)
        self._update(size)

    def _go_with_mean_velocities(self, acceleration: NDArray, size: float, of_bodies: Sequence[Carried]) -> None:
        """Let the middle of each body go with its mean velocity of the step; the later one falls g t dt / 2 too far."""
        for body, carried in zip(self._moving, of_bodies, strict=True):
            body.lag = 0.5 * (carried.after - carried.before) / carried.mass
            self._work[0] += 0.5 * size * float(acceleration @ (carried.before + carried.after))

    def _update(self, size: float) -> None:
        """Velocities, places, strains and stresses of the points."""
        if not self._updates_last:
            with self.costs.timed("to_points"):
                for body in self.bodies:
                    body.update_all(size)
            return
        with self.costs.timed("to_points"):
            for body in self.bodies:
                body.update_points(size)
        with self.costs.timed("to_grid"):
            for body in self._deforming:
                body.map_momentum_again()
            self._hold()
        with self.costs.timed("to_points"):
            for body in self._deforming:
                body.update_stresses(size)

    def _hold(self) -> NDArray:
        """Prescribe velocities; the impulses (n_lines,) that it takes [force time]."""
        return np.array([line.apply() for line in self._lines])

    def _count_boundary_work(self, impulses: NDArray, size: float, damping: float, of_bodies: Sequence[Carried]) -> None:
        work = sum(i * line.velocity for i, line in zip(impulses, self._lines, strict=True))
        work += size * (self._tractions.power() - damping * sum(carried.damped for carried in of_bodies))
        on_nodes = sum(body.work_on_nodes() for body in self._deforming)
        self._work[:] = self._work[0] + work, work / size, self._work[2] + on_nodes

    # ---------------------------------------------------------------- what can be seen

    def balance(self) -> Balance:
        """Energies and momentum of the bodies that do not keep their velocity whatever they meet."""
        motions = [body.whole_motion() for body in self._moving]
        momentum = np.sum([motion.momentum for motion in motions], axis=0)
        lost = self._kinetic_energy_of_points() - self._kinetic_at_start - float(self._work[2])
        return Balance(
            elastic=sum(float((body.energy_density() * body.points.matter.volume).sum()) for body in self._deforming),
            fracture=sum(phase_field.fracture_energy() for phase_field in self.phase_fields),
            kinetic=sum(motion.energy for motion in motions),
            external_work=float(self._work[0]) + self.contact.work_of_rigid,
            external_power=float(self._frame.acceleration(self._now) @ momentum) + float(self._work[1]),
            contact_work=self.contact.work,
            friction_work=self.contact.work_of_friction,
            transfer_work=None if self._updates_last else lost,
            momentum=(float(momentum[0]), float(momentum[1])),
        )

    def _kinetic_energy_of_points(self) -> float:
        """Of the bodies that deform."""
        return sum(body.whole_motion().energy for body in self._deforming)

    def least_phase_field(self) -> float:
        """Smallest phase field of all points."""
        return min(float(body.points.crack.c.min()) for body in self.bodies)

    def monitored(self) -> dict[str, float]:
        """Motion of each body as a whole, and the impulse that contact has given it."""
        columns: dict[str, float] = {}
        self.contact.begin_record()
        for body, impulse in zip(self.bodies, self.contact.impulse, strict=True):
            motion = body.whole_motion()
            values = (*motion.place, *motion.momentum, motion.spin)
            columns |= {f"{body.name}_{key}": float(v) for key, v in zip(MOTION_COLUMNS, values, strict=True)}
            if isinstance(body, FreeRigidBody):
                columns[f"{body.name}_angle"] = body.angle
            elif self.case.rocking is not None and body.name == self.case.rocking.body:
                columns[f"{body.name}_angle"] = body_angle(body, self.cloud.positions)
            if len(self.bodies) > 1:
                columns |= {f"{body.name}_impulse_x": float(impulse[0]), f"{body.name}_impulse_y": float(impulse[1])}
        columns |= {f"{name}_angle": body_angle(*region) for name, region in self._regions.items()}
        for name, count in self.contact.violations.items():
            self.costs.count[name] = count
        return columns

    def fields(self) -> Fields:
        """Points as they stand, in the order in which they were placed, and the occupied cells of the grid."""
        return fields_of(self.bodies, self.cloud)

    def measures(self) -> dict[str, float]:
        """Errors against an exact solution, half-width and peak of the pressure on a floor, lengths of loaded edges."""
        errors = moving_errors(self.case, self.fields()) | loaded_lengths(self._tractions.lengths)
        errors |= placement_health_in_bodies(self.case, self.cloud) | gap_health_in_bodies(self.case)
        return errors | _pressure_on_floor(self.case, self.contact, self._moving)

    def checkpoint(self) -> dict[str, NDArray]:
        """Arrays from which `restore` makes the state again."""
        arrays = {"boundary": np.append(self._work, self._now)}
        arrays |= {f"contact_{name}": array for name, array in self.contact.checkpoint().items()}
        for number, body in enumerate(self.bodies):
            arrays |= {f"body{number}_{name}": array for name, array in body.checkpoint().items()}
        for number, phase_field in enumerate(self.phase_fields):
            arrays |= {f"phase_field{number}_{name}": array for name, array in phase_field.checkpoint().items()}
        return arrays

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to the state of a checkpoint of the same case."""
        self._work[:], self._now = saved["boundary"][:3], float(saved["boundary"][3])
        self.contact.restore(_part(saved, "contact_"))
        for number, body in enumerate(self.bodies):
            body.restore(_part(saved, f"body{number}_"))
        for number, phase_field in enumerate(self.phase_fields):
            phase_field.restore(_part(saved, f"phase_field{number}_"))


def _pressure_on_floor(case: Case, contact: Contact, moving: Sequence[MovingBody]) -> dict[str, float]:
    """Half-width [length] and peak [stress] of the pressure on a floor, where bodies lie on one."""
    pressed = contact.pressure_on_floor(case.mpm.order)
    if not pressed or case.dynamics is None:
        return {}
    weight = -case.dynamics.gravity[1] * sum(body.points.matter.mass.sum() for body in moving)
    peak = weight * pressed["peak"] / (case.mesh.h * case.plane.thickness)
    return {"contact_half_width": case.mesh.h * pressed["half_width"], "peak_pressure": peak}


def _part(saved: Mapping[str, NDArray], prefix: str) -> dict[str, NDArray]:
    """Arrays whose names begin with a prefix, under the rest of their names."""
    return {name.removeprefix(prefix): array for name, array in saved.items() if name.startswith(prefix)}


def _refuse_what_needs_a_grid_that_stays(case: Case) -> None:
    if case.mesh.fine is not None:
        raise GridError(f"{case.source}: mesh.fine: explicit material points need a uniform grid; remove it.")
    for notch in case.all_notches:
        if notch.kind == "slit":
            raise GridError(
                f"{case.source}: notches: the slit from {list(notch.start)} to {list(notch.end)} would open a grid"
                f' that stays, this one moves; give kind = "cells" with a width of {3.0 * case.mesh.h:g}, or "history".'
            )


def _start_from_exact(case: Case, deforming: Sequence[MovingBody]) -> None:
    """Velocities and strains of the case's exact solution at the start, where it has them."""
    solution = SOLUTIONS.get(case.exact or "")
    for body in deforming:
        motion, elastic = body.points.motion, body.points.elastic
        if solution is not None and solution.velocity is not None:
            motion.vx[:], motion.vy[:] = solution.velocity(case, body.positions(), 0.0).T
        if solution is not None and solution.strain is not None:
            elastic.exx[:], elastic.eyy[:], elastic.gxy[:] = solution.strain(case, body.positions(), 0.0).T
        body.wandering.largest_speed = body.points.largest_speed()
        body.evaluate_stresses()


def _start_notches(case: Case, bodies: Sequence[MovingBody]) -> None:
    """Initial history fields of the notches that are drawn by them (Eq. 6.51)."""
    table = MaterialTable(case)
    for number, body in enumerate(bodies):
        if body.breakable:
            history = body.points.crack.history
            drawn = initial_history(case, body.positions(), table.toughness[number], table.length_scale[number])
            np.maximum(history, drawn, out=history)


def _check_notches(case: Case, cloud: PointCloud) -> None:
    """Raise BuiltError where points on both sides of a notch lie within h of the same node: it hardly parts them."""
    h = case.mesh.h
    places = (cloud.positions - case.bounding_box()[0]) / h + 0.5 * (case.mpm.order - 1)
    first = np.floor(places + 1e-9).astype(np.int64) + 1
    around = np.array([(0, 0), (0, 1), (1, 0), (1, 1)])
    nodes = (first[:, None, :] + around) @ (int(first.max()) + 2, 1)
    check_notches_part(case, cloud.positions, nodes, h, "make mesh.h no more than half of it")
