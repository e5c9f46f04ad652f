"""What will be modelled before anything runs: sizes, increments, memory, time, and the savings in use."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

from cases import Case, load_case
from cases.bodies import Body
from cases.judging import merge
from cases.solvers import SOLVERS
from numerics.description import Description, describe, remarks
from numerics.time_steps import beyond_stable
from physics.surface_energy import RAISED
from verify.planning.recorded_prices import chosen_savings, costs_of_savings
from verify.planning.savings import Saving, all_off, savings
from verify.runs.costs import Cost, Demand, demand_of, predict
from verify.runs.jobs import Job
from verify.runs.memory import check_memory, predicted_cost, require_memory

RULE = (
    "processor seconds on one thread, by a model of unknowns and iterations fitted to finished runs "
    "(`verify calibrate`); waiting for other programs comes on top"
)
NOTCHES = {
    "slit": "a slit of no width",
    "cells": "left-out cells",
    "history": "an initial history field (Eq. 6.51)",
}


@dataclass(frozen=True)
class Choice:
    """What an accuracy asks of a run.

    change : tables that the plan lays over it, because savings are too dear
    too_dear : why, for each of them
    unpriced : savings that are used without a recorded price
    """

    change: dict[str, Any] = field(default_factory=dict)
    too_dear: dict[str, str] = field(default_factory=dict)
    unpriced: str = ""

    def sentences(self) -> list[str]:
        """What is switched off and why, and what is left on unpriced."""
        off = [f"{name} off: it {why}" for name, why in self.too_dear.items()]
        return off + ([self.unpriced] if self.unpriced else [])


@dataclass(frozen=True)
class Plan:
    """Predicted size and cost of one run of a case as it will be done; seconds and memory are rough (a factor of two)."""

    case: Case
    run: str
    described: Description
    demand: Demand
    cost: Cost
    savings: tuple[Saving, ...]
    notes: tuple[str, ...]
    choice: Choice

    @property
    def title(self) -> str:
        """Case, tier and run."""
        return f"{self.case.name} · {self.case.tier} · {self.run}"

    def rows(self) -> list[tuple[str, str]]:
        """What is planned and how, in words."""
        said, case = self.described, self.case
        return [
            ("regime", _regime(case)),
            ("bodies", ", ".join(f"{name}: {_regime_of(case, body)}" for name, body in case.bodies.items())),
            *(("between bodies", between) for between in [_between_bodies(case)] if between),
            ("solver", f"{case.run_spec(self.run).solver}: {said.basis}"),
            ("notch", ", ".join(NOTCHES[notch.kind] for notch in case.all_notches) or "none"),
            ("cells", f"{said.cells}; {said.fine}"),
            ("points", f"{said.points}"),
            ("unknowns", f"{said.unknowns_displacement} of u, {said.unknowns_phase_field} of c"),
            ("increments", self._increments()),
            ("memory", f"about {self.cost.memory_mb:.0f} MB"),
            ("time", f"about {self.cost.seconds:.0f} s"),
            *((saving.name, f"{'on' if saving.used else 'off'}: {saving.reason}") for saving in self.savings),
            *(("note", note) for note in (*self.notes, self.choice.unpriced) if note),
        ]

    def _increments(self) -> str:
        number = self.demand.increments
        if self.case.dynamics is not None:
            return f"{number} equal steps in time"
        adaptive = any(saving.used for saving in self.savings if saving.name == "adaptive increments")
        adapts = " or more, adaptive" if adaptive else ", constant"
        iterations = f"about {round(self.cost.iterations)} staggered iterations in all"
        return f"{number}{adapts}, {iterations}, about as many Newton iterations"


def plan(case: Case, run: str, accuracy: float | None = None) -> Plan:
    """The plan of one run; ``case`` must be loaded with that run's changes merged in.

    accuracy : error allowed in each checked quantity; the dearest savings are switched off until the others together
        keep within it

    Raises TooLargeError where this machine has too little memory.
    """
    prices = costs_of_savings(case, run)
    choice = _choice(case, run, accuracy, prices)
    if choice.change:
        case = load_case(case.source, case.tier, run, merge(case.change, choice.change))
    solver = case.run_spec(run).solver
    described = describe(case, solver)
    demand = demand_of(case, solver, described)
    cost = predict(demand)
    check_memory(case, described.cells, cost)
    told = _priced(case, prices, choice.too_dear)
    return Plan(case, run, described, demand, cost, told, _notes(case, accuracy, described), choice)


def planned_job(job: Job, accuracy: float | None) -> tuple[Job, list[str]]:
    """A job with the savings that are too dear for an accuracy off, and what there is to say of it.

    Raises TooLargeError where this machine has too little memory.
    """
    case = job.case()
    if SOLVERS[case.run_spec(job.run).solver].table:
        return job, []
    if accuracy is not None:
        choice = plan(case, job.run, accuracy).choice
        return replace(job, change=choice.change), choice.sentences()
    require_memory(case, job.run)
    return job, []


def longest_first(jobs: list[Job]) -> list[Job]:
    """Jobs side by side in an order in which none is left alone at the end."""

    def seconds(job: Job) -> float:
        case = job.case()
        return 0.0 if SOLVERS[case.run_spec(job.run).solver].table else expected_seconds(case, job.run)

    return sorted(jobs, key=seconds, reverse=True)


def expected_seconds(case: Case, run: str) -> float:
    """Processor seconds of a run, its case with the run's changes merged in.

    Raises TooLargeError where this machine has too little memory.
    """
    return predicted_cost(case, run).seconds


def _choice(case: Case, run: str, accuracy: float | None, prices: dict[str, float]) -> Choice:
    if accuracy is None:
        return Choice()
    dear, reasons = chosen_savings(case, run, accuracy)
    too_dear = dict(zip((saving.name for saving in dear), reasons, strict=True))
    return Choice(all_off(dear), too_dear, _unpriced(case, prices))


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


def _notes(case: Case, accuracy: float | None, described: Description) -> tuple[str, ...]:
    """What the spacing does to the toughness, what the accuracy asks of it, and what the sizes leave out."""
    notes = [*case.mesh_remarks, *remarks(case)]
    stable = described.stable_step if described.rigid < 1.0 else None  # no waves run through a rigid block
    if stable is not None and (beyond := beyond_stable(case, stable)):
        notes.append(f"{beyond}; the run may blow up")
    if case.mesh.follow_crack:
        notes.append("sizes, memory and time are those of the first fine box; they grow with it")
    for name, material in case.materials.items():
        if material.fracture is None:
            continue
        (words, share), scale = RAISED[material.fracture.functional], material.fracture.length_scale
        excess = share * case.mesh.h / scale
        note = f"the mesh sees the toughness of {name} raised by {words} = {100 * excess:.2g} %"
        if accuracy and excess > accuracy:
            fine = scale * accuracy / share
            note += f"; {100 * accuracy:g} % needs h = {fine:.3g}, or compare with Gc (1 + {words})"
        notes.append(note)
    return tuple(notes)


def _regime(case: Case) -> str:
    if case.dynamics is not None:
        return "explicit in time"
    return "quasi-static, staggered" if case.fracture_enabled else "quasi-static, elastic"


def _between_bodies(case: Case) -> str:
    """What several bodies do to each other; nothing of a single one."""
    if len(case.bodies) == 1:
        return ""
    if case.dynamics is None:
        return "those that touch hold together, those apart go through each other where they meet"
    return "contact with friction: they press on each other and part, those that touch are not joined"


def _regime_of(case: Case, body: Body) -> str:
    if not body.deforms:
        return "rigid, moves freely" if body.is_free_rigid else "rigid"
    if body.unbreakable:
        return f"breaks, but for {len(body.unbreakable)} parts"
    return "breaks" if case.materials[body.material].fracture else "deforms, cannot break"
