"""The price of every saving: time spared against change in each checked quantity.

>>> price(load_case("sen_tension", "quick"), Options(Path("reports/out")))  # doctest: +SKIP

Each run of a case is done as planned, with each saving off in turn and with all off. The prices are written to
``<out>/prices/<case>/<tier>.csv`` and, on request, recorded beside the case's baseline in ``prices.csv``, from
where the plan reads them.
"""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from cases import Case, Check, load_case
from cases.loader import reading_once
from cases.solvers import SOLVERS
from numerics.status import RunStatus
from verify.metrics.registry import METRICS, PAIR_METRICS, find_metric, metric_unit
from verify.planning.recorded_prices import PRICE_COLUMNS, PRICES_FILE, read_prices
from verify.planning.savings import all_off, savings
from verify.runs.atomic import write_table
from verify.runs.jobs import Job
from verify.runs.run_folder import RunFolder
from verify.studies.records import require_committed_runs
from verify.studies.study import (
    NO_VALUE,
    Options,
    StudyError,
    Variation,
    announce,
    counted_unknowns,
    counted_work,
    finished_run,
    forecast,
    processor_seconds,
    run_all,
)

ALL_SAVINGS = "all savings"
#: metrics of two runs that are priced: relative errors of a curve, and distances of crack paths
RELATIVE = ("curve_l2_before_peak", "curve_l2_whole", "curve_l2_peak_normalised")
PATHS = ("path_mean_distance", "path_mean_distance_over_h")
#: told, but no share of anything: distances, and what the increments quantise
NO_SHARE = (*PATHS, "displacement_at_peak")

Tell = Callable[[str], None]


def _change(check: Check, usual: RunFolder, without: RunFolder) -> dict[str, Any]:
    """A checked metric with and without the saving, and the relative change; not a number where there is none.

    One of a pair compares the run with that without the saving.
    """
    if check.metric in PAIR_METRICS:
        error = _value(check, usual, without)
        return {"with": error, "without": 0.0, "change": math.nan if check.metric in NO_SHARE else error}
    with_it, without_it = _value(check, usual), _value(check, without)
    is_share = without_it != 0.0 and check.metric not in NO_SHARE
    change = (with_it - without_it) / abs(without_it) if is_share else math.nan
    return {"with": with_it, "without": without_it, "change": change}


def _value(check: Check, *runs: RunFolder) -> float:
    try:
        return find_metric(check.metric)(*runs, **check.parameters)
    except NO_VALUE:
        return math.nan


@reading_once()
def price(
    case: Case, options: Options, runs: Sequence[str] = (), tell: Tell = lambda line: None, record: bool = False,
    only: Sequence[str] = (),
) -> Path:  # fmt: skip
    """Do the runs that are not finished and write the table of prices; returns its path.

    only : names of the savings to switch off, each in turn; all of them, and all at once, without.

    Raises
    ------
    StudyError : no such run or saving, or no saving of its can be switched off.
    JudgeError : prices of runs that were made by code that is not committed are to be recorded.
    """
    priced = [_Priced(case, name, options, only) for name in runs or _plain_runs(case)]
    todo = [job for one in priced for job in one.jobs()]
    if not todo:
        what = f"none of the savings {', '.join(only)}" if only else "no saving"
        known = dict.fromkeys(saving.name for one in priced for saving in one.all_switches)
        remedy = f"; its runs have: {', '.join(known)}" if known else ""
        raise StudyError(f"{case.source}: {what} of its runs can be switched off at tier {case.tier!r}{remedy}.")
    if record:
        require_committed_runs(todo, options.out)
    warning = announce(forecast(todo, options.at_once), f"The prices of {case.name}")
    if warning:
        tell(warning)
    run_all(todo, options, lambda outcome: tell(f"{outcome.title}: {outcome.line}"))
    table = pd.DataFrame([row for one in priced for row in one.rows()], columns=list(PRICE_COLUMNS))
    file = options.out / "prices" / case.name / f"{case.tier}.csv"
    write_table(file, table)
    if record:
        _record(case, table)
    return file


def _plain_runs(case: Case) -> list[str]:
    return [name for name, spec in case.run_specs().items() if not spec.sweep_values and not SOLVERS[spec.solver].table]


def _record(case: Case, table: pd.DataFrame) -> None:
    """Beside the baseline, in place of what was recorded for these savings of these runs at this tier."""
    old, keys = read_prices(case), ["tier", "run", "saving"]
    kept = old[~pd.MultiIndex.from_frame(old[keys]).isin(pd.MultiIndex.from_frame(table[keys]))]
    both = pd.concat([kept, table], ignore_index=True) if len(kept) else table
    write_table(case.kept_folder / PRICES_FILE, both)


class _Priced:
    """One run of a case, with and without its savings."""

    def __init__(self, case: Case, run: str, options: Options, only: Sequence[str] = ()) -> None:
        self.case, self.run, self.options = case, run, options
        self.merged = load_case(case.source, case.tier, run)
        self.all_switches = tuple(saving for saving in savings(self.merged) if saving.off)
        self.switches = tuple(saving for saving in self.all_switches if not only or saving.name in only)
        self._together = len(self.switches) > 1 and not only

    def _job(self, saving: str, change: dict[str, Any]) -> Job:
        return Variation(f"{self.run} without {saving}" if change else self.run, self.run, change).job(
            self.case, self.options
        )

    def _without(self) -> list[tuple[str, Job]]:
        """Each saving off in turn, and all off where there are several."""
        each = [(saving.name, self._job(saving.name, saving.off or {})) for saving in self.switches]
        together = [(ALL_SAVINGS, self._job(ALL_SAVINGS, all_off(self.switches)))]
        return each + (together if self._together else [])

    def jobs(self) -> list[Job]:
        """The run as it is, and those without savings."""
        return [self._job("", {}), *(job for _, job in self._without())] if self.switches else []

    def rows(self) -> list[dict[str, Any]]:
        """A row for each saving and checked quantity."""
        usual = finished_run(self._job("", {})) if self.switches else None
        if usual is None or not usual.good:
            return []
        return [row for name, job in self._without() for row in self._rows_of(name, usual, finished_run(job))]

    def _rows_of(self, saving: str, usual: RunFolder, run: RunFolder | None) -> list[dict[str, Any]]:
        told: dict[str, Any] = {"tier": self.case.tier, "run": self.run, "saving": saving}
        told |= {"version": usual.info["code_version"], "stated_hash": self.merged.hash(stated=True)}
        told |= _costs(usual, "with")
        if run is None or not run.good:
            return [told | {"status": run.info["status"] if run else RunStatus.FAILED}]
        told |= _costs(run, "without")
        told["status"] = run.info["status"]
        return [told | self._told(check) | _change(check, usual, run) for check in self._priced_checks()]

    def _told(self, check: Check) -> dict[str, str]:
        return {"quantity": check.metric, "unit": metric_unit(check.metric, self.case)}

    def _priced_checks(self) -> list[Check]:
        """One for each quantity that checks ask of this run, or of another against it: physical ones, errors of two."""
        found: dict[str, Check] = {}
        for _, check in self.case.applying_checks():
            if self.run in (check.run, check.target[1]) and _is_priced(check.metric):
                found.setdefault(f"{check.metric}{check.parameters}", check)
        return list(found.values())


def _is_priced(name: str) -> bool:
    """Angles and errors against something exact tell nothing of a saving."""
    return name in PATHS + RELATIVE or (name in METRICS and METRICS[name].unit not in ("number", "degree"))


def _costs(run: RunFolder, which: str) -> dict[str, float]:
    costs = {"seconds": processor_seconds(run), "work": counted_work(run), "unknowns": counted_unknowns(run)}
    return {f"{name}_{which}": value for name, value in costs.items()}
