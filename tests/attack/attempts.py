"""What is attempted: each kind takes a random generator and an empty folder, and says how it ended."""

from __future__ import annotations

import random
import tempfile
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

from cases import Case, case_from_tables, load_case
from cases.judging import TIERS
from numerics.status import RunStatus
from verify.judging.judge import checks_of
from verify.planning.plan import plan as make_plan
from verify.runs.listeners import TimeLimit
from verify.runs.running import run as run_case
from verify.runs.selection import selected_runs

from .harness import FoundError
from .mutants import Tables, mutated, written_mutant
from .toml_text import toml_text

#: seconds, megabytes and cells up to which a mutant is run
QUICK, SMALL, FEW = 5.0, 500.0, 3000
#: errors that a solver ends with in words of its own
TOLD = ("LinearSolverError", "MeshError")


def validate(rng: random.Random, folder: Path) -> str:
    """A mutant of the library through `verify validate`."""
    path = written_mutant(rng, folder)
    for tier in TIERS:
        checks_of(load_case(path, tier))
    return "valid"


def plan(rng: random.Random, folder: Path) -> str:
    """A mutant of the library through `verify plan`, for one of its runs."""
    path, tier = written_mutant(rng, folder), rng.choice(TIERS)
    _planned(rng, path, tier)
    return "planned"


def _planned(rng: random.Random, path: Path, tier: str) -> tuple[Case, Any]:
    names = selected_runs(load_case(path, tier), None)
    case = load_case(path, tier, rng.choice(names or ["none"]))
    planned = make_plan(case, str(case.run))
    planned.rows()
    return case, planned


@cache
def compiled() -> None:
    """Run the tiny cases once in this process: what is compiled or read on the way is not the mutants'."""
    with tempfile.TemporaryDirectory() as folder:
        for number, tables in enumerate(TINY):
            for name in tables["runs"]:
                case = case_from_tables(tables, "quick", name, name=f"tiny{number}")
                run_case(case, name, out=folder, threads=1)


def run(rng: random.Random, folder: Path) -> str:
    """A mutant of a tiny case, from its file to the end of a run with a time limit."""
    path = folder / "tiny" / "case.toml"
    path.parent.mkdir()
    path.write_text(toml_text(mutated(rng, rng.choice(TINY))), encoding="utf-8")
    case, planned = _planned(rng, path, "quick")
    if planned.cost.seconds > QUICK or planned.cost.memory_mb > SMALL or planned.described.cells > FEW:
        return "too large for a quick run"
    done = run_case(case, str(case.run), out=folder, listeners=[TimeLimit(QUICK)], threads=1)
    if done.info["status"] == RunStatus.FAILED and not done.info["reason"].startswith(TOLD):
        raise FoundError(f"a run's reason is {done.info['reason']}")
    return str(done.info["status"].value)


#: small cases of each regime, whose runs take seconds
TINY: list[Tables] = [
    tomllib.loads(path.read_text(encoding="utf-8")) for path in sorted(Path(__file__).with_name("tiny").glob("*.toml"))
]
