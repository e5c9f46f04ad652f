"""Run folders: complete or refused."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import fake_solver
import numpy as np
import pytest

from cases import load_case
from reports.words import runs_sentence
from verify.judging.judge import find_run
from verify.runs import jobs, running
from verify.runs.atomic import WriteError, superseded, write_text
from verify.runs.run_folder import RunFolder, RunFolderError, RunWriter, partial_folder, run_path
from verify.runs.running import InterruptedRunError, run


@pytest.fixture
def case_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    fake_solver.install(monkeypatch)
    return fake_solver.write_case(tmp_path / "square")


def test_a_finished_run_is_read_back_as_it_was(case_file: Path, tmp_path: Path) -> None:
    seen = []
    done = run(case_file, "mpm", "quick", tmp_path, seen.append)
    assert done.folder == run_path(tmp_path, "square", "quick", "mpm")
    assert done.info["status"] == "complete"
    assert len(seen) == len(done.history) == done.info["increments"] == 11
    assert done.history["F"].max() == pytest.approx(0.5)
    assert not partial_folder(done.folder).exists()
    assert done.case.hash() == done.info["case_hash"]
    solver = fake_solver.FakeSolver(done.case)
    solver.u = 0.01
    expected, fields = solver.fields(), done.fields()
    assert fields.broken_at is None  # a static state
    for name in vars(expected).keys() - {"broken_at"}:
        np.testing.assert_allclose(getattr(fields, name), getattr(expected, name), atol=1e-15, err_msg=name)
    assert done.points().point_data["hydrostatic_stress"] == pytest.approx(2.0)
    assert done.points().celltypes.tolist() == [1] * 4
    assert done.checkpoint.record == seen[-1]
    assert done.checkpoint.state["u"] == 0.01


def test_fields_are_written_where_asked_and_at_the_end(case_file: Path, tmp_path: Path) -> None:
    done = run(case_file, "fem", "quick", tmp_path)
    snapshots = list(done.snapshots())
    assert [round(snapshot.u, 6) for snapshot in snapshots] == [0.004, 0.006, 0.01]
    assert done.grid(0.0061)["phase_field"] == pytest.approx(0.4)
    for name in ("points.pvd", "grid.pvd"):
        text = (done.folder / name).read_text()
        assert text.count("<DataSet") == 3
    import pyvista

    reader = pyvista.get_reader(done.folder / "points.pvd")
    assert reader.time_values == pytest.approx([0.004, 0.006, 0.01])
    assert reader.read()[0].n_points == 4


def test_no_convergence_keeps_the_last_good_state(
    case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "solver_records", fake_solver.stopping_at(4))
    done = run(case_file, "fem", "quick", tmp_path)
    assert (done.info["status"], done.good) == ("no_convergence", False)
    assert done.info["reason"] == "the smallest increment failed"
    assert done.history["step"].tolist() == [0, 1, 2, 3, 4]
    assert done.checkpoint.record.step == 4
    assert [snapshot.step for snapshot in done.snapshots()] == [4]


def test_a_failure_that_the_case_expects_is_a_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake_solver.install(monkeypatch, fake_solver.stopping_at(4))
    case = fake_solver.write_case(tmp_path / "square")
    case.write_text(case.read_text().replace('solver = "fem"', 'solver = "fem"\nexpect_failure = true'))
    done = run(case, "fem", "quick", tmp_path)
    assert (done.info["status"], done.good) == ("expected_failure", True)
    assert done.info["reason"] == "the smallest increment failed"
    assert not run(case, "mpm", "quick", tmp_path).good


def test_a_solver_that_raises_leaves_a_failed_run_with_its_reason(
    case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "solver_records", fake_solver.stopping_at(2, ValueError("singular\nmatrix")))
    done = run(case_file, "fem", "quick", tmp_path)
    assert done.info["status"] == "failed"
    assert done.info["reason"] == "ValueError: singular matrix"
    assert "singular" in (done.folder / "traceback.txt").read_text()


def test_an_unchanged_run_is_not_computed_again(case_file: Path, tmp_path: Path) -> None:
    calls: list[object] = []
    for force, expected in ((False, 11), (False, 11), (True, 22)):
        run(case_file, "fem", "quick", tmp_path, calls.append, force=force)
        assert len(calls) == expected
    case_file.write_text(case_file.read_text().replace("young = 210.0", "young = 211.0"))
    run(case_file, "fem", "quick", tmp_path, calls.append)
    assert len(calls) == 33


def test_an_interrupted_run_says_where_it_stopped_and_spares_the_older_one(
    case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = run(case_file, "fem", "quick", tmp_path)
    monkeypatch.setattr(running, "solver_records", fake_solver.stopping_at(3, KeyboardInterrupt()))
    with pytest.raises(InterruptedRunError, match=r"fem\.partial"):
        run(case_file, "fem", "quick", tmp_path, force=True)
    partial = partial_folder(old.folder)
    assert len((partial / "history.csv").read_text().splitlines()) == 1 + 4
    assert len(RunFolder(old.folder).history) == 11
    with pytest.raises(RunFolderError, match="not finished"):
        RunFolder(partial)


KILLED = """
import os, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
import fake_solver
from cases import load_case
from reports.words import runs_sentence
from verify.runs import running
from verify.runs import run_folder
running.DISCRETISATIONS["fem"] = fake_solver.FakeSolver
def increments(solver, case):
    for increment in fake_solver.fake_increments(solver, case):
        yield increment
        if increment.step == {step}:
            os._exit(9)
running.solver_records = increments
if {last_moment}:
    run_folder.replace_folder = lambda new, folder: os._exit(9)
running.run(Path({case!r}), "fem", "quick", Path({out!r}), force=True)
"""


def _start_and_kill(case_file: Path, out: Path, step: int, last_moment: bool) -> "subprocess.Popen[bytes]":
    tests = str(Path(__file__).parent)
    code = KILLED.format(tests=tests, step=step, last_moment=last_moment, case=str(case_file), out=str(out))
    return subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE)


def test_a_killed_run_is_never_taken_for_a_whole_one(case_file: Path, tmp_path: Path) -> None:
    old = run(case_file, "fem", "quick", tmp_path / "renaming")
    killed = [
        _start_and_kill(case_file, tmp_path / "midway", step=5, last_moment=False),
        _start_and_kill(case_file, tmp_path / "renaming", step=99, last_moment=True),
    ]
    for process in killed:
        _, errors = process.communicate(timeout=60)
        assert process.returncode == 9, errors.decode()
    assert partial_folder(old.folder).is_dir()
    assert len(RunFolder(old.folder).history) == 11
    midway = run_path(tmp_path / "midway", "square", "quick", "fem")
    assert len((partial_folder(midway) / "history.csv").read_text().splitlines()) == 1 + 6
    with pytest.raises(RunFolderError, match="not finished"):
        RunFolder(midway)
    assert run(case_file, "fem", "quick", tmp_path / "midway").good


def test_a_run_is_interrupted_when_its_parent_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    killed = SimpleNamespace(join=lambda: None)
    monkeypatch.setattr(jobs.multiprocessing, "parent_process", lambda: killed)
    monkeypatch.setattr(jobs, "do", lambda job: time.sleep(10.0))
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a shell starts what runs in its background
    try:
        with pytest.raises(KeyboardInterrupt):
            jobs._do_for_parent(None)
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_kill_between_the_two_renames_gives_the_older_run_back(case_file: Path, tmp_path: Path) -> None:
    old = run(case_file, "fem", "quick", tmp_path)
    os.replace(old.folder, superseded(old.folder))
    assert len(RunFolder(old.folder).history) == 11


def test_the_older_run_goes_only_once_the_new_one_has_its_name(
    case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = run(case_file, "fem", "quick", tmp_path)
    rename = os.replace

    def stop_before_the_new_name(source: Path, target: Path) -> None:
        if Path(source).name.endswith(".partial"):
            raise OSError(errno.EIO, "Input/output error")
        rename(source, target)

    monkeypatch.setattr(os, "replace", stop_before_the_new_name)
    with pytest.raises(WriteError, match="could not be written"):
        run(case_file, "fem", "quick", tmp_path, force=True)
    monkeypatch.undo()
    assert len(RunFolder(old.folder).history) == 11


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EACCES])
def test_a_refusing_disk_is_one_sentence_and_the_older_run_stays(
    case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    old = run(case_file, "fem", "quick", tmp_path)

    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(RunWriter, "_write_row", refuse)
    with pytest.raises(WriteError) as caught:
        run(case_file, "fem", "quick", tmp_path, force=True)
    assert ("disk is full" if number == errno.ENOSPC else "no permission") in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(RunFolder(old.folder).history) == 11


def test_a_disk_that_fills_up_under_a_file_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "summary.json"
    write_text(path, "old")

    def full(self: Path, *_: object, **__: object) -> None:
        self.open("w").write("hal")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(WriteError, match="disk is full"):
        write_text(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])


def _without_last_line(path: Path) -> None:
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-1]))


@pytest.mark.parametrize(
    ("file", "damage", "read"),
    [
        ("run.json", Path.unlink, "info"),
        ("run.json", _cut, "info"),
        ("history.csv", Path.unlink, "history"),
        ("history.csv", _without_last_line, "history"),
        ("checkpoint.npz", _cut, "checkpoint"),
        ("crack_path.csv", Path.unlink, "crack_path"),
        ("fields/index.csv", Path.unlink, "index"),
    ],
)
def test_a_damaged_folder_is_refused_in_one_sentence(
    case_file: Path, tmp_path: Path, file: str, damage: object, read: str
) -> None:
    folder = run(case_file, "fem", "quick", tmp_path).folder
    damage(folder / file)  # type: ignore[operator]
    with pytest.raises(RunFolderError, match=Path(file).name) as caught:
        getattr(RunFolder(folder), read)
    assert "\n" not in str(caught.value)


def test_an_unknown_status_is_refused(case_file: Path, tmp_path: Path) -> None:
    folder = run(case_file, "fem", "quick", tmp_path).folder
    info = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps(info | {"status": "running"}))
    with pytest.raises(RunFolderError, match="status 'running'"):
        RunFolder(folder)


def test_pickled_arrays_are_refused(case_file: Path, tmp_path: Path) -> None:
    folder = run(case_file, "fem", "quick", tmp_path).folder
    np.savez(folder / "checkpoint.npz", u=np.array([{"an": "object"}], dtype=object))
    with pytest.raises(RunFolderError, match="checkpoint"):
        RunFolder(folder).checkpoint  # noqa: B018


def test_a_missing_run_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match="no such run"):
        RunFolder(tmp_path / "nothing")


def test_a_second_writer_is_refused_while_the_first_lives(tmp_path: Path) -> None:
    import psutil

    partial = partial_folder(tmp_path / "fem")
    partial.mkdir()
    parent = psutil.Process(os.getppid())
    (partial / "writer.json").write_text(json.dumps({"process": parent.pid, "started": parent.create_time()}))
    with pytest.raises(WriteError, match="is writing this run now"), RunWriter(tmp_path / "fem"):
        pass
    (partial / "writer.json").write_text(json.dumps({"process": parent.pid, "started": 0.0}))
    with RunWriter(tmp_path / "fem"):
        assert not (tmp_path / "fem").exists()


def _stop_at(step: int):
    """A listener that presses Ctrl-C."""

    def listener(increment) -> None:
        if increment.step == step:
            raise KeyboardInterrupt

    return listener


@pytest.fixture
def save_always(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RunWriter, "checkpoint_interval", -1.0)
    monkeypatch.setattr(RunWriter, "largest_share", float("inf"))


@pytest.mark.usefixtures("save_always")
def test_a_stopped_run_goes_on_from_its_checkpoint(case_file: Path, tmp_path: Path) -> None:
    with pytest.raises(InterruptedRunError, match="--resume"):
        run(case_file, "fem", "quick", tmp_path, _stop_at(5))
    partial = partial_folder(run_path(tmp_path, "square", "quick", "fem"))
    # as if the kill had come after more increments than the checkpoint knows
    with (partial / "history.csv").open("a") as history:
        history.write("6,0.6,0.006,1,1,1,0,1,1,1,1,1\n7,0.7")
    seen: list = []
    done = run(case_file, "fem", "quick", tmp_path, seen.append, resume=True)
    assert [increment.step for increment in seen] == [6, 7, 8, 9, 10]
    assert done.info["resumed_after_step"] == 5
    whole = run(case_file, "fem", "quick", tmp_path / "whole")
    assert whole.info["resumed_after_step"] is None
    assert done.history.equals(whole.history)
    assert done.index.equals(whole.index)


@pytest.mark.usefixtures("save_always")
def test_savings_take_no_more_than_their_share(
    case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RunWriter, "largest_share", 1e-9)
    with pytest.raises(InterruptedRunError):
        run(case_file, "fem", "quick", tmp_path, _stop_at(5))
    done = run(case_file, "fem", "quick", tmp_path, resume=True)
    assert done.info["resumed_after_step"] == 0


@pytest.mark.usefixtures("save_always")
def test_a_checkpoint_of_another_case_or_a_damaged_one_is_not_taken_up(case_file: Path, tmp_path: Path) -> None:
    def stopped_then_resumed() -> object:
        seen: list = []
        done = run(case_file, "fem", "quick", tmp_path, seen.append, resume=True, force=True)
        assert seen[0].step == 0
        return done.info["resumed_after_step"]

    for spoil in (
        lambda checkpoint: case_file.write_text(case_file.read_text().replace("210.0", "211.0")),
        lambda checkpoint: _cut(checkpoint),
        lambda checkpoint: checkpoint.unlink(),
    ):
        with pytest.raises(InterruptedRunError):
            run(case_file, "fem", "quick", tmp_path, _stop_at(5), force=True)
        spoil(partial_folder(run_path(tmp_path, "square", "quick", "fem")) / "checkpoint.npz")
        assert stopped_then_resumed() is None


@pytest.mark.usefixtures("save_always")
@pytest.mark.parametrize("solver", ["fem", "mpm"])
def test_a_resumed_solution_is_that_of_an_uninterrupted_run(
    monkeypatch: pytest.MonkeyPatch, variant, tmp_path: Path, solver: str
) -> None:
    """Broken through on the way, with increments that were undone, and points that move."""
    case = variant(
        "sen_tension", solver,
        mesh={"h": 0.02, "coarse": 0.1, "fine": {"lower": [0.4, 0.4], "upper": [1.0, 0.6]}},
        load={"path": [0.0, 0.0075, 0.007, 0.02], "increment": 1e-3, "smallest": 2.5e-4},
        materials={"steel": {"fracture": {"length_scale": 0.03}}},
    )  # fmt: skip
    whole = run(case, solver, "standard", tmp_path / "whole")
    steps = len(whole.history)
    assert whole.info["status"] == "broken_through"
    for step in (3, steps - 2):
        with pytest.raises(InterruptedRunError):
            run(case, solver, "standard", tmp_path, _stop_at(step), resume=True)
    done = run(case, solver, "standard", tmp_path, resume=True)
    assert done.info["resumed_after_step"] == steps - 2
    apart = (done.history - whole.history).drop(columns="seconds").abs().max()
    assert (apart <= 1e-9 * whole.history.abs().max().drop("seconds")).all()
    work = ("increments", "staggered_iterations", "newton", "factorisations")
    assert {name: done.info["counters"][name] for name in work} == {
        name: whole.info["counters"][name] for name in work
    }


@pytest.mark.usefixtures("save_always")
def test_a_damped_bar_that_goes_on_is_not_taken_for_one_that_blew_up(variant, tmp_path: Path) -> None:
    """What damping has taken by then is little beside the energy at the start."""
    case = variant("vibrating_bar", mesh={"h": 10.0}, dynamics={"end_time": 0.1, "damping": 1.0})
    with pytest.raises(InterruptedRunError):
        run(case, "mpm", "standard", tmp_path, _stop_at(3))
    done = run(case, "mpm", "standard", tmp_path, resume=True)
    assert (done.info["status"], done.info["resumed_after_step"]) == ("complete", 3)
    whole = run(case, "mpm", "standard", tmp_path / "whole")
    assert done.history.drop(columns="seconds").equals(whole.history.drop(columns="seconds"))


def test_points_that_leave_the_grid_end_the_run_in_a_sentence(variant, tmp_path: Path) -> None:
    unbroken = {"steel": {"fracture": {"toughness": 1e6}}}
    load, mpm = {"path": [0.0, 0.3], "increment": 0.1}, {"margin": 0, "move_points": True}
    case = variant("homogeneous_bar", mpm=mpm, load=load, materials=unbroken)
    done = run(case, "mpm", "standard", tmp_path)
    assert done.info["status"] == "no_convergence" and not (done.folder / "traceback.txt").exists()
    assert "material points have left the grid; enlarge mpm.margin" in done.info["reason"]


@pytest.mark.usefixtures("save_always")
def test_a_run_resumed_at_its_last_record_tells_the_same_measures(variant, tmp_path: Path) -> None:
    case = variant("hertz_cylinder", mesh={"h": 0.8}, dynamics={"end_time": 0.02}, output={"records": 4})

    def stop_at_the_end(instant) -> None:
        if instant.share == 1.0:
            raise KeyboardInterrupt

    with pytest.raises(InterruptedRunError):
        run(case, "mpm", "standard", tmp_path, stop_at_the_end)
    measures = run(case, "mpm", "standard", tmp_path, resume=True).info["measures"]
    assert measures["peak_pressure"] > 0.0
    assert measures == run(case, "mpm", "standard", tmp_path / "whole").info["measures"]


def test_a_run_that_blew_up_keeps_the_snapshots_before_and_no_state_of_the_wreck(variant, tmp_path: Path) -> None:
    case = variant(
        "vibrating_bar", mesh={"h": 10.0}, dynamics={"end_time": 2.0, "time_step_share": 2.5}, output={"times": [0.05]}
    )
    done = run(case, "mpm", "standard", tmp_path)
    assert done.info["status"] == "blew_up" and done.history["time"].iloc[-1] > 0.1
    assert [round(snapshot.u, 2) for snapshot in done.snapshots()] == [0.05]
    assert done.info["measures"] == {} and np.isfinite(done.history.to_numpy()).all()


def test_what_a_case_expects_is_judged_as_the_case_stands_now(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake_solver.install(monkeypatch, fake_solver.stopping_at(4))
    plain = fake_solver.write_case(tmp_path / "square")
    assert run(plain, "fem", "quick", tmp_path).info["status"] == "no_convergence"
    expecting = plain.read_text().replace('solver = "fem"', 'solver = "fem"\nexpect_failure = true')
    plain.write_text(expecting)
    state = find_run(load_case(plain, "quick"), "fem", tmp_path)
    assert (state.status, state.failed) == ("expected_failure", False)
    assert runs_sentence([state]).startswith("1 run ended as intended")


@pytest.mark.usefixtures("save_always")
def test_a_history_that_does_not_reach_the_checkpoint_is_not_gone_on_with(
    case_file: Path, tmp_path: Path
) -> None:
    with pytest.raises(InterruptedRunError):
        run(case_file, "fem", "quick", tmp_path, _stop_at(5))
    history = partial_folder(run_path(tmp_path, "square", "quick", "fem")) / "history.csv"
    _cut(history)
    done = run(case_file, "fem", "quick", tmp_path, resume=True)
    assert done.info["resumed_after_step"] is None
    assert len(done.history) == 11
