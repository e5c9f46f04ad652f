"""What will be modelled before anything runs: sizes, increments, memory, time, and the savings in use."""

import math
from dataclasses import dataclass
from typing import Any

from cases import Case, load_case
from cases.bodies import Body
from cases.judging import merge
from verify.planning.calibration import cost_of
from verify.planning.recorded_prices import chosen_savings, costs_of_savings
from verify.planning.savings import Saving, all_off, savings
from verify.planning.sizes import fourth_order, has_triangles, size_of

RULE = (
    "processor seconds on one thread, by a model of unknowns and iterations fitted to finished runs "
    "(`verify calibrate`); waiting for other programs comes on top"
)


@dataclass(frozen=True)
class Plan:
    """Predicted size and cost of one run; seconds and memory are rough (a factor of two).

    change : tables that the plan lays over the run, because savings are too dear for the accuracy wanted
    too_dear : why, for each of them
    unpriced : savings that are used without a recorded price, where an accuracy is wanted
    """

    case: str
    tier: str
    run: str
    solver: str
    regime: str
    bodies: str
    basis: str
    notches: str
    cells: int
    points: int
    unknowns_displacement: int
    unknowns_phase_field: int
    increments: int
    explicit: bool
    adaptive: bool
    iterations: int
    memory_mb: float
    seconds: float
    savings: tuple[Saving, ...]
    notes: tuple[str, ...]
    change: dict[str, Any]
    too_dear: dict[str, str]
    unpriced: str


def plan(case: Case, run_name: str, accuracy: float | None = None) -> Plan:
    """The plan of one run; ``case`` must be loaded with that run's changes merged in.

    accuracy : error allowed in each checked quantity; the dearest savings are switched off until the others together
        keep within it
    """
    prices = costs_of_savings(case, run_name)
    dear, reasons = chosen_savings(case, run_name, accuracy) if accuracy else ((), ())
    change, too_dear = all_off(dear), dict(zip((saving.name for saving in dear), reasons, strict=True))
    if change:
        case = load_case(case.source, case.tier, run_name, merge(case.change, change))
    size = size_of(case, run_name)
    cost = cost_of(case, size)
    return Plan(
        case=case.name,
        tier=case.tier,
        run=run_name,
        solver=size.solver,
        regime=_regime(case),
        bodies=_bodies(case),
        basis=_basis(case, size.solver),
        notches=_notches(case),
        cells=size.cells,
        points=size.points,
        unknowns_displacement=size.unknowns,
        unknowns_phase_field=size.unknowns_phase_field,
        increments=size.increments,
        explicit=case.dynamics is not None,
        adaptive=case.load.adaptive and case.dynamics is None,
        iterations=round(cost.iterations),
        memory_mb=cost.memory_mb,
        seconds=cost.seconds,
        savings=_priced(case, prices, too_dear),
        notes=_notes(case, accuracy),
        change=change,
        too_dear=too_dear,
        unpriced=_unpriced(case, prices) if accuracy else "",
    )


def _priced(case: Case, prices: dict[str, float], too_dear: dict[str, str]) -> tuple[Saving, ...]:
    """All savings with their prices; those too dear are off, and say why."""
    told = []
    for saving in savings(case):
        cost = prices.get(saving.name, math.nan)
        said = f"{saving.reason}; measured price {100 * cost:.2g} %" if math.isfinite(cost) else saving.reason
        off = too_dear.get(saving.name)
        told.append(Saving(saving.name, saving.used and off is None, off or said, saving.off))
    return tuple(told)


def _unpriced(case: Case, prices: dict[str, float]) -> str:
    """What the accuracy cannot be said to include."""
    unknown = [name for name, cost in prices.items() if math.isnan(cost)]
    remedy = f"`verify price {case.name} --tier {case.tier} --record` measures it"
    return f"not priced as the case stands, so left on: {', '.join(unknown)}; {remedy}" if unknown else ""


def _notes(case: Case, accuracy: float | None) -> tuple[str, ...]:
    """What the spacing does to the toughness, what the accuracy asks of it, and what the sizes leave out."""
    notes = []
    if case.mesh.follow_crack:
        notes.append("sizes, memory and time are those of the first fine box; they grow with it")
    for name, material in case.materials.items():
        if material.fracture is None:
            continue
        limit = material.fracture.length_scale
        excess = case.mesh.h / (4.0 * limit)
        note = f"the mesh sees the toughness of {name} raised by h / (4 l0) = {100 * excess:.2g} %"
        if accuracy and excess > accuracy:
            note += f"; {100 * accuracy:g} % needs h = {4.0 * limit * accuracy:.3g}, or compare with Gc (1 + h / (4 l0))"
        notes.append(note)
    return tuple(notes)


def _regime(case: Case) -> str:
    if case.dynamics is not None:
        return "explicit in time"
    return "quasi-static, staggered" if case.fracture_enabled else "quasi-static, elastic"


def _bodies(case: Case) -> str:
    return ", ".join(f"{name}: {_regime_of(case, body)}" for name, body in case.bodies.items())


def _regime_of(case: Case, body: Body) -> str:
    if body.rigid:
        return "rigid"
    return "breaks" if case.materials[body.material].fracture else "deforms, cannot break"


def _basis(case: Case, solver: str) -> str:
    if solver == "mpm":
        return f"B-splines of order {case.mpm.order}, points placed {case.mpm.placement}"
    if fourth_order(case):
        return "bilinear quads, 3 x 3 Gauss points; phase field on Bogner-Fox-Schmit quads"
    triangles = has_triangles(case, solver)
    return "linear triangles, 3 Gauss points" if triangles else "bilinear quads, 2 x 2 Gauss points"


def _notches(case: Case) -> str:
    said = {
        "slit": "a slit of no width",
        "cells": "left-out cells",
        "history": "an initial history field (Eq. 6.51)",
    }
    return ", ".join(said[notch.kind] for notch in case.notches) or "none"
