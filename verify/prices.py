"""The price of every saving: time spared against change in each checked quantity.

>>> price(load_case("sen_tension", "quick"), Options(Path("reports/out")))  # doctest: +SKIP

Each run of a case is done as planned, with each saving off in turn and with all off. The prices are written to
``<out>/prices/<case>/<tier>.csv`` and, on request, recorded beside the case's baseline in ``prices.csv``, from
where the plan reads them.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from cases import Case, load_case
from verify.atomic import write_table
from verify.jobs import Job
from verify.metrics import METRICS, PAIR_METRICS, Metric, find_metric, metric_unit
from verify.provenance import code_version
from verify.run_folder import RunFolder
from verify.savings import Saving, all_off, savings
from verify.studies import (
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

PRICES_FILE = "prices.csv"
COLUMNS = (
    "tier", "run", "saving", "seconds_with", "seconds_without", "work_with", "work_without", "unknowns_with",
    "unknowns_without", "quantity", "with", "without", "unit", "change", "status", "version", "case_hash",
)  # fmt: skip
ALL_SAVINGS = "all savings"
#: metrics of two runs that are priced: relative errors of a curve, and distances of crack paths
RELATIVE = ("curve_l2_before_peak", "curve_l2_whole", "curve_l2_peak_normalised")
PATHS = ("path_mean_distance", "path_mean_distance_over_h")
#: told, but no share of anything: distances, and what the increments quantise
NO_SHARE = (*PATHS, "displacement_at_peak")

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Quantity:
    """A checked metric with its parameters; one of a pair compares the run with that without the saving."""

    metric: str
    parameters: dict[str, Any]

    def change(self, usual: RunFolder, without: RunFolder) -> dict[str, Any]:
        """Its value with and without the saving, and the relative change; not a number where there is none."""
        if self.metric in PAIR_METRICS:
            error = self._value(find_metric(self.metric), usual, without)
            return {"with": error, "without": 0.0, "change": math.nan if self.metric in NO_SHARE else error}
        with_it, without_it = (self._value(find_metric(self.metric), run) for run in (usual, without))
        is_share = without_it != 0.0 and self.metric not in NO_SHARE
        change = (with_it - without_it) / abs(without_it) if is_share else math.nan
        return {"with": with_it, "without": without_it, "change": change}

    def _value(self, metric: Metric, *runs: RunFolder) -> float:
        try:
            return metric(*runs, **self.parameters)
        except NO_VALUE:
            return math.nan


def price(
    case: Case, options: Options, runs: Sequence[str] = (), tell: Tell = lambda line: None, record: bool = False,
    only: Sequence[str] = (),
) -> Path:  # fmt: skip
    """Do the runs that are not finished and write the table of prices; returns its path.

    only : names of the savings to switch off, each in turn; all of them, and all at once, without.

    Raises
    ------
    StudyError : no such run or saving, or no saving of its can be switched off.
    """
    priced = [_Priced(case, name, options, only) for name in runs or _plain_runs(case)]
    todo = [job for one in priced for job in one.jobs()]
    if not todo:
        what = f"none of the savings {', '.join(only)}" if only else "no saving"
        known = dict.fromkeys(saving.name for one in priced for saving in one.all_switches)
        remedy = f"; its runs have: {', '.join(known)}" if known else ""
        raise StudyError(f"{case.source}: {what} of its runs can be switched off at tier {case.tier!r}{remedy}.")
    warning = announce(forecast(todo, options.at_once), f"The prices of {case.name}")
    if warning:
        tell(warning)
    run_all(todo, options, lambda outcome: tell(f"{outcome.title}: {outcome.line}"))
    table = pd.DataFrame([row for one in priced for row in one.rows()], columns=list(COLUMNS))
    file = options.out / "prices" / case.name / f"{case.tier}.csv"
    write_table(file, table)
    if record:
        _record(case, table)
    return file


def _plain_runs(case: Case) -> list[str]:
    return [name for name, spec in case.run_specs().items() if not spec.sweep_values]


def _record(case: Case, table: pd.DataFrame) -> None:
    """Beside the baseline, in place of what was recorded for these savings of these runs at this tier."""
    old, keys = read_prices(case), ["tier", "run", "saving"]
    kept = old[~pd.MultiIndex.from_frame(old[keys]).isin(pd.MultiIndex.from_frame(table[keys]))]
    both = pd.concat([kept, table], ignore_index=True) if len(kept) else table
    write_table(case.folder / PRICES_FILE, both)


def read_prices(case: Case) -> pd.DataFrame:
    """All recorded prices of a case, of every tier; empty without any.

    Raises
    ------
    StudyError : the file is damaged.
    """
    file = case.folder / PRICES_FILE
    if not file.is_file():
        return pd.DataFrame(columns=list(COLUMNS))
    try:
        table = pd.read_csv(file)
    except ValueError as error:
        raise StudyError(f"{file}: is no readable table ({error}); restore it or delete it.") from error
    if tuple(table.columns) != COLUMNS:
        raise StudyError(f"{file}: its columns must be {','.join(COLUMNS)}; restore it or delete it.")
    return table


def current_prices(case: Case, run: str) -> pd.DataFrame:
    """Recorded prices of a run's savings, of its case as it stands.

    case : with the run's changes merged in
    """
    prices = read_prices(case)
    mine = (prices["tier"] == case.tier) & (prices["run"] == run) & (prices["case_hash"] == case.hash())
    return prices[mine]


def costs_of_savings(case: Case, run: str) -> dict[str, float]:
    """Largest change of a checked quantity that each saving in use costs; not a number where that was not priced."""
    prices = current_prices(case, run)
    used = [saving.name for saving in savings(case) if saving.off]
    return {name: float(prices.loc[prices["saving"] == name, "change"].abs().max()) for name in used}


class _Priced:
    """One run of a case, with and without its savings."""

    def __init__(self, case: Case, run: str, options: Options, only: Sequence[str] = ()) -> None:
        self.case, self.run, self.options = case, run, options
        merged = load_case(case.source, case.tier, run)
        self.all_switches = tuple(saving for saving in savings(merged) if saving.off)
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
        told: dict[str, Any] = {"tier": self.case.tier, "run": self.run, "saving": saving, "version": code_version()}
        told["case_hash"] = usual.info["case_hash"]
        told |= _costs(usual, "with")
        if run is None or not run.good:
            return [told | {"status": run.info["status"] if run else "failed"}]
        told |= _costs(run, "without")
        told["status"] = run.info["status"]
        return [told | self._told(quantity) | quantity.change(usual, run) for quantity in self._quantities()]

    def _told(self, quantity: Quantity) -> dict[str, str]:
        return {"quantity": quantity.metric, "unit": metric_unit(quantity.metric, self.case)}

    def _quantities(self) -> list[Quantity]:
        """What checks ask of this run, or of another against it: physical quantities, and errors of two runs."""
        found: dict[str, Quantity] = {}
        for _, check in self.case.applying_checks():
            if self.run in (check.run, check.target[1]) and _is_priced(check.metric):
                found.setdefault(f"{check.metric}{check.parameters}", Quantity(check.metric, check.parameters))
        return list(found.values())


def _is_priced(name: str) -> bool:
    """Angles and errors against something exact tell nothing of a saving."""
    return name in PATHS + RELATIVE or (name in METRICS and METRICS[name].unit not in ("number", "degree"))


def _costs(run: RunFolder, which: str) -> dict[str, float]:
    costs = {"seconds": processor_seconds(run), "work": counted_work(run), "unknowns": counted_unknowns(run)}
    return {f"{name}_{which}": value for name, value in costs.items()}


def chosen_savings(case: Case, run: str, accuracy: float) -> tuple[tuple[Saving, ...], tuple[str, ...]]:
    """The savings of a run's case that are too dear for an accuracy, and why, one reason each.

    case : with the run's changes merged in. Errors can add up: the dearest are left out until the recorded prices of
    the others together are within the accuracy; savings that were not priced count for nothing.
    """
    used = {saving.name: saving for saving in savings(case) if saving.off}
    left = {name: cost for name, cost in costs_of_savings(case, run).items() if cost > 0.0}
    dear, reasons = [], []
    while (together := sum(left.values())) > accuracy:
        name = max(left, key=lambda name: left[name])
        dear.append(used[name])
        own, all_ = f"{100 * left.pop(name):.2g} %", f"{100 * together:.2g} %"
        others = f", {all_} with the others" if all_ != own else ""
        reasons.append(f"costs {own}{others}, of {100 * accuracy:.2g} % wanted")
    return tuple(dear), tuple(reasons)


__all__ = ["PRICES_FILE", "chosen_savings", "costs_of_savings", "current_prices", "price", "read_prices"]
