"""What is prescribed over time, or over the load parameter: rows of a table in the case or in a file beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, ValidationInfo

from cases.errors import BrokenRuleError
from cases.files import existing_file, read_curve

Rows = tuple[tuple[float, float], ...]


def _rows_or_file(value: Any, info: ValidationInfo) -> Any:
    """Rows as they stand, or the absolute path of a file."""
    if isinstance(value, str | Path):
        return existing_file(Path(value), info, "a CSV file")
    if not isinstance(value, list | tuple):
        raise BrokenRuleError("is not a table", "write [[time, value], ...] or the name of a CSV file", value=value)
    for number, row in enumerate(value):
        right = isinstance(row, list | tuple) and len(row) == 2
        if not right or not all(isinstance(x, int | float) and not isinstance(x, bool) and np.isfinite(x) for x in row):
            raise BrokenRuleError(f"has no two finite numbers in row {number + 1}", "write [[time, value], ...]")
    return tuple((float(time), float(amount)) for time, amount in value)


CourseTable = Annotated[Rows | Path, BeforeValidator(_rows_or_file, json_schema_input_type=Rows | str)]


@dataclass(frozen=True, eq=False)
class Course:
    """A displacement over time, linear between rows, or the integral from the first row on of such a velocity.

    times, values : (n,), the times ascending. is_velocity : of the values.
    """

    times: NDArray[np.float64]
    values: NDArray[np.float64]
    is_velocity: bool

    @classmethod
    def of(cls, table: Rows | Path, columns: tuple[str, str], what: str) -> Course:
        """From rows, or from two columns of a file. Raises BrokenRuleError."""
        rows = read_curve(table, columns) if isinstance(table, Path) else np.array(table).reshape(-1, 2)
        if len(rows) < 2:
            raise BrokenRuleError("has fewer than two rows", "give two or more", "table")
        back = np.flatnonzero(np.diff(rows[:, 0]) <= 0.0)
        if len(back):
            text = f"has a time in row {back[0] + 2} that is not later than the one before"
            raise BrokenRuleError(text, "sort the rows by time, each time once", "table")
        return cls(rows[:, 0], rows[:, 1], what == "velocity")

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Course) or self.is_velocity != other.is_velocity:
            return False
        return np.array_equal(self.times, other.times) and np.array_equal(self.values, other.values)

    @property
    def moves(self) -> bool:
        """Some of its rows change the displacement."""
        return bool(np.any(self.values if self.is_velocity else np.diff(self.values)))

    def displacement(self, time: ArrayLike) -> NDArray[np.float64]:
        """Displacement at times; beyond the rows as at the nearest one [length]."""
        at = np.clip(time, self.times[0], self.times[-1])
        if not self.is_velocity:
            return np.interp(at, self.times, self.values)
        steps = 0.5 * (self.values[1:] + self.values[:-1]) * np.diff(self.times)
        row = np.clip(np.searchsorted(self.times, at, side="right") - 1, 0, len(steps) - 1)
        since = at - self.times[row]
        mean = 0.5 * (self.values[row] + np.interp(at, self.times, self.values))
        return np.concatenate([[0.0], np.cumsum(steps)])[row] + mean * since

    def rate(self, start: float, end: float) -> float:
        """Mean change of the displacement between two times."""
        return float(self.displacement(end) - self.displacement(start)) / (end - start)
