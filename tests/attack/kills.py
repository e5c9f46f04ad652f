"""Kills at any moment: no result is lost or changed, and the same command again comes to the same end."""

from __future__ import annotations

import os
import random
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import fake_solver
import pandas as pd
import psutil

from verify import cli
from verify.runs.checkpoint import CheckpointWriter
from verify.runs.run_folder import RunFolder, run_path

from .damage import RUNS, TIER, case_in, finished
from .harness import FoundError

SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
#: seconds that a stand-in takes for an increment, so that there is time to be killed in
PAUSE = 0.01
#: seconds up to which a command is let go on, but for those that are quick
LONGEST = {"run": 0.6, "run --force": 0.6, "chart": 3.0, "price": 3.0, "report": 4.0}
#: studies -> their table, and the columns that tell of no time
STUDIES = {
    "chart": ("charts/square/quick/spacing.csv", ["ladder", "at", "status", "value", "error"]),
    "price": ("prices/square/quick.csv", ["run", "saving", "quantity", "with", "without"]),
}
#: columns that tell of time, not of the solution
TIMES = ["seconds"]


def kill(rng: random.Random, folder: Path) -> str:
    """A command of the stand-ins is killed, and done again."""
    finished()
    fake_solver.FakeSolver.force = _slow_force
    command = rng.choice(["run"] * 8 + ["run --force", "compare", "accept"] * 4 + ["chart", "price"] * 2 + ["report"])
    out = folder / "out"
    if command != "run":
        shutil.copytree(finished(), out)
    # a baseline is written beside the case; a run is that of one file
    case = case_in(folder) if command == "accept" else finished() / "square" / "case.toml"
    arguments = [*_words(command, case, out)]
    child = _started(arguments)
    time.sleep(rng.uniform(0.0, LONGEST.get(command, 0.3)))
    ended = _killed(child, rng.choice(SIGNALS))
    if command == "run --force" or not command.startswith("run"):
        _same(out, "after the kill")
    again = [*arguments, "--resume"] if command.startswith("run") else arguments
    code = cli._exit_code(again)
    if code:
        raise FoundError(f"{command} again exits {code}")
    _same(out, "after doing it again")
    if command in STUDIES and not _table(out, command).equals(_studied(command)):
        raise FoundError(f"the table of {command} is another one")
    return f"{command} {ended}"


def _slow_force(solver: fake_solver.FakeSolver, u: float) -> float:
    time.sleep(PAUSE)
    return solver.factor * 100.0 * max(0.0, min(u, 0.005 - (u - 0.005) * 5 / 3))


def _words(command: str, case: Path, out: Path) -> Iterator[str]:
    name, *options = command.split()
    yield from (name, *options, "--out", str(out))
    if name != "report":
        yield from (str(case), "--tier", TIER)
    else:
        cli._exit_code(["compare", str(case), "--tier", TIER, "--out", str(out)])
    if name == "accept":
        yield from ("--reason", "an attack")
    if name == "run":
        yield from ("--threads", "1")


def _same(out: Path, when: str) -> None:
    """Both runs hold what the undisturbed ones do."""
    for name in RUNS:
        found, whole = (RunFolder(run_path(place, "square", TIER, name)) for place in (out, finished()))
        if not found.history.drop(columns=TIMES).equals(whole.history.drop(columns=TIMES)):
            raise FoundError(f"the history of {name} is another one {when}")
        pairs = zip(found.snapshots(), whole.snapshots(), strict=True)
        if any((a.points["phase_field"] != b.points["phase_field"]).any() for a, b in pairs):
            raise FoundError(f"the fields of {name} are others {when}")


def _table(out: Path, study: str) -> pd.DataFrame:
    file, columns = STUDIES[study]
    return pd.read_csv(out / file)[columns]


@cache
def _studied(study: str) -> pd.DataFrame:
    """The table of an undisturbed study."""
    out = Path(tempfile.mkdtemp(prefix="attack-study-"))
    cli._exit_code([*_words(study, finished() / "square" / "case.toml", out)])
    return _table(out, study)


def _started(arguments: list[str]) -> int:
    """A child at work on a command, in a group of its own, that saves its state at every increment."""
    child = os.fork()
    if child:
        return child
    os.setsid()
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    CheckpointWriter.interval = 0.0
    code = 99
    with suppress(BaseException):
        code = cli._exit_code(arguments)
    os._exit(code)


def _killed(child: int, with_signal: signal.Signals) -> str:
    """Kill a child, or one of its own, and wait for its end."""
    with suppress(ProcessLookupError):
        os.kill(child, with_signal)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        return f"killed by {signal.Signals(os.WTERMSIG(status)).name}"
    return "came to its end first" if os.WEXITSTATUS(status) == 0 else f"ended with {os.WEXITSTATUS(status)}"


# ------------------------------------------------------------------------------------------- the solvers


def kill_solver(rng: random.Random, folder: Path) -> str:
    """A run of a solver, alone or beside another, is killed and gone on with; the end is the same to the bit."""
    name = rng.choice(["slit", "pulled"])
    whole, case = _whole(name), Path(__file__).with_name("tiny") / f"{name}.toml"
    jobs = rng.choice(["1", "1", "2"])
    arguments = ["run", str(case), "--tier", TIER, "--out", str(folder), "--threads", jobs, "--jobs", jobs]
    child = _started(arguments)
    time.sleep(rng.uniform(0.3, 1.1) * whole["seconds"])
    victims = [child, *(process.pid for process in psutil.Process(child).children(recursive=True))]
    victim = rng.choice(victims)
    if victim != child:
        with suppress(ProcessLookupError):
            os.kill(victim, signal.SIGKILL)
        _, _ = os.waitpid(child, 0)
        ended = "worker killed"
    else:
        ended = _killed(child, rng.choice(SIGNALS))
    _without_orphans(victims)
    again = _started([*arguments, "--resume"])
    _, status = os.waitpid(again, 0)
    if os.waitstatus_to_exitcode(status) != 0:
        raise FoundError(f"{name} again exits {os.waitstatus_to_exitcode(status)}")
    for run in RUNS:
        if not _history(folder, name, run).equals(whole[run]):
            raise FoundError(f"the history of {name} {run} is another one")
    resumed = [RunFolder(run_path(folder, name, TIER, run)).info["resumed_after_step"] is not None for run in RUNS]
    return f"{name}, jobs {jobs}, {ended}, {'resumed' if any(resumed) else 'begun anew or whole'}"


@cache
def _whole(name: str) -> dict[str, Any]:
    """Histories of the undisturbed runs, and the seconds that they take."""
    out, started = Path(tempfile.mkdtemp(prefix="attack-whole-")), time.monotonic()
    case = Path(__file__).with_name("tiny") / f"{name}.toml"
    os.waitpid(_started(["run", str(case), "--tier", TIER, "--out", str(out), "--threads", "1"]), 0)
    return {"seconds": time.monotonic() - started} | {run: _history(out, name, run) for run in RUNS}


def _history(out: Path, name: str, run: str) -> pd.DataFrame:
    return RunFolder(run_path(out, name, TIER, run)).history.drop(columns=TIMES)


def _without_orphans(victims: list[int]) -> None:
    """Workers whose parent is gone end by themselves; wait for it."""
    _, alive = psutil.wait_procs([psutil.Process(pid) for pid in victims if psutil.pid_exists(pid)], timeout=60.0)
    if alive:
        for process in alive:
            process.kill()
        raise FoundError("a worker outlives its parent")
