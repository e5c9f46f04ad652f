"""Run folders and a summary that look like a finished verification, made without any solver.

A unit square with a slit breaks along y = 0.5: every field is a formula of x, y and u, so that tests of what
reads results need no computation. The two solvers differ by a small, known amount.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd

from cases import load_case
from numerics.costs import Costs
from numerics.fields import Fields
from numerics.quasi_static import Increment
from numerics.status import RunStatus
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
[[checks]]
metric = "peak_force"
run = "mpm"
against = "fem"
limit = 0.01
reason = "the thesis finds 0.014 %"
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


def write_run(case: Any, run: str, out: Path, cells: int, factor: float) -> dict[str, Any]:
    """Write one run folder and return its entry of the summary."""
    folder, solver = run_path(out, case.name, case.tier, run), case.run_spec(run).solver
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
        info = _info(case, run, solver, cells)
        writer.close(info, np.column_stack([x, line_of_crack(x, factor)]))
    kept = ("status", "reason", "counters", "seconds", "memory_mb", "measures", "case_hash", "solver")
    return {"folder": folder.relative_to(out).as_posix(), **{key: info[key] for key in kept}}


def _solver(cells: int, state: State) -> Any:
    return SimpleNamespace(costs=Costs(), fields=lambda: fields(cells, state))


def _info(case: Any, run: str, solver: str, cells: int) -> dict[str, Any]:
    part = 1.0 if solver == "fem" else 1.13
    return {
        "case": case.name,
        "tier": case.tier,
        "run": run,
        "solver": solver,
        "status": "broken_through",
        "reason": "",
        "case_hash": case.hash(),
        "code_version": "0.1.0",
        "versions": {"numpy": "2.0"},
        "processor": "a <processor>",
        "threads": 2,
        "memory_mb": 512.5,
        "measures": {},
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
    """Write a case, the folders of two runs and ``out/summary.json``; return the summary."""
    source = out / "cases" / "notched" / "case.toml"
    source.parent.mkdir(parents=True)
    u = np.linspace(0.0, 0.0059, 18)
    points = pd.DataFrame({"u": u, "F": [0.99 * State(v, 1.0).force for v in u]})
    points.to_csv(source.with_name("someone2010.csv"), index=False)
    source.write_text(CASE, encoding="utf-8")
    source.with_name("README.md").write_text(
        "# Notes\n\n| a | b |\n|---|---|\n| 1 | <script>x</script> |\n", "utf-8"
    )
    case = load_case(source)
    runs = {
        "fem": write_run(case, "fem", out, cells, 1.0),
        "mpm": write_run(case, "mpm", out, cells, FORCE_OF_MPM),
    }
    runs |= {
        f"levels[h={h:g}]": {
            "folder": "",
            "status": "missing",
            "reason": "",
            "seconds": {},
            "counters": {},
            "measures": {"l2_error_displacement": 0.3 * h**3},
            "solver": "mpm",
        }
        for h in (0.05, 0.025, 0.0125)
    }
    summary = {
        "version": "0.1.0",
        "created": "2026-01-01T00:00:00",
        "tier": case.tier,
        "cases": [_entry(case, runs, out)],
    }
    (out / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    return summary


def _checks() -> list[dict[str, Any]]:
    common = {
        "metric": "peak_force",
        "run": "mpm",
        "measure": "relative",
        "gate": True,
        "note": "",
        "parameters": {},
    }
    against_fem = common | {
        "against": "fem",
        "value": 0.68136,
        "target": 0.67864,
        "error": 0.004008,
        "limit": 0.01,
        "margin_used": 0.4008,
        "verdict": "PASS",
        "reason": "the thesis finds 0.014 %",
        "source": "",
    }
    published = common | {
        "against": "reference:someone2010",
        "value": 0.68136,
        "target": 0.55,
        "error": 0.23884,
        "limit": 0.03,
        "margin_used": 7.961,
        "verdict": "FAIL",
        "reason": "two readings <differ>",
        "source": "Someone & Other (2010)",
    }
    missing = common | {
        "against": "baseline",
        "value": 0.68136,
        "target": None,
        "error": None,
        "limit": 0.001,
        "margin_used": None,
        "verdict": "MISSING",
        "reason": "own baseline",
        "source": "",
        "note": "no baseline for this tier",
    }
    return [against_fem, published, missing]


def _entry(case: Any, runs: dict[str, Any], out: Path) -> dict[str, Any]:
    return {
        "case": case.name,
        "source": str(case.source),
        "title": case.title,
        "section": case.section,
        "requirement": case.requirement,
        "tier": case.tier,
        "verdict": "FAIL",
        "command": f"verify run {case.name} && verify compare {case.name}",
        "runs": runs,
        "checks": _checks(),
        "curves": [
            _curve("mpm", "fem", out),
            _curve("mpm", "someone2010", out),
            _curve("fem", "someone2010", out),
        ],
        "crack_paths": [
            {"pair": "mpm vs fem", "run": "mpm", "reference": "fem", "hausdorff": 0.004, "mean": 0.0025}
        ],
    }


def _curve(run: str, reference: str, out: Path) -> dict[str, Any]:
    factors = {"mpm": FORCE_OF_MPM, "fem": 1.0, "someone2010": 0.99}
    u = np.linspace(0.0, END, 201)[1:]
    table = pd.DataFrame({"u": u, "F_reference": [State(v, factors[reference]).force for v in u]})
    table["F"] = [State(v, factors[run]).force + 0.002 * max(v - PEAK, 0) / PEAK for v in u]
    shown = table["F_reference"] > 1e-3 * table["F_reference"].max()
    error = 100 * (table["F"] - table["F_reference"]) / table["F_reference"]
    table["relative_error_percent"] = error.where(shown)
    file = Path("curves") / f"{run}_vs_{reference}.csv"
    (out / file).parent.mkdir(exist_ok=True)
    table.to_csv(out / file, index=False)
    return {
        "against": f"{run} vs {reference}",
        "run": run,
        "reference": reference,
        "file": file.as_posix(),
        "note": "",
        "l2_percent_before_peak": 0.4,
        "l2_percent_after_peak": 3.21,
        "l2_percent_whole": 1.5,
    }
