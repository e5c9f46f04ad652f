"""Verdicts: within, out of, missing; baselines change only by accepting."""

import csv
import json
import math
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import fake_solver
import pandas as pd
import pytest
from synthetic_run import write_verification

from cases import Case, case_from_tables, load_case
from numerics.quasi_static import Increment
from reports.pages import fill_page
from verify import compare
from verify.judging.acceptance import accept
from verify.judging.archive import read_archive, write_archive
from verify.judging.baseline import read_baseline, write_baseline
from verify.judging.coverage import NO_CHECK, Printed, coverage, coverage_sentence
from verify.judging.judge import checks_of, judge_case
from verify.judging.summary import exit_code, summarise, write_summary
from verify.judging.targets import JudgeError
from verify.judging.views import checks_csv, junit_xml
from verify.metrics.metric import REGISTERED, Metric, NothingToCompareError
from verify.metrics.registry import find_metric
from verify.runs import running
from verify.runs.atomic import WriteError
from verify.runs.kept import read_kept
from verify.runs.run_folder import partial_folder, run_path
from verify.runs.running import run

OUT = "out"


@pytest.fixture(autouse=True)
def stand_ins(monkeypatch: pytest.MonkeyPatch) -> None:
    """The MPM's stand-in is two per cent stiffer than the FEM's; the code is committed."""
    fake_solver.install(monkeypatch, mpm_factor=1.02)
    monkeypatch.setattr(running, "code_version", lambda: "0.1.0+abc1234")


def made(folder: Path, *checks: str, runs: tuple[str, ...] = ("fem", "mpm")) -> tuple[Case, Path]:
    """A case with checks whose runs are done."""
    path = fake_solver.write_case(folder / "square", *checks)
    for name in runs:
        run(path, name, "quick", folder / OUT)
    return load_case(path, "quick"), folder / OUT


@pytest.mark.parametrize(
    ("against", "limit", "verdict", "error"),
    [
        ("fem", 0.03, "PASS", 0.02),
        ("fem", 0.01, "FAIL", 0.02),
        ("value:0.51", 1e-9, "PASS", 0.0),
        ("value:0.6", 0.1, "FAIL", 0.15),
        ("value:-0.51", 0.99, "FAIL", 2.0),
    ],
)
def test_a_value_is_held_against_its_target(
    tmp_path: Path, against: str, limit: float, verdict: str, error: float
) -> None:
    judged = judge_case(*made(tmp_path, fake_solver.check(against, limit)))
    (result,) = judged.checks
    assert (result.verdict, judged.verdict) == (verdict, verdict)
    assert result.value == pytest.approx(0.51)
    assert result.error == pytest.approx(error, abs=1e-12)
    assert result.margin_used == pytest.approx(error / limit, abs=1e-2)


def test_a_reference_brings_its_value_and_source(tmp_path: Path) -> None:
    reference = """
[references.paper]
kind = "table"
source = "Somebody (2010)"
values = { peak_force = 0.5 }
"""
    judged = judge_case(*made(tmp_path, fake_solver.check("reference:paper", 0.03), reference))
    (result,) = judged.checks
    assert (result.verdict, result.target, result.source) == ("PASS", 0.5, "Somebody (2010)")


def test_a_relative_error_of_zero_target_is_never_within() -> None:
    force = find_metric("peak_force")
    assert force.error(1e-12, 0.0, "relative") == math.inf
    assert force.error(-0.5, 0.25, "absolute") == 0.75
    assert force.error(-0.5, None, "relative") == 0.5
    with pytest.raises(NothingToCompareError):
        force.error(0.0, 0.0, "relative")


@pytest.mark.parametrize(
    ("metric", "value", "target", "error"),
    [
        ("crack_angle", -90.0, 90.0, 0.0),
        ("crack_angle", -160.0, 20.5, 0.5),
        ("crack_angle_in_layer", 179.0, 1.0, 2.0),
        ("crack_direction", -179.0, 179.0, 2.0),
        ("crack_direction", -90.0, 90.0, 180.0),
        ("branching_angle", 10.0, 170.0, 160.0),
    ],
)
def test_angles_of_lines_and_directions_are_compared_round_the_circle(
    metric: str, value: float, target: float, error: float
) -> None:
    assert find_metric(metric).error(value, target, "absolute") == pytest.approx(error)


def test_nothing_against_nothing_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake_solver.install(monkeypatch, mpm_factor=0.0)
    absolute = fake_solver.check("value:0.0").replace("gate", 'measure = "absolute"\ngate')
    judged = judge_case(*made(tmp_path, fake_solver.check("value:0.0"), absolute))
    assert [result.verdict for result in judged.checks] == ["MISSING", "PASS"]
    assert "both zero" in judged.checks[0].note and judged.verdict == "MISSING"


@pytest.mark.parametrize("against", ["fem", "value:0.5", "baseline"])
def test_a_limit_that_a_value_of_nought_would_keep_is_refused(against: str, tmp_path: Path) -> None:
    case, _ = made(tmp_path, fake_solver.check(against, 5.0), runs=())
    with pytest.raises(JudgeError, match=r"checks\[0\]\.limit: 5 lets a value of 0 pass .*0\.05 for 5 %"):
        checks_of(case)


def test_a_check_without_gate_is_shown_and_not_gated(tmp_path: Path) -> None:
    judged = judge_case(*made(tmp_path, fake_solver.check("fem", 0.001, gate=False)))
    assert [result.verdict for result in judged.checks] == ["INFO"]
    assert judged.verdict == "NOT_CHECKED"


def test_a_case_without_checks_is_not_checked(tmp_path: Path) -> None:
    assert judge_case(*made(tmp_path)).verdict == "NOT_CHECKED"


def test_a_missing_baseline_is_missing_and_fails_until_accepted(tmp_path: Path) -> None:
    case, out = made(tmp_path, fake_solver.check("baseline", 1e-6))
    assert judge_case(case, out).verdict == "MISSING"
    assert exit_code({"cases": [compare(case, out=out)]}) == 1
    accept(case, "first values", out)
    assert judge_case(case, out).verdict == "PASS"
    row = read_baseline(case)[0]
    assert (row.tier, row.run, row.metric, row.reason) == ("quick", "mpm", "peak_force", "first values")
    assert row.value == pytest.approx(0.51)


def test_a_baseline_in_another_unit_is_missing_and_the_remedy_names_the_file(tmp_path: Path) -> None:
    case, out = made(tmp_path, fake_solver.check("baseline", 0.5))
    (row,) = accept(case, "first values", out)
    write_baseline(case, [replace(row, unit="MN")])
    (result,) = judge_case(case, out).checks
    assert result.verdict == "MISSING" and "the baseline is in MN, the case in kN" in result.note
    assert f"`verify accept {case.source} --tier quick --reason" in result.note


def test_a_changed_result_fails_against_the_baseline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case, out = made(tmp_path, fake_solver.check("baseline", 1e-3))
    accept(case, "first values", out)
    fake_solver.install(monkeypatch, mpm_factor=1.03)
    run(case, "mpm", out=out, force=True)
    assert judge_case(case, out).verdict == "FAIL"


def test_printed_numbers_stand_beside_ours(tmp_path: Path) -> None:
    """Of a run, then of the record that accepting leaves; what no check compares is told."""
    values = "values = { peak_force = 0.5, displacement_at_peak = 0.7 }"
    reference = f'[references.paper]\nkind = "table"\nsource = "Someone (2010)"\n{values}'
    case, out = made(tmp_path, fake_solver.check("reference:paper", 0.03), reference)
    peak, place = coverage([case], out)
    assert (peak.quantity, peak.ours, peak.found, peak.gated) == ("peak_force", pytest.approx(0.51), "run", True)
    assert peak.share == pytest.approx(0.02)  # a hair above
    assert (place.quantity, place.ours, place.reason) == ("displacement_at_peak", None, NO_CHECK)
    nowhere = tmp_path / "nothing"
    assert coverage([case], nowhere)[0].ours is None
    assert coverage([case], nowhere, summarise([case], "quick", out))[0] == peak
    accept(case, "first values", out)
    assert coverage([case], nowhere)[0].found.startswith("baseline of")
    assert "1 more within 5%" in coverage_sentence([peak, place])
    assert "1 without a value" in coverage_sentence([peak, place])


@pytest.mark.parametrize(
    ("printed", "ours", "gated", "reason", "standing"),
    [
        (0.0, 0.0, True, "none comes", "met"), (0.0, 1.0, False, "shown: one comes", "shown"),
        (-2.0, -1.99, True, "asked", "met"), (2.0, 2.08, False, "shown", "near"), (2.0, 3.0, True, "one digit", "gated"),
        (2.0, 4.0, True, "one digit", "open"), (2.0, 3.0, False, "open discrepancy: why?", "open"),
        (2.0, 3.0, False, "for interest", "open"), (2.0, None, True, "asked", "without"),
    ],
)  # fmt: skip
def test_where_a_value_stands_beside_print(printed, ours, gated, reason, standing):
    row = Printed("case", "Someone", "table", "force", "N", printed, ours=ours, limit=0.5, gated=gated, reason=reason)
    assert row.standing == standing


def test_accepting_again_keeps_what_was_recorded_of_runs_that_are_not_there(tmp_path: Path) -> None:
    """Beside printed values; a sweep, too, is accepted for these alone."""
    reference = '[references.paper]\nkind = "table"\nsource = "Someone (2010)"\nvalues = { peak_force = 0.5 }'
    case, out = made(tmp_path, fake_solver.check("reference:paper", 0.03), reference)
    (row,) = accept(case, "first values", out)
    assert read_baseline(case) == [row]
    shutil.rmtree(run_path(out, case.name, "quick", "mpm"))
    assert accept(case, "of the finite elements alone", out) == [] and read_baseline(case) == [row]
    sweep = '[runs.more]\nsolver = "fem"\nsweep = { "mesh.h" = [0.25, 0.2] }'
    printed = fake_solver.check("reference:paper", 0.03).replace('"mpm"', '"more[h=0.25]"')
    text = fake_solver.CASE[: fake_solver.CASE.index("[runs.fem]")] + "\n".join((sweep, printed, reference))
    path = tmp_path / "swept.toml"
    path.write_text(text)
    name = "more[h=0.25]"
    run(path, name, "quick", out)
    assert [row.run for row in accept(load_case(path, "quick"), "of a sweep", out)] == [name]


def test_a_parameter_of_a_metric_of_ones_own_may_be_written_in_any_way() -> None:
    def share(run: Any, *, at: float, count: int, plain=1) -> float:  # type: ignore[no-untyped-def]
        return 0.0

    own = Metric("share", "number", "of anything", share)
    assert own.kind_of("at")[0] == "number" and not own.kind_of("at")[1]("5 um")
    assert own.kind_of("count")[1](2) and own.kind_of("plain")[1]("left")


def test_accepting_keeps_the_other_tiers(tmp_path: Path) -> None:
    case, out = made(tmp_path, fake_solver.check("baseline", 1e-6))
    accept(case, "first values", out)
    run(case, "mpm", "standard", out)
    accept(load_case(case.source, "standard"), "other tier, with a comma", out)
    assert [(row.tier, row.reason) for row in read_baseline(case)] == [
        ("quick", "first values"),
        ("standard", "other tier, with a comma"),
    ]


def of_peak(check: str, at: str) -> str:
    """An energy balance, which has a parameter, in place of the peak force."""
    return check.replace('"peak_force"', '"energy_balance"') + f'parameters = {{ at = "{at}" }}\n'


def test_case_files_of_one_folder_keep_what_is_theirs(tmp_path: Path) -> None:
    """Their baselines, results and pages are of runs of one name; the folder's own page is of neither."""
    text = fake_solver.CASE + fake_solver.check("baseline", 1e-6)
    (tmp_path / "README.md").write_text("My project: {{ no placeholder of ours }")
    cases = {}
    for name, young in (("soft", 100.0), ("stiff", 210.0)):
        file = tmp_path / f"{name}.toml"
        file.write_text(text.replace("young = 210.0", f"young = {young}"))
        for solver in ("fem", "mpm"):
            run(file, solver, "quick", tmp_path / OUT)
        cases[name] = load_case(file, "quick")
        assert compare(cases[name], out=tmp_path / OUT)["verdict"] == "MISSING"
        accept(cases[name], f"values of the {name} one", tmp_path / OUT)
    for name, case in cases.items():
        kept = read_kept(case, "fem")
        assert kept is not None and kept.fits(load_case(case.source, "quick", "fem")) and fill_page(case) == ""
        assert [row.reason for row in read_baseline(case)] == [f"values of the {name} one"]
        write_archive(case, tmp_path / OUT, tmp_path / f"{name}.zip")
        assert read_archive(tmp_path / f"{name}.zip", tmp_path / "there").summary["cases"][0]["verdict"] == "PASS"


def test_checks_of_one_metric_with_other_parameters_have_rows_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def working(solver: fake_solver.FakeSolver, case: Case, after: object = None) -> Iterator[Increment]:
        for increment in fake_solver.fake_increments(solver, case):
            yield replace(increment, external_work=1.0 + increment.u, elastic_energy=increment.u**2)

    fake_solver.install(monkeypatch, working)
    checks = [of_peak(fake_solver.check("baseline", 1e-9), at) for at in ("peak", "end")]
    case, out = made(tmp_path, *checks)
    accept(case, "first values", out)
    rows = read_baseline(case)
    assert [row.parameters for row in rows] == ['{"at": "peak"}', '{"at": "end"}']
    assert rows[0].value != rows[1].value
    assert {result.verdict for result in judge_case(case, out).checks} == {"PASS"}


def test_a_baseline_has_the_version_that_made_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case, out = made(tmp_path, fake_solver.check("baseline"))
    monkeypatch.setattr(running, "code_version", lambda: "0.1.0+later-dirty")
    accept(case, "first values", out)
    assert read_baseline(case)[0].version == "0.1.0+abc1234"
    run(case, "mpm", out=out, force=True)
    with pytest.raises(JudgeError, match="made by code that is not committed"):
        accept(case, "nobody could make this again", out)
    assert [row.reason for row in read_baseline(case)] == ["first values"]


@pytest.mark.parametrize("reason", ["", "  \n "])
def test_nothing_is_accepted_without_a_reason(tmp_path: Path, reason: str) -> None:
    case, out = made(tmp_path, fake_solver.check("baseline"))
    with pytest.raises(JudgeError, match="reason"):
        accept(case, reason, out)
    assert not (case.folder / "baseline.csv").exists()


def test_nothing_is_accepted_from_a_run_that_did_not_end_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case, out = made(tmp_path, fake_solver.check("baseline"), runs=())
    with pytest.raises(JudgeError, match="missing"):
        accept(case, "no run", out)
    fake_solver.install(monkeypatch, fake_solver.stopping_at(4))
    run(case, "mpm", out=out)
    with pytest.raises(JudgeError, match="no_convergence"):
        accept(case, "bad run", out)


def test_a_full_disk_leaves_the_old_baseline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case, out = made(tmp_path, fake_solver.check("baseline"))
    accept(case, "first values", out)
    before = (case.folder / "baseline.csv").read_text()

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(WriteError, match="disk is full"):
        accept(case, "second values", out)
    assert (case.folder / "baseline.csv").read_text() == before


@pytest.mark.parametrize(
    "damage", ["tier,run\nquick,mpm\n", "quick,mpm,peak_force,,many,kN,r,v,d\n", "quick,mpm,peak_force,,0.5\n"]
)
def test_a_damaged_baseline_is_one_sentence(tmp_path: Path, damage: str) -> None:
    case, out = made(tmp_path, fake_solver.check("baseline"), runs=("mpm",))
    header = "" if damage.startswith("tier") else "tier,run,metric,parameters,value,unit,reason,version,date\n"
    (case.folder / "baseline.csv").write_text(header + damage)
    with pytest.raises(JudgeError, match=r"baseline\.csv"):
        judge_case(case, out)


def test_an_unknown_metric_names_the_nearest(tmp_path: Path) -> None:
    case, out = made(tmp_path, fake_solver.check("fem").replace("peak_force", "peek_force"), runs=())
    with pytest.raises(JudgeError, match=r"checks\[0\]\.metric: 'peek_force' .* 'peak_force'"):
        judge_case(case, out)
    printed = "\n[references.print]\nkind = 'table'\nsource = 'a book'\nvalues = { peek_force = 0.5 }\n"
    case, out = made(tmp_path / "printed", printed, runs=())
    with pytest.raises(JudgeError, match=r"references\.print\.values\.peek_force: 'peek_force' .* 'peak_force'"):
        judge_case(case, out)


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"time": 1.0, "direction": "x"}, r"parameters: travel needs body; add"),
        ({"body": "a", "time": "1 ms", "direction": "x"}, r"time: '1 ms' is no number; give a plain number, in the"),
        ({"body": "a", "time": True, "direction": "x"}, r"parameters\.time: True is no number"),
        ({"body": 3, "time": 1.0, "direction": "x"}, r"parameters\.body: 3 is no text; give a text"),
        ({"body": "plat", "time": 1.0, "direction": "x"}, r"parameters\.body: 'plat' is no body .* name one of"),
        ({"body": "a", "time": 1.1, "direction": "x"}, r"parameters\.time: 1\.1 comes after dynamics\.end_time = 1"),
    ],
)
def test_what_no_run_will_hold_is_refused_before_one_is_made(parameters: dict[str, Any], said: str) -> None:
    body = {"material": "steel", "shape": {"rectangle": {"lower": [0, 0], "upper": [1, 1]}}}
    check = {"metric": "travel", "run": "mpm", "against": "value:1", "limit": 1.0, "reason": "r"}
    tables = {
        "title": "t", "requirement": "r", "units": {"length": "mm", "force": "N"}, "plane": {"assumption": "strain"},
        "materials": {"steel": {"young": 1.0, "poisson": 0.3, "density": 1.0}}, "bodies": {"a": body},
        "dynamics": {"end_time": 1.0}, "mesh": {"h": 0.5}, "runs": {"mpm": {"solver": "mpm"}},
        "checks": [check | {"parameters": parameters}],
    }  # fmt: skip
    with pytest.raises(JudgeError, match=said):
        checks_of(case_from_tables(tables))


def test_every_parameter_of_a_metric_is_of_a_known_kind() -> None:
    for found in REGISTERED.values():
        for name in found.parameters:
            assert found.kind_of(name)[0] in ("text", "number", "list of numbers")


def test_the_momentum_of_a_body_that_turns_is_held_to_what_its_energy_allows() -> None:
    """Its whole momentum is round-off at the start, which is no measure of its change."""
    body = {"material": "steel", "shape": {"rectangle": {"lower": [0, 0], "upper": [2, 1]}}}
    tables = {
        "title": "t", "requirement": "r", "units": {"length": "mm", "force": "N"},
        "plane": {"assumption": "strain", "thickness": 3.0}, "bodies": {"a": body}, "dynamics": {"end_time": 1.0},
        "materials": {"steel": {"young": 1.0, "poisson": 0.3, "density": 4.0}}, "mesh": {"h": 0.5},
        "runs": {"mpm": {"solver": "mpm"}},
    }  # fmt: skip
    tiny, none = [1e-17, 1e-17], [0.0, 0.0]
    columns = {"momentum_x": tiny, "momentum_y": [0.0, 1.2], "a_momentum_x": tiny, "a_momentum_y": none, "E_kin": [3, 3]}
    run = SimpleNamespace(case=case_from_tables(tables), history=pd.DataFrame(columns), info={})
    assert find_metric("momentum_drift")(run) == pytest.approx(1.2 / (2.0 * 24.0 * 3.0) ** 0.5)


@pytest.mark.parametrize(
    "increments", [fake_solver.stopping_at(4), fake_solver.stopping_at(4, ValueError("no"))]
)
def test_a_failed_run_outweighs_everything(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, increments: object
) -> None:
    fake_solver.install(monkeypatch, increments)
    case, out = made(tmp_path, fake_solver.check("fem"))
    judged = judge_case(case, out)
    assert judged.verdict == "RUN_FAILED"
    assert [result.verdict for result in judged.checks] == ["MISSING"]
    assert exit_code({"cases": [compare(case, out=out)]}) == 2


def test_a_run_of_another_case_file_is_not_judged(tmp_path: Path) -> None:
    case, out = made(tmp_path, fake_solver.check("fem", 0.03))
    case.source.write_text(case.source.read_text().replace("young = 210.0", "young = 200.0"))
    judged = judge_case(load_case(case.source, "quick"), out)
    assert {state.status for state in judged.runs.values()} == {"changed"}
    assert judged.verdict == "MISSING"


def test_a_changed_limit_judges_the_same_runs_anew(tmp_path: Path) -> None:
    case, out = made(tmp_path, fake_solver.check("fem", 0.03))
    case.source.write_text(case.source.read_text().replace("limit = 0.03", "limit = 0.01"))
    assert judge_case(load_case(case.source, "quick"), out).verdict == "FAIL"


def test_half_a_run_is_never_judged(tmp_path: Path) -> None:
    case, out = made(tmp_path, fake_solver.check("fem", 0.03))
    folder = run_path(out, case.name, case.tier, "mpm")
    folder.rename(partial_folder(folder))
    judged = judge_case(case, out)
    assert judged.runs["mpm"].status == "unfinished"
    assert judged.verdict == "MISSING"


def test_a_history_with_nan_fails_its_checks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def without_force(solver: fake_solver.FakeSolver, case: Case, after: object = None) -> Iterator[Increment]:
        for increment in fake_solver.fake_increments(solver, case):
            yield replace(increment, F=math.nan) if increment.step == 3 else increment

    fake_solver.install(monkeypatch, without_force)
    judged = judge_case(*made(tmp_path, fake_solver.check("fem", 0.03)))
    assert judged.verdict == "FAIL"
    assert "NaN" in judged.checks[0].note


def test_summary_and_its_views_tell_the_same(tmp_path: Path) -> None:
    checks = [fake_solver.check("fem", 0.03), fake_solver.check("fem", 0.01), fake_solver.check("baseline")]
    case, out = made(tmp_path, *checks, fake_solver.check("value:1.0", gate=False))
    write_summary(summarise([case], "quick", out), out)
    summary = json.loads((out / "summary.json").read_text())
    (entry,) = summary["cases"]
    verdicts = [check["verdict"] for check in entry["checks"]]
    assert verdicts == ["PASS", "FAIL", "MISSING", "INFO"]
    with (out / "summary.csv").open(newline="") as file:
        assert [row["verdict"] for row in csv.DictReader(file)] == verdicts
    suite = ElementTree.parse(out / "junit.xml").getroot()[0]
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("6", "2", "0")
    page = (out / "summary.md").read_text()
    assert "| square | FAIL | 1 of 3 |" in page
    assert "MISSING: peak_force of mpm against baseline" in page
    assert (out / entry["curves"][0]["file"]).is_file()
    assert entry["curves"][0]["l2_percent_whole"] == pytest.approx(2.0)
    assert (out / entry["runs"]["mpm"]["folder"] / "run.json").is_file()


def test_views_hold_nothing_that_breaks_or_runs_in_other_programs(tmp_path: Path) -> None:
    case, out = made(tmp_path, fake_solver.check("fem", 0.01), fake_solver.check("value:-0.5"))
    summary = summarise([case], "quick", out)
    check, other = summary["cases"][0]["checks"]
    check["reason"] = '=HYPERLINK("x")\x00\x1b[31m\x0b\ufffe'
    other["reason"] = "@SUM(A1)"
    (suite,) = ElementTree.fromstring(junit_xml(summary))
    assert "HYPERLINK" in str(suite.findall("testcase/failure")[0].text)
    rows = list(csv.DictReader(checks_csv(summary).splitlines()))
    assert rows[0]["reason"].startswith("'=HYPERLINK") and rows[1]["reason"] == "'@SUM(A1)"
    assert float(rows[1]["target"]) == -0.5


def test_curves_that_cannot_be_compared_are_in_the_summary(tmp_path: Path) -> None:
    summary = write_verification(tmp_path / OUT, cells=4)
    assert json.loads((tmp_path / OUT / "summary.json").read_text()) == summary
    problems = summary["cases"][0]["curve_problems"]
    assert any(problem.startswith("mpm vs cycled2012: ") and "up to u = 0.002" in problem for problem in problems)
    assert {curve["reference"] for curve in summary["cases"][0]["curves"]} == {"fem", "someone2010"}


def test_the_exit_code_is_that_of_the_worst_case() -> None:
    def code(*verdicts: str) -> int:
        return exit_code({"cases": [{"verdict": verdict} for verdict in verdicts]})

    assert code("PASS", "PASS") == 0
    assert code("PASS", "MISSING") == 1
    assert code("FAIL", "NOT_CHECKED") == 1
    assert code("FAIL", "RUN_FAILED", "PASS") == 2
    assert code("PASS", "NOT_CHECKED") == 4
    assert code() == 4
