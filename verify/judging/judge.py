"""Checks become verdicts: what finished runs give is held against targets and limits. No solver runs here."""

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from cases import Case, Check, load_case
from numerics.status import RunStatus
from verify.judging.targets import JudgeError, require_sense, target_of, value_of
from verify.metrics.curves import CurveError
from verify.metrics.registry import metric_unit
from verify.runs.atomic import write_text
from verify.runs.provenance import code_version
from verify.runs.run_folder import RunFolder, RunFolderError, as_expected, partial_folder, run_path

CheckVerdict = Literal["PASS", "FAIL", "MISSING", "INFO"]
CaseVerdictName = Literal["PASS", "FAIL", "RUN_FAILED", "NOT_CHECKED", "MISSING"]
BASELINE_COLUMNS = ("tier", "run", "metric", "value", "unit", "reason", "version", "date")
BASELINE_FILE = "baseline.csv"


@dataclass(frozen=True)
class RunState:
    """A run of a case as judging finds it.

    status : of run.json, or why there is no such folder that fits the case file.
    run : the folder, present when the run ended well and belongs to the case as it stands.
    """

    folder: Path
    status: RunStatus
    reason: str
    run: RunFolder | None = None

    @property
    def failed(self) -> bool:
        """True when the solver ran and did not come to a good end."""
        return self.status.failed


@dataclass(frozen=True)
class CheckResult:
    """A judged check; ``value`` and ``target`` are None where there is none, ``note`` says why."""

    check: Check
    verdict: CheckVerdict
    value: float | None = None
    target: float | None = None
    error: float | None = None
    source: str = ""
    note: str = ""

    @property
    def margin_used(self) -> float | None:
        """Error over limit: 1 is at the limit."""
        if self.error is None:
            return None
        return (
            self.error / self.check.limit if self.check.limit > 0 else (0.0 if self.error == 0 else math.inf)
        )


@dataclass(frozen=True)
class CaseVerdict:
    """The verdict on one case at one tier with everything that it rests on."""

    case: Case
    runs: dict[str, RunState]
    checks: list[CheckResult]

    @property
    def verdict(self) -> CaseVerdictName:
        """A failed run outweighs a check out of tolerance, that outweighs a missing target."""
        gated = {result.verdict for result in self.checks if result.check.gate}
        if any(state.failed for state in self.runs.values()):
            return "RUN_FAILED"
        if "FAIL" in gated:
            return "FAIL"
        if "MISSING" in gated:
            return "MISSING"
        return "PASS" if gated else "NOT_CHECKED"


# -------------------------------------------------------------------------------------------------- runs


def find_run(case: Case, run_name: str, out: Path) -> RunState:
    """The state of one run of a case under the output folder."""
    folder = run_path(out, case.name, case.tier, run_name)
    if not folder.exists() and not partial_folder(folder).exists():
        return RunState(folder, RunStatus.MISSING, "not computed yet")
    try:
        found = RunFolder(folder)
    except RunFolderError as error:
        status = RunStatus.DAMAGED if folder.exists() else RunStatus.UNFINISHED
        return RunState(folder, status, str(error))
    if found.info["case_hash"] != load_case(case.source, case.tier, run_name).hash():
        return RunState(folder, RunStatus.CHANGED, "computed for another version of the case file; run it again")
    status = as_expected(found.info["status"], case, run_name)
    return RunState(folder, status, found.info["reason"], found if status.good else None)


def find_runs(case: Case, out: Path) -> dict[str, RunState]:
    """All runs that the case describes, by name."""
    return {name: find_run(case, name, out) for name in case.expanded_runs()}


# ---------------------------------------------------------------------------------------------- judging


def judge_case(case: Case, out: Path) -> CaseVerdict:
    """Judge all checks of a case's tier from the run folders under ``out``.

    Raises
    ------
    JudgeError : a check asks for a metric that does not exist, or a baseline file is damaged.
    """
    runs = find_runs(case, out)
    judge = _Judge(case, runs)
    return CaseVerdict(case, runs, [judge.result(check) for check in checks_of(case)])


def checks_of(case: Case) -> list[Check]:
    """The checks that apply at the case's tier, looked through for mistakes.

    Raises
    ------
    JudgeError : a check that no result could ever answer.
    """
    applying = case.applying_checks()
    for number, check in applying:
        require_sense(case, number, check)
    return [check for _, check in applying]


class _UnavailableError(Exception):
    """A value or target is not there; the text says why."""


class _Judge:
    """Judges the checks of one case."""

    def __init__(self, case: Case, runs: Mapping[str, RunState]) -> None:
        self.case, self.runs = case, runs

    @cached_property
    def baseline(self) -> dict[tuple[str, str, str], "BaselineRow"]:
        """Rows of the case's baseline by their keys."""
        return {row.key: row for row in read_baseline(self.case)}

    def result(self, check: Check) -> CheckResult:
        """Judge one check; what cannot be evaluated is MISSING, what makes no sense FAILs."""
        value: float | None = None
        source = self._source(check)
        try:
            value = self.value(check)
            target = self.target(check)
        except _UnavailableError as missing:
            return self._without_error(check, "MISSING", value, source, str(missing))
        except (CurveError, RunFolderError, ValueError) as error:
            return self._without_error(check, "FAIL", value, source, str(error))
        distance = error_of(value, target, check.measure)
        if not math.isfinite(distance):
            return self._without_error(
                check, "FAIL", value, source, "the value or its target is not a number"
            )
        verdict: CheckVerdict = "PASS" if distance <= check.limit else "FAIL"
        return CheckResult(check, verdict if check.gate else "INFO", value, target, distance, source)

    @staticmethod
    def _without_error(
        check: Check, verdict: CheckVerdict, value: float | None, source: str, note: str
    ) -> CheckResult:
        return CheckResult(check, verdict if check.gate else "INFO", value, source=source, note=note)

    def value(self, check: Check) -> float:
        """What the run gives for the metric."""
        return value_of(check, self.case, self._available)

    def _available(self, run_name: str) -> RunFolder:
        state = self.runs[run_name]
        if state.run is None:
            raise _UnavailableError(
                f"run {run_name!r} is {state.status}" + (f": {state.reason}" if state.reason else "")
            )
        return state.run

    def target(self, check: Check) -> float | None:
        """The value to meet; None where the metric is an error or a distance itself."""
        if check.against == "baseline":
            row = self.baseline.get((self.case.tier, check.run, check.metric))
            if row is None:
                raise _UnavailableError(
                    f"no baseline for this tier; accept one with "
                    f'`verify accept {self.case.name} --tier {self.case.tier} --reason "..."`'
                )
            return row.value
        return target_of(check, self.case, self._available)

    def _source(self, check: Check) -> str:
        kind, name = check.target
        if kind == "reference":
            return self.case.references[name].source
        if kind == "baseline":
            row = self.baseline.get((self.case.tier, check.run, check.metric))
            return f"accepted {row.date} with version {row.version}: {row.reason}" if row else ""
        return {"exact": "exact solution", "value": "stated value"}.get(kind, "")


def error_of(value: float, target: float | None, measure: str) -> float:
    """Distance of a value from its target; of a metric without target its absolute value.

    Relative to a target of zero there is no error but 0 or infinity.
    """
    if target is None:
        return abs(value)
    difference = abs(value - target)
    if measure == "absolute" or difference == 0.0:
        return difference
    return difference / abs(target) if target != 0.0 else math.inf


# --------------------------------------------------------------------------------------------- baselines


@dataclass(frozen=True)
class BaselineRow:
    """One accepted value of our own, against which a later version is held."""

    tier: str
    run: str
    metric: str
    value: float
    unit: str
    reason: str
    version: str
    date: str

    @property
    def key(self) -> tuple[str, str, str]:
        """What the value is of: tier, run, metric."""
        return (self.tier, self.run, self.metric)


def baseline_file(case: Case) -> Path:
    """The baseline beside the case file."""
    return case.folder / BASELINE_FILE


def read_baseline(case: Case) -> list[BaselineRow]:
    """All accepted values of a case; none when there is no file.

    Raises
    ------
    JudgeError : the file is damaged.
    """
    path = baseline_file(case)
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        if tuple(reader.fieldnames or ()) != BASELINE_COLUMNS:
            raise JudgeError(f"{path}: its columns must be {','.join(BASELINE_COLUMNS)}; restore the file.")
        return [_baseline_row(path, reader.line_num, record) for record in reader]


def _baseline_row(path: Path, line: int, record: dict[str, Any]) -> BaselineRow:
    try:
        value = float(record.pop("value"))
    except (TypeError, ValueError):
        value = math.nan
    if not math.isfinite(value) or None in record or None in record.values():
        raise JudgeError(f"{path}: line {line} is damaged or its value is no number; restore the file.")
    return BaselineRow(value=value, **record)


def accept(case: Case, reason: str, out: Path) -> list[BaselineRow]:
    """Make the values of the finished runs the baseline of this tier; the other tiers' rows stay.

    Raises
    ------
    JudgeError : no reason, no check against the baseline, or a run that is not there or did not end well.
    """
    reason = " ".join(reason.split())
    if not reason:
        raise JudgeError(
            'A baseline changes only with a reason: give --reason "why the new values are right".'
        )
    checks = [check for check in checks_of(case) if check.against == "baseline"]
    if not checks:
        raise JudgeError(
            f"{case.source}: no check of tier {case.tier!r} is against the baseline; nothing to accept."
        )
    judge = _Judge(case, find_runs(case, out))
    rows = [_accepted(case, check, judge, reason) for check in checks]
    kept = [row for row in read_baseline(case) if row.tier != case.tier]
    write_text(baseline_file(case), _baseline_text(kept + rows))
    return rows


def _accepted(case: Case, check: Check, judge: _Judge, reason: str) -> BaselineRow:
    try:
        value = judge.value(check)
    except (_UnavailableError, CurveError, RunFolderError, ValueError) as error:
        raise JudgeError(
            f"{case.name}: {check.metric} of {check.run!r} cannot be accepted: {error}."
        ) from error
    if not math.isfinite(value):
        raise JudgeError(f"{case.name}: {check.metric} of {check.run!r} is {value}; nothing was accepted.")
    unit = metric_unit(check.metric, case)
    today = date.today().isoformat()
    return BaselineRow(case.tier, check.run, check.metric, value, unit, reason, code_version(), today)


def _baseline_text(rows: list[BaselineRow]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, BASELINE_COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(vars(row) | {"value": repr(row.value)} for row in rows)
    return text.getvalue()
