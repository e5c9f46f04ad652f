"""What charts, maps and prices share: variations of a case, run as ordinary run folders, and what they cost."""

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from cases import Case, Check
from cases.errors import UserError
from cases.judging import merge
from cases.studies import Chart, Levels, Map, coordinates, level_changes
from verify.metrics.curves import CurveError
from verify.metrics.metric import MetricError
from verify.planning.plan import expected_seconds
from verify.runs.cluster import worker_count
from verify.runs.jobs import Job, Outcome, outcomes
from verify.runs.provenance import source_hash
from verify.runs.run_folder import RunFolder, RunFolderError

#: a study that will take longer says so before it starts [s]
LONG = 600.0
#: what a metric may raise where a run does not give it
NO_VALUE = (MetricError, CurveError, RunFolderError, ValueError)
#: before what a table says that was made with another case or code
MADE_BEFORE = "Made with another state of case or code:"


class StudyError(UserError):
    """A study cannot be made; its text is one sentence with place, value and remedy."""


def chosen_tables(case: Case, key: str, names: Sequence[str]) -> list[str]:
    """The names of a case's charts or maps (``key``) that are asked for, all of them without.

    Raises
    ------
    StudyError : one of them is not in the case, or the case has none at its tier
    """
    tables, one = getattr(case, key), key.removesuffix("s")
    for name in names:
        if name not in tables:
            known = ", ".join(tables) or "none"
            raise StudyError(f"{case.source}: {key}.{name} is not a {one} of this case; it has: {known}.")
    if not tables:
        raise StudyError(f"{case.source}: {key!r} has no {one} at tier {case.tier!r}; add a table [{key}.NAME].")
    return list(names) or list(tables)


@dataclass(frozen=True)
class Options:
    """How the runs of a study are done: so many at a time, each on so many threads.

    cluster : address of a Dask scheduler whose workers do the runs, in place of processes of this machine
    """

    out: Path
    jobs: int = 1
    threads: int = 1
    cluster: str | None = None

    @cached_property
    def at_once(self) -> int:
        """Runs at the same time."""
        return self.jobs if self.cluster is None else worker_count(self.cluster)


@dataclass(frozen=True)
class Variation:
    """A run of the case with tables laid over it, and what it is called in the study."""

    label: str
    run: str
    change: dict[str, Any] = field(default_factory=dict)
    at: Any = None

    def job(self, case: Case, options: Options, timeout: float | None = None) -> Job:
        """The run to do."""
        return Job(
            case.source, case.name, self.run, case.tier, options.out, options.threads,
            resume=True, change=self.change, timeout=timeout, failures_count=timeout is not None, label=self.label,
        )  # fmt: skip


def variations(label: str, run: str, change: dict[str, Any], levels: Levels) -> list[Variation]:
    """One for each level, called by the first key's value."""
    short = next(iter(levels)).rpartition(".")[2]
    return [
        Variation(f"{label} {short}={text_of(at)}", run, merge(change, level), at)
        for at, level in zip(coordinates(levels), level_changes(levels), strict=True)
    ]


def state_of(case: Case, study: Chart | Map) -> str:
    """16 hexadecimal digits that stand for case, chart or map, and code: tables with others were made before."""
    parts = (case.hash(), study.model_dump_json(), source_hash())
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


def is_of_state(table: pd.DataFrame, state: str) -> bool:
    """Whether a table of a chart or map was made with the case and code as they stand."""
    return "state" in table and bool((table["state"] == state).all())


def text_of(value: Any) -> str:
    """A coordinate in few letters."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def forecast(todo: Iterable[Job], jobs: int) -> float:
    """Seconds that the jobs will take, as they are planned; what is finished takes none."""
    cases = [(job.case(), job.run) for job in todo if job.finished() is None]
    return sum(expected_seconds(case, run) for case, run in cases) / jobs


def announce(seconds: float, what: str) -> str:
    """A sentence for what takes long; empty for what does not."""
    if seconds <= LONG:
        return ""
    return f"{what} will take about {seconds / 60:.0f} minutes; what is finished is kept if you stop it."


def run_all(todo: Sequence[Job], options: Options, tell: Callable[[Outcome], None]) -> None:
    """Do the jobs that are not finished, each computation once."""
    distinct = {job.folder(): job for job in todo}
    for outcome in outcomes(list(distinct.values()), options.jobs, options.cluster):
        tell(outcome)


def finished_run(job: Job) -> RunFolder | None:
    """The folder of a job that has been done for the case and code as they stand."""
    return job.finished()


def counted_unknowns(run: RunFolder) -> int:
    """Unknowns of displacement and phase field."""
    counters = run.info.get("counters", {})
    return int(counters.get("unknowns_displacement", 0) + counters.get("unknowns_phase_field", 0))


def counted_work(run: RunFolder) -> float:
    """What no clock can disturb: points times steps in time, else unknowns times iterations.

    The iterations are summed over displacement and phase field.
    """
    counters = run.info.get("counters", {})
    if "steps" in counters:
        return float(counters["points"] * counters["steps"])
    newton = counters.get("newton", run.history["newton"].sum())
    work = counters.get("unknowns_displacement", 0) * newton
    return float(work + counters.get("unknowns_phase_field", 0) * run.history["staggered"].sum())


def processor_seconds(run: RunFolder) -> float:
    """Processor time of the solution, compilation apart; on an idle machine and one thread, its duration."""
    return float(run.info["seconds"]["processor"])


def check_of(metric: str, run: str, against: str, **more: Any) -> Check:
    """A check as a case file would have it, for the functions that evaluate checks."""
    return Check(metric=metric, run=run, against=against, limit=0.0, reason="a study", **more)
