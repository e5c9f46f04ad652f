"""Measured motions that are not there: told at every place where a case needs one, no failure and no pass."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import physics.rocking.records as records
from cases import CaseError, load_case
from cases.errors import MissingRecordError
from numerics.status import RunStatus
from physics.rocking.of_case import ground_motion
from physics.rocking.records import missing_record
from reports import rocking
from verify import compare
from verify.cli import main
from verify.judging.summary import exit_code, summarise
from verify.judging.views import junit_xml, markdown

CASE = """
title = "Block under a record"
requirement = "It stands."
units = { length = "m", force = "MN", time = "s" }
plane = { assumption = "strain" }
materials.stone = { young = 5200.0, poisson = 0.3, density = 6e-4 }
bodies.block = { material = "stone", shape = { rectangle = { lower = [-0.4, 0.0], upper = [0.4, 3.0] } } }
bodies.ground = { material = "stone", shape = { rectangle = { lower = [-2.0, -0.5], upper = [2.0, 0.0] } } }
dynamics = { end_time = 1.0, gravity = [0.0, -9.81], ground = <ground> }
rocking = { body = "block", on = "ground" }
mesh = { h = 0.1 }
runs.pendulum = { solver = "pendulum" }
runs.linear = { solver = "pendulum_linear" }
checks = [
    { metric = "verdict", run = "pendulum", against = "value:0", measure = "absolute", limit = 0.0, reason = "stands" },
]
"""
RECORD = '{ record = "RSN1244-N", cut = [0.0, 2.0] }'
PULSE = '{ pulse = "sine", amplitude = 0.1, period = 0.5 }'


@pytest.fixture
def no_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(records, "find_spec", lambda name: None)


def write(folder: Path, ground: str) -> Path:
    folder.mkdir(exist_ok=True)
    file = folder / "case.toml"
    file.write_text(CASE.replace("<ground>", ground))
    return file


@pytest.fixture
def case_file(tmp_path: Path, no_package: None) -> Path:
    return write(tmp_path / "shaken", RECORD)


def test_it_says_what_to_install_or_which_file_to_give(case_file: Path) -> None:
    case = load_case(case_file, "standard", "pendulum")
    with pytest.raises(MissingRecordError) as told:
        ground_motion(case)
    for part in ("case.toml: dynamics.ground.record = 'RSN1244-N'", "fracture-verify[records]", "RSN1244-N.csv"):
        assert part in str(told.value)
    assert missing_record(case) == str(told.value)


def test_a_file_of_its_name_beside_the_case_takes_its_place_and_is_part_of_it(case_file: Path) -> None:
    before = load_case(case_file, "standard", "pendulum").hash()
    (case_file.parent / "RSN1244-N.csv").write_text("time,acceleration\n0,0\n1,0.2\n2,0\n")
    case = load_case(case_file, "standard", "pendulum")
    assert missing_record(case) == "" and case.hash() != before
    np.testing.assert_allclose(ground_motion(case).acceleration([0.5, 1.0]), [0.1, 0.2])
    (case_file.parent / "RSN1244-N.csv").write_text("time,acceleration\n0,0\n1,0.2\n1,0\n")
    with pytest.raises(CaseError, match=r"RSN1244-N.csv.* not later"):
        ground_motion(case)


def test_the_ground_is_not_drawn_where_no_run_has_it(case_file: Path, tmp_path: Path) -> None:
    results = SimpleNamespace(case=load_case(case_file), shown_runs=list)
    assert rocking.ground(results, tmp_path) is None


def test_a_run_of_its_own_is_refused_with_the_sentence(case_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["run", str(case_file), "--out", str(case_file.parent / "out")])
    assert ended.value.code == 3
    assert "fracture-verify[records]" in capsys.readouterr().err


def library(monkeypatch: pytest.MonkeyPatch, *files: Path) -> None:
    monkeypatch.setattr("verify.cli.shared.list_cases", lambda: [str(file) for file in files])
    monkeypatch.setattr("verify.cli.computing.LIBRARY", files[0].parent.parent)


def test_the_other_cases_of_a_library_run_and_are_judged_beside_it(
    case_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    other, out = write(tmp_path / "pulsed", PULSE), tmp_path / "out"
    library(monkeypatch, case_file, other)
    with pytest.raises(SystemExit) as ended:
        main(["run", "--out", str(out)])
    assert not ended.value.code
    assert " ".join(capsys.readouterr().out.split()).count("needs record RSN1244-N") == 1
    with pytest.raises(SystemExit) as ended:
        main(["compare", "--out", str(out)])
    told = " ".join(capsys.readouterr().out.split())
    assert "NEEDS_RECORD" in told and "fracture-verify[records]" in told and not ended.value.code


def test_its_verdict_is_of_its_own_kind(case_file: Path, tmp_path: Path) -> None:
    entry = compare(load_case(case_file), "standard", tmp_path)
    assert entry["verdict"] == "NEEDS_RECORD" and entry["checks"][0]["verdict"] == "NEEDS_RECORD"
    assert entry["runs"]["pendulum"]["status"] == RunStatus.NEEDS_RECORD
    summary = summarise([load_case(case_file)], "standard", tmp_path)
    assert exit_code(summary) == 4, "nothing was checked"
    assert "RSN1244-N" in markdown(summary)
    assert "<skipped" in junit_xml(summary) and "<failure" not in junit_xml(summary)


def test_a_case_that_needs_one_is_valid(case_file: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["validate", str(case_file)])
    assert not ended.value.code
    told = " ".join(capsys.readouterr().out.split())
    assert "valid" in told and "RSN1244-N" in told
