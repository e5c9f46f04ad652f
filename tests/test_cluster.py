"""Runs on the workers of a Dask cluster: two processes of this machine that use the stand-ins."""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import fake_solver
import pandas as pd
import pytest

from cases import load_case
from verify import cli
from verify.runs import cluster, jobs, running
from verify.runs.checkpoint import CheckpointWriter
from verify.runs.jobs import Job, outcomes
from verify.runs.run_folder import RunFolder, partial_folder
from verify.studies.charts import make_charts
from verify.studies.study import Options

CHART = """
[charts.spacing]
quantities = [{ metric = "peak_force", value = 0.5 }]
change.mesh.under_resolved = true
[charts.spacing.ladders.coarse]
run = "fem"
levels = { "mesh.h" = [0.4, 0.3, 0.25, 0.2] }
"""


def use_stand_ins(pause: float = 0.0) -> None:
    """In a worker for good: the stand-ins, slow where wished, with the state saved at each increment."""

    def slow(solver: Any, case: Any, after: Any = None) -> Iterator[Any]:
        for increment in fake_solver.fake_increments(solver, case, after):
            time.sleep(pause)
            yield increment

    running.DISCRETISATIONS.update(fem=fake_solver.FakeSolver, mpm=fake_solver.FakeSolver)
    running.solver_records = slow
    CheckpointWriter.interval, CheckpointWriter.largest_share = 0.0, 1.0


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """A client of two workers with a thread each, on the loopback alone."""
    distributed = pytest.importorskip("distributed")
    local = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None
    )
    with local, distributed.Client(local, set_as_default=False) as client:
        yield client


@pytest.fixture
def address(client: Any) -> str:
    """The scheduler's address; its workers use the stand-ins."""
    client.wait_for_workers(2, timeout=60)
    client.run(use_stand_ins)
    return str(client.scheduler.address)


@pytest.fixture
def case_file(tmp_path: Path) -> Path:
    return fake_solver.write_case(tmp_path / "square", CHART)


def job(case_file: Path, out: Path, run: str = "fem") -> Job:
    return Job(case_file, "square", run, "quick", out, threads=1)


def exit_code(*arguments: str) -> Any:
    with pytest.raises(SystemExit) as ended:
        cli.main(list(arguments))
    return ended.value.code


def test_what_a_client_remembers_of_its_workers_is_not_relied_on(
    address: str, case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the background it is overwritten by what has no workers."""
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(distributed.Client, "scheduler_info", lambda *_, **__: {"workers": {}})
    (outcome,) = outcomes([job(case_file, tmp_path)], jobs=1, cluster=address)
    assert not outcome.failed, outcome.line


def test_runs_leave_their_folders_where_they_are_asked_for(
    address: str, case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    asked = ("run", "square/case.toml", "--tier", "quick", "--out", "results", "--cluster", address)
    assert exit_code(*asked) == 0
    told = capsys.readouterr().out
    for run in ("fem", "mpm"):
        folder = job(case_file, tmp_path / "results", run).folder()
        assert RunFolder(folder).good and str(folder) in told
    assert exit_code(*asked) == 0 and "up to date" in capsys.readouterr().out


def test_a_chart_is_the_same_as_in_this_process(
    address: str, case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake_solver.install(monkeypatch)
    case, costs = load_case(case_file, "quick"), ["seconds", "warm_up", "memory_mb", "on_front"]
    here, there = (
        pd.read_csv(make_charts(case, Options(tmp_path / place, cluster=where))[0]).drop(columns=costs)
        for place, where in (("here", None), ("there", address))
    )
    pd.testing.assert_frame_equal(here, there)
    assert Options(tmp_path, cluster=address).at_once == 2


def test_a_run_whose_worker_is_killed_is_told_and_can_be_resumed(
    client: Any, address: str, case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    client.run(use_stand_ins, 0.2)
    asked = job(case_file, tmp_path / "out")
    saved = partial_folder(asked.folder()) / "checkpoint.npz"
    threading.Thread(target=_kill_the_worker_that_saved, args=(client, saved), daemon=True).start()
    (outcome,) = outcomes([asked], 1, address)
    assert outcome.failed and "ended before it" in outcome.line
    assert f"{asked.folder()}: go on behind its last checkpoint with `verify run --resume`" in outcome.line
    fake_solver.install(monkeypatch)
    assert "resumed after step" in jobs.do(replace(asked, resume=True)).line


def _kill_the_worker_that_saved(client: Any, saved: Path) -> None:
    while not saved.exists():
        time.sleep(0.02)
    processes = client.run(os.getpid)
    (busy,) = (worker for worker, tasks in client.processing().items() if tasks)
    os.kill(processes[busy], signal.SIGKILL)


def test_each_item_comes_back_with_its_own_result(address: str) -> None:
    assert dict(cluster.results(abs, range(-5, 0), address)) == {-n: n for n in range(1, 6)}


def test_a_worker_with_other_code_does_nothing(
    address: str, case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "source_hash", lambda: "other")
    (outcome,) = outcomes([job(case_file, tmp_path)], 1, address)
    assert outcome.failed and "another version of the project" in outcome.line


def test_an_address_without_a_scheduler_is_told(
    client: Any, case_file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    for nowhere in ("tcp://127.0.0.1:9", "nowhere"):
        assert exit_code("chart", str(case_file), "--tier", "quick", "--cluster", nowhere) == 3
        assert f"{nowhere}: no Dask scheduler answers there" in capsys.readouterr().err


def test_what_is_no_address_is_not_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("distributed.Client", lambda *_, **__: pytest.fail("it was looked for"))
    for name in ("nonsense", "tcp://127.0.0.1"):
        with pytest.raises(cluster.ClusterError, match=f"{name}: no Dask scheduler answers there"):
            cluster.worker_count(name)


def test_without_dask_one_sentence_tells_how_to_install_it(
    case_file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert exit_code("run", str(case_file), "--tier", "quick", "--cluster", "tcp://127.0.0.1:8786") == 3
    assert "pip install 'dask[distributed]'" in capsys.readouterr().err
