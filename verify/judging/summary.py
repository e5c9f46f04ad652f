"""summary.json: all verdicts in one file, and its views for CI services and spreadsheets.

Judging reads finished run folders; no solver runs here.
"""

import csv
import io
import json
import math
import re
import shlex
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from cases import Case, load_case
from numerics.status import RunStatus
from verify.judging.judge import CaseVerdict, CheckResult, RunState, judge_case
from verify.judging.targets import reference_curve
from verify.metrics.crack_path import hausdorff, mean_distance
from verify.metrics.curves import Curve, CurveError, compare_curves
from verify.metrics.registry import metric_unit
from verify.runs.atomic import write_table, write_text
from verify.runs.provenance import code_version
from verify.runs.run_folder import RunFolder, RunFolderError

EXIT_CODES = {"PASS": 0, "FAIL": 1, "MISSING": 1, "RUN_FAILED": 2, "NOT_CHECKED": 4}
CURVE_COLUMNS = ["u", "F_reference", "F", "relative_error_percent"]

Json = dict[str, Any]


def summarise(cases: Sequence[Case], tier: str, out: Path) -> Json:
    """Judge the cases from their run folders and return the contents of summary.json; writes curve tables."""
    return {
        "version": code_version(),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "tier": tier,
        "cases": [_case_entry(judge_case(case, out), out) for case in cases],
    }


def compare(case: Case | str | Path, tier: str | None = None, out: Path | str = "reports/out") -> Json:
    """Judge one case from its finished runs and return its entry of summary.json; nothing is computed."""
    if not isinstance(case, Case):
        case = load_case(case, tier)
    return _case_entry(judge_case(case, Path(out)), Path(out))


def write_summary(summary: Json, out: Path) -> None:
    """Write summary.json and its views: junit.xml, summary.csv, summary.md."""
    write_text(out / "summary.json", json.dumps(summary, indent=2, allow_nan=False) + "\n")
    write_text(out / "junit.xml", junit_xml(summary))
    write_text(out / "summary.csv", checks_csv(summary))
    write_text(out / "summary.md", markdown(summary))


def exit_code(summary: Json) -> int:
    """0 within tolerance, 1 out of tolerance or without target, 2 a run failed, 4 nothing was checked."""
    codes = {EXIT_CODES[case["verdict"]] for case in summary["cases"]} or {4}
    return next(code for code in (2, 1, 4, 0) if code in codes)


# ------------------------------------------------------------------------------------------------ entries


def _case_entry(judged: CaseVerdict, out: Path) -> Json:
    case = judged.case
    curves, problems = _curve_entries(judged, out)
    return {
        "case": case.name,
        "source": str(case.source),
        "title": case.title,
        "section": case.section,
        "requirement": case.requirement,
        "tier": case.tier,
        "verdict": judged.verdict,
        "command": reproduce_command(case),
        "runs": {name: _run_entry(state, out) for name, state in judged.runs.items()},
        "checks": [_check_entry(result, case) for result in judged.checks],
        "curves": curves,
        "curve_problems": problems,
        "crack_paths": _crack_path_entries(judged),
    }


def reproduce_command(case: Case) -> str:
    """The command that computes and judges this case again."""
    from cases import list_cases

    if case.name in list_cases() and load_case(case.name).source == case.source:
        return f"make verify CASE={case.name} TIER={case.tier}"
    here, source = Path.cwd(), Path(case.source).resolve()
    asked = f"{shlex.quote(str(source.relative_to(here) if source.is_relative_to(here) else source))} --tier {case.tier}"
    return f"verify run {asked} && verify compare {asked}"


def _run_entry(state: RunState, out: Path) -> Json:
    info = state.run.info if state.run else _info_of_failed(state)
    kept = ("solver", "case_hash", "code_version", "processor", "threads", "memory_mb")
    return {
        "folder": state.folder.relative_to(out).as_posix(),
        "status": state.status,
        "reason": state.reason,
        "counters": info.get("counters", {}),
        "seconds": info.get("seconds", {}),
        "measures": info.get("measures", {}),
    } | {key: info.get(key) for key in kept}


def _info_of_failed(state: RunState) -> Json:
    try:
        return RunFolder(state.folder).info
    except RunFolderError:
        return {}


def _number(value: float | None) -> float | None:
    """JSON knows no NaN and no infinity."""
    return None if value is None or not math.isfinite(value) else float(value)


def _check_entry(result: CheckResult, case: Case) -> Json:
    check = result.check
    return {
        "metric": check.metric,
        "run": check.run,
        "against": check.against,
        "value": _number(result.value),
        "target": _number(result.target),
        "unit": metric_unit(check.metric, case),
        "error": _number(result.error),
        "limit": check.limit,
        "measure": check.measure,
        "margin_used": _number(result.margin_used),
        "verdict": result.verdict,
        "reason": check.reason,
        "source": result.source,
        "note": result.note,
        "gate": check.gate,
        "parameters": check.model_dump(mode="json")["parameters"],
    }


def _pairs(judged: CaseVerdict) -> list[tuple[str, str]]:
    """(run, other) of all checks of a run against another run, each once, both there."""
    pairs = []
    for result in judged.checks:
        kind, other = result.check.target
        pair = (result.check.run, other)
        if kind == "run" and pair not in pairs and all(_there(judged, name) for name in pair):
            pairs.append(pair)
    return pairs


def _there(judged: CaseVerdict, run: str) -> bool:
    return run in judged.runs and judged.runs[run].run is not None


def _curve(judged: CaseVerdict, name: str) -> Curve:
    """Load-displacement curve of a run or of a reference."""
    if name in judged.case.references:
        return reference_curve(judged.case, name)
    run = judged.runs[name].run
    assert run is not None
    return Curve.from_history(run.history, name)


def _curve_pairs(judged: CaseVerdict) -> list[tuple[str, str]]:
    """Runs against each other as checked, and every run against every published curve."""
    published = [name for name, reference in judged.case.references.items() if reference.curve]
    runs = [name for name in judged.runs if _there(judged, name)]
    return _pairs(judged) + [(run, name) for name in published for run in runs]


def _curve_entries(judged: CaseVerdict, out: Path) -> tuple[list[Json], list[str]]:
    """Comparisons with their tables, and one sentence for each pair of curves that cannot be compared."""
    entries, problems = [], []
    for run, other in _curve_pairs(judged):
        try:
            entries.append(_curve_entry(judged, run, other, out))
        except CurveError as error:
            problems.append(str(error))
    return entries, problems


def _curve_entry(judged: CaseVerdict, run: str, other: str, out: Path) -> Json:
    comparison = compare_curves(_curve(judged, other), _curve(judged, run))
    case = judged.case
    file = Path("curves") / case.name / case.tier / f"{_file_name(run)}_vs_{_file_name(other)}.csv"
    write_table(out / file, comparison.errors[CURVE_COLUMNS])
    return {
        "against": f"{run} vs {other}",
        "run": run,
        "reference": other,
        "file": file.as_posix(),
        "l2_percent_before_peak": _number(comparison.l2_percent_before_peak),
        "l2_percent_after_peak": _number(comparison.l2_percent_after_peak),
        "l2_percent_whole": _number(comparison.l2_percent_whole),
    }


def _file_name(run: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.=-]+", "_", run).strip("_")


def _crack_path_entries(judged: CaseVerdict) -> list[Json]:
    entries = []
    for run, other in _pairs(judged):
        one, two = (_crack(judged, name) for name in (run, other))
        if len(one) > 1 and len(two) > 1:
            distances = {"hausdorff": _number(hausdorff(two, one)), "mean": _number(mean_distance(two, one))}
            entries.append({"pair": f"{run} vs {other}", "run": run, "reference": other} | distances)
    return entries


def _crack(judged: CaseVerdict, name: str) -> Any:
    run = judged.runs[name].run
    assert run is not None
    return run.crack_path


# ------------------------------------------------------------------------------------------------ views


def check_name(check: Json) -> str:
    """Name of a check in tables."""
    return f"{check['metric']} of {check['run']} against {check['against']}"


def check_sentence(check: Json) -> str:
    """What was found, in numbers."""
    if check["error"] is None:
        return check["note"] or "no value"
    target = "" if check["target"] is None else f", target {check['target']:.6g}"
    kind = "relative" if check["measure"] == "relative" and check["target"] is not None else "absolute"
    return (
        f"value {check['value']:.6g}{target}, {kind} error {check['error']:.3g}, limit {check['limit']:.3g}"
    )


def failed_runs(case: Json) -> list[str]:
    """One sentence for each run that the solver did not bring to a good end."""
    runs = case["runs"].items()
    return [f"{n}: {r['status']}: {r['reason']}" for n, r in runs if RunStatus(r["status"]).failed]


def junit_xml(summary: Json) -> str:
    """JUnit XML: a suite for each case, a test for each run and each check."""
    root = ElementTree.Element("testsuites", name="verify")
    for case in summary["cases"]:
        suite = ElementTree.SubElement(root, "testsuite", name=f"{case['case']} ({case['tier']})")
        for name, entry in case["runs"].items():
            _junit_run(suite, case, name, entry)
        for check in case["checks"]:
            _junit_check(suite, case, check)
        if case["verdict"] == "NOT_CHECKED":
            test = ElementTree.SubElement(suite, "testcase", classname=case["case"], name="checks")
            ElementTree.SubElement(test, "failure", message="nothing was checked")
        _junit_counts(suite)
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _junit_run(suite: ElementTree.Element, case: Json, name: str, entry: Json) -> None:
    seconds = str(entry["seconds"].get("total", 0.0))
    test = ElementTree.SubElement(suite, "testcase", classname=case["case"], name=f"run {name}", time=seconds)
    status = RunStatus(entry["status"])
    if status.failed or status == RunStatus.DAMAGED:
        ElementTree.SubElement(test, "error", message=f"{entry['status']}: {entry['reason']}")
    elif not status.good:
        ElementTree.SubElement(test, "skipped", message=f"{entry['status']}: {entry['reason']}")


def _junit_check(suite: ElementTree.Element, case: Json, check: Json) -> None:
    test = ElementTree.SubElement(suite, "testcase", classname=case["case"], name=check_name(check))
    message = check_sentence(check)
    if check["verdict"] in ("FAIL", "MISSING"):
        failure = ElementTree.SubElement(test, "failure", message=f"{check['verdict']}: {message}")
        failure.text = check["reason"]
    elif check["verdict"] == "INFO":
        ElementTree.SubElement(test, "skipped", message=f"not gated: {message}")


def _junit_counts(suite: ElementTree.Element) -> None:
    suite.set("tests", str(len(suite.findall("testcase"))))
    for kind, attribute in (("failure", "failures"), ("error", "errors"), ("skipped", "skipped")):
        suite.set(attribute, str(len(suite.findall(f"testcase/{kind}"))))


def checks_csv(summary: Json) -> str:
    """One row for each check of each case."""
    columns = ["case", "tier", "metric", "run", "against", "value", "target", "error", "limit", "measure",
               "margin_used", "verdict", "gate", "reason", "source", "note"]  # fmt: skip
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for case in summary["cases"]:
        writer.writerows({"case": case["case"], "tier": case["tier"]} | check for check in case["checks"])
    return text.getvalue()


def markdown(summary: Json) -> str:
    """A page for a CI service: the verdicts, then all that is not within tolerance."""
    lines = [
        f"# Verification, tier {summary['tier']}",
        "",
        f"Version {summary['version']}, {summary['created']}",
        "",
    ]
    lines += ["| case | verdict | checks passed | largest share of a limit |", "|---|---|---|---|"]
    lines += [_markdown_row(case) for case in summary["cases"]]
    for case in summary["cases"]:
        problems = [f"- {sentence}" for sentence in failed_runs(case)]
        bad = (check for check in case["checks"] if check["verdict"] in ("FAIL", "MISSING"))
        problems += [f"- {c['verdict']}: {check_name(c)}: {check_sentence(c)}" for c in bad]
        if problems:
            lines += ["", f"## {case['case']}: {case['verdict']}", "", *problems, "", f"`{case['command']}`"]
    return "\n".join(lines) + "\n"


def counts(case: Json) -> tuple[int, int, float | None]:
    """Gated checks passed, gated checks in all, largest share of a limit that a gated check uses."""
    gated = [check for check in case["checks"] if check["gate"]]
    margins = [check["margin_used"] for check in gated if check["margin_used"] is not None]
    passed = sum(check["verdict"] == "PASS" for check in gated)
    return passed, len(gated), max(margins, default=None)


def _markdown_row(case: Json) -> str:
    passed, gated, margin = counts(case)
    share = "" if margin is None else f"{100 * margin:.0f} %"
    return f"| {case['case']} | {case['verdict']} | {passed} of {gated} | {share} |"
