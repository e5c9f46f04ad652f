"""Accuracy against cost: ladders of runs, their errors in checked quantities, the front of best choices.

>>> make_charts(load_case("sen_tension", "quick"), Options(Path("reports/out")))  # doctest: +SKIP

Leaves ``<out>/charts/<case>/<tier>/<chart>.csv`` (a row for each level and quantity), ``<chart>-slopes.csv`` and
``<chart>-choices.csv``; the runs are ordinary run folders and are used again.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cases import Case, Check
from cases.judging import merge
from cases.loader import reading_once
from cases.studies import Chart, ChartedMetric, Varied, coordinates
from numerics.status import RunStatus
from verify.judging.targets import target_of, value_of
from verify.metrics.measures import fitted_order
from verify.metrics.registry import PAIR_METRICS, find_metric
from verify.runs.atomic import write_table
from verify.runs.jobs import Job, Outcome
from verify.runs.run_folder import RunFolder
from verify.studies.records import record as keep
from verify.studies.records import require_committed_runs
from verify.studies.study import (
    MADE_BEFORE,
    NO_VALUE,
    Options,
    StudyError,
    Variation,
    announce,
    check_of,
    chosen_tables,
    counted_unknowns,
    counted_work,
    finished_run,
    forecast,
    is_of_state,
    processor_seconds,
    run_all,
    state_of,
    text_of,
    variations,
)

COLUMNS = (
    "ladder", "solver", "level", "at", "status", "seconds", "repeats", "warm_up", "unknowns", "work", "memory_mb",
    "quantity", "value", "reference", "uncertainty", "error", "on_front", "folder", "state",
)  # fmt: skip
SLOPE_COLUMNS = ("quantity", "ladder", "solver", "over", "order", "cost_slope", "levels")
CHOICE_COLUMNS = (
    "quantity", "target", "ladder", "solver", "over", "at", "error", "seconds", "work", "next_ladder", "next_factor",
)  # fmt: skip
TIME_KEYS = ("case_hash", "source_hash", "processor", "threads")
TIME_COLUMNS = (*TIME_KEYS, "seconds")
ALL = "all quantities"

Tell = Callable[[str], None]


def chart_folder(out: Path, case: Case) -> Path:
    """Where the tables of a case's charts lie."""
    return out / "charts" / case.name / case.tier


@reading_once()
def make_charts(
    case: Case, options: Options, names: Sequence[str] = (), repeats: int = 1, tell: Tell = lambda line: None,
    record: bool = False,
) -> list[Path]:
    """Run what is not finished, evaluate, write the tables of the named charts (all without names).

    record : keep them beside the case too

    Raises
    ------
    StudyError : no such chart, or a chart asks for what cannot be evaluated. CaseError : a level is no valid case.
    JudgeError : charts of runs that were made by code that is not committed are to be recorded.
    """  # fmt: skip
    studies = [ChartStudy(case, name, options) for name in chosen_tables(case, "charts", names)]
    todo = [job for study in studies for job in study.jobs()]
    if record:
        require_committed_runs(todo, options.out)
    warning = announce(_forecast(todo, options, repeats), f"The charts of {case.name}")
    if warning:
        tell(warning)
    times = Times(chart_folder(options.out, case) / "times.csv")
    times.measure(todo, options, repeats, tell)
    for study in studies:
        for sentence in study.without_error(times):
            tell(sentence)
    files = [study.write(times) for study in studies]
    if record:
        kept = [keep(case, "charts", file, study.jobs()) for study, file in zip(studies, files, strict=True)]
        tell("\n".join(f"Recorded: {file}" for file in kept))
    return files


def _forecast(todo: list[Job], options: Options, repeats: int) -> float:
    return forecast(todo, options.at_once) * repeats


class Times:
    """Processor seconds of every computation so far: the least of all repeats counts."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.table = pd.read_csv(file) if file.is_file() else pd.DataFrame(columns=list(TIME_COLUMNS))

    def of(self, run: RunFolder) -> pd.Series:
        """Measured seconds of all repeats of a finished run."""
        same = [self.table[key] == run.info[key] for key in TIME_KEYS]
        return self.table.loc[np.logical_and.reduce(same), "seconds"]

    def measure(self, todo: list[Job], options: Options, repeats: int, tell: Tell) -> None:
        """Run each job as often as is still wanted; the first of each run once more, as its process starts with it."""
        self._do(todo, options, tell)
        firsts = list({job.run: job for job in reversed(todo)}.values())
        for number, jobs in [(1, firsts), *((number, todo) for number in range(1, repeats))]:
            self._do([replace(job, force=True, resume=False) for job in jobs if self._few(job, number)], options, tell)

    def _few(self, job: Job, number: int) -> bool:
        run = finished_run(job)
        return run is not None and len(self.of(run)) <= number

    def _do(self, todo: list[Job], options: Options, tell: Tell) -> None:
        def take(outcome: Outcome) -> None:
            tell(f"{outcome.title}: {outcome.line}")

        old = [job for job in todo if not job.force and self._other_threads(job, options.threads)]
        run_all([replace(job, force=True) if job in old else job for job in todo], options, take)
        for job in {job.folder(): job for job in todo}.values():
            run = finished_run(replace(job, force=False))
            if run is not None and (job.force or self.of(run).empty):
                self._add(run)

    @staticmethod
    def _other_threads(job: Job, threads: int) -> bool:
        run = finished_run(job)
        return run is not None and run.info.get("threads") != threads

    def _add(self, run: RunFolder) -> None:
        self.table.loc[len(self.table)] = [*(run.info[key] for key in TIME_KEYS), processor_seconds(run)]
        write_table(self.file, self.table)


# ---------------------------------------------------------------------------------------------- references


@dataclass(frozen=True)
class Target:
    """What a quantity should be, how sure that is, and the run that curves and paths are compared with."""

    value: float
    uncertainty: float
    finest: RunFolder | None = None


def extrapolated(at: Sequence[float], values: Sequence[float], order: float) -> tuple[float, float]:
    """Limit of values that converge with a power of their coordinate, from the last two of three or more.

    Its uncertainty is how much the limit changes against that of the two before; if the order is another, this shows.
    """
    before, limit = (_limit(at[k : k + 2], values[k : k + 2], order) for k in (len(at) - 3, len(at) - 2))
    return limit, abs(limit - before)


def _limit(at: Sequence[float], values: Sequence[float], order: float) -> float:
    ratio = max(at[0] / at[1], at[1] / at[0])
    return values[1] + (values[1] - values[0]) / (ratio**order - 1.0)


# ------------------------------------------------------------------------------------------------- a chart


class ChartStudy:
    """One chart of a case: its runs, and what they tell."""

    def __init__(self, case: Case, name: str, options: Options) -> None:
        self.case, self.name, self.options = case, name, options
        self.chart: Chart = case.charts[name]
        for quantity in self.chart.quantities:
            self._require_reference(quantity)

    def _require_reference(self, quantity: ChartedMetric) -> None:
        place = f"{self.case.source}: charts.{self.name}.quantities"
        try:
            find_metric(quantity.metric)
        except NO_VALUE as error:
            raise StudyError(f"{place}: {error}") from error
        of_two = quantity.metric in PAIR_METRICS
        if of_two and quantity.value is not None:
            raise StudyError(f"{place}: {quantity.metric} compares two runs and has no value of its own; leave it out.")
        exact = self.case.exact is not None or any(constraint.motion for constraint in self.case.constraints)
        known = exact and not quantity.metric.startswith("path_")
        if self.chart.reference is None and quantity.value is None and not known:
            remedy = "" if of_two else ", or the quantity's 'value'"
            raise StudyError(
                f"{place}: {quantity.metric} has nothing to be compared with; "
                f"add the table 'reference' with finer levels{remedy}."
            )

    @cached_property
    def ladders(self) -> dict[str, list[Variation]]:
        """The levels of each ladder, the cheapest first."""
        return {
            name: self._levels(name, ladder)
            for name, ladder in self.chart.ladders.items()
        }

    @cached_property
    def finest(self) -> list[Variation]:
        """The levels of the reference."""
        return self._levels("reference", self.chart.reference) if self.chart.reference else []

    def _levels(self, name: str, varied: Varied) -> list[Variation]:
        change = merge(self.chart.change, varied.change)
        return variations(f"{self.name}.{name}", varied.run, change, varied.levels)

    def jobs(self) -> list[Job]:
        """All runs of the chart, those of the reference last."""
        levels = [level for ladder in self.ladders.values() for level in ladder]
        return [level.job(self.case, self.options) for level in levels + self.finest]

    def _run(self, level: Variation) -> RunFolder | None:
        return finished_run(level.job(self.case, self.options))

    # ---- errors

    def target(self, quantity: ChartedMetric) -> Target | None:
        """The reference of a quantity; None where it differs from level to level or its runs do not give it."""
        if quantity.value is not None:
            return Target(quantity.value, 0.0)
        if self.chart.reference is None:
            return None
        runs = [run for run in map(self._run, self.finest) if run is not None and run.good]
        if len(runs) < len(self.finest):
            return None
        try:
            if quantity.metric in PAIR_METRICS:
                return Target(0.0, _distance(quantity, runs[-2], runs[-1]), runs[-1])
            values = [_value(quantity, run) for run in runs]
        except NO_VALUE:
            return None
        at = coordinates(self.chart.reference.levels)
        return Target(*extrapolated(at, values, self.chart.reference.order), runs[-1])

    def table(self, times: Times) -> pd.DataFrame:
        """A row for each level and quantity."""
        rows = []
        for quantity in self.chart.quantities:
            target = self.target(quantity)
            for name, ladder in self.ladders.items():
                rows += [self._row(name, level, quantity, target, times) for level in ladder]
        table = pd.DataFrame(rows, columns=list(COLUMNS)).assign(state=state_of(self.case, self.chart))
        table["on_front"] = _on_front(table)
        return table

    def _row(
        self, ladder: str, level: Variation, quantity: ChartedMetric, target: Target | None, times: Times
    ) -> dict[str, Any]:
        run = self._run(level)
        row: dict[str, Any] = dict.fromkeys(COLUMNS, math.nan)
        row |= {"ladder": ladder, "solver": self.case.run_spec(level.run).solver, "level": text_of(level.at)}
        row |= {"at": level.at, "quantity": quantity.metric, "status": run.info["status"] if run else RunStatus.FAILED}
        if run is None:
            return row
        seconds = times.of(run)
        row |= {"seconds": seconds.min(), "repeats": len(seconds), "warm_up": run.info["seconds"].get("warm_up")}
        row |= {"unknowns": counted_unknowns(run), "work": counted_work(run)}
        row |= {"memory_mb": run.info.get("memory_mb"), "folder": _within(run.folder, self.options.out)}
        if run.good:
            row |= self._error(quantity, run, level, target)
        return row

    def _error(
        self, quantity: ChartedMetric, run: RunFolder, level: Variation, target: Target | None
    ) -> dict[str, float]:
        """Value, reference, uncertainty and relative error; what the run does not give is left out.

        Of a reference of zero there is no relative error, but of a number that should be nought, an error itself.
        """
        try:
            if quantity.metric in PAIR_METRICS:
                distance, unsure = self._distance(quantity, run, level, target)
                return {"value": distance, "reference": 0.0, "uncertainty": unsure, "error": distance}
            value, target = _value(quantity, run), target or Target(self._exact(quantity, run, level), 0.0)
        except NO_VALUE:
            return {}
        told, size = {"value": value, "reference": target.value}, abs(target.value)
        if size == 0.0:
            is_error = find_metric(quantity.metric).unit == "number"
            return told | ({"uncertainty": 0.0, "error": abs(value)} if is_error else {})
        error = find_metric(quantity.metric).error(value, target.value, "relative")
        return told | {"uncertainty": target.uncertainty / size, "error": error}

    def _distance(
        self, quantity: ChartedMetric, run: RunFolder, level: Variation, target: Target | None
    ) -> tuple[float, float]:
        """A metric of two runs, against the finest run or the exact curve, and how sure it is."""
        if target is not None and target.finest is not None:
            return _distance(quantity, run, target.finest), target.uncertainty
        return value_of(self._exact_check(quantity, level), self.case, lambda _: run), 0.0

    def _exact(self, quantity: ChartedMetric, run: RunFolder, level: Variation) -> float:
        exact = target_of(self._exact_check(quantity, level), self.case, lambda _: run)
        assert exact is not None, "only metrics of two runs have no value elsewhere"
        return exact

    def _exact_check(self, quantity: ChartedMetric, level: Variation) -> Check:
        if self.chart.reference is not None:
            raise ValueError(f"charts.{self.name}.reference: a run of it did not end well")
        return check_of(quantity.metric, level.run, "exact", parameters=quantity.parameters)

    # ---- tables

    def without_error(self, times: Times) -> list[str]:
        """One sentence for each quantity of which no level has an error."""
        table = self.table(times)
        told = table.groupby("quantity", sort=False)[["value", "error"]].count()
        return [
            f"charts.{self.name}: {quantity} has no relative error: "
            + ("its reference is zero or unknown." if row["value"] else "no level or not every reference gives it.")
            for quantity, row in told.iterrows()
            if not row["error"]
        ]

    def write(self, times: Times) -> Path:
        """Write the three tables; returns the first."""
        table = self.table(times)
        folder = chart_folder(self.options.out, self.case)
        over = {name: next(iter(ladder.levels)) for name, ladder in self.chart.ladders.items()}
        chosen = choices(table, over, self.chart.targets).assign(state=state_of(self.case, self.chart))
        tables = {"": table, "-slopes": slopes(table, over), "-choices": chosen}
        for ending, part in tables.items():
            write_table(folder / f"{self.name}{ending}.csv", part)
        return folder / f"{self.name}.csv"


def _value(quantity: ChartedMetric, run: RunFolder) -> float:
    return find_metric(quantity.metric)(run, **quantity.parameters)


def _distance(quantity: ChartedMetric, run: RunFolder, finest: RunFolder) -> float:
    """A metric of two runs as a share: lengths are taken over the length of the finest run's crack."""
    metric = PAIR_METRICS[quantity.metric]
    distance = metric(run, finest, **quantity.parameters)
    return distance / find_metric("crack_length")(finest) if metric.unit == "length" else distance


def _within(folder: Path, out: Path) -> str:
    return folder.relative_to(out).as_posix()


def _on_front(table: pd.DataFrame) -> list[bool]:
    """Levels that no other beats in both seconds and error of the same quantity."""
    front = []
    for _, row in table.iterrows():
        rivals = table[table["quantity"] == row["quantity"]]
        better = (rivals["seconds"] <= row["seconds"]) & (rivals["error"] <= row["error"])
        strictly = (rivals["seconds"] < row["seconds"]) | (rivals["error"] < row["error"])
        front.append(bool(math.isfinite(row["error"]) and not (better & strictly).any()))
    return front


def slopes(table: pd.DataFrame, over: dict[str, str]) -> pd.DataFrame:
    """Fitted powers of the error for each quantity and ladder, over its coordinate and over seconds.

    Only levels whose error is known, that is, above the uncertainty of the reference, take part; a fit needs three.
    """
    rows = []
    for (quantity, ladder), part in table.groupby(["quantity", "ladder"], sort=False):
        known = part[part["error"] > part["uncertainty"]]
        numbers = pd.to_numeric(known["at"], errors="coerce")
        order = _fit(numbers, known["error"])
        cost = _fit(known["seconds"], known["error"])
        rows.append((quantity, ladder, part["solver"].iloc[0], over[str(ladder)], order, cost, len(known)))
    return pd.DataFrame(rows, columns=list(SLOPE_COLUMNS))


def _fit(x: pd.Series, error: pd.Series) -> float:
    if len(x) < 3 or x.isna().any():
        return math.nan
    try:
        return fitted_order(x, error)
    except NO_VALUE:
        return math.nan


def choices(table: pd.DataFrame, over: dict[str, str], targets: Sequence[float]) -> pd.DataFrame:
    """The cheapest level for each target error, of each quantity and of all together.

    A level counts where it and all finer ones of its ladder keep the target, the reference's uncertainty included.
    """
    rows = []
    failed = table["error"].fillna(math.inf)
    table = table.assign(error=failed, bound=failed + table["uncertainty"].fillna(0.0))
    together = ["ladder", "solver", "level", "at", "seconds", "work"]
    merged = table.groupby(together, sort=False, dropna=False)[["error", "bound"]].max().reset_index()
    several = table["quantity"].nunique() > 1
    parts = pd.concat([table, merged.assign(quantity=ALL)] if several else [table])
    for quantity, part in parts.groupby("quantity", sort=False):
        for target in targets:
            rows.append((quantity, target, *_cheapest(part, over, target)))
    return pd.DataFrame(rows, columns=list(CHOICE_COLUMNS))


def _cheapest(part: pd.DataFrame, over: dict[str, str], target: float) -> tuple[Any, ...]:
    """Of all ladders the cheapest level within the target, and by how much the next best ladder costs more.

    Where there is none, the least error of the finest levels with the reference's uncertainty; infinite if they failed.
    """
    found = []
    for ladder, levels in part.groupby("ladder", sort=False):
        kept = (levels["bound"] <= target).to_numpy()
        from_here = np.logical_and.accumulate(kept[::-1])[::-1]
        if from_here.any():
            found.append((str(ladder), levels[from_here].sort_values("seconds").iloc[0]))
    if not found:
        return ("", "", "", math.nan, part.groupby("ladder")["bound"].nth(-1).min(), math.nan, math.nan, "", math.nan)
    found.sort(key=lambda entry: entry[1]["seconds"])
    ladder, best = found[0]
    rival = next((entry for entry in found[1:] if entry[1]["solver"] == best["solver"]), None)
    told = (ladder, best["solver"], over[ladder], best["at"], best["error"], best["seconds"], best["work"])
    return (*told, rival[0], rival[1]["seconds"] / best["seconds"]) if rival else (*told, "", math.nan)


def choice_sentence(choice: pd.Series) -> str:
    """What to choose for one target, in words."""
    wanted = f"For {100 * choice['target']:g} % in {str(choice['quantity']).replace('_', ' ')}"
    if not isinstance(choice["ladder"], str) or not choice["ladder"]:
        least = f"at the finest, error and the reference's uncertainty are {100 * choice['error']:.2g} %"
        told = least if math.isfinite(choice["error"]) else "the finest have no result"
        return f"{wanted} no level is accurate enough: {told}."
    short = str(choice["over"]).rpartition(".")[2]
    chosen = f"{wanted} choose {choice['ladder']} with {short} = {text_of(choice['at'])}"
    told = f"{chosen} (error {100 * choice['error']:.2g} %, {choice['seconds']:.2g} s)"
    if isinstance(choice["next_ladder"], str) and choice["next_ladder"]:
        return f"{told}; {choice['next_ladder']} takes {choice['next_factor']:.2g} times as long."
    return f"{told}."


def recorded_choices(case: Case, out: Path, target: float) -> list[str]:
    """What the charts of a case that have been made say of a target error."""
    said = []
    for name in case.charts:
        file = chart_folder(out, case) / f"{name}-choices.csv"
        if file.is_file():
            table = pd.read_csv(file)
            before = "" if is_of_state(table, state_of(case, case.charts[name])) else f"{MADE_BEFORE} "
            said += [before + choice_sentence(row) for _, row in table[np.isclose(table["target"], target)].iterrows()]
    return said


__all__ = [
    "ChartStudy", "chart_folder", "choice_sentence", "choices", "extrapolated", "make_charts", "recorded_choices",
    "slopes",
]  # fmt: skip
