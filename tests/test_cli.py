"""The command line: exit codes, one sentence for a mistake, nothing computed twice."""

import io
import json
import tempfile
from pathlib import Path

import fake_solver
import pandas as pd
import pytest
from rich.console import Console

from cases import list_cases
from verify import cli
from verify.cli.shared import new_table
from verify.runs import running
from verify.runs.provenance import library_versions
from verify.runs.run_folder import run_path


@pytest.fixture(autouse=True)
def stand_ins(monkeypatch: pytest.MonkeyPatch) -> None:
    fake_solver.install(monkeypatch, mpm_factor=1.02)


def verify(*arguments: object) -> int:
    """Exit code of the command line."""
    with pytest.raises(SystemExit) as ended:
        cli.main([str(argument) for argument in arguments])
    assert isinstance(ended.value.code, int)
    return ended.value.code


@pytest.fixture
def options(tmp_path: Path) -> tuple[str, ...]:
    return ("--tier", "quick", "--out", str(tmp_path / "out"))


@pytest.mark.parametrize(
    ("check", "code"),
    [
        (fake_solver.check("fem", 0.03), 0),
        (fake_solver.check("fem", 0.01), 1),
        (fake_solver.check("baseline"), 1),
        (fake_solver.check("fem", 0.01, gate=False), 4),
        ("", 4),
    ],
)
def test_compare_exits_by_the_verdict(
    tmp_path: Path, options: tuple[str, ...], check: str, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    case = fake_solver.write_case(tmp_path / "square", check)
    assert verify("run", case, *options) == 0
    assert verify("compare", case, *options) == code
    verdict = json.loads((tmp_path / "out" / "summary.json").read_text())["cases"][0]["verdict"]
    assert verdict in capsys.readouterr().out


def test_several_cases_are_run_judged_and_reported_together(
    tmp_path: Path, options: tuple[str, ...], few_sections: None
) -> None:
    cases = [fake_solver.write_case(tmp_path / name, fake_solver.check("fem", 0.03)) for name in ("one", "other")]
    for command in (("validate",), ("plan", *options)):
        assert verify(command[0], *cases, *command[1:]) == 0
    assert verify("run", *cases, *options) == 0
    assert verify("compare", *cases, *options) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert [entry["case"] for entry in summary["cases"]] == ["one", "other"]
    assert verify("compare", *cases, *options, "--jobs", "2") == 0
    side_by_side = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert side_by_side["cases"] == summary["cases"]
    assert verify("report", "--out", tmp_path / "out") == 0
    index = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert all(f'href="pages/{name}-quick.html"' in index for name in ("one", "other"))


@pytest.mark.parametrize("command", ["validate", "plan", "run", "compare"])
def test_two_case_files_of_one_name_are_refused(
    tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    cases = [fake_solver.write_case(tmp_path / name / "square", "") for name in ("one", "other")]
    assert verify(command, *cases) == 3
    said = capsys.readouterr().err
    assert "rename one of the two" in said and str(cases[0]) in said and str(cases[1]) in said


def test_a_run_that_does_not_converge_exits_2_and_says_what_was_saved(
    tmp_path: Path,
    options: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    fake_solver.install(monkeypatch, fake_solver.stopping_at(4))
    case = fake_solver.write_case(tmp_path / "square", fake_solver.check("fem"))
    assert verify("run", case, *options) == 2
    said = capsys.readouterr().out
    assert "the smallest increment failed; what came before is saved there" in said
    assert verify("compare", case, *options) == 2
    assert verify("run", case, *options) == 2, "up to date, and still not converged"


def test_a_mistake_in_a_solver_is_a_failed_run_without_traceback(
    tmp_path: Path,
    options: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    fake_solver.install(monkeypatch, fake_solver.stopping_at(0, ZeroDivisionError("division by zero")))
    assert verify("run", fake_solver.write_case(tmp_path / "square"), *options) == 2
    captured = capsys.readouterr()
    assert "ZeroDivisionError: division by zero" in captured.out
    assert "Traceback" not in captured.out + captured.err


def test_what_is_up_to_date_is_not_computed_again_unless_forced(
    tmp_path: Path, options: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    case = fake_solver.write_case(tmp_path / "square")
    assert verify("run", case, "--run", "fem", *options) == 0
    assert "up to date" not in capsys.readouterr().out
    assert verify("run", case, "--run", "fem", *options) == 0
    assert "up to date" in capsys.readouterr().out
    assert verify("run", case, "--run", "fem", "--force", *options) == 0
    assert "up to date" not in capsys.readouterr().out


def test_what_another_version_of_a_library_computed_is_not_up_to_date(
    tmp_path: Path, options: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    case = fake_solver.write_case(tmp_path / "square")
    assert verify("run", case, "--run", "fem", *options) == 0
    before = library_versions()
    monkeypatch.setattr("verify.runs.running.library_versions", lambda: before | {"numpy": "0.0"})
    assert verify("run", case, "--run", "fem", *options) == 0
    assert "up to date" not in capsys.readouterr().out


def test_a_full_disk_is_one_sentence_and_exit_code_2(
    tmp_path: Path,
    options: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("verify.runs.vtk_files.write_mesh", full)
    case = fake_solver.write_case(tmp_path / "square")
    assert verify("run", case, "--run", "fem", *options) == 2
    assert "the disk is full" in capsys.readouterr().out
    assert not run_path(tmp_path / "out", "square", "quick", "fem").exists()


def test_an_interrupted_run_says_where_it_stopped(
    tmp_path: Path,
    options: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    fake_solver.install(monkeypatch, fake_solver.stopping_at(4, KeyboardInterrupt()))
    assert verify("run", fake_solver.write_case(tmp_path / "square"), *options) == 2
    assert "fem.partial" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "sen_tensoin"], "did you mean 'sen_tension'"),
        (["run", "{case}", "--tier", "quik"], "'quik' is not a tier"),
        (["run", "{case}", "--run", "mmp"], "did you mean 'mpm'"),
        (["plan", "nowhere/case.toml"], "no such case file"),
        (["compare", "{case}", "--out", "{out}"], "nothing has been run"),
        (["report", "--out", "{out}"], "verify compare"),
        (["accept", "{case}"], "--reason"),
        (["accept", "{case}", "--reason", " ", "--out", "{out}"], "reason"),
        (["run", "{case}", "--threads", "none"], "--threads"),
        (["run", "{case}", "--out", ""], "is empty; give a folder"),
        (["run", "{case}", "--out", "{case}"], "is a file; give a folder"),
        (["run", "--run", "nobody", "--tier", "quick"], "no case has a run called nobody"),
        (["frobnicate"], "No such command"),
        (["chart", "{case}"], "add a table [charts.NAME]"),
        (["stability", "{case}"], "add a table [maps.NAME]"),
        (["calibrate", "--out", "{out}"], "holds no finished runs of two cases"),
    ],
)
def test_a_mistake_is_one_sentence_on_stderr_and_exit_code_3(
    tmp_path: Path, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    case = fake_solver.write_case(tmp_path / "square")
    filled = [argument.format(case=case, out=tmp_path / "out") for argument in arguments]
    assert verify(*filled) == 3
    captured = capsys.readouterr()
    assert words in captured.err
    assert len(captured.err.strip().splitlines()) == 1
    assert captured.out == ""


@pytest.mark.parametrize("file", [None, "out/figures"])
def test_a_disk_that_takes_no_more_is_one_sentence(
    file: str | None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def write() -> None:
        raise OSError(28, "No space left on device", file)

    monkeypatch.setattr(cli.before, "list_cases", write)
    assert cli._exit_code(["list"]) == cli.RUN_FAILED
    said = f"{file or 'The disk'}: no space left on device; make room, or name another folder.\n"
    assert capsys.readouterr().err == said


def test_ctrl_c_is_one_sentence_wherever_it_comes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli.before, "list_cases", interrupt)
    assert cli._exit_code(["list"]) == cli.INTERRUPTED
    assert capsys.readouterr().err == f"{cli.STOPPED}\n"


def test_a_damaged_run_is_missing_in_the_verdict_not_a_crash(
    tmp_path: Path, options: tuple[str, ...]
) -> None:
    case = fake_solver.write_case(tmp_path / "square", fake_solver.check("fem"))
    assert verify("run", case, *options) == 0
    (run_path(tmp_path / "out", "square", "quick", "fem") / "run.json").write_text("{")
    assert verify("compare", case, *options) == 1


def test_compare_never_runs_a_solver(
    tmp_path: Path, options: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    case = fake_solver.write_case(tmp_path / "square", fake_solver.check("fem", 0.03))
    assert verify("run", case, *options) == 0
    fake_solver.install(monkeypatch, fake_solver.stopping_at(0, AssertionError("a solver ran")))
    assert verify("compare", case, *options) == 0


def test_accept_then_compare_is_within(
    tmp_path: Path, options: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is not there to be accepted is told."""
    monkeypatch.setattr(running, "code_version", lambda: "0.1.0+abc1234")
    case = fake_solver.write_case(tmp_path / "square", fake_solver.check("baseline"))
    assert verify("run", case, "--run", "mpm", *options) == 0
    assert verify("accept", case, "--reason", "first values", *options) == 0
    assert "Not run, and so left as they are recorded: fem" in capsys.readouterr().out
    assert verify("run", case, *options) == 0
    assert verify("accept", case, "--reason", "first values", *options) == 0
    assert "Not run" not in capsys.readouterr().out
    assert verify("compare", case, *options) == 0


@pytest.mark.parametrize(
    "command",
    [
        "list", "validate", "plan", "surface", "run", "compare", "report", "coverage", "accept", "schema", "chart",
        "stability", "price", "calibrate",
    ],
)
def test_every_command_shows_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert verify(command, "--help") == 0
    assert f"verify {command}" in capsys.readouterr().out.split("Example")[1]


def test_schema_is_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert verify("schema") == 0
    assert "properties" in json.loads(capsys.readouterr().out)


def test_validate_reads_all_tiers_and_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = fake_solver.write_case(tmp_path / "square", fake_solver.check("fem"))
    assert verify("validate", case) == 0
    assert "valid" in capsys.readouterr().out
    case.write_text(case.read_text().replace("h = 0.2\n", "h = 0.4\n"))
    assert verify("validate", case) == 3


def test_validate_tries_each_solver_once_however_long_that_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    case, tried = fake_solver.write_case(tmp_path / "square"), []
    monkeypatch.setattr("verify.runs.refusals.MOST_SECONDS", 0.0)
    monkeypatch.setattr("verify.runs.refusals._refusal", lambda case: tried.append(case.run) or "")
    case.write_text(case.read_text() + '[runs.fine]\nsolver = "fem"\nchange.mesh.h = 0.1\n')
    assert verify("validate", case) == 0
    assert tried == ["fem", "mpm"] and "some of its runs were not set up" in capsys.readouterr().out


def test_validate_reads_the_tiers_of_a_case_without_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = fake_solver.write_case(tmp_path / "square")
    text = case.read_text()
    for run in ("fem", "mpm"):
        text = text.replace(f'[runs.{run}]\nsolver = "{run}"\n', "")
    case.write_text(text)
    assert verify("validate", case) == 0
    assert verify("run", case) == 3 and "add a table [runs.NAME]" in capsys.readouterr().err
    case.write_text(text + "[tiers.paper.mesh]\nh = -1.0\n")
    assert verify("validate", case) == 3 and "tiers.paper.mesh.h" in capsys.readouterr().err


@pytest.mark.parametrize("folder", ["[h=10]", "[/bold]"])
def test_brackets_are_printed_as_they_are(tmp_path: Path, folder: str, capsys: pytest.CaptureFixture[str]) -> None:
    case = fake_solver.write_case(tmp_path / folder)
    case.write_text(case.read_text() + '[runs.swept]\nsolver = "fem"\nsweep = { "mesh.h" = [0.25, 0.125] }\n')
    assert verify("validate", case) == 0
    assert f"{Path(folder).name}: valid" in capsys.readouterr().out
    assert verify("plan", case, "--run", "swept") == 0
    assert "swept[h=0.125]" in capsys.readouterr().out


def test_a_mistake_of_the_program_is_no_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def mistaken(*_: object) -> None:
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr("verify.planning.plan.plan", mistaken)
    case = fake_solver.write_case(tmp_path / "square")
    assert verify("plan", case) == 5
    said = capsys.readouterr().err
    assert said.startswith("Internal error: ZeroDivisionError") and len(said.strip().splitlines()) == 1
    file = Path(said.split("with ")[1].split()[0])
    assert "Traceback" in file.read_text(encoding="utf-8")
    file.unlink()
    assert verify("--debug", "plan", case) == 5
    assert "Traceback" in capsys.readouterr().err

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tempfile, "NamedTemporaryFile", full)
    assert verify("plan", case) == 5
    said = capsys.readouterr().err
    assert "Traceback" in said and said.strip().splitlines()[-1].startswith("Internal error: ZeroDivisionError")


def test_plan_prints_sizes_before_anything_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = fake_solver.write_case(tmp_path / "square")
    assert verify("plan", case, "--tier", "quick", "--run", "fem") == 0
    said = capsys.readouterr().out
    assert "25" in said and "54 of u, 36 of c" in said and "11 or more" in said


def test_surface_energy_is_drawn_before_anything_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert verify("surface", "square_plate_anisotropic", "--out", str(tmp_path)) == 0
    assert "1.1575" in capsys.readouterr().out
    folder = tmp_path / "surface" / "square_plate_anisotropic"
    for name in ("surface-energy", "surface-stiffness", "surface-profiles"):
        assert (folder / f"{name}.svg").is_file()
    table = pd.read_csv(folder / "extremes.csv")
    assert list(table["least"]) == pytest.approx([0.7071, 0.7071], abs=1e-4)
    assert verify("surface", "cantilever", "--out", str(tmp_path)) == 3
    assert "no material has a table 'fracture'" in capsys.readouterr().err


def test_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert verify("--version") == 0
    assert capsys.readouterr().out[0].isdigit()


def test_tables_cut_off_no_name_in_files_and_narrow_terminals(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    assert verify("list") == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(" plate_impact_anisotropic " in line for line in lines)
    assert len([line for line in lines if "│" in line]) == len(list_cases())
    table = new_table("case", "verdict")
    table.add_row("plate_impact_anisotropic_of_a_long_name", "PASS")
    Console(width=20).print(table)
    assert "…" not in capsys.readouterr().out


def test_letters_that_a_pipe_cannot_take_are_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    taken = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(taken, encoding="ascii", write_through=True))
    assert verify("list", "--help") == 0 and verify("schema") == 0
    assert b"verify list --solvers" in taken.getvalue() and b"?" in taken.getvalue()


def test_a_command_that_is_told_can_be_pasted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = fake_solver.write_case(tmp_path / "my square", "")
    assert verify("compare", case, "--out", tmp_path / "no such") == 3
    assert f"`verify run '{case}' --tier standard --out '{tmp_path / 'no such'}'`" in capsys.readouterr().err


def test_a_file_that_cannot_be_written_is_told_by_its_place(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert verify("coverage", "l_panel", "--to", tmp_path) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"{tmp_path}: could not be written") and "--out" not in told
