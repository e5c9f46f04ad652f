"""Run folders and a summary that look like a finished verification, made without any solver.

A unit square with a slit breaks along y = 0.5: every field is a formula of x, y and u, so that tests of what
reads results need no computation. The two solvers differ by a small, known amount.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd

from cases import Case, load_case
from numerics.costs import Costs
from numerics.fields import Fields
from numerics.quasi_static import Increment
from numerics.status import RunStatus
from verify.judging.summary import summarise, write_summary
from verify.runs.run_folder import run_path
from verify.runs.run_writer import RunWriter

PEAK, BROKEN, END = 0.0056, 0.0060, 0.0064
FORCE_OF_MPM = 1.004  # force of the synthetic MPM over that of the FEM
TITLE = 'Notched <plate> & "tension"'

CASE = f"""
title = '{TITLE}'
section = "4.4.1"
requirement = "Both solvers give the same peak force & crack path; limits hold for h < l0."
[units]
length = "mm"
force = "kN"
[plane]
assumption = "strain"
[materials.steel]
young = 210.0
poisson = 0.3
fracture = {{ toughness = 0.0027, length_scale = 0.05, split = "spectral" }}
[bodies.plate]
material = "steel"
shape = {{ rectangle = {{ lower = [0, 0], upper = [1, 1] }} }}
[[notches]]
kind = "slit"
start = [0, 0.5]
end = [0.5, 0.5]
[[constraints]]
on = "bottom"
direction = "x"
value = 0.0
[[constraints]]
on = "bottom"
direction = "y"
value = 0.0
[[constraints]]
on = "top"
direction = "y"
scale = 1.0
[load]
path = [0.0, {END}]
increment = 1e-4
[mesh]
h = 0.025
[output]
snapshots = [0.0050, 0.0058]
[runs.fem]
solver = "fem"
[runs.mpm]
solver = "mpm"
[runs.levels]
solver = "mpm"
sweep = {{ "mesh.h" = [0.05, 0.025, 0.0125] }}
[references.someone2010]
kind = "read from figure"
source = "Someone & Other (2010), <Journal> 199"
uncertainty = "1 %"
values = {{ peak_force = 0.70 }}
curve = "someone2010.csv"
[references.cycled2012]
kind = "measured"
source = "A test that was unloaded once (2012)"
curve = "cycled2012.csv"
[[checks]]
metric = "peak_force"
run = "mpm"
against = "fem"
limit = 0.01
reason = "the thesis finds 0.014 %"
[[checks]]
metric = "peak_force"
run = "mpm"
against = "reference:someone2010"
limit = 0.01
reason = "two readings <differ>"
[[checks]]
metric = "peak_force"
run = "mpm"
against = "baseline"
limit = 0.001
reason = "own baseline"
"""


@dataclass(frozen=True)
class State:
    """What the synthetic specimen does at displacement u."""

    u: float
    factor: float

    @property
    def share_broken(self) -> float:
        """How far the crack has run through the ligament, 0 to 1."""
        return float(np.clip((self.u - 0.97 * PEAK) / (BROKEN - 0.97 * PEAK), 0.0, 1.0))

    @property
    def force(self) -> float:
        """Reaction force in kN."""
        return self.factor * 125.0 * self.u * (1.0 - self.share_broken) ** 1.5

    def phase_field(self, places: np.ndarray) -> np.ndarray:
        """AT2 profile around the line from the slit's end to the crack's tip."""
        tip = 0.5 + 0.5 * self.share_broken
        ahead = np.maximum(np.maximum(places[:, 0] - tip, 0.5 - places[:, 0]), 0.0)
        away = np.hypot(places[:, 1] - line_of_crack(places[:, 0], self.factor), ahead)
        broken = (1.0 - np.exp(-away / 0.03)) if self.share_broken > 0 else np.ones(len(places))
        return np.clip(broken, 0.0, 1.0)

    def displacement(self, places: np.ndarray) -> np.ndarray:
        """Upper half lifted over the crack, stretched before it."""
        upper = (places[:, 1] > line_of_crack(places[:, 0], self.factor)).astype(float)
        opened = np.where(places[:, 0] < 0.5 + 0.5 * self.share_broken, upper, places[:, 1])
        return np.column_stack([-0.1 * self.u * places[:, 0] * (1 - self.share_broken), self.u * opened])


def line_of_crack(x: np.ndarray, factor: float) -> np.ndarray:
    """Height of the crack over x; the solvers' lines differ by (factor - 1)."""
    return 0.5 + (factor - 1.0) * np.sin(2 * np.pi * np.clip(x - 0.5, 0.0, None))


def fields(cells: int, state: State) -> Fields:
    """All fields on ``cells`` x ``cells`` squares with 2 x 2 points each."""
    x = np.linspace(0.0, 1.0, cells + 1)
    grid = np.array(np.meshgrid(x, x, indexing="xy")).reshape(2, -1).T
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    quads = np.column_stack([corner, corner + 1, corner + cells + 2, corner + cells + 1])
    middle = (x[:-1, None] + np.array([0.2113, 0.7887]) / cells).ravel()
    places = np.array(np.meshgrid(middle, middle, indexing="xy")).reshape(2, -1).T
    c, n = state.phase_field(places), len(places)
    displacement = state.displacement(places)
    stress = np.zeros((n, 3))
    stress[:, 1] = (
        state.force * c**2 * (1.0 + 0.8 * np.exp(-np.hypot(places[:, 0] - 0.5, places[:, 1] - 0.5) / 0.1))
    )
    return Fields(
        points=places + displacement,
        reference=places,
        volume=np.full(n, (0.5 / cells) ** 2),
        displacement=displacement,
        gradient=np.zeros((n, 4)),
        phase_field=c,
        history_field=np.zeros(n),
        stress=stress,
        energy_density=np.zeros(n),
        body=np.zeros(n, dtype=int),
        grid_points=grid,
        grid_cells=quads,
        grid_displacement=state.displacement(grid),
        grid_phase_field=state.phase_field(grid),
    )


def write_run(case: Case, out: Path, cells: int, factor: float, measures: dict[str, float] | None = None) -> None:
    """Write the folder of one run, whose case it is."""
    folder = run_path(out, case.name, case.tier, case.run)
    displacements = np.unique(np.concatenate([np.linspace(0.0, END, 65), case.output.snapshots]))
    work, before = 0.0, (0.0, 0.0)
    with RunWriter(folder, case.output.snapshots) as writer:
        writer.start(None, "")
        for step, u in enumerate(displacements):
            state = State(float(u), factor)
            work += 0.5 * (state.force + before[1]) * (u - before[0])
            before = (u, state.force)
            elastic = 0.5 * state.force * u
            increment = Increment(
                step=step,
                u=u,
                share=u / END,
                F=state.force,
                elastic_energy=elastic,
                fracture_energy=work - elastic,
                external_work=work,
                c_min=1.0 - state.share_broken,
                staggered=4,
                newton=8,
                seconds=0.01,
                status=RunStatus.COMPLETE,
                reason="",
            )
            writer.record(increment, _solver(cells, state))
        writer.finish(_solver(cells, State(END, factor)), fields(cells, State(END, factor)))
        x = np.linspace(0.5, 1.0, 60)
        writer.close(_info(case, cells, measures or {}), np.column_stack([x, line_of_crack(x, factor)]))


def _solver(cells: int, state: State) -> Any:
    return SimpleNamespace(costs=Costs(), fields=lambda: fields(cells, state))


def _info(case: Case, cells: int, measures: dict[str, float]) -> dict[str, Any]:
    solver = case.run_spec(case.run).solver
    part = 1.0 if solver == "fem" else 1.13
    return {
        "case": case.name,
        "case_source": str(case.source),
        "tier": case.tier,
        "run": case.run,
        "solver": solver,
        "status": "broken_through",
        "reason": "",
        "case_hash": case.hash(),
        "code_version": "0.1.0",
        "versions": {"numpy": "2.0"},
        "processor": "a <processor>",
        "threads": 2,
        "memory_mb": 512.5,
        "measures": measures,
        "counters": {
            "unknowns_displacement": 2 * (cells + 1) ** 2,
            "unknowns_phase_field": (cells + 1) ** 2,
            "points": 4 * cells**2,
            "cells": cells**2,
            "factorisations": 300,
            "newton": 520,
        },
        "seconds": {
            "warm_up": 1.25,
            "assembly": 3.0 * part,
            "factorisation": 6.0 * part,
            "solve": 20.0 * part,
            "total": 22.0 * part,
        },
    }


def write_verification(out: Path, cells: int = 40) -> dict[str, Any]:
    """Write a case and the folders of its runs, judge them into ``out/summary.json``; return the summary."""
    source = out / "cases" / "notched" / "case.toml"
    source.parent.mkdir(parents=True)
    cycle = np.concatenate([np.linspace(0.0, 0.002, 9), np.linspace(0.00175, 0.0, 8), np.linspace(0.00025, 0.006, 24)])
    for name, u in (("someone2010", np.linspace(0.0, 0.0059, 18)), ("cycled2012", cycle)):
        points = pd.DataFrame({"u": u, "F": [0.99 * State(v, 1.0).force for v in u]})
        points.to_csv(source.with_name(f"{name}.csv"), index=False)
    source.write_text(CASE, encoding="utf-8")
    source.with_name("README.md").write_text(
        "# Notes\n\n| a | b |\n|---|---|\n| 1 | <script>x</script> |\n", "utf-8"
    )
    write_run(load_case(source, run="fem"), out, cells, 1.0)
    write_run(load_case(source, run="mpm"), out, cells, FORCE_OF_MPM)
    for h in (0.05, 0.025, 0.0125):
        measures = {"l2_error_displacement": 0.3 * h**3}
        write_run(load_case(source, run=f"levels[h={h:g}]"), out, 4, FORCE_OF_MPM, measures)
    case = load_case(source)
    summary = summarise([case], case.tier, out)
    write_summary(summary, out)
    return summary
