"""Several runs at a time, each by a process of its own."""

import os
import signal
from dataclasses import replace
from pathlib import Path

import fake_solver
import pytest

from cases.loader import LIBRARY
from verify.runs.jobs import Job, Waiting, outcomes
from verify.runs.run_folder import RunFolder
from verify.runs.running import run


class KilledJob(Job):
    """Ends its process as the system does where memory is short."""

    def finished(self) -> RunFolder | None:
        os.kill(os.getpid(), signal.SIGKILL)
        return None


def test_a_process_that_is_killed_fails_its_own_run_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake_solver.install(monkeypatch)
    case = fake_solver.write_case(tmp_path / "square")
    job = Job(case, "square", "fem", "quick", tmp_path, threads=1)
    run(case, "fem", "quick", tmp_path)
    killed = KilledJob(case, "square", "mpm", "quick", tmp_path, threads=1)
    told = {outcome.title: outcome for outcome in outcomes([killed, *(replace(job, label=n) for n in "abc")], jobs=2)}
    assert len(told) == 4
    assert [outcome.title for outcome in told.values() if outcome.failed] == [killed.title]
    line = told[killed.title].line
    assert "its process ended before it" in line and f"{killed.folder()}: go on behind its last checkpoint" in line


def test_processes_go_on_with_what_they_have_compiled(tmp_path: Path) -> None:
    moving, still = (
        [Job(LIBRARY / name / "case.toml", name, run, "quick", tmp_path, 1) for run in ("fem", "mpm")]
        for name in ("plate_impact", "sen_tension")
    )
    waiting, (one, other) = Waiting([*moving, *still, moving[0]]), (object(), object())
    assert waiting.next_for(one) == moving[0]
    assert waiting.next_for(other) == still[0], "what is next has the kernels that the first one compiles"
    assert waiting.next_for(other) == still[1]
    assert waiting.next_for(other) == moving[1], "where none of its own is left, the next one"
    assert waiting.next_for(one) == moving[0]
