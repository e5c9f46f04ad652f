"""An analytic stand-in for the solvers: a square that softens after a peak, in milliseconds."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import Case
from numerics.costs import Costs
from numerics.fields import Fields
from numerics.quasi_static import Increment
from numerics.status import RunStatus
from verify.runs import running
from verify.runs.listeners import Listener

CASE = """
title = "Softening square"
requirement = "Both stand-ins give the same curve."
[units]
length = "mm"
force = "kN"
[plane]
assumption = "strain"
[materials.steel]
young = 210.0
poisson = 0.3
fracture = { toughness = 0.0027, length_scale = 0.3, split = "none" }
[bodies.plate]
material = "steel"
shape = { rectangle = { lower = [0, 0], upper = [1, 1] } }
[[constraints]]
on = "top"
direction = "y"
scale = 1.0
[[constraints]]
on = "left"
direction = "x"
value = 0
[[constraints]]
on = "bottom"
direction = "y"
value = 0
[load]
path = [0.0, 0.01]
increment = 0.001
[mesh]
h = 0.25
[output]
snapshots = [0.0035, 0.006]
[runs.fem]
solver = "fem"
[runs.mpm]
solver = "mpm"
[tiers.quick.mesh]
h = 0.2
"""
CHECK = """
[[checks]]
metric = "peak_force"
run = "mpm"
against = "{against}"
limit = {limit}
gate = {gate}
reason = "the stand-ins differ by their factor only"
"""


def write_case(folder: Path, *checks: str) -> Path:
    """A case file of the softening square with the given [[checks]]."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "case.toml"
    path.write_text(CASE + "".join(checks), encoding="utf-8")
    return path


def check(against: str, limit: float = 0.01, gate: bool = True) -> str:
    """A check of the MPM's peak force."""
    return CHECK.format(against=against, limit=limit, gate=str(gate).lower())


class FakeSolver:
    """Force over displacement in closed form; ``factor`` scales the force."""

    def __init__(self, case: Case, factor: float = 1.0) -> None:
        self.case, self.factor = case, factor
        self.u = 0.0
        self.costs = Costs()
        self.costs.count.update(unknowns_displacement=8, points=4, cells=1)

    def force(self, u: float) -> float:
        """Linear up to 0.005, then down to nothing at 0.008."""
        return self.factor * 100.0 * max(0.0, min(u, 0.005 - (u - 0.005) * 5 / 3))

    def fields(self) -> Fields:
        square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        stretched = square * [0.0, self.u]
        phase = np.full(4, 1.0 - min(1.0, self.u / 0.01))
        scalar = np.full(4, self.u)
        return Fields(
            points=square + stretched, reference=square, volume=np.full(4, 0.25), displacement=stretched,
            gradient=np.tile([0.0, 0.0, 0.0, self.u], (4, 1)), phase_field=phase, history_field=scalar,
            stress=np.tile([1.0, 3.0, 0.0], (4, 1)), energy_density=scalar, body=np.zeros(4, dtype=int),
            grid_points=square, grid_cells=np.array([[0, 1, 2, 3]]), grid_displacement=stretched,
            grid_phase_field=phase,
        )  # fmt: skip

    def measures(self) -> dict[str, float]:
        return {"constraint_error": 1e-9}

    def checkpoint(self) -> dict[str, np.ndarray]:
        return {"u": np.array(self.u)}

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        self.u = float(saved["u"])


def fake_increments(solver: FakeSolver, case: Case, after: Increment | None = None) -> Iterator[Increment]:
    """Constant increments along the load path."""
    first = after.step + 1 if after else 0
    assert after is None or solver.u == after.u, "the solver was not restored"
    for step, u in enumerate(np.linspace(case.load.path[0], case.load.path[-1], 11)):
        if step < first:
            continue
        solver.u = float(u)
        yield Increment(
            step=step, u=float(u), F=solver.force(u), elastic_energy=0.0, fracture_energy=0.0,
            external_work=0.0, c_min=1.0 - 100 * float(u), staggered=1, newton=1, seconds=0.001 * step,
            status=RunStatus.COMPLETE, share=step / 10,
        )  # fmt: skip


def stopping_at(step: int, error: BaseException | None = None) -> Any:
    """Increments that end after ``step``: raising ``error``, or reporting no convergence without one."""

    def increments(solver: FakeSolver, case: Case, after: Increment | None = None) -> Iterator[Increment]:
        for increment in fake_increments(solver, case, after):
            yield increment
            if increment.step == step:
                break
        if error is not None:
            raise error
        yield replace(increment, status="no_convergence", reason="the smallest increment failed")

    return increments


class Seen(Listener):
    """Keeps what it is told; presses Ctrl-C where ``stop`` says so."""

    def __init__(self, stop: Callable[[Any], bool] = lambda record: False) -> None:
        self.records: list[Any] = []
        self.note, self._stop = "", stop

    def start(self, after: Any, note: str) -> None:
        self.note = note

    def record(self, record: Any, discretisation: Any) -> None:
        self.records.append(record)
        if self._stop(record):
            raise KeyboardInterrupt


def install(
    monkeypatch: pytest.MonkeyPatch, increments: Any = fake_increments, mpm_factor: float = 1.0
) -> None:
    """Let every run use the stand-ins, in whose four points there is no crack to trace."""
    monkeypatch.setattr("verify.metrics.crack_path.crack_path", lambda *_: np.empty((0, 2)))
    monkeypatch.setitem(running.DISCRETISATIONS, "fem", FakeSolver)
    monkeypatch.setitem(running.DISCRETISATIONS, "mpm", lambda case: FakeSolver(case, mpm_factor))
    monkeypatch.setattr(running, "solver_records", increments)
