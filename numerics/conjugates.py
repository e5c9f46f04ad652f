"""What does work on the load parameter, and how far forces that nothing else holds have displaced a body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cases import Case

from .staggered import QuasiStaticDiscretisation

#: below it material gives way where it is displaced out of all proportion
GIVING_PHASE_FIELD = 0.5


@dataclass(frozen=True)
class MarchState:
    """What the march along the load path needs to go on from an increment.

    Attributes
    ----------
    leg : number of the path's target
    next_size : of the increment to come [unit of the load parameter]
    peak : largest force so far, on what moves by tables over their pace
    peak_at : how far what the load moves was from its start there, by the load parameter without tables
    controlled : the fracture energy leads, not the load
    reaction : force conjugate to the load parameter on the way that comes next
    displaced : work of the forces that follow the load, at load factor one, on the displacement so far
    heat : of the stress on the eigenstrain that follows the load, at load factor one
    compliance : smallest size of F over the load so far, of forces alone; 0 while there is none
    """

    leg: int = 0
    next_size: float = 0.0
    peak: float = 0.0
    peak_at: float = 0.0
    controlled: bool = False
    reaction: float = 0.0
    displaced: float = 0.0
    heat: float = 0.0
    compliance: float = 0.0


#: nothing has been followed yet
AT_START = MarchState()


def why_it_ends(case: Case, march: MarchState, problem: str, load: float) -> str:
    """The sentence about a step beyond a load that no increment, however small, has taken."""
    if case.loaded_by_factor and march.controlled:
        return f"{problem}, after u = {load:g}"
    reason = f"{problem}; the smallest increment {case.load.smallest:g} after u = {load:g} failed"
    if case.loaded_by_factor:
        reason += ', so the load cannot rise further; load.control = "dissipation" follows what comes after'
    return reason


def gentler_start(case: Case) -> str:
    """What to do where the first state of the load path has no equilibrium."""
    smaller = "begin load.path at a smaller load"
    if all(item.follows_load for item in (*case.tractions, *case.body_forces, *case.eigenstrains)):
        return smaller
    return f'let what acts from the first state on grow with ramp = "load", or {smaller}'


def conjugate_force(discretisation: QuasiStaticDiscretisation, case: Case, march: MarchState, towards: float) -> float:
    """F of the trial state: of constraints on the way to or from a load, or of the loads where they alone follow."""
    if case.loaded_by_factor and not case.moved_by_load:
        work = discretisation.work_of_loads()
        return march.displaced + work.following - work.heat
    return discretisation.reaction_force(towards)


def rates(case: Case, load: float, towards: float) -> NDArray:
    """What each constraint moves by over the load on the way to another one (n,)."""
    moved = (c.course.rate(load, towards) if c.course and towards != load else c.scale or 0.0 for c in case.constraints)
    return np.fromiter(moved, float)


def carried_force(case: Case, force: float, load: float, towards: float) -> float:
    """Size of the force on what is moved: that of F over the pace of tables, infinite where they stand still."""
    if not any(c.course for c in case.constraints):
        return abs(force)
    pace = float(np.abs(rates(case, load, towards)).max())
    return abs(force) / pace if pace else np.inf


def turns_aside(case: Case, targets: Sequence[Target]) -> bool:
    """Whether tables move other things on the way to the last target than to the one before: F is of another force."""
    ways = pairwise([case.load.path[0], *(target.load for target in targets)])
    legs = [leg / np.linalg.norm(leg) for leg in (rates(case, *ends) for ends in ways) if leg.any()]
    return len(legs) > 1 and bool(abs(legs[-1] @ legs[-2]) < 1.0 - 1e-9)


def way(case: Case, load: float) -> float:
    """How far the load has moved what it moves the most from the path's start; how far it has come without tables."""
    start = case.load.path[0]
    courses = [c.course for c in case.constraints if c.course]
    if not courses:
        return abs(load - start)
    moved = [float(course.displacement(load) - course.displacement(start)) for course in courses]
    return max(map(abs, [*moved, *((c.scale or 0.0) * (load - start) for c in case.constraints)]))


def has_lost_its_force(case: Case, march: MarchState, load: float, carried: float) -> bool:
    """Whether a force on what is moved is gone at a load, and the run is to end there if the body is broken."""
    given = case.load
    if not given.stop_when_broken or not march.peak_at or carried >= given.broken_fraction * march.peak:
        return False  # nor where the largest force is that of what acts from the first state on, and is taken off
    # once the path has turned, force and load fall together: what is broken has lost its stiffness too
    return march.leg == 0 or carried * march.peak_at < given.broken_fraction * march.peak * way(case, load)


def gives_way(
    discretisation: QuasiStaticDiscretisation, case: Case, march: MarchState, load: float, force: float
) -> bool:
    """Whether forces that nothing holds displace a broken body out of all proportion."""
    if case.moved_by_load or not case.load.stop_when_broken or not march.compliance:
        return False
    # what is relieved of its load is held against the one that it bore
    beyond = abs(force) > march.compliance * max(abs(load), march.peak_at) / case.load.broken_fraction
    return bool(beyond and discretisation.phase_field.min() < GIVING_PHASE_FIELD)


def step_work(discretisation: QuasiStaticDiscretisation, march: MarchState, before: float, load: float) -> float:
    """External work of a step between two loads, of constraints and of what acts, by the trapezoidal rule [energy]."""
    work = discretisation.work_of_loads()
    reaction = discretisation.reaction_force(before) if load != before else march.reaction
    of_load = 0.5 * (reaction + march.reaction - work.heat - march.heat) * (load - before)
    return of_load + work.constant + 0.5 * (load + before) * work.following


def noted(
    discretisation: QuasiStaticDiscretisation, case: Case, march: MarchState, load: float, beyond: float, force: float
) -> MarchState:
    """The march with what the work of the next step, on the way to the load ``beyond``, begins with."""
    work = discretisation.work_of_loads()
    alone = case.loaded_by_factor and not case.moved_by_load
    compliance = abs(force / load) if alone and load else 0.0
    return replace(
        march,
        reaction=discretisation.reaction_force(beyond),
        displaced=march.displaced + work.following,
        heat=work.heat,
        compliance=min(march.compliance or np.inf, compliance) if compliance else march.compliance,
    )


class Target(NamedTuple):
    """A load that the path runs to, and the largest increment on the way."""

    load: float
    increment: float


def path_targets(case: Case) -> list[Target]:
    """Loads that the path runs to in turn: its own, and between them those at which a table has a row."""
    rows = np.concatenate([[], *(c.course.times for c in case.constraints if c.course is not None)])
    targets: list[Target] = []
    for (start, end), increment in zip(pairwise(case.load.path), case.load.increments, strict=True):
        slack = 1e-9 * abs(end - start)
        between = np.unique(rows[(rows > min(start, end) + slack) & (rows < max(start, end) - slack)])
        loads = [*map(float, between if end > start else between[::-1]), end]
        targets += [Target(load, increment) for load in loads]
    return targets
