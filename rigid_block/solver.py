"""The rigid models of a rocking block as discretisations in time; the motion is found at once and then told."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cases import Case, CaseError
from cases.geometry import slack_of
from numerics.costs import Costs
from numerics.description import Description
from numerics.explicit import Balance
from numerics.fields import Fields
from physics.rocking.motion import RockingMotion
from physics.rocking.of_case import block_of, ground_motion
from physics.rocking.pendulum import Pendulum
from physics.rocking.winkler import WinklerBlock
from rigid_block.pictures import picture
from rigid_block.verdicts import borders_of, model_of, named_borders

#: rows of the Winkler model's motion over the longest time that is told
MOST_ROWS = 20_000


class _RigidBlockMotion:
    """A block and the ground's motion; implements ``DynamicDiscretisation``.

    The block stands still before time 0. Energies are its kinetic one and the work of gravity and the moving frame; what
    base and impacts have taken, or the springs hold, follows from the balance.
    """

    solver: ClassVar[str]

    def __init__(self, case: Case) -> None:
        assert case.dynamics is not None and case.rocking is not None
        _refuse_what_is_not_known(case, self.solver)
        self.case, self.costs, self.block = case, Costs(), block_of(case)
        self.model = model_of(case, self.solver)
        self.ground = ground_motion(case, self.model.uplift_acceleration)
        self._now = case.dynamics.start_time
        self.motion = self._respond()
        self._work = self._work_until()
        self.costs.count.update(points=1, cells=1, unknowns_displacement=3, rows=len(self.motion.time))

    def _respond(self) -> RockingMotion:
        assert self.case.dynamics is not None
        return self.model.respond(self.ground, stop_when_settled=False, until=self.case.dynamics.end_time)

    def _work_until(self) -> NDArray:
        """Work (n,) of gravity and the moving frame since the start, by the trapezoidal rule [energy].

        It is no less than what the block holds, which the rule may miss where both nearly vanish.
        """
        motion, block = self.motion, self.block
        push = -self.ground.acceleration(motion.time) * motion.velocity[:, 0]
        steps = np.diff(motion.time) * 0.5 * (push[1:] + push[:-1])
        pushed = np.concatenate([[0.0], np.cumsum(steps)])
        work = self._mass * (pushed - block.gravity * (motion.place[:, 1] - motion.place[0, 1]))
        return np.maximum(work, self._kinetic(motion.velocity, motion.rate))

    @property
    def _mass(self) -> float:
        return self.block.mass * self.case.plane.thickness

    # ---------------------------------------------------------------- time

    def stable_step(self) -> float:
        """As long as the distance between two records [time]."""
        return _interval(self.case)

    def steps(self, times: NDArray, size: float) -> int:
        """Go on to tell the end of the last of the steps that begin at times (n,), and tell how many they are."""
        self._now = float(times[-1]) + size
        return len(times)

    def _at(self, values: NDArray) -> float:
        return float(np.interp(self._now, self.motion.time, values))

    # ---------------------------------------------------------------- what can be seen

    def balance(self) -> Balance:
        """Energies and momentum; ``contact_work`` is what is missing."""
        velocity = np.array([self._at(v) for v in self.motion.velocity.T])
        kinetic, momentum = float(self._kinetic(velocity, self._at(self.motion.rate))), self._mass * velocity
        work = self._at(self._work)
        push = -float(self.ground.acceleration(self._now)[0])
        power = momentum[0] * push - momentum[1] * self.block.gravity
        return Balance(0.0, 0.0, kinetic, work, power, kinetic - work, (float(momentum[0]), float(momentum[1])))

    def _kinetic(self, velocity: NDArray, rate: ArrayLike) -> NDArray:
        """Kinetic energy (n,) at velocities (n, 2) of the centre and rates (n,) of the angle."""
        turning = self.block.inertia / self.block.mass * np.square(rate)
        return 0.5 * self._mass * ((velocity**2).sum(axis=-1) + turning)

    def least_phase_field(self) -> float:
        """Nothing breaks."""
        return 1.0

    def monitored(self) -> dict[str, float]:
        """Place, momentum, spin and angle of the block, counter-clockwise, as the material points tell them."""
        motion, name = self.motion, self.case.rocking.body  # type: ignore[union-attr]
        x, y = (self._at(place) + first for place, first in zip(motion.place.T, self._middle_of_base(), strict=True))
        momentum = self.balance().momentum
        return {
            f"{name}_x": x, f"{name}_y": y, f"{name}_momentum_x": momentum[0], f"{name}_momentum_y": momentum[1],
            f"{name}_spin": -self._at(motion.rate), f"{name}_angle": -self._at(motion.angle),
        }  # fmt: skip

    def _middle_of_base(self) -> NDArray:
        lower, upper = self.case.bodies[self.case.rocking.body].bounds()  # type: ignore[union-attr]
        return np.array([0.5 * (lower[0] + upper[0]), lower[1]])

    def fields(self) -> Fields:
        """The bodies as coarse pictures, the block where it is."""
        told, name = self.monitored(), self.case.rocking.body  # type: ignore[union-attr]
        return picture(self.case, np.array([told[f"{name}_x"], told[f"{name}_y"]]), told[f"{name}_angle"])

    def measures(self) -> dict[str, float]:
        """The borders of the verdict, where the case asks for them."""
        asked = bool(self.case.rocking.borders)  # type: ignore[union-attr]
        return named_borders(borders_of(self.case, self.model)) if asked else {}

    def checkpoint(self) -> dict[str, NDArray]:
        """The time that was told last."""
        return {"now": np.array(self._now)}

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to a time."""
        self._now = float(saved["now"])


class PendulumMotion(_RigidBlockMotion):
    """Housner's block on a rigid base."""

    solver = "pendulum"

    def _kinetic(self, velocity: NDArray, rate: ArrayLike) -> NDArray:
        inertia = self.block.inertia + self.block.mass * self.block.half_diagonal**2
        return 0.5 * inertia * self.case.plane.thickness * np.square(rate)

    def measures(self) -> dict[str, float]:
        """The borders, and how well the free motion keeps its energy between impacts."""
        return super().measures() | {"energy_between_impacts": self._energy_scatter()}

    def _energy_scatter(self) -> float:
        """Largest change of the energy between two impacts, or the start and one, over the energy there."""
        motion, model = self.motion, self.model
        assert isinstance(model, Pendulum)
        free = (motion.time > self.ground.end) & (motion.angle != 0.0)
        between = np.searchsorted(motion.impacts, motion.time[free], side="right")
        energy = np.array([model.energy(a, r) for a, r in zip(motion.angle[free], motion.rate[free], strict=True)])
        pieces = [energy[between == number] for number in np.unique(between)[:10]]
        return max((float(np.ptp(piece) / piece[0]) for piece in pieces), default=0.0)


class LinearPendulumMotion(PendulumMotion):
    """The same for small angles."""

    solver = "pendulum_linear"


class WinklerMotion(_RigidBlockMotion):
    """A rigid block on one-sided springs and dampers with friction."""

    solver = "winkler"

    def _respond(self) -> RockingMotion:
        assert isinstance(self.model, WinklerBlock) and self.case.dynamics is not None
        end = self.case.dynamics.end_time
        every = math.ceil(end / (MOST_ROWS * self.model.time_step))
        return self.model.respond(self.ground, stop_when_settled=False, every=every, until=end)


def _refuse_what_is_not_known(case: Case, solver: str) -> None:
    """Raise CaseError where something moves the block other than gravity and the horizontal motion of its ground."""
    assert case.dynamics is not None and case.rocking is not None
    dynamics, block = case.dynamics, case.rocking.body
    beneath = case.rocking.on or next((name for name in case.bodies if name != block), None)
    keys = [(name, key) for name in case.bodies for key in ("velocity", "velocity_gradient")]
    found = [f"bodies.{name}.{key}" for name, key in keys if np.any(getattr(case.bodies[name], key))]
    found += ["dynamics.damping"] if dynamics.damping else []
    found += ["dynamics.ground.direction"] if dynamics.ground and dynamics.ground.direction != "x" else []
    found += [f"constraints[{n}]" for n, held in enumerate(case.constraints) if held.velocity or held.table is not None]
    found += ["tractions[0]"] if case.tractions else []
    if found:
        text = f"{found[0]}: acts on no {solver}, a block at rest that gravity and a horizontal motion of its ground move"
        raise CaseError(f"{case.source}: {text}; remove it, or give solver = \"mpm\".")
    if beneath is None:
        if solver == WinklerMotion.solver:
            raise CaseError(f"{case.source}: rocking.on: nothing is beneath the block; add a body that it rocks on.")
        return
    (lower, upper), (ground_lower, ground_upper) = case.bodies[block].bounds(), case.bodies[beneath].bounds()
    above, slack = lower[1] - ground_upper[1], slack_of(case.bounding_box())
    beside = max(ground_lower[0] - lower[0], upper[0] - ground_upper[0])
    for distance, where in ((abs(above), f"{above:g} {case.units.length} above"), (beside, "beyond the edge of")):
        if distance > slack:
            text = f"rocking.on: the block stands {where} '{beneath}'"
            raise CaseError(f"{case.source}: {text}; set it upon the body that it rocks on.")


def _interval(case: Case) -> float:
    assert case.dynamics is not None
    return (case.dynamics.end_time - case.dynamics.start_time) / case.output.records


def describe(case: Case) -> Description:
    """One body of three unknowns at most, told as often as it is recorded."""
    return Description(
        basis="a rigid block", fine="no mesh", cells=1, points=1, unknowns_displacement=3, unknowns_phase_field=0,
        order=1, rigid=1.0, stable_step=_interval(case),
    )  # fmt: skip
