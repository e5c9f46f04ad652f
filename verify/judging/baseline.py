"""Accepted values of our own, kept beside the case file, against which later versions are held."""

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from cases import Case, Check
from verify.judging.targets import JudgeError
from verify.runs.atomic import write_text

BASELINE_FILE = "baseline.csv"
#: what a value is of: tier, run, metric, parameters
Key = tuple[str, str, str, str]


@dataclass(frozen=True)
class BaselineRow:
    """One accepted value.

    parameters : of the metric, as JSON; empty without. version : of the code that made the run.
    """

    tier: str
    run: str
    metric: str
    parameters: str
    value: float
    unit: str
    reason: str
    version: str
    date: str

    @property
    def key(self) -> Key:
        """What the value is of."""
        return (self.tier, self.run, self.metric, self.parameters)


BASELINE_COLUMNS = tuple(field.name for field in fields(BaselineRow))


def parameters_text(check: Check) -> str:
    """A check's parameters as JSON in the order of their names; empty without."""
    return json.dumps(check.parameters, sort_keys=True) if check.parameters else ""


def key_of(check: Check, case: Case) -> Key:
    """Key of the row that a check of a case at its tier is held against."""
    return (case.tier, check.run, check.metric, parameters_text(check))


def baseline_file(case: Case) -> Path:
    """The baseline beside the case file."""
    return case.kept_folder / BASELINE_FILE


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


def write_baseline(case: Case, rows: Sequence[BaselineRow]) -> None:
    """Replace the file as a whole."""
    text = io.StringIO()
    writer = csv.DictWriter(text, BASELINE_COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(vars(row) | {"value": repr(row.value)} for row in rows)
    write_text(baseline_file(case), text.getvalue())
