"""A rigid block on a Winkler foundation: one-sided distributed springs and dampers, friction, uplift, sliding and flight.

The point at ``s`` of the base, -b to b, is ``d = h cos theta - y - s sin theta`` deep in the ground and sinks at the rate
``e = -y' - theta' (h sin theta + s cos theta)``. Where d > 0 it is pushed up by ``q = max(0, k d + c e)`` per length:

    N = ∫ q ds,   M = ∫ q (s cos theta + h sin theta) ds,
    m x'' = -m a + F,   m y'' = -m g + N,   I theta'' = M + (h cos theta - s_c sin theta) F,

with the friction ``F = -K xi - C v`` of an elastic slip xi at the centre s_c of the pressure, returned to |F| <= mu N.
Positive angles turn counter-clockwise here; motions are told with the pendulum's sign, positive towards +x.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from physics.rocking.block import Block
from physics.rocking.ground import GroundMotion, acceleration
from physics.rocking.motion import IMPACT_ANGLE, OVERTURNED, SAFE_IMPACTS, RockingMotion, verdict_of

#: time that is followed after the ground has come to rest where no end is given [s]
PATIENCE = 15.0
#: energy over rest, as a share of what lifts the centre over a corner, with which a block on a ground that rests is safe
SAFE_ENERGY = 0.5
#: step of the integration over the smallest period of the block on its springs
STEP_SHARE = 1.0 / 200.0


@dataclass(frozen=True)
class Foundation:
    """The ground under a slice one metre thick.

    Attributes
    ----------
    stiffness : k of the vertical springs, force per area of the base and depth [N/m³]. damping : c of the dampers, the
        same per velocity [N s/m³].
    friction : Coulomb's coefficient.
    tangential_stiffness : K of the whole base [N/m]; tangential_damping : C [N s/m].
    """

    stiffness: float
    damping: float
    friction: float
    tangential_stiffness: float
    tangential_damping: float


def half_space(
    young: float, poisson: float, density: float, width: float, stiffness: float, friction: float
) -> Foundation:
    """Foundation of vertical ``stiffness`` [N/m²] whose dampers carry plane waves into a half-space.

    c = rho c_p (pressure waves) and rho c_s (shear waves, times the width); the tangential springs are as stiff as the
    vertical ones. ``young`` [Pa], ``density`` [kg/m³], ``width`` [m].
    """
    shear = young / (2.0 * (1.0 + poisson))
    pressure = young * (1.0 - poisson) / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    return Foundation(
        stiffness, math.sqrt(density * pressure), friction, stiffness * width, width * math.sqrt(density * shear)
    )


def half_space_stiffness(mode: str, young: float, poisson: float, width: float, thickness: float = 1.0) -> float:
    """k [force per area and depth, N/m³] of a rigid rectangle on an elastic half-space (Pais and Kausel 1988).

    mode : "vertical" motion, or "rocking" about the axis along the thickness; as distributed springs of the same
    resultant. ``young`` [Pa], ``width`` along the ground's motion and ``thickness`` [m].
    """
    b, l = 0.5 * width, 0.5 * thickness  # noqa: E741  as in the source
    compliance = 2.0 * (1.0 + poisson) * (1.0 - poisson) / young  # (1 - nu) / G
    short, long = min(b, l), max(b, l)
    if mode == "vertical":
        return short / compliance * (3.1 * (long / short) ** 0.75 + 1.6) / (4.0 * b * l)
    about_long, about_short = 3.2 * long / short + 0.8, 3.73 * (long / short) ** 2.4 + 0.27
    rocking = short**3 / compliance * (about_long if b <= l else about_short)
    return rocking / (4.0 * b * l * b**2 / 3.0)


class _Constants(NamedTuple):
    """What the compiled loop needs."""

    b: float
    h: float
    mass: float
    inertia: float
    gravity: float
    k: float
    c: float
    mu: float
    K: float
    C: float
    fallen: float
    impact: float
    safe: float


class _State(NamedTuple):
    """Centre (x, y) in the moving frame, angle, their rates, and the elastic slip."""

    x: float
    y: float
    angle: float
    vx: float
    vy: float
    rate: float
    slip: float


@dataclass(frozen=True)
class WinklerBlock:
    """A rigid block on a foundation; ``step`` [s] of the integration, a small share of its fastest period without.

    patience : time that is followed after the ground has come to rest where no end is given [s]
    """

    block: Block
    foundation: Foundation
    step: float | None = None
    patience: float = PATIENCE

    @property
    def time_step(self) -> float:
        """Step of the integration [s]."""
        if self.step is not None:
            return self.step
        fastest = max(self.foundation.stiffness * self.block.width, self.foundation.tangential_stiffness)
        # a corner lifts with the block's mass and its inertia
        omega = math.sqrt(4.0 * fastest / self.block.mass)
        return STEP_SHARE * 2.0 * math.pi / omega

    @property
    def uplift_acceleration(self) -> float:
        """Acceleration that lifts the same block off a rigid ground, the unit of amplitudes [m/s²]."""
        return self.block.uplift_acceleration

    @property
    def _constants(self) -> _Constants:
        block, ground = self.block, self.foundation
        return _Constants(
            0.5 * block.width, 0.5 * block.height, block.mass, block.inertia, block.gravity, ground.stiffness,
            ground.damping, ground.friction, ground.tangential_stiffness, ground.tangential_damping,
            math.radians(OVERTURNED), math.radians(IMPACT_ANGLE),
            SAFE_ENERGY * block.mass * block.gravity * (block.half_diagonal - 0.5 * block.height),
        )  # fmt: skip

    def respond(
        self, ground: GroundMotion, stop_when_settled: bool = True, every: int = 1, until: float | None = None
    ) -> RockingMotion:
        """The motion from rest on the ground under a ground motion.

        stop_when_settled : end after `SAFE_IMPACTS` impacts of the free motion, or where the block has fallen or has less
            energy than `SAFE_ENERGY`
        every : steps between the rows that are kept. until : time at which it ends [s]; `patience` behind the ground's
        """
        last = ground.end + self.patience if until is None else until
        rows, impacts, overturned = _respond(self._constants, ground, self.time_step, last, stop_when_settled, every)
        verdict, place, velocity = verdict_of(overturned, len(impacts)), rows[:, 1:3], rows[:, 4:6]
        return RockingMotion(
            rows[:, 0], -rows[:, 3], -rows[:, 6], verdict, float(rows[-1, 0]), impacts, place, velocity
        )  # fmt: skip


@njit(cache=True)
def _pressure(c, depth, sink, sine, slope):
    """Force N and first moment ∫ q s ds of the pressure q = k d + c e where both d and q are positive.

    d = depth - s sine and e = sink - s slope are linear in s, so that the base is pressed over one interval.
    """
    low, high = -c.b, c.b
    constant, linear = c.k * depth + c.c * sink, -(c.k * sine + c.c * slope)
    for level, rise in ((depth, -sine), (constant, linear)):
        if rise == 0.0:
            if level <= 0.0:
                return 0.0, 0.0
        elif rise > 0.0:
            low = max(low, -level / rise)
        else:
            high = min(high, -level / rise)
    if low >= high:
        return 0.0, 0.0
    first, second, third = high - low, 0.5 * (high**2 - low**2), (high**3 - low**3) / 3.0
    return constant * first + linear * second, constant * second + linear * third


@njit(cache=True)
def _forces(c, s):
    """Normal force, its moment, lever and velocity of the friction at the centre of pressure."""
    sine, cosine = math.sin(s.angle), math.cos(s.angle)
    depth, sink = c.h * cosine - s.y, -s.vy - s.rate * c.h * sine
    normal, moment = _pressure(c, depth, sink, sine, s.rate * cosine)
    if normal <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    centre = moment / normal
    lever = c.h * cosine - centre * sine
    return normal, moment * cosine + normal * c.h * sine, lever, s.vx + s.rate * lever


@njit(cache=True)
def _accelerations(c, ground, time, s):
    """x'', y'', theta'' and the rate of the elastic slip."""
    normal, moment, lever, velocity = _forces(c, s)
    friction, slip_rate = 0.0, velocity
    if normal > 0.0:
        trial, limit = -c.K * s.slip - c.C * velocity, c.mu * normal
        friction = min(max(trial, -limit), limit)
        if friction != trial:
            # the dashpot carries what the spring does not: the spring relaxes towards the limit
            slip_rate = -(friction + c.K * s.slip) / c.C if c.C > 0.0 else 0.0
    ax = -acceleration(ground, time) + friction / c.mass
    ay = -c.gravity + normal / c.mass
    return ax, ay, (moment + lever * friction) / c.inertia, slip_rate, normal


@njit(cache=True)
def _moved(s, d, step):
    return _State(
        s.x + step * d.x, s.y + step * d.y, s.angle + step * d.angle, s.vx + step * d.vx, s.vy + step * d.vy,
        s.rate + step * d.rate, s.slip + step * d.slip,
    )  # fmt: skip


@njit(cache=True)
def _rate_of(c, ground, time, s):
    ax, ay, turning, slip_rate, _ = _accelerations(c, ground, time, s)
    return _State(s.vx, s.vy, s.rate, ax, ay, turning, slip_rate)


@njit(cache=True)
def _stays(c, s, rest):
    """Whether a block whose centre is over its base has too little energy, kinetic and of its height, to fall."""
    energy = 0.5 * (c.mass * (s.vx**2 + s.vy**2) + c.inertia * s.rate**2) + c.mass * c.gravity * (s.y - rest)
    return abs(s.angle) < math.atan2(c.b, c.h) and energy < c.safe


@njit(cache=True)
def _respond(c, ground, step, last, stop_when_settled, every):
    """Rows of time and state (n, 7); times of impacts; whether the block falls."""
    rest = c.h - c.mass * c.gravity / (2.0 * c.b * c.k)
    s = _State(0.0, rest, 0.0, 0.0, 0.0, 0.0, 0.0)
    rows, impacts, free_impacts, side = [(0.0, s.x, s.y, s.angle, s.vx, s.vy, s.rate)], [0.0 for _ in range(0)], 0, 0.0
    crossed = 0.0
    for number in range(math.ceil(last / step)):
        time = number * step
        d1 = _rate_of(c, ground, time, s)
        d2 = _rate_of(c, ground, time + 0.5 * step, _moved(s, d1, 0.5 * step))
        d3 = _rate_of(c, ground, time + 0.5 * step, _moved(s, d2, 0.5 * step))
        d4 = _rate_of(c, ground, time + step, _moved(s, d3, step))
        before = s.angle
        s = _moved(_moved(_moved(_moved(s, d1, step / 6.0), d2, step / 3.0), d3, step / 3.0), d4, step / 6.0)
        time += step
        if _accelerations(c, ground, time, s)[4] <= 0.0:
            s = _State(s.x, s.y, s.angle, s.vx, s.vy, s.rate, 0.0)
        if before * s.angle <= 0.0:
            crossed = time
        if abs(s.angle) > c.impact:
            now = math.copysign(1.0, s.angle)
            if side * now < 0.0:
                impacts.append(crossed)
                free_impacts += crossed > ground.end
            side = now
        if (number + 1) % every == 0:
            rows.append((time, s.x, s.y, s.angle, s.vx, s.vy, s.rate))
        if abs(s.angle) >= c.fallen:
            rows.append((time, s.x, s.y, s.angle, s.vx, s.vy, s.rate))
            return np.array(rows), impacts, True
        if stop_when_settled and time > ground.end and (free_impacts >= SAFE_IMPACTS or _stays(c, s, rest)):
            break
    return np.array(rows), impacts, False
