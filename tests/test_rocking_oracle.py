"""Borders of the rigid rocking block against integrations by scipy that share no code with it."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from physics.rocking.block import Block
from physics.rocking.borders import borders
from physics.rocking.ground import pulse
from physics.rocking.motion import Verdict
from physics.rocking.pendulum import Pendulum
from physics.rocking.winkler import WinklerBlock, half_space

#: the block of thesis 7.3.2
WIDTH, HEIGHT, DENSITY, G, FRICTION = 0.795, 3.113, 606.101, 9.81, 0.625
ALPHA, R = math.atan(WIDTH / HEIGHT), 0.5 * math.hypot(WIDTH, HEIGHT)
P = math.sqrt(0.75 * G / R)
BLOCK = Block(WIDTH, HEIGHT, DENSITY)
#: relative distance from a border at which both sides are checked
NEAR = 2e-3


def turns_over(amplitude: float, ratio: float, restitution: float) -> Verdict:
    """Housner's equation with impacts as events; the motion starts where the sine lifts the block."""
    omega = ratio * P
    end = 2.0 * math.pi / omega
    start, side, impacts, state = math.asin(1.0 / amplitude) / omega, -1.0, 0, [0.0, 0.0]

    def rates(time, state, side):
        push = amplitude * math.tan(ALPHA) * math.sin(omega * time) if time < end else 0.0
        lever = side * ALPHA - state[0]
        return [state[1], -(P**2) * (math.sin(lever) + push * math.cos(lever))]

    def impact(time, state, side):
        return state[0] + (0.0 if time > begin else side)

    def fallen(time, state, side):
        return abs(state[0]) - 3.0 * ALPHA

    impact.terminal = fallen.terminal = True
    while True:
        begin = start + 1e-4
        found = solve_ivp(
            rates, (start, start + 30.0 / P), state, args=(side,), events=(impact, fallen), rtol=1e-10, atol=1e-13,
            max_step=0.02 / P,
        )  # fmt: skip
        if len(found.t_events[1]):
            return Verdict.AFTER_IMPACTS if impacts else Verdict.NO_IMPACT
        if not len(found.t_events[0]) or impacts == 6:
            return Verdict.SAFE
        start, side, impacts = float(found.t[-1]), -side, impacts + 1
        state = [side * 1e-15, restitution * float(found.y[1, -1])]


@pytest.mark.parametrize(("ratio", "high"), [(3.0, 6.0), (5.0, 10.0), (7.0, 16.0)])
def test_the_pendulum_falls_where_an_integration_with_events_does(ratio, high):
    pendulum = Pendulum(BLOCK)

    def verdict_at(amplitude: float) -> Verdict:
        return pendulum.respond(pulse("sine", amplitude * G * math.tan(ALPHA), ratio * P)).verdict

    found = borders(verdict_at, np.geomspace(1.5, high, 24), 1e-6)
    restitution = 1.0 - 1.5 * math.sin(ALPHA) ** 2
    assert {Verdict.AFTER_IMPACTS, Verdict.NO_IMPACT} & {border.above for border in found}
    for border in found:
        assert turns_over(border.amplitude * (1.0 - NEAR), ratio, restitution) is border.below
        assert turns_over(border.amplitude * (1.0 + NEAR), ratio, restitution) is border.above


class Springs:
    """The Winkler block with its pressure summed over points of the base."""

    def __init__(self, foundation, amplitude: float, ratio: float) -> None:
        self.ground, self.amplitude, self.omega = foundation, amplitude * G * math.tan(ALPHA), ratio * P
        self.places = (np.arange(600) + 0.5) / 600 * WIDTH - 0.5 * WIDTH
        self.mass = DENSITY * WIDTH * HEIGHT
        self.inertia = self.mass * (WIDTH**2 + HEIGHT**2) / 12.0

    def rates(self, time, state):
        _, y, angle, vx, vy, spin, slip = state
        ground, sine, cosine = self.ground, math.sin(angle), math.cos(angle)
        down = -0.5 * HEIGHT
        arm_x, arm_y = self.places * cosine - down * sine, self.places * sine + down * cosine
        depth, sinking = -(y + arm_y), -(vy + spin * arm_x)
        pressure = np.where(depth > 0.0, ground.stiffness * depth + ground.damping * sinking, 0.0).clip(0.0)
        pressure *= WIDTH / len(self.places)
        normal = float(pressure.sum())
        push = self.amplitude * math.sin(self.omega * time) if self.omega * time < 2.0 * math.pi else 0.0
        drag, slipping, turning = 0.0, 0.0, float(pressure @ arm_x)
        if normal > 0.0:
            lever = -float(pressure @ arm_y) / normal
            velocity = vx + spin * lever
            limit = ground.friction * normal
            sticking = -ground.tangential_stiffness * slip - ground.tangential_damping * velocity
            drag = min(max(sticking, -limit), limit)
            slipping = -(drag + ground.tangential_stiffness * slip) / ground.tangential_damping
            turning += drag * lever
        return [vx, vy, spin, drag / self.mass - push, normal / self.mass - G, turning / self.inertia, slipping]

    def falls_outward(self) -> bool:
        """Whether it falls to the side to which it rises first, before it meets the ground again."""
        rest = 0.5 * HEIGHT - self.mass * G / (WIDTH * self.ground.stiffness)

        def down_again(time, state):
            return state[2] * side + math.radians(0.1) if time > 0.2 / P else 1.0

        def over(time, state):
            return abs(state[2]) - 1.5 * ALPHA

        side = 1.0  # the ground goes to +x first, the block turns counter-clockwise
        down_again.terminal = over.terminal = True
        found = solve_ivp(
            self.rates, (0.0, 8.0 / P), [0.0, rest, 0.0, 0.0, 0.0, 0.0, 0.0], events=(down_again, over), rtol=1e-6,
            atol=1e-9, max_step=5e-3,
        )  # fmt: skip
        assert len(found.t_events[0]) + len(found.t_events[1]) == 1
        return bool(len(found.t_events[1]))


@pytest.mark.parametrize(("ratio", "low", "high"), [(3.0, 2.6, 4.0), (5.0, 5.0, 8.0)])
def test_the_winkler_block_falls_without_impact_where_summed_pressures_make_it(ratio, low, high):
    ground = half_space(260e6, 0.3, 1300.0, WIDTH, 3.77e8, FRICTION)
    model = WinklerBlock(BLOCK, ground)

    def verdict_at(amplitude: float) -> Verdict:
        return model.respond(pulse("sine", amplitude * G * math.tan(ALPHA), ratio * P)).verdict

    border = borders(verdict_at, [low, high])[-1]
    assert border.above is Verdict.NO_IMPACT
    assert not Springs(ground, border.amplitude * (1.0 - NEAR), ratio).falls_outward()
    assert Springs(ground, border.amplitude * (1.0 + NEAR), ratio).falls_outward()
