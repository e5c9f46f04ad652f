"""Runs that were stopped: gone on with to the same end, or said not to be."""

from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import fake_solver
import numpy as np
import pytest
from fake_solver import Seen

from numerics.costs import Costs
from numerics.status import RunStatus
from verify import cli
from verify.runs.checkpoint import Checkpoint, CheckpointError, CheckpointWriter
from verify.runs.listeners import StoppedError, TimeLimit
from verify.runs.run_folder import partial_folder, run_path
from verify.runs.running import InterruptedRunError, run


@pytest.fixture
def case_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    fake_solver.install(monkeypatch)
    return fake_solver.write_case(tmp_path / "square")


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])


def _stop_at(step: int) -> list[Seen]:
    """A listener that presses Ctrl-C."""
    return [Seen(lambda record: record.step >= step)]


@pytest.fixture
def save_always(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CheckpointWriter, "interval", -1.0)
    monkeypatch.setattr(CheckpointWriter, "largest_share", float("inf"))


@pytest.mark.usefixtures("save_always")
def test_a_stopped_run_goes_on_from_its_checkpoint(case_file: Path, tmp_path: Path) -> None:
    with pytest.raises(InterruptedRunError, match="--resume"):
        run(case_file, "fem", "quick", tmp_path, _stop_at(5))
    partial = partial_folder(run_path(tmp_path, "square", "quick", "fem"))
    # as if the kill had come after more increments than the checkpoint knows
    with (partial / "history.csv").open("a") as history:
        history.write("6,0.6,0.006,1,1,1,0,1,1,1,1,1\n7,0.7")
    seen = Seen()
    done = run(case_file, "fem", "quick", tmp_path, [seen], resume=True)
    assert seen.note == "goes on after step 5"
    assert [increment.step for increment in seen.records] == [6, 7, 8, 9, 10]
    assert done.info["resumed_after_step"] == 5
    whole = run(case_file, "fem", "quick", tmp_path / "whole")
    assert whole.info["resumed_after_step"] is None
    assert done.history.equals(whole.history)
    assert done.index.equals(whole.index)


@pytest.mark.usefixtures("save_always")
def test_savings_take_no_more_than_their_share(
    case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(CheckpointWriter, "largest_share", 1e-9)
    with pytest.raises(InterruptedRunError):
        run(case_file, "fem", "quick", tmp_path, _stop_at(5))
    done = run(case_file, "fem", "quick", tmp_path, resume=True)
    assert done.info["resumed_after_step"] == 0


@pytest.mark.usefixtures("save_always")
@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda partial, case: case.write_text(case.read_text().replace("210.0", "211.0")), "another version"),
        (lambda partial, case: _cut(partial / "checkpoint.npz"), "unreadable"),
        (lambda partial, case: _cut(partial / "history.csv"), "its history.csv does not reach"),
        (lambda partial, case: (partial / "fields" / "index.csv").write_text("a\n1"), "damaged fields/index.csv"),
    ],
)
def test_a_checkpoint_that_cannot_be_gone_on_with_is_told_and_kept(
    case_file: Path, tmp_path: Path, spoil: object, why: str
) -> None:
    folder = run_path(tmp_path, "square", "quick", "fem")
    with pytest.raises(InterruptedRunError):
        run(case_file, "fem", "quick", tmp_path, _stop_at(5))
    spoil(partial_folder(folder), case_file)  # type: ignore[operator]
    saved, seen = (partial_folder(folder) / "checkpoint.npz").read_bytes(), Seen(lambda record: record.step == 0)
    with pytest.raises(InterruptedRunError):
        run(case_file, "fem", "quick", tmp_path, [seen], resume=True)
    kept = folder.with_name("fem.stopped")
    assert seen.records[0].step == 0 and why in seen.note and seen.note.endswith(f"is kept in {kept}")
    assert (kept / "checkpoint.npz").read_bytes() == saved
    done = run(case_file, "fem", "quick", tmp_path)
    assert done.info["resumed_after_step"] is None and len(done.history) == 11
    assert [path.name for path in folder.parent.iterdir()] == ["fem"], "nothing is left to go on with"


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


@pytest.mark.usefixtures("save_always")
def test_a_run_resumed_at_its_last_record_tells_the_same_measures(variant, tmp_path: Path) -> None:
    case = variant("hertz_cylinder", mesh={"h": 0.8}, dynamics={"end_time": 0.02}, output={"records": 4})

    with pytest.raises(InterruptedRunError):
        run(case, "mpm", "standard", tmp_path, [Seen(lambda instant: instant.share == 1.0)])
    measures = run(case, "mpm", "standard", tmp_path, resume=True).info["measures"]
    assert measures["peak_pressure"] > 0.0
    assert measures == run(case, "mpm", "standard", tmp_path / "whole").info["measures"]


@pytest.mark.usefixtures("save_always")
@pytest.mark.parametrize("solver", ["fem", "mpm"])
def test_a_resumed_explicit_run_is_the_uninterrupted_one_to_the_bit(variant, tmp_path: Path, solver: str) -> None:
    """Its records are many steps apart, so that the number of a step is not that of a row."""
    case = variant(
        "vibrating_bar", solver, mesh={"h": 10.0}, dynamics={"end_time": 0.3},
        output={"records": 6, "times": [0.05, 0.25]},
    )  # fmt: skip
    whole = run(case, solver, "standard", tmp_path / "whole", threads=1)
    stop = int(whole.history["step"].iloc[3])
    assert stop > 4 + len(whole.history)
    with pytest.raises(InterruptedRunError):
        run(case, solver, "standard", tmp_path, _stop_at(stop), threads=1)
    done = run(case, solver, "standard", tmp_path, resume=True, threads=1)
    assert done.info["resumed_after_step"] == stop
    assert done.history.drop(columns="seconds").equals(whole.history.drop(columns="seconds"))
    files = ("fields/index.csv", *done.index["points_file"], *done.index["grid_file"])
    assert {file: done.info["checksums"][file] for file in files} == {
        file: whole.info["checksums"][file] for file in files
    }


def test_a_run_out_of_time_keeps_its_state_and_goes_on(case_file: Path, tmp_path: Path) -> None:
    late = run(case_file, "fem", "quick", tmp_path, [TimeLimit(0.0)])
    assert late.info["status"] == RunStatus.TIMED_OUT and late.info["reason"].startswith("more than 0 s, at u = 0")
    assert late.history["step"].tolist() == [0] and late.checkpoint.record.step == 0
    assert len(late.index) == 1
    seen = Seen()
    done = run(case_file, "fem", "quick", tmp_path, [seen], resume=True)
    assert seen.records[0].step == 1 and done.info["status"] == RunStatus.COMPLETE
    whole = run(case_file, "fem", "quick", tmp_path / "whole")
    assert done.history.equals(whole.history)


def test_time_ends_in_the_middle_of_an_increment(tmp_path: Path) -> None:
    case_file = Path(__file__).parent / "attack" / "tiny" / "slit.toml"

    class Late(TimeLimit):
        def record(self, record, discretisation) -> None:
            super().record(record, discretisation)
            discretisation.costs.until = 0.0 if record.step == 1 else discretisation.costs.until

    late = run(case_file, "fem", "quick", tmp_path, [Late(1e3)])
    assert late.info["status"] == RunStatus.TIMED_OUT
    assert late.info["reason"].startswith("out of time in the increment after u = ")
    assert late.history["step"].tolist() == [0, 1] and late.checkpoint.record.step == 1
    done = run(case_file, "fem", "quick", tmp_path, resume=True).history.drop(columns="seconds")
    assert done.equals(run(case_file, "fem", "quick", tmp_path / "whole").history.drop(columns="seconds"))


def test_a_run_that_is_at_its_end_is_not_out_of_time() -> None:
    limit, solver = TimeLimit(-1.0), SimpleNamespace(costs=Costs())
    limit.record(SimpleNamespace(share=1.0, is_last=False, u=1.0), solver)
    limit.record(SimpleNamespace(share=0.5, is_last=True, u=0.5), solver)
    with pytest.raises(StoppedError, match=r"at u = 0\.5"):
        limit.record(SimpleNamespace(share=0.5, is_last=False, u=0.5), solver)


def test_the_time_of_a_run_can_be_limited_from_the_command_line(
    case_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def verify(*options: str) -> tuple[object, str]:
        asked = ["run", str(case_file), "--run", "fem", "--tier", "quick", "--out", str(tmp_path / "out"), *options]
        with pytest.raises(SystemExit) as ended:
            cli.main(asked)
        return ended.value.code, capsys.readouterr().out

    code, said = verify("--timeout", "0")
    assert code == 2 and "out of time" in said and "go on behind its last checkpoint with `verify run --resume`" in said
    code, said = verify("--resume", "--timeout", "60")
    assert code == 0 and "goes on after step 0" in said and "resumed after step 0" in said


def _damaged(whole: bytes, random: np.random.Generator) -> bytes:
    """Cut, with foreign bytes in it, without some, or nothing of it."""
    data, place = bytearray(whole), int(random.integers(len(whole)))
    length = int(random.integers(1, 64))
    kind = random.integers(5)
    if kind == 0:
        return bytes(data[:place])
    if kind == 1:
        data[place : place + length] = random.bytes(length)
    if kind == 2:
        data[place] ^= 1 << int(random.integers(8))
    if kind == 3:
        del data[place : place + length]
    return random.bytes(length * 40) if kind == 4 else bytes(data)


def test_a_damaged_checkpoint_is_refused_or_whole(case_file: Path, tmp_path: Path) -> None:
    path = run(case_file, "fem", "quick", tmp_path).folder / "checkpoint.npz"
    np.savez_compressed(tmp_path / "squeezed.npz", **dict(np.load(path)))
    random, whole = np.random.default_rng(5), Checkpoint.read(path)
    for data in (path.read_bytes(), (tmp_path / "squeezed.npz").read_bytes()):
        for _ in range(400):
            path.write_bytes(_damaged(data, random))
            with suppress(CheckpointError):
                assert Checkpoint.read(path).record == whole.record
