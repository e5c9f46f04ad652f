"""What the exact solutions take for granted: a case that has it otherwise is told so, not held against them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from difflib import get_close_matches
from itertools import pairwise
from typing import Any

from cases import Case, CaseError

from .exact import MOTIONS, SOLUTIONS

#: splits that let all energy of a body under tension alone drive the crack
_WHOLE_IN_TENSION = ("none", "star_convex", "volumetric_deviatoric")
#: those of which the solution is that of a dynamic case
_MOVING = ("vibrating_bar", "spinning_disc", "sliding_block", "line_contact", "rolling_cylinder")

#: what is otherwise, and what would be right
Otherwise = Iterator[tuple[str, str]]


def require_exact(case: Case) -> None:
    """Hold that the exact solution and motions of a case are known ones, and that the case is one of theirs.

    Raises
    ------
    CaseError : a name that is none, or something that the solution has otherwise.
    """
    for number, constraint in enumerate(case.constraints):
        if constraint.motion is not None:
            _known(case, f"constraints[{number}].motion", constraint.motion, MOTIONS)
    if case.exact is None:
        return
    _known(case, "exact", case.exact, SOLUTIONS)
    if otherwise := otherwise_than(case, case.exact):
        raise CaseError(f"{case.source}: exact = '{case.exact}': {otherwise}, or remove exact.")


def otherwise_than(case: Case, solution: str) -> str:
    """What the case has otherwise than an exact solution, and what would be right; empty where it is one of its cases."""
    found = next(iter((*_regime(case, solution), *_RULES.get(solution, _no_rules)(case))), None)
    return f"{found[0]}; {found[1]}" if found else ""


def _known(case: Case, key: str, name: str, known: Mapping[str, Any]) -> None:
    if name not in known:
        near = get_close_matches(name, known, n=1)
        remedy = f"did you mean '{near[0]}'?" if near else f"choose one of {', '.join(known)}."
        kind = "motion" if known is MOTIONS else "solution"
        raise CaseError(f"{case.source}: {key} = '{name}' is not an exact {kind}; {remedy}")


def _regime(case: Case, name: str) -> Otherwise:
    if (case.dynamics is not None) != (name in _MOVING):
        other = "load" if case.dynamics else "dynamics"
        yield f"is that of a case with the table {other}", "give another one"


def _no_rules(case: Case) -> Otherwise:
    yield from ()


def _bar(case: Case) -> Otherwise:
    """One body, even tension along x or y that grows, free to contract."""
    moved = [c for c in case.constraints if c.follows_load]
    if len(moved) != 1 or moved[0].scale != 1.0 or case.loaded_by_factor:
        yield "is that of a bar of which one end follows the load with scale = 1", "pull it so"
    elif len({c.on for c in case.constraints if c.direction not in ("phase", moved[0].direction)}) > 1:
        yield "is that of a bar that may contract, held across at one side", "hold one side only"
    if len(case.bodies) > 1 or case.notches:
        yield "is that of one body without notches", "leave one"
    fracture = case.materials[next(iter(case.bodies.values())).material].fracture
    if fracture and fracture.split not in _WHOLE_IN_TENSION:
        yield f"has all energy drive the crack, which split = '{fracture.split}' has not", "give split = \"none\""
    back = any(after <= before for before, after in pairwise(case.load.path)) or case.load.path[0] < 0.0
    if back and fracture:
        yield "is that of a tension that grows", "give a path that grows from 0"


def _vibrating_bar(case: Case) -> Otherwise:
    """Held at the left end along the bar, and across it at both sides or, without contraction, at either."""
    along = [edge for c in case.constraints if c.direction == "x" for edge in _edges(case, c.on)]
    across = {edge for c in case.constraints if c.direction == "y" for edge in _edges(case, c.on)}
    if along != ["left"] or across != {"bottom", "top"}:
        yield "is that of a bar held along x at its left end and along y at both sides", "hold it so"


def _edges(case: Case, name: str) -> tuple[str, ...]:
    boundary = case.boundaries[name]
    return boundary.edges or ((boundary.edge,) if boundary.edge else ())


def _on_a_floor(case: Case) -> Otherwise:
    """Two bodies, the second one of which is a rigid floor."""
    if len(case.bodies) != 2 or [body.keeps_velocity for body in case.bodies.values()] != [False, True]:
        yield "is that of a body on a rigid floor that comes second", "give two bodies, the floor with rigid = true"
    elif case.dynamics is not None and not case.dynamics.gravity[1] < 0.0:
        yield "is that of a weight on the floor", "give gravity a negative y"


def _disc_on_a_floor(case: Case) -> Otherwise:
    yield from (*_on_a_floor(case), *_disc(case))


def _disc(case: Case) -> Otherwise:
    body = next((body for body in case.bodies.values() if body.deforms), None)
    if body is None or not (body.shape and body.shape.disc):
        yield "is that of a disc", "give the body the shape of one"


def _double_edge(case: Case) -> Otherwise:
    """Two equal slits from the left and the right edge, level with each other."""
    lower, upper = case.bounding_box()
    slits = case.notches
    ends = sorted((slit.start[0], slit.end[0]) for slit in slits if slit.start[1] == slit.end[1]) if slits else []
    edges = len(ends) == 2 and lower[0] in ends[0] and upper[0] in ends[1]
    slack = 1e-9 * float(upper[0] - lower[0])
    if not edges or slits[0].start[1] != slits[1].start[1] or abs(slits[0].length - slits[1].length) > slack:
        yield "is that of a plate with a notch from its left edge and an equal one from its right edge", "give both"


_RULES: dict[str, Callable[[Case], Otherwise]] = {
    "homogeneous_bar": _bar,
    "vibrating_bar": _vibrating_bar,
    "spinning_disc": _disc,
    "sliding_block": _on_a_floor,
    "rolling_cylinder": _disc_on_a_floor,
    "line_contact": _disc_on_a_floor,
    "double_edge_notch": _double_edge,
}
