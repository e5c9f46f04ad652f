"""What a metric is, and what it needs of a run."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import pandas as pd

from cases.errors import UserError

if TYPE_CHECKING:
    from cases import Case


class MetricError(UserError, ValueError):
    """A metric that a run cannot give; the message is one sentence: metric or run, what is wrong, remedy."""


class RunData(Protocol):
    """What the metrics need of a finished run: its history, crack path, snapshots, case and run.json."""

    @property
    def history(self) -> pd.DataFrame: ...
    @property
    def crack_path(self) -> np.ndarray: ...
    @property
    def case(self) -> Case: ...
    @property
    def info(self) -> dict[str, Any]: ...
    def snapshots(self) -> Iterable[tuple[float, int, Any]]: ...
    def points(self, u: float | None = None) -> Any: ...
    def __hash__(self) -> int: ...


@dataclass(frozen=True)
class Metric:
    """A named scalar.

    unit : kind of quantity as in ``cases.units`` ("force", "length", "number", ..), or "degree".
    meaning : one line for reports. function : of a run, of a run and its reference, or of a list of runs.
    """

    name: str
    unit: str
    meaning: str
    function: Callable[..., float]

    def __call__(self, *runs: Any, **parameters: Any) -> float:
        """Value of the metric; MetricError for parameters that it does not have or lacks, or for no value."""
        try:
            inspect.signature(self.function).bind(*runs, **parameters)
        except TypeError as error:
            known = ", ".join(self.parameters) or "none"
            raise MetricError(f"metric {self.name}: {error}; its parameters are: {known}") from None
        value = float(self.function(*runs, **parameters))
        if not math.isfinite(value):
            raise MetricError(f"metric {self.name}: has no finite value for this run; look at its history")
        return value

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters that a check may give."""
        return [
            parameter.name
            for parameter in inspect.signature(self.function).parameters.values()
            if parameter.kind is inspect.Parameter.KEYWORD_ONLY
        ]
