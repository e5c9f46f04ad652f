"""Charts and maps of record: their tables kept beside the case, with where they come from; every report shows them.

They lie in ``charts/TIER`` and ``maps/TIER`` of the case's folder, as the commands leave them in their output folder;
the first table of each has the columns `PROVENANCE` besides.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from cases import Case, load_case
from cases.judging import TIERS
from verify.judging.acceptance import require_committed
from verify.runs.atomic import write_table
from verify.runs.jobs import Job
from verify.runs.provenance import code_version, processor_name
from verify.studies.study import MADE_BEFORE, finished_run, is_of_state, state_of

PROVENANCE = ("date", "tier", "version", "processor")
Kind = Literal["charts", "maps"]


def require_committed_runs(todo: Sequence[Job], folder: Path) -> None:
    """Before anything is run: of what is finished the code that made it counts, else the code as it stands.

    folder : of what needs no run. Raises JudgeError for code that is not committed.
    """
    for version, place in [(code_version(), folder)] if not todo else _versions(todo):
        require_committed(version, place)


def _versions(todo: Sequence[Job]) -> Iterator[tuple[str, Path]]:
    for job in todo:
        run = finished_run(job)
        yield run.info["code_version"] if run else code_version(), job.folder()


def record(case: Case, kind: Kind, file: Path, todo: Sequence[Job]) -> Path:
    """Keep the tables of a chart or map beside its case, in place of older ones of its tier; returns the first.

    file : its first table. todo : its runs, none of a probe.
    """
    runs = [run for run in map(finished_run, todo) if run is not None]
    told: dict[str, Any] = {"date": date.today().isoformat(), "tier": case.tier}
    told["version"] = ", ".join(sorted({run.info["code_version"] for run in runs})) or code_version()
    told["processor"] = ", ".join(sorted({run.info["processor"] for run in runs})) or processor_name()
    kept = case.kept_folder / kind / case.tier / file.name
    for part in file.parent.glob(f"{file.stem}-*.csv"):
        write_table(kept.with_name(part.name), pd.read_csv(part))
    # where a run lay tells nobody else anything
    write_table(kept, pd.read_csv(file).drop(columns="folder", errors="ignore").assign(**told))
    return kept


@dataclass(frozen=True)
class Made:
    """A chart or map that has been made: its first table, and its case at the table's tier."""

    kind: Kind
    name: str
    file: Path
    case: Case

    @property
    def study(self) -> Any:
        """The chart or map as the case describes it."""
        return getattr(self.case, self.kind)[self.name]

    def note(self) -> str:
        """Where a record comes from; of any table whether case or code have changed since. Empty if all is as it was."""
        table = pd.read_csv(self.file)
        current = is_of_state(table, state_of(self.case, self.study))
        if not set(PROVENANCE) <= set(table):
            return "" if current else MADE_BEFORE
        when, tier, version, processor = table[list(PROVENANCE)].iloc[0]
        said = f"Recorded on {when} at tier {tier} by version {version} on {processor}."
        return said if current else f"{said} The case or the code has changed since."


def made_of(case: Case, kind: Kind, out: Path) -> list[Made]:
    """The charts or maps of a case to be shown: of its tier those in ``out``, else records, else those of the finest."""
    return [made for name in getattr(case, kind) if (made := _made(case, kind, name, out))]


def _made(case: Case, kind: Kind, name: str, out: Path) -> Made | None:
    fresh = out / kind / case.name / case.tier / f"{name}.csv"
    if fresh.is_file():
        return Made(kind, name, fresh, case)
    for tier in dict.fromkeys((case.tier, *reversed(TIERS))):
        file = case.kept_folder / kind / tier / f"{name}.csv"
        if file.is_file():
            return Made(kind, name, file, load_case(case.source, tier))
    return None
