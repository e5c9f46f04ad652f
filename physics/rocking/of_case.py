"""The block, the ground beneath it and its motion, as a case with the table rocking describes them."""

from __future__ import annotations

import math

from cases import Case, CaseError
from cases.files import read_curve
from cases.ground import COLUMNS, Ground
from cases.rocking import Rocking
from physics.rocking.block import Block
from physics.rocking.ground import GroundMotion, cut, pulse, record
from physics.rocking.pendulum import Pendulum
from physics.rocking.records import recorded_motion
from physics.rocking.winkler import PATIENCE, Foundation, WinklerBlock, half_space, half_space_stiffness

REST = pulse("sine", 0.0, 1.0)._replace(end=0.0)


def _rocking(case: Case) -> Rocking:
    assert case.rocking is not None and case.dynamics is not None
    return case.rocking


def block_of(case: Case) -> Block:
    """The rectangle that rocks, in the units of the case, of a slice of thickness one."""
    body = case.bodies[_rocking(case).body]
    width, height = (float(size) for size in body.bounds()[1] - body.bounds()[0])
    assert case.dynamics is not None
    return Block(width, height, case.materials[body.material].density or 0.0, -case.dynamics.gravity[1])


def pendulum_of(case: Case, linear: bool = False) -> Pendulum:
    """The inverted pendulum of the case's block."""
    rocking = _rocking(case)
    model = Pendulum(block_of(case), linear, rocking.restitution)
    return Pendulum(model.block, linear, rocking.restitution, model.step * rocking.step_share)


def foundation_of(case: Case) -> Foundation:
    """Springs and dampers of the Winkler model, in the units of the case."""
    rocking, block = _rocking(case), block_of(case)
    names = list(case.bodies)
    beneath = rocking.on or next(name for name in names if name != rocking.body)
    material = case.materials[case.bodies[beneath].material]
    young = material.mu * (3.0 * material.lam + 2.0 * material.mu) / (material.lam + material.mu)
    poisson = 0.5 * material.lam / (material.lam + material.mu)
    stiffness = rocking.stiffness
    if isinstance(stiffness, str):
        stiffness = half_space_stiffness(stiffness, young, poisson, block.width, case.plane.thickness)
    friction = case.friction(names.index(rocking.body), names.index(beneath))
    made = half_space(young, poisson, material.density or 0.0, block.width, stiffness, friction)
    return made if rocking.damping is None else Foundation(**(vars(made) | {"damping": rocking.damping}))


def winkler_of(case: Case) -> WinklerBlock:
    """The Winkler model of the case's block."""
    model = WinklerBlock(block_of(case), foundation_of(case))
    patience = PATIENCE / case.units.in_si("time")
    return WinklerBlock(model.block, model.foundation, model.time_step * _rocking(case).step_share, patience)


def ground_motion(case: Case, uplift: float | None = None) -> GroundMotion:
    """The motion of the ground in the units of the case.

    uplift : acceleration that an `uplift_ratio` is of; that of the case's block without [length/time²].

    Raises
    ------
    CaseError : a record that cannot be had.
    """
    assert case.dynamics is not None
    ground = case.dynamics.ground
    if ground is None:
        return REST
    if ground.pulse is not None:
        return _pulse(case, ground, uplift)
    if ground.table is not None:
        times, accelerations = read_curve(ground.table, COLUMNS).T
    else:
        times, accelerations = recorded_motion(case)
    motion = record(times, ground.scale * accelerations)
    if ground.cut is None:
        return motion
    first, last = float(times[0]), float(times[-1])
    if not first <= ground.cut[0] < ground.cut[1] <= last:
        raise CaseError(
            f"{case.source}: dynamics.ground.cut = {list(ground.cut)}: leaves the motion, which is from {first:g} to"
            f" {last:g}; give times inside."
        )
    return cut(motion, ground.cut[0] - first, ground.cut[1] - first)


def _pulse(case: Case, ground: Ground, uplift: float | None) -> GroundMotion:
    if ground.uplift_ratio is None:
        assert ground.amplitude is not None
        amplitude = ground.amplitude
    else:
        amplitude = ground.uplift_ratio * (block_of(case).uplift_acceleration if uplift is None else uplift)
    if ground.frequency_ratio is not None:
        frequency = ground.frequency_ratio * block_of(case).frequency
    else:
        frequency = ground.circular_frequency or 2.0 * math.pi / (ground.period or 1.0)
    assert ground.pulse is not None
    return pulse(ground.pulse, ground.scale * amplitude, frequency, ground.cycles)
