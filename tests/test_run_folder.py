"""Run folders: complete or refused."""

import errno
import gc
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import fake_solver
import numpy as np
import psutil
import pytest
from fake_solver import Seen

from cases import CaseError, case_from_tables, load_case
from cases.loader import read_tables
from reports.words import runs_sentence
from verify import cli
from verify.judging.judge import find_run
from verify.metrics.metric import NotGivenError
from verify.runs import jobs, running
from verify.runs.atomic import WriteError, superseded, write_text
from verify.runs.provenance import ROOT, SOLVING_MODULES
from verify.runs.run_folder import RunFolder, RunFolderError, partial_folder, run_path
from verify.runs.run_writer import RunWriter
from verify.runs.running import InterruptedRunError, run
from verify.runs.vtk_files import grid_mesh, points_mesh, write_mesh


@pytest.fixture
def case_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    fake_solver.install(monkeypatch)
    return fake_solver.write_case(tmp_path / "square")


def test_what_was_changed_in_memory_is_not_lost_on_the_way_to_a_run(case_file: Path, tmp_path: Path) -> None:
    finer = {"mesh": {"h": 0.1}}
    with pytest.raises(CaseError, match=r"'change' is that of a run; name the run too"):
        load_case(case_file, "quick", change=finer)
    assert run(load_case(case_file, "quick", "fem", finer), "fem", out=tmp_path).case.mesh.h == 0.1
    shorter = {"load": {"path": np.array([0.0, 0.005])}, "mpm": {"points_per_cell": np.int64(3)}}
    done = run(load_case(case_file, "quick", "fem", shorter), "fem", out=tmp_path)
    assert done.info["change"] == {"load": {"path": [0.0, 0.005]}, "mpm": {"points_per_cell": 3}}
    case, tables = load_case(case_file, "quick"), read_tables(case_file)
    changed = [
        case.model_copy(update={"mesh": case.mesh.model_copy(update={"h": 0.1})}),
        case_from_tables({**tables, "load": {**tables["load"], "increment": 0.002}}, "quick", source=case_file),
        load_case(case_file, "quick", "mpm", finer),
    ]
    for other in changed:
        with pytest.raises(CaseError, match=r"is not what this case says.*give load_case the run and its change"):
            run(other, "fem", out=tmp_path)
    assert run(case, "fem", "standard", tmp_path).case.tier == "standard"
    with pytest.raises(CaseError, match="is no file, and what runs is a case file"):
        run(case_from_tables(tables, "quick", source=tmp_path / "none.toml"), "fem", out=tmp_path)


def test_a_finished_run_is_read_back_as_it_was(case_file: Path, tmp_path: Path) -> None:
    listener = Seen()
    done = run(case_file, "mpm", "quick", tmp_path, [listener])
    seen = listener.records
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


def test_a_run_is_read_from_another_working_directory(
    case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run(case_file, "fem", "quick", "out")
    monkeypatch.chdir("/")
    assert len(done.history) > 1 and done.grid().n_points > 0 and done.checkpoint.record.step > 0


def test_fields_are_written_where_asked_and_at_the_end(case_file: Path, tmp_path: Path) -> None:
    done = run(case_file, "fem", "quick", tmp_path)
    snapshots = list(done.snapshots())
    assert [round(snapshot.u, 6) for snapshot in snapshots] == [0.004, 0.006, 0.01]
    assert done.grid(0.0061)["phase_field"] == pytest.approx(0.4)
    for far in (0.0081, 1.0, -5.0, np.nan):
        for read in (done.grid, done.points, done.fields):
            with pytest.raises(NotGivenError, match=r"no fields at .* one of 0\.004, 0\.006, 0\.01, or add it to output"):
                read(far)
    assert done.nearest(1.0) == pytest.approx(0.01)
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
    seen = Seen()
    for force, expected in ((False, 11), (False, 11), (True, 22)):
        run(case_file, "fem", "quick", tmp_path, [seen], force=force)
        assert len(seen.records) == expected
    case_file.write_text(case_file.read_text().replace("young = 210.0", "young = 211.0"))
    run(case_file, "fem", "quick", tmp_path, [seen])
    assert len(seen.records) == 33


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
from verify.runs import run_writer, running
running.DISCRETISATIONS["fem"] = fake_solver.FakeSolver
def increments(solver, case):
    for increment in fake_solver.fake_increments(solver, case):
        yield increment
        if increment.step == {step}:
            os._exit(9)
running.solver_records = increments
if {last_moment}:
    run_writer.replace_folder = lambda new, folder: os._exit(9)
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
        _, errors = process.communicate(timeout=300)
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
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a shell starts what runs in its background
    try:
        with pytest.raises(KeyboardInterrupt):
            jobs._watch_parent()
            time.sleep(10.0)
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


def _reversed(path: Path) -> None:
    head, *rows = path.read_text().splitlines(keepends=True)
    path.write_text("".join([head, *reversed(rows)]))


def _with_text(path: Path) -> None:
    path.write_text(path.read_text().replace("0.", "none", 1))


def _of_the_other_run(path: Path) -> None:
    path.write_bytes(Path(str(path).replace("/fem/", "/mpm/")).read_bytes())


POINTS, GRID = "fields/points_0000.vtu", "fields/grid_0000.vtu"


@pytest.fixture(scope="module")
def two_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of results with two whole runs that differ in all their files."""
    out = tmp_path_factory.mktemp("two")
    with pytest.MonkeyPatch.context() as monkeypatch:
        path = np.array([[0.0, 0.5], [0.3, 0.6]])
        fake_solver.install(monkeypatch, mpm_factor=2.0)
        monkeypatch.setattr("verify.metrics.crack_path.crack_path", lambda *_: path)
        case_file = fake_solver.write_case(out / "square")
        run(case_file, "fem", "quick", out)
        monkeypatch.setattr(fake_solver.FakeSolver, "fields", _other_fields(fake_solver.FakeSolver.fields))
        run(case_file, "mpm", "quick", out)
    return out


def _other_fields(fields: Callable) -> Callable:
    return lambda solver: replace(fields(solver), phase_field=np.full(4, 0.25), grid_phase_field=np.full(4, 0.25))


@pytest.mark.parametrize(
    ("file", "damage", "read"),
    [
        ("run.json", Path.unlink, "info"),
        ("run.json", _cut, "info"),
        *[("history.csv", damage, "history") for damage in (Path.unlink, _without_last_line, _reversed, _with_text)],
        ("history.csv", _of_the_other_run, "history"),
        ("checkpoint.npz", _cut, "checkpoint"),
        *[("crack_path.csv", damage, "crack_path") for damage in (Path.unlink, _reversed, _with_text)],
        *[("fields/index.csv", damage, "index") for damage in (Path.unlink, _without_last_line, _with_text)],
        *[(POINTS, damage, "points") for damage in (Path.unlink, _cut, _of_the_other_run)],
        *[(GRID, damage, "grid") for damage in (Path.unlink, _cut, _of_the_other_run)],
    ],
)
def test_a_damaged_folder_is_refused_in_one_sentence(
    two_runs: Path, tmp_path: Path, file: str, damage: Callable[[Path], object], read: str
) -> None:
    shutil.copytree(two_runs, tmp_path / "out")
    folder = run_path(tmp_path / "out", "square", "quick", "fem")
    damage(folder / file)
    with pytest.raises(RunFolderError, match=Path(file).name) as caught:
        found = getattr(RunFolder(folder), read)
        found(0.004) if callable(found) else None
    assert "\n" not in str(caught.value) and "verify run --force" in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("case", None), ("solver", 3), ("status", ["complete"]), ("reason", {}), ("increments", "11"), ("measures", []),
        ("counters", {"cells": "many"}), ("seconds", {"total": "long"}), ("change", "none"), ("checksums", None),
        ("checksums", {"history.csv": 1}), ("memory_mb", "little"), ("resumed_after_step", 0.5), ("case_source", 1),
    ],
)  # fmt: skip
def test_a_mistyped_entry_of_run_json_is_damage(case_file: Path, tmp_path: Path, key: str, value: object) -> None:
    folder = run(case_file, "fem", "quick", tmp_path).folder
    info = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps(info | {key: value}))
    with pytest.raises(RunFolderError, match=rf"run.json: is damaged at '{key}") as caught:
        RunFolder(folder)
    assert "\n" not in str(caught.value)
    assert find_run(load_case(case_file, "quick"), "fem", tmp_path).status == "damaged"


def test_nested_beyond_measure_is_damage(case_file: Path, tmp_path: Path) -> None:
    folder = run(case_file, "fem", "quick", tmp_path).folder
    (folder / "run.json").write_text("[" * 100_000)
    with pytest.raises(RunFolderError, match="not valid JSON"):
        RunFolder(folder)


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of a file's size")
@pytest.mark.parametrize("size", [150, 300, 2000, 3000])
def test_no_room_for_a_file_is_one_sentence_whichever_it_is(
    case_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], size: int
) -> None:
    """History, index, VTU, checkpoint: a limit stands for the disk that is full."""
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        code = cli._exit_code(["run", str(case_file), "--run", "fem", "--tier", "quick", "--out", str(tmp_path / "out")])
        gc.collect()  # what is left half written tells of it here
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, ignored)
    told = capsys.readouterr()
    assert code == 2, told
    assert "could not be written (File too large); check it or give another place" in told.out
    assert "Traceback" not in told.out and not told.err


def test_fields_are_written_as_pyvista_would(case_file: Path, tmp_path: Path) -> None:
    fields = fake_solver.FakeSolver(load_case(case_file, "quick")).fields()
    for number, mesh in enumerate((points_mesh(fields), grid_mesh(fields))):
        mesh.save(tmp_path / f"{number}.vtu")
        write_mesh(mesh, tmp_path / "ours.vtu")
        assert (tmp_path / "ours.vtu").read_bytes() == (tmp_path / f"{number}.vtu").read_bytes()


def test_fields_tell_where_they_are_their_units_and_their_components(case_file: Path, tmp_path: Path) -> None:
    done = run(case_file, "fem", "quick", tmp_path)
    points, grid = done.points(), done.grid()
    assert list(points.field_data["u"]) == list(grid.field_data["u"]) == [0.01]
    assert {"points mm", "displacement mm", "stress kN/mm^2", "volume mm^3"} <= set(points.field_data["units"])
    assert list(grid.field_data["units"]) == ["points mm", "displacement mm"]
    stress = points.GetPointData().GetArray("stress")
    assert [stress.GetComponentName(number) for number in range(3)] == ["xx", "yy", "xy"]


def test_what_can_change_the_numbers_of_a_run_is_known() -> None:
    """Whatever takes part in `running`, but for what only reads, refuses, waits or tells."""
    only_tell = {"atomic", "imported_error", "lock", "memory", "provenance", "run_folder", "sketch"}
    source = "".join((ROOT / module).read_text() for module in SOLVING_MODULES)
    used = set(re.findall(r"from verify\.runs\.(\w+) import", source)) - only_tell
    health = "".join(module.read_text() for module in (ROOT / "verify/health").glob("*.py"))
    judging = {"crack_path", *re.findall(r"from verify\.metrics\.(\w+) import", health)}
    assert {f"verify/runs/{name}.py" for name in {*used, "running"}} | {
        f"verify/metrics/{name}.py" for name in judging
    } == {*SOLVING_MODULES}


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


LOCKED = """
import sys
from pathlib import Path
from verify.runs.run_writer import RunWriter
with RunWriter(Path(sys.argv[1])):
    print("locked", flush=True)
    sys.stdin.read()
"""


def test_a_second_writer_is_refused_while_the_first_lives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the processes know of each other: in another container the other's number is unknown or a stranger's."""
    first = subprocess.Popen(
        [sys.executable, "-c", LOCKED, str(tmp_path / "fem")], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert first.stdout is not None and first.stdout.readline() == b"locked\n"

    def unknown(process: int | None = None) -> None:
        raise psutil.NoSuchProcess(process or 0)

    monkeypatch.setattr(psutil, "Process", unknown)
    refused = rf"fem: process {first.pid} on .* is writing this run now"
    with pytest.raises(WriteError, match=refused), RunWriter(tmp_path / "fem"):
        pass
    first.kill()
    first.communicate()
    with RunWriter(tmp_path / "fem"):
        assert not (tmp_path / "fem").exists()
    assert not list(tmp_path.iterdir())


def test_points_that_leave_the_grid_end_the_run_in_a_sentence(variant, tmp_path: Path) -> None:
    unbroken = {"steel": {"fracture": {"toughness": 1e6}}}
    load, mpm = {"path": [0.0, 0.3], "increment": 0.1}, {"margin": 0, "move_points": True, "constraints_on": "edges"}
    case = variant("homogeneous_bar", mpm=mpm, load=load, materials=unbroken)
    done = run(case, "mpm", "standard", tmp_path)
    assert done.info["status"] == "no_convergence" and not (done.folder / "traceback.txt").exists()
    assert "material points have left the grid; enlarge mpm.margin" in done.info["reason"]


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


def test_a_history_tells_its_units(case_file: Path, tmp_path: Path) -> None:
    done = run(case_file, "fem", "quick", tmp_path)
    units = {"u": "mm", "F": "kN", "time": "1", **dict.fromkeys(("E_el", "E_frac", "E_kin", "W_ext"), "kN·mm")}
    assert done.history.attrs["units"] == done.info["units"] == units
    assert "kN" in done._repr_html_() and "fem" in repr(done)
    moving = load_case("vibrating_bar", "quick").history_units
    assert (moving["u"], moving["F"], moving["time"]) == ("ms", "N·mm/ms", "ms")
