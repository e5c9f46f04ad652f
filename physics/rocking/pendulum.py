"""Housner's inverted pendulum: a rigid block on a rigid base, impacts located as events (thesis Eqs. 7.1-7.5).

    theta'' = -p² [sin(s alpha - theta) + (a/g) cos(s alpha - theta)],    s = sign of theta,
    theta'+ = eta theta'-  at an impact.

The linear form takes sin x = x and cos x = 1. The block begins to rock where |a| reaches g tan alpha (linear: g alpha),
away from the ground's acceleration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from physics.rocking.block import Block
from physics.rocking.ground import GroundMotion, acceleration
from physics.rocking.motion import OVERTURNED, RockingMotion, verdict_of

#: rate below which a block that has come down stays down, as a share of p alpha: impacts pile up before a finite time
RESTS = 1e-6
#: time that is followed after the ground has come to rest, in units of 1/p
PATIENCE = 60.0
#: step of the integration in units of 1/p
STEP = 2e-3
#: bisections that locate an event within a step
BISECTIONS = 60


class _Constants(NamedTuple):
    """What the compiled loop needs of a pendulum."""

    alpha: float
    gravity: float
    square: float
    eta: float
    uplift: float
    linear: bool
    fallen: float
    rests: float


@dataclass(frozen=True)
class Pendulum:
    """The block's equation of motion.

    Attributes
    ----------
    block : its dimensions. linear : of small angles.
    restitution : eta; Housner's without.
    step : of the fourth-order integration, in units of 1/p; impacts, uplift and breaks of the ground motion are met.
    """

    block: Block
    linear: bool = False
    restitution: float | None = None
    step: float = STEP

    @property
    def uplift_acceleration(self) -> float:
        """Acceleration of the ground at which rocking begins [m/s²]."""
        return self.block.gravity * self.block.slenderness if self.linear else self.block.uplift_acceleration

    @property
    def _constants(self) -> _Constants:
        block = self.block
        eta = block.housner_restitution if self.restitution is None else self.restitution
        rests = RESTS * block.frequency * block.slenderness
        fallen = math.radians(OVERTURNED)
        square, uplift = block.frequency**2, self.uplift_acceleration
        return _Constants(block.slenderness, block.gravity, square, eta, uplift, self.linear, fallen, rests)

    def energy(self, angle: float, rate: float) -> float:
        """Energy over the moment of inertia about the corner, from upright rest [1/s²]."""
        return float(_energy(self._constants, angle, rate))

    def respond(self, ground: GroundMotion, stop_when_settled: bool = True, until: float = 0.0) -> RockingMotion:
        """The motion from rest under a ground motion.

        stop_when_settled : end where the verdict cannot change: the ground rests, and the block moves outward with more
            energy than the barrier where its centre stands over the corner, or has less. Without, it is followed until
            it has fallen or come to rest.
        until : time to which it is followed at least [s]
        """
        frequency = self.block.frequency
        step, last = self.step / frequency, max(ground.end + PATIENCE / frequency, until)
        # a pulse that jumps at its start is met there
        breaks = np.unique(np.append(ground.breaks(), last))
        rows, impacts, overturned = _respond(self._constants, ground, breaks, step, stop_when_settled)
        verdict = verdict_of(overturned, len(impacts))
        time, angle, rate = rows.T
        centre = self._centre(angle, rate)
        return RockingMotion(time, angle, rate, verdict, float(time[-1]), impacts, *centre)

    def _centre(self, angle: NDArray, rate: NDArray) -> tuple[NDArray, NDArray]:
        """Place and velocity (n, 2) of the block's centre as it turns about its corners."""
        side, radius = np.sign(angle), self.block.half_diagonal
        lever = self.block.slenderness - np.abs(angle)
        across, up, slope = np.sin(lever), np.cos(lever), np.cos(lever)
        if self.linear:
            across, up, slope = lever, 1.0 - 0.5 * lever**2, np.ones_like(lever)
        place = np.column_stack([side * (0.5 * self.block.width - radius * across), radius * up])
        velocity = radius * rate[:, None] * np.column_stack([slope, side * across])
        return place, velocity


@njit(cache=True)
def _curvature(c, ground, time, angle, side):
    """theta'' on the corner of a side."""
    lever, share = side * c.alpha - angle, acceleration(ground, time) / c.gravity
    if c.linear:
        return -c.square * (lever + share)
    return -c.square * (math.sin(lever) + share * math.cos(lever))


@njit(cache=True)
def _energy(c, angle, rate):
    lever = c.alpha - abs(angle)
    potential = 0.5 * (c.alpha**2 - lever**2) if c.linear else math.cos(lever) - math.cos(c.alpha)
    return 0.5 * rate**2 + c.square * potential


@njit(cache=True)
def _settled(c, angle, rate):
    """+1 falls, -1 never falls, 0 not yet known of a block on a ground that rests."""
    barrier = c.square * (0.5 * c.alpha**2 if c.linear else 1.0 - math.cos(c.alpha))
    enough = _energy(c, angle, rate) >= barrier
    if enough:
        # inward, an impact that takes energy comes first
        return 1 if angle * rate >= 0.0 else 0
    return -1 if abs(angle) < c.alpha else 1


@njit(cache=True)
def _advance(c, ground, time, angle, rate, side, step):
    """One step of the classical Runge-Kutta method."""
    middle, end = time + 0.5 * step, time + step
    a1 = _curvature(c, ground, time, angle, side)
    r2 = rate + 0.5 * step * a1
    a2 = _curvature(c, ground, middle, angle + 0.5 * step * rate, side)
    r3 = rate + 0.5 * step * a2
    a3 = _curvature(c, ground, middle, angle + 0.5 * step * r2, side)
    r4 = rate + step * a3
    a4 = _curvature(c, ground, end, angle + step * r3, side)
    return angle + step / 6.0 * (rate + 2.0 * r2 + 2.0 * r3 + r4), rate + step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)


@njit(cache=True)
def _impact_within(c, ground, time, angle, rate, side, step):
    """Part of a step after which the block is down again."""
    low, high = 0.0, step
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if side * _advance(c, ground, time, angle, rate, side, middle)[0] > 0.0:
            low = middle
        else:
            high = middle
    return high


@njit(cache=True)
def _uplift_within(c, ground, time, step):
    """Part of a step after which the ground's acceleration lifts the block, the whole step where it does not."""
    if abs(acceleration(ground, time + step)) <= c.uplift:
        return step
    low, high = 0.0, step
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if abs(acceleration(ground, time + middle)) > c.uplift:
            high = middle
        else:
            low = middle
    return high


@njit(cache=True)
def _respond(c, ground, breaks, largest_step, stop_when_settled):
    """Rows of time, angle, rate (n, 3); times of impacts; whether the block falls."""
    rows, impacts = [(0.0, 0.0, 0.0)], [0.0 for _ in range(0)]
    time, angle, rate, side = 0.0, 0.0, 0.0, 0.0  # no side: the block rests
    for end in breaks:
        number = math.ceil((end - time) / largest_step * (1.0 - 1e-12))
        step = (end - time) / max(number, 1)
        start, passed = time, 0
        while passed < number:
            if side == 0.0:
                if stop_when_settled and time >= ground.end:
                    return np.array(rows), impacts, False
                # just inside, where a pulse that begins with a jump already acts
                if abs(acceleration(ground, time + 1e-9 * step)) > c.uplift:
                    side = -math.copysign(1.0, acceleration(ground, time + 1e-9 * step))
                    continue
                left = start + (passed + 1) * step - time
                part = _uplift_within(c, ground, time, left)
                time += part
                if part < left:
                    side = -math.copysign(1.0, acceleration(ground, time))
                else:
                    passed += 1
                    time = start + passed * step
                rows.append((time, 0.0, 0.0))
                continue
            if time >= ground.end and stop_when_settled:
                known = _settled(c, angle, rate)
                if known != 0:
                    return np.array(rows), impacts, known > 0
            left = start + (passed + 1) * step - time
            new_angle, new_rate = _advance(c, ground, time, angle, rate, side, left)
            if side * new_angle < 0.0:
                part = _impact_within(c, ground, time, angle, rate, side, left)
                _, before = _advance(c, ground, time, angle, rate, side, part)
                time += part
                angle, rate = 0.0, c.eta * before
                rows.append((time, 0.0, rate))
                if abs(rate) < c.rests:
                    rate, side = 0.0, 0.0
                else:
                    impacts.append(time)
                    side = math.copysign(1.0, rate)
                continue
            angle, rate = new_angle, new_rate
            passed += 1
            time = start + passed * step
            rows.append((time, angle, rate))
            if abs(angle) >= c.fallen:
                return np.array(rows), impacts, True
    return np.array(rows), impacts, False


def linear_border_without_impact(frequency_ratio: float) -> float:
    """Amplitude over g alpha of one sine above which the linear block falls without an impact; free of eta.

    A [x cos psi + sin psi - x exp(-(2 pi - psi)/x)] = 1 + x²,  x = omega / p,  sin psi = 1/A.
    """
    x = frequency_ratio

    from scipy.optimize import brentq  # half a second to import, and only this border needs it

    def excess(amplitude: float) -> float:
        psi = math.asin(1.0 / amplitude)
        left = x * math.cos(psi) + math.sin(psi) - x * math.exp(-(2.0 * math.pi - psi) / x)
        return amplitude * left - 1.0 - x * x

    return float(brentq(excess, 1.0 + 1e-9, 10.0 * (1.0 + x * x), xtol=1e-13))
