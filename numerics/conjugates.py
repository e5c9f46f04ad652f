"""What does work on the load parameter, and how far forces that nothing else holds have displaced a body."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

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
    peak : largest force so far
    peak_at : distance of the load parameter from its start there
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


def conjugate_force(discretisation: QuasiStaticDiscretisation, case: Case, march: MarchState, towards: float) -> float:
    """F of the trial state: of constraints on the way to or from a load, or of the loads where they alone follow."""
    if case.loaded_by_factor and not case.moved_by_load:
        work = discretisation.work_of_loads()
        return march.displaced + work.following - work.heat
    return discretisation.reaction_force(towards)


def gives_way(
    discretisation: QuasiStaticDiscretisation, case: Case, march: MarchState, load: float, force: float
) -> bool:
    """Whether forces that nothing holds displace a broken body out of all proportion."""
    if case.moved_by_load or not case.load.stop_when_broken or not march.compliance:
        return False
    beyond = abs(force) > march.compliance * abs(load) / case.load.broken_fraction
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
