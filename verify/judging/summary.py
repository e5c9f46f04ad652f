"""summary.json: all verdicts in one file. Judging reads finished run folders; no solver runs here."""

import json
import math
import re
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from cases import Case, case_at, load_case
from cases.loader import reading_once
from verify.judging.judge import CaseVerdict, CheckResult, RunState, judge_case
from verify.judging.targets import asked_for, reference_curve
from verify.judging.views import Json, checks_csv, junit_xml, markdown
from verify.metrics.crack_path import hausdorff, mean_distance
from verify.metrics.curves import Curve, CurveError, compare_curves
from verify.metrics.registry import metric_unit
from verify.runs.atomic import write_table, write_text
from verify.runs.processes import fresh_processes
from verify.runs.provenance import code_version
from verify.runs.run_folder import RunFolder, RunFolderError

EXIT_CODES = {"PASS": 0, "FAIL": 1, "MISSING": 1, "SUSPECT": 1, "RUN_FAILED": 2, "NOT_CHECKED": 4}
CURVE_COLUMNS = ["u", "F_reference", "F", "relative_error_percent"]


def summarise(cases: Sequence[Case], tier: str, out: Path, jobs: int = 1) -> Json:
    """Judge the cases from their run folders, ``jobs`` at the same time, and return the contents of summary.json.

    Tables of curves are written beside it.
    """
    if jobs == 1:
        entries = [_judged(case, out) for case in cases]
    else:
        processes = fresh_processes("verify.judging.summary", "verify.metrics.registry", "verify.runs.vtk_files")
        with ProcessPoolExecutor(jobs, mp_context=processes) as pool:
            entries = list(pool.map(partial(_read_and_judged, tier=tier, out=out), [case.source for case in cases]))
    return {
        "version": code_version(),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "tier": tier,
        "cases": entries,
    }


def _judged(case: Case, out: Path) -> Json:
    with reading_once():
        return _case_entry(judge_case(case, out), out)


def _read_and_judged(source: Path, tier: str, out: Path) -> Json:
    """The case is read in this process, so that solvers of other packages that it names are known."""
    return _judged(load_case(source, tier), out)


def compare(case: Case | str | Path, tier: str | None = None, out: Path | str = "reports/out") -> Json:
    """Judge one case from its finished runs and return its entry of summary.json; nothing is computed."""
    return _case_entry(judge_case(case_at(case, tier), Path(out)), Path(out))


def write_summary(summary: Json, out: Path) -> None:
    """Write summary.json and its views: junit.xml, summary.csv, summary.md."""
    write_text(out / "summary.json", json.dumps(summary, indent=2, allow_nan=False) + "\n")
    write_text(out / "junit.xml", junit_xml(summary))
    write_text(out / "summary.csv", checks_csv(summary))
    write_text(out / "summary.md", markdown(summary))


def exit_code(summary: Json) -> int:
    """0 within tolerance, 1 out of tolerance or without target, 2 a run failed, 4 nothing was checked.

    A case that needs a record that is not there does not count.
    """
    codes = {EXIT_CODES[case["verdict"]] for case in summary["cases"] if case["verdict"] != "NEEDS_RECORD"} or {4}
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
    asked = asked_for(case)
    if asked == case.name:
        return f"make verify CASE={asked} TIER={case.tier}"
    return f"verify run {asked} --tier {case.tier} && verify compare {asked} --tier {case.tier}"


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
        "health": info.get("health", {}),
        "suspicions": list(state.suspicions),
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
        except (CurveError, RunFolderError) as error:
            problems.append(f"{run} vs {other}: {error}")
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
        try:
            one, two = (_crack(judged, name) for name in (run, other))
        except RunFolderError:  # damaged, which its checks tell
            continue
        if len(one) > 1 and len(two) > 1:
            distances = {"hausdorff": _number(hausdorff(two, one)), "mean": _number(mean_distance(two, one))}
            entries.append({"pair": f"{run} vs {other}", "run": run, "reference": other} | distances)
    return entries


def _crack(judged: CaseVerdict, name: str) -> Any:
    run = judged.runs[name].run
    assert run is not None
    return run.crack_path
