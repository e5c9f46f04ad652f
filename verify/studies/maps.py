"""Maps of where a method fails: a verdict for every pair of two levels, and the border between them made sharp.

>>> make_maps(load_case("surfing", "quick"), Options(Path("reports/out")))  # doctest: +SKIP

Leaves ``<out>/maps/<case>/<tier>/<map>.csv`` (a row for each cell), ``<map>-borders.csv`` (a row for each change of the
verdict along x) and ``<map>-powers.csv`` (a row for each y: its errors as a power of x). A cell is an ordinary run of
the case, or a probe that needs no run.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cases import Case, CaseError
from cases.judging import merge, nest
from cases.loader import reading_once
from cases.studies import REACHED, RUN, Judged, Map, coordinates, level_changes
from numerics.status import RunStatus
from verify.judging.targets import target_of
from verify.metrics.registry import METRICS, find_metric
from verify.metrics.rocking import verdict_on
from verify.runs.atomic import write_table
from verify.runs.jobs import Job
from verify.runs.run_folder import RunFolder
from verify.studies.borders import BORDERS, RigidBlock
from verify.studies.probes import PROBES
from verify.studies.records import record as keep
from verify.studies.records import require_committed_runs
from verify.studies.study import (
    NO_VALUE,
    Options,
    StudyError,
    Variation,
    announce,
    check_of,
    chosen_tables,
    finished_run,
    forecast,
    run_all,
    state_of,
    text_of,
)
from verify.studies.verdicts import (
    BLEW_UP,
    DRIFT,
    NO_CONVERGENCE,
    NOT_POSSIBLE,
    NUMERICAL_FRACTURE,
    STABLE,
    TIMEOUT,
    Verdict,
    accuracy,
)

#: nothing counts as broken above this phase field: a force that is gone there was lost by the discretisation
WHOLE = 0.9
#: how a run that did not end well is called on a map; a solver's further statuses are one more entry each
VERDICTS = {
    RunStatus.NO_CONVERGENCE: NO_CONVERGENCE, RunStatus.EXPECTED_FAILURE: NO_CONVERGENCE,
    RunStatus.BLEW_UP: BLEW_UP, RunStatus.FAILED: BLEW_UP, RunStatus.TIMED_OUT: TIMEOUT,
}  # fmt: skip
POWER_COLUMNS = ("y", "levels", "least", "largest", "power", "uncertainty")
BORDER_COLUMNS = ("y", "below", "above", "verdict_below", "verdict_above", "measured", "border", "theory")

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Cell:
    """A place on the map and what decides it."""

    x: Any
    y: Any
    change: dict[str, Any]
    bisected: bool = False


def map_folder(out: Path, case: Case) -> Path:
    """Where the tables of a case's maps lie."""
    return out / "maps" / case.name / case.tier


@reading_once()
def make_maps(
    case: Case, options: Options, names: Sequence[str] = (), tell: Tell = lambda line: None, record: bool = False
) -> list[Path]:
    """Run what is not finished, judge every cell, bisect the borders, write the tables of the named maps.

    record : keep them beside the case too

    Raises
    ------
    StudyError : no such map, probe, border or metric. CaseError : the case itself is not valid.
    JudgeError : maps of runs that were made by code that is not committed are to be recorded.
    """
    studies = [MapStudy(case, name, options) for name in chosen_tables(case, "maps", names)]
    todo = [job for study in studies for job in study.jobs(study.cells)]
    if record:
        require_committed_runs(todo, options.out)
    warning = announce(forecast(todo, options.at_once), f"The maps of {case.name}")
    if warning:
        tell(warning)
    files = [study.make(tell) for study in studies]
    if record:
        kept = [keep(case, "maps", file, study.jobs(study.cells)) for study, file in zip(studies, files, strict=True)]
        tell("\n".join(f"Recorded: {file}" for file in kept))
    return files


def _at(history: pd.DataFrame, row: int = -1) -> dict[str, Any]:
    return {"step": int(history["step"].iloc[row]), "u": float(history["u"].iloc[row])} if len(history) else {}


def _torn(history: pd.DataFrame, fraction: float) -> int | None:
    """First row at which the force is gone although it has grown with u before and nothing is broken."""
    force, growing = history["F"].abs(), history["u"].abs().is_monotonic_increasing
    gone = (force < fraction * force.cummax()) & (history["c_min"].cummin() > WHOLE)
    return int(gone.to_numpy().argmax()) if growing and gone.any() else None


def _fault(job: Job) -> str | None:
    """Why the case of a job is no valid one."""
    try:
        job.case()
    except CaseError as error:
        return str(error)
    return None


def powers(table: pd.DataFrame) -> pd.DataFrame:
    """Least and largest error of each row of a map, and the power of x that fits its errors, with its standard error.

    A fit needs three cells with an error at positive numbers.
    """
    from scipy.stats import linregress

    rows = []
    for y, row in table[table["error"] > 0.0].groupby("y", sort=False):
        fit: tuple[float, float] = (math.nan, math.nan)
        if len(row) > 2 and pd.api.types.is_numeric_dtype(pd.Series(list(row["x"]))) and row["x"].min() > 0.0:
            line = linregress(np.log(row["x"].astype(float)), np.log(row["error"]))
            fit = float(line.slope), float(line.stderr)
        rows.append((y, len(row), row["error"].min(), row["error"].max(), *fit))
    return pd.DataFrame(rows, columns=list(POWER_COLUMNS))


class MapStudy:
    """One map of a case: its cells, and what is said of them."""

    def __init__(self, case: Case, name: str, options: Options) -> None:
        self.case, self.name, self.options = case, name, options
        self.map: Map = case.maps[name]
        self._require_known("probe", self.map.probe, PROBES)
        for border in self.map.borders:
            self._require_known("borders", border, BORDERS)
        if self.map.judged and self.map.judged.metric not in METRICS:
            raise StudyError(f"{self._place('judged.metric')}: {self.map.judged.metric!r} is no metric of one run.")

    def _place(self, key: str) -> str:
        return f"{self.case.source}: maps.{self.name}.{key}"

    def _require_known(self, key: str, name: str | None, known: dict[str, Any]) -> None:
        if name is not None and name not in known:
            raise StudyError(f"{self._place(key)}: {name!r} is not known; choose one of {', '.join(known)}.")

    # ---- cells

    @cached_property
    def cells(self) -> list[Cell]:
        """One for each pair of levels."""
        return [
            Cell(x, y, merge(merge(self.map.change, x_change), y_change))
            for y, y_change in zip(coordinates(self.map.y), level_changes(self.map.y), strict=True)
            for x, x_change in zip(coordinates(self.map.x), level_changes(self.map.x), strict=True)
        ]

    def job(self, cell: Cell) -> Job | None:
        """The run of a cell; None for a probe and for a cell that is no valid case."""
        if self.map.run is None:
            return None
        job = self._job(cell)
        return job if _fault(job) is None else None

    def _job(self, cell: Cell) -> Job:
        tables = {key: value for key, value in cell.change.items() if key not in (RUN, REACHED.partition(".")[0])}
        label = f"{self.name} x={text_of(cell.x)} y={text_of(cell.y)}"
        run = str(cell.change.get(RUN, self.map.run))
        return Variation(label, run, tables).job(self.case, self.options, self.map.timeout)

    def jobs(self, cells: Sequence[Cell]) -> list[Job]:
        """The runs of cells, and the one that they are judged against."""
        jobs = [job for job in map(self.job, cells) if job is not None]
        return [*jobs, self._reference()] if jobs and self.map.reference is not None else jobs

    def _reference(self) -> Job:
        change = merge(self.map.change, self.map.reference or {})
        return Variation(f"{self.name} reference", str(self.map.run), change).job(self.case, self.options)

    # ---- verdicts

    def verdict(self, cell: Cell) -> Verdict:
        """What is said of a cell whose run is done."""
        if self.map.probe is not None:
            return self._judged_probe(PROBES[self.map.probe](self.case, **cell.change))
        job = self._job(cell)
        fault = _fault(job)
        if fault is not None:
            return Verdict(NOT_POSSIBLE, reason=fault)
        run = finished_run(job)
        if run is None:
            return Verdict(BLEW_UP, reason="the run left no result")
        return self._verdict_of_run(run, cell)

    def _verdict_of_run(self, run: RunFolder, cell: Cell) -> Verdict:
        info, counters = run.info, run.info["counters"]
        wanted = cell.change.get("history", {}).get("u")
        history = run.history if wanted is None else run.history[run.history["u"] <= wanted * (1.0 + 1e-9)]
        told: dict[str, Any] = {
            "reason": info["reason"], "seconds": info["seconds"].get("total", math.nan),
            "newton": int(counters.get("newton", 0)), "iterations": int(counters.get("gmres_iterations", 0)),
        }  # fmt: skip
        if run.case.rocking is not None and info["status"].good:
            return self._becomes(run, _at(history) | told)
        torn = _torn(history, run.case.load.broken_fraction)
        if torn is not None:
            why = {"reason": "the force is gone, nothing broke"}
            return Verdict(NUMERICAL_FRACTURE, **_at(history, torn), **(told | why))
        if len(history) == len(run.history) and info["status"] in VERDICTS:
            return Verdict(VERDICTS[info["status"]], **_at(history), **told)
        told["reason"] = "" if wanted is not None else told["reason"]
        drift = self._drift(history)
        if drift is not None:
            why = {"reason": f"energy drift above {self.map.drift:g} of work and energy"}
            return Verdict(DRIFT, **_at(history, drift), **(told | why))
        return self._judged_run(run, _at(history) | told)

    def _becomes(self, run: RunFolder, told: dict[str, Any]) -> Verdict:
        """What becomes of the body that rocks."""
        try:
            return Verdict(str(verdict_on(run)), **(told | {"reason": ""}))
        except NO_VALUE as problem:
            return Verdict(NOT_POSSIBLE, **(told | {"reason": str(problem)}))

    def _drift(self, history: pd.DataFrame) -> int | None:
        """First step at which more than allowed of the work and of the energy at the start became no energy."""
        if self.map.drift is None:
            return None
        energy = history[["E_el", "E_frac", "E_kin"]].sum(axis=1)
        work = history["W_ext"] - history["W_ext"].iloc[0]
        lost = (work - (energy - energy.iloc[0])).abs()
        above = (lost > self.map.drift * (work.abs().max() + energy.iloc[0])).to_numpy()
        return int(above.argmax()) if above.any() else None

    def _judged_run(self, run: RunFolder, told: dict[str, Any]) -> Verdict:
        judged = self.map.judged
        if judged is None:
            return Verdict(STABLE, **told)
        try:
            metric = find_metric(judged.metric)
            value = metric(run, **judged.parameters)
            error = metric.error(value, self._target(judged, run), judged.measure)
        except NO_VALUE as problem:
            return Verdict(NOT_POSSIBLE, **(told | {"reason": str(problem)}))
        return Verdict(self._accuracy(error), value=value, error=error, **told)

    def _target(self, judged: Judged, run: RunFolder) -> float | None:
        if self.map.reference is not None:
            reference = finished_run(self._reference())
            if reference is None:
                raise ValueError("the map's reference left no result")
            return find_metric(judged.metric)(reference, **judged.parameters)
        check = check_of(
            judged.metric, run.info["run"], judged.against, measure=judged.measure, parameters=judged.parameters
        )
        return target_of(check, self.case, lambda _: run)

    def _judged_probe(self, verdict: Verdict) -> Verdict:
        if self.map.judged is None or not math.isfinite(verdict.error):
            return verdict
        return Verdict(**(asdict(verdict) | {"verdict": self._accuracy(verdict.error)}))

    def _accuracy(self, error: float) -> str:
        assert self.map.judged is not None
        return accuracy(error, self.map.judged.within)

    # ---- the map

    def make(self, tell: Tell) -> Path:
        """Do what is not finished, bisect, and write the tables; returns the first."""
        table = self._decided(self.cells, tell)
        for _ in range(self.map.bisections):
            table = pd.concat([table, self._decided(self._between(table), tell)], ignore_index=True)
        folder = map_folder(self.options.out, self.case)
        table = table.assign(state=state_of(self.case, self.map))
        for ending, part in {"": table, "-borders": self._borders(table), "-powers": powers(table)}.items():
            write_table(folder / f"{self.name}{ending}.csv", part)
        return folder / f"{self.name}.csv"

    def _decided(self, cells: Sequence[Cell], tell: Tell) -> pd.DataFrame:
        """A row for each cell, its run done."""
        run_all(self.jobs(cells), self.options, lambda outcome: tell(f"{outcome.title}: {outcome.line}"))
        rows = [{"x": c.x, "y": c.y, "bisected": c.bisected, **asdict(self.verdict(c))} for c in cells]
        return pd.DataFrame(rows, columns=["x", "y", "bisected", *(f.name for f in fields(Verdict))])

    def _changes(self, table: pd.DataFrame) -> Iterator[tuple[Any, pd.Series, pd.Series]]:
        """y and the rows below and above, wherever the verdict changes along x."""
        for y in dict.fromkeys(table["y"]):
            row = table[table["y"] == y]
            if not pd.api.types.is_numeric_dtype(pd.Series(list(row["x"]))):
                continue
            row = row.sort_values("x")
            for number in range(len(row) - 1):
                if row["verdict"].iloc[number] != row["verdict"].iloc[number + 1]:
                    yield y, row.iloc[number], row.iloc[number + 1]

    def _between(self, table: pd.DataFrame) -> list[Cell]:
        """Cells halfway between neighbours of different verdicts; none where x cannot be divided or is read off a run."""
        if len(self.map.x) > 1 or REACHED in self.map.x:
            return []
        key, rows = next(iter(self.map.x)), dict(zip(coordinates(self.map.y), level_changes(self.map.y), strict=True))
        whole = all(isinstance(value, int) for value in self.map.x[key])
        cells = []
        for y, below, above in self._changes(table):
            x = self._middle(float(below["x"]), float(above["x"]), whole)
            if x not in (below["x"], above["x"]):
                change = merge(merge(self.map.change, nest(key, x)), rows[y])
                cells.append(Cell(x, y, change, bisected=True))
        return cells

    def _middle(self, low: float, high: float, whole: bool) -> float:
        middle = math.sqrt(low * high) if self.map.logarithmic and low > 0.0 else 0.5 * (low + high)
        # few digits, so that the same border is bisected at the same places
        return int(middle) if whole else float(f"{middle:.6g}")

    def _borders(self, table: pd.DataFrame) -> pd.DataFrame:
        """Where the verdict changes in each row, and where the theory has the border."""
        rows = []
        for y, below, above in self._changes(table):
            measured = self._middle(float(below["x"]), float(above["x"]), whole=False)
            if REACHED in self.map.x and below["x"] < above["u"] <= above["x"]:
                measured = above["u"]
            told = (y, below["x"], above["x"], below["verdict"], above["verdict"], measured)
            rows.append((*told, *self._theory(y, table, below["verdict"], above["verdict"])))
        return pd.DataFrame(rows, columns=list(BORDER_COLUMNS))

    def _theory(self, y: Any, table: pd.DataFrame, below: str, above: str) -> tuple[str, float]:
        """Name and place of the border that should part these two verdicts."""
        jobs = [self.job(cell) for cell in self.cells if cell.y == y]
        job = next((job for job in jobs if job is not None), None)
        for name in self.map.borders:
            border = BORDERS[name]
            if isinstance(border, RigidBlock):
                assert job is not None
                return name, border.between(job.case(), below, above)
            sides = border.inside(below, self.map), border.inside(above, self.map)
            if None not in sides and sides[0] != sides[1]:
                case = job.case() if job else self.case
                return name, border.position(case, self.map, table[table["y"] == y])
        return "", math.nan
