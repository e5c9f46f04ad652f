"""Values of finished runs become the baseline of a case and tier, with the version of the code that made them.

Values that are checked against printed ones are recorded with them.
The histories and crack paths of its main runs are kept beside it, against which results from elsewhere are judged.
"""

import math
from collections.abc import Iterable
from contextlib import suppress
from datetime import date
from pathlib import Path

import numpy as np

from cases import Case, Check
from verify.judging.baseline import BaselineRow, key_of, parameters_text, read_baseline, write_baseline
from verify.judging.judge import Judge, UnavailableError, checks_of, find_runs
from verify.judging.targets import JudgeError, is_printed, members_of
from verify.metrics.curves import CurveError
from verify.metrics.registry import metric_unit
from verify.runs.kept import keep, main_runs, read_kept
from verify.runs.run_folder import RunFolder, RunFolderError

#: end of the version of code that is not committed
DIRTY = "-dirty"


def require_committed(version: str, folder: Path) -> None:
    """Raises JudgeError for a run made by code that is not committed, so that nobody could make it again."""
    if version.endswith(DIRTY):
        raise JudgeError(f"{folder}: is made by code that is not committed ({version}); commit it and run with --force.")


def _version_of(runs: Iterable[RunFolder]) -> str:
    """Version of the code that made the runs, where it differs all of them."""
    versions = set()
    for run in runs:
        require_committed(run.info["code_version"], run.folder)
        versions.add(run.info["code_version"])
    return ", ".join(sorted(versions))


def accept(case: Case, reason: str, out: Path) -> list[BaselineRow]:
    """Make the values of the finished runs the baseline of this tier and keep its main runs; other tiers' rows stay.

    Raises
    ------
    JudgeError : no reason, nothing to accept or keep, or a run that is not there, did not end well or was made by code
        that is not committed.
    """
    reason = " ".join(reason.split())
    if not reason:
        raise JudgeError('A baseline changes only with a reason: give --reason "why the new values are right".')
    everything = checks_of(case)
    checks = [check for check in everything if check.against == "baseline"]
    judge = Judge(case, find_runs(case, out))
    rows = {row.key: row for row in (_accepted(case, check, judge, reason) for check in checks)}
    for check in everything:
        if is_printed(case, check) and key_of(check, case) not in rows:
            with suppress(JudgeError):  # what a run does not give is told by its check
                row = _accepted(case, check, judge, "recorded beside the printed value")
                rows[row.key] = row
    if not rows and not main_runs(case):
        said = f"no check of tier {case.tier!r} is against the baseline or printed and every run is one of a sweep"
        raise JudgeError(f"{case.source}: {said}; nothing to accept.")
    if all(found.run is None for found in judge.runs.values()):
        raise JudgeError(f"{out}: no run of {case.name} is there in tier {case.tier!r}; do it with `verify run` first.")
    keep_main_runs(case, judge)
    if rows:
        absent = {key_of(check, case) for check in everything
                  if any(judge.runs[name].run is None for name in members_of(case, check.run))}  # fmt: skip
        kept = [row for row in read_baseline(case) if row.tier != case.tier or row.key in absent - rows.keys()]
        write_baseline(case, [*kept, *rows.values()])
    return list(rows.values())


def keep_main_runs(case: Case, judge: Judge) -> None:
    """Keep the main runs that are there beside the case; what is then read from there must give the same peak.

    Raises JudgeError for a run that was made by code that is not committed.
    """
    for name in main_runs(case):
        found = judge.runs[name].run
        if found is None:
            continue
        _version_of([found])
        file, kept = keep(case, found), read_kept(case, name)
        assert kept is not None
        full, fewer = (np.abs(history["F"].to_numpy()).max() for history in (found.history, kept.history))
        if not math.isclose(full, fewer, rel_tol=1e-5, abs_tol=1e-12):
            raise JudgeError(f"{file}: has the largest force {fewer:g} in place of {full:g}; it is not to be used.")


def _accepted(case: Case, check: Check, judge: Judge, reason: str) -> BaselineRow:
    try:
        value = judge.value(check)
        version = _version_of(judge.available(name) for name in members_of(case, check.run))
    except (UnavailableError, CurveError, RunFolderError, ValueError) as error:
        raise JudgeError(f"{case.name}: {check.metric} of {check.run!r} cannot be accepted: {error}.") from error
    if not math.isfinite(value):
        raise JudgeError(f"{case.name}: {check.metric} of {check.run!r} is {value}; nothing was accepted.")
    unit, today = metric_unit(check.metric, case), date.today().isoformat()
    return BaselineRow(
        case.tier, check.run, check.metric, parameters_text(check), value, unit, reason, version, today
    )
