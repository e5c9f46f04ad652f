"""Checks become verdicts: what finished runs give is held against targets and limits. No solver runs here."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

from cases import Case, Check, load_case
from cases.solvers import SOLVERS
from numerics.status import RunStatus
from physics.rocking.records import missing_record
from verify.health import INDICATORS, suspicions
from verify.judging.baseline import BaselineRow, Key, key_of, read_baseline
from verify.judging.targets import JudgeError, asked_for, require_known, require_sense, target_of, value_of
from verify.metrics.curves import CurveError
from verify.metrics.metric import NotGivenError, NothingToCompareError
from verify.metrics.registry import find_metric, metric_unit
from verify.runs.run_folder import RunFolder, RunFolderError, as_expected, partial_folder, run_path

CheckVerdict = Literal["PASS", "FAIL", "MISSING", "NEEDS_RECORD", "INFO"]
CaseVerdictName = Literal["PASS", "FAIL", "RUN_FAILED", "NOT_CHECKED", "MISSING", "NEEDS_RECORD", "SUSPECT"]


@dataclass(frozen=True)
class RunState:
    """A run of a case as judging finds it.

    status : of run.json, or why there is no such folder that fits the case file.
    run : the folder, present when the run ended well and belongs to the case as it stands.
    suspicions : a sentence for each indicator of its health record beyond the limit, but for what the case accepts.
    """

    folder: Path
    status: RunStatus
    reason: str
    run: RunFolder | None = None
    suspicions: tuple[str, ...] = ()

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
        """A failed run outweighs a check out of tolerance, that a missing target, that a run that is suspect, that a run
        that needs the record of a measured motion."""
        gated = {result.verdict for result in self.checks if result.check.gate}
        if any(state.failed for state in self.runs.values()):
            return "RUN_FAILED"
        if "FAIL" in gated:
            return "FAIL"
        if "MISSING" in gated:
            return "MISSING"
        if any(state.suspicions for state in self.runs.values()):
            return "SUSPECT"
        if "NEEDS_RECORD" in gated:
            return "NEEDS_RECORD"
        return "PASS" if gated else "NOT_CHECKED"


# -------------------------------------------------------------------------------------------------- runs


def find_run(case: Case, run_name: str, out: Path) -> RunState:
    """The state of one run of a case under the output folder."""
    folder = run_path(out, case.name, case.tier, run_name)
    if not folder.exists() and not partial_folder(folder).exists():
        sentence = missing_record(load_case(case.source, case.tier, run_name))
        status = RunStatus.NEEDS_RECORD if sentence else RunStatus.MISSING
        return RunState(folder, status, sentence or "not computed yet")
    try:
        found = RunFolder(folder)
    except RunFolderError as error:
        status = RunStatus.DAMAGED if folder.exists() else RunStatus.UNFINISHED
        return RunState(folder, status, str(error))
    if found.info["case_hash"] != load_case(case.source, case.tier, run_name).hash():
        return RunState(folder, RunStatus.CHANGED, "computed for another version of the case file; run it again")
    status = as_expected(found.info["status"], case, run_name)
    told = suspicions(found.info.get("health", {}), case.run_spec(run_name).accepts)
    return RunState(folder, status, found.info["reason"], found if status.good else None, tuple(told))


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
    judge = Judge(case, runs)
    return CaseVerdict(case, runs, [judge.result(check) for check in checks_of(case)])


def checks_of(case: Case) -> list[Check]:
    """The checks that apply at the case's tier, looked through for mistakes.

    Raises
    ------
    JudgeError : a check that no result could ever answer, or a printed value of no metric.
    """
    for family, run in case.runs.items():
        for name in run.accepts.keys() - INDICATORS.keys():
            known = ", ".join(INDICATORS)
            raise JudgeError(f"{case.source}: runs.{family}.accepts.{name}: is no indicator; name one of {known}.")
    for reference, printed in case.references.items():
        for name in printed.values:
            require_known(name, f"{case.source}: references.{reference}.values.{name}")
    applying = case.applying_checks()
    for number, check in applying:
        require_sense(case, number, check)
    return [check for _, check in applying]


class UnavailableError(Exception):
    """A value or target is not there; the text says why."""


class NeedsRecordError(UnavailableError):
    """It needs the record of a measured motion that is not on this machine."""


class Judge:
    """Judges the checks of one case."""

    def __init__(self, case: Case, runs: Mapping[str, RunState]) -> None:
        self.case, self.runs = case, runs

    @cached_property
    def baseline(self) -> dict[Key, BaselineRow]:
        """Rows of the case's baseline by their keys."""
        return {row.key: row for row in read_baseline(self.case)}

    def result(self, check: Check) -> CheckResult:
        """Judge one check; what cannot be evaluated is MISSING, what makes no sense FAILs."""
        value: float | None = None
        source = self._source(check)
        try:
            value = self.value(check)
            target = self.target(check)
            distance = find_metric(check.metric).error(value, target, check.measure)
        except NeedsRecordError as needs:
            return self._without_error(check, "NEEDS_RECORD", value, source, str(needs))
        except (UnavailableError, NothingToCompareError) as missing:
            return self._without_error(check, "MISSING", value, source, str(missing))
        except (CurveError, RunFolderError, ValueError) as error:
            if isinstance(error, NotGivenError | CurveError) and self._comes_as_a_table(check):
                check = check.model_copy(update={"gate": False})
            return self._without_error(check, "FAIL", value, source, str(error))
        if not math.isfinite(distance):
            note = "the target is zero, of which no relative error can be taken; judge the absolute one"
            return self._without_error(check, "FAIL", value, source, note)
        verdict: CheckVerdict = "PASS" if distance <= check.limit else "FAIL"
        return CheckResult(check, verdict if check.gate else "INFO", value, target, distance, source)

    def _comes_as_a_table(self, check: Check) -> bool:
        """A result from elsewhere need not have what a check asks for: that is said, and is no failure."""
        spec = self.case.run_specs().get(check.run)
        return spec is not None and bool(SOLVERS[spec.solver].table)

    @staticmethod
    def _without_error(
        check: Check, verdict: CheckVerdict, value: float | None, source: str, note: str
    ) -> CheckResult:
        return CheckResult(check, verdict if check.gate else "INFO", value, source=source, note=note)

    def value(self, check: Check) -> float:
        """What the run gives for the metric."""
        return value_of(check, self.case, self.available)

    def available(self, run_name: str) -> RunFolder:
        """The finished run of a name; UnavailableError where there is none."""
        state = self.runs[run_name]
        if state.status is RunStatus.NEEDS_RECORD:
            raise NeedsRecordError(state.reason)
        if state.run is None:
            raise UnavailableError(
                f"run {run_name!r} is {state.status}" + (f": {state.reason}" if state.reason else "")
            )
        return state.run

    def target(self, check: Check) -> float | None:
        """The value to meet; None where the metric is an error or a distance itself."""
        if check.against == "baseline":
            row, unit = self.baseline.get(key_of(check, self.case)), metric_unit(check.metric, self.case)
            if row is None or row.unit != unit:
                missing = f"the baseline is in {row.unit}, the case in {unit}" if row else "no baseline for this tier"
                remedy = f'`verify accept {asked_for(self.case)} --tier {self.case.tier} --reason "..."`'
                raise UnavailableError(f"{missing}; accept one with {remedy}")
            return row.value
        return target_of(check, self.case, self.available)

    def _source(self, check: Check) -> str:
        kind, name = check.target
        if kind == "reference":
            return self.case.references[name].source
        if kind == "baseline":
            row = self.baseline.get(key_of(check, self.case))
            return f"accepted {row.date} with version {row.version}: {row.reason}" if row else ""
        return {"exact": "exact solution", "value": "stated value"}.get(kind, "")
