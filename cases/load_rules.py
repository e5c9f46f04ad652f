"""Rules for what acts on bodies and for tables over time, which look across the tables of a case."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.errors import BrokenRuleError
from cases.geometry import SLACK
from cases.loads import WITH_LOAD, Acting, BodyForce, Eigenstrain

if TYPE_CHECKING:
    from cases.schema import CaseDescription


def acting(case: CaseDescription) -> Iterator[tuple[str, Acting]]:
    """All that acts on the bodies, with the keys of the file."""
    for key in ("tractions", "body_forces", "eigenstrains"):
        for number, item in enumerate(getattr(case, key)):
            yield f"{key}[{number}]", item


def loads_fit_statics(case: CaseDescription) -> None:
    """Raise BrokenRuleError where something that acts on bodies does not fit a quasi-static case."""
    for number, traction in enumerate(case.tractions):
        if traction.ramp and not traction.follows_load:
            text, remedy = "is a time, and nothing moves", 'give "load", or remove it'
            raise BrokenRuleError(text, remedy, f"tractions[{number}].ramp", traction.ramp)
    for number, constraint in enumerate(case.constraints):
        if constraint.course is None:
            continue
        if constraint.course.is_velocity:
            remedy = "give a table of displacements, or the table dynamics"
            raise BrokenRuleError("acts in dynamics only", remedy, f"constraints[{number}].of", "velocity")
        _covers(case, number, min(case.load.path), max(case.load.path), "load.path")
    for key, item in acting(case):
        if isinstance(item, BodyForce) and item.gravity is not None:
            _have(case, item.on, "density", f"{key}.gravity needs mass")
        if isinstance(item, Eigenstrain) and item.temperature is not None:
            _have(case, item.on, "expansion", f"{key}.temperature needs it")
            _expand_in_plane(case, item, key)
    _leaves_dissipation_alone(case)


def loads_fit_dynamics(case: CaseDescription) -> None:
    """Raise BrokenRuleError where something that acts on bodies does not fit a dynamic case."""
    for key, item in acting(case):
        if isinstance(item, BodyForce):
            raise BrokenRuleError("acts in quasi-static cases only", "give dynamics.gravity instead", key)
        if isinstance(item, Eigenstrain):
            raise BrokenRuleError("acts in quasi-static cases only", "remove it, or give the table load", key)
        if item.follows_load:
            raise BrokenRuleError("follows no load in dynamics", "give a time, or remove it", f"{key}.ramp", WITH_LOAD)
    assert case.dynamics is not None
    for number, constraint in enumerate(case.constraints):
        if constraint.course is None:
            continue
        _covers(case, number, 0.0, case.dynamics.end_time, "dynamics.end_time")
        first = float(constraint.course.displacement(0.0))
        if first != 0.0:
            remedy = "let the displacement be 0 at time 0"
            raise BrokenRuleError("begins with a jump in time", remedy, f"constraints[{number}].table", first)
    driven = case.tractions or any(c.velocity is not None or c.course is not None for c in case.constraints)
    if driven and not _moves(case):
        remedy = "give a velocity, table or traction that is not zero, or gravity"
        raise BrokenRuleError("moves nothing: all that would drive it is zero", remedy, "dynamics")


def follows_load(case: CaseDescription) -> bool:
    """Something in a quasi-static case grows or moves with the load parameter."""
    tables = (constraint.course for constraint in case.constraints if constraint.course is not None)
    return (
        any(constraint.scale or constraint.motion for constraint in case.constraints)
        or any(course.moves for course in tables)
        or any(item.follows_load and not item.is_zero for _, item in acting(case))
    )


def _moves(case: CaseDescription) -> bool:
    """Something in a dynamic case moves or acts."""
    assert case.dynamics is not None
    of_bodies = ("velocity", "velocity_gradient")
    return bool(
        case.dynamics.ground
        or any(case.dynamics.gravity)
        or any(constraint.velocity or (constraint.course and constraint.course.moves) for constraint in case.constraints)
        or any(np.any(getattr(body, key)) for body in case.bodies.values() for key in of_bodies)
        or not all(traction.is_zero for traction in case.tractions)
    )


def _covers(case: CaseDescription, number: int, first: float, last: float, key: str) -> None:
    course = case.constraints[number].course
    assert course is not None
    slack = SLACK * (last - first)
    if course.times[0] > first + slack or course.times[-1] < last - slack:
        text = f"goes from {course.times[0]:g} to {course.times[-1]:g}, but the run ({key}) from {first:g} to {last:g}"
        raise BrokenRuleError(text, "add rows, or shorten the run", f"constraints[{number}].table")


def _have(case: CaseDescription, on: str | None, constant: str, why: str) -> None:
    """The materials of a body, or of all, have a constant."""
    for body in case.bodies.values() if on is None else (case.bodies[on],):
        if getattr(case.materials[body.material], constant) is None:
            raise BrokenRuleError("is missing", f"add it, since {why}", f"materials.{body.material}.{constant}")


def _expand_in_plane(case: CaseDescription, item: Eigenstrain, key: str) -> None:
    """What a material does out of the plane is known of an isotropic one only."""
    names = {body.material for name, body in case.bodies.items() if item.on in (None, name)}
    anisotropic = next((name for name in sorted(names) if case.materials[name].is_anisotropic), None)
    if anisotropic and case.plane.assumption == "strain":
        text = f"leaves open what '{anisotropic}' does out of the plane, which plane strain holds"
        remedy = "give the eigenstrain as a value, or plane.assumption = \"stress\""
        raise BrokenRuleError(text, remedy, f"{key}.temperature", item.temperature)


def _leaves_dissipation_alone(case: CaseDescription) -> None:
    """Control by the fracture energy scales one state: all that acts grows with the load."""
    if case.load.control != "dissipation":
        return
    constant: Any = next((key for key, item in acting(case) if not item.follows_load), None)
    fixed = ((f"constraints[{n}]", c) for n, c in enumerate(case.constraints) if c.direction != "phase")
    constant = constant or next((key for key, c in fixed if c.value or c.table is not None), None)
    if constant:
        text = f"scales all that acts, but {constant} does not grow in proportion to the load"
        remedy = 'give it ramp = "load" or a scale, or control = "displacement"'
        raise BrokenRuleError(text, remedy, "load.control", "dissipation")
