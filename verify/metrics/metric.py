"""What a metric is, what it needs of a run, and the list in which each stands beside its own function."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar

import numpy as np
import pandas as pd

from cases.errors import UserError

if TYPE_CHECKING:
    from cases import Case

#: what a metric is a function of: a run, a run and its reference, the runs of a sweep
Of = Literal["run", "pair", "sweep"]
Function = TypeVar("Function", bound=Callable[..., float])
#: periods of angles [degree]: of a line, which has no sense, and of a direction
LINE, DIRECTION = 180.0, 360.0


class MetricError(UserError, ValueError):
    """A metric that a run cannot give; the message is one sentence: metric or run, what is wrong, remedy."""


class NothingToCompareError(MetricError):
    """A value and its target are both zero, of which no relative error can be taken."""


class NotGivenError(MetricError):
    """A run does not hold what a metric is taken from: a result from elsewhere need not have everything."""


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
    def nearest(self, u: float) -> float: ...
    def __hash__(self) -> int: ...


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_list(value: Any) -> bool:
    return isinstance(value, list | tuple) and all(map(_is_number, value))


#: how a parameter is written in a metric's function -> what it is called, and whether a value is that
KINDS_OF_PARAMETERS: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "str": ("text", lambda value: isinstance(value, str)),
    "float": ("number", _is_number),
    "float | None": ("number", _is_number),
    "Sequence[float]": ("list of numbers", _is_list),
    "Sequence[float] | None": ("list of numbers", _is_list),
}


@dataclass(frozen=True)
class Metric:
    """A named scalar.

    unit : kind of quantity as in ``cases.units`` ("force", "length", "number", ..), or "degree".
    meaning : one line for reports. function : of a run, of a run and its reference, or of a list of runs.
    period : by which values of it are the same, 0 without.
    """

    name: str
    unit: str
    meaning: str
    function: Callable[..., float]
    of: Of = "run"
    period: float = 0.0

    def __call__(self, *runs: Any, **parameters: Any) -> float:
        """Value of the metric; MetricError for parameters that it does not have or lacks, or for no value."""
        try:
            inspect.signature(self.function).bind(*runs, **parameters)
        except TypeError as error:
            known = ", ".join(self.parameters) or "none"
            raise MetricError(f"metric {self.name}: {error}; its parameters are: {known}") from None
        value = float(self.function(*runs, **parameters))
        if not math.isfinite(value):
            # of a result from elsewhere that does not hold what it is taken from
            kind = NotGivenError if math.isnan(value) else MetricError
            raise kind(f"metric {self.name}: has no finite value for this run; look at its history")
        return value

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters that a check may give."""
        return [
            parameter.name
            for parameter in inspect.signature(self.function).parameters.values()
            if parameter.kind is inspect.Parameter.KEYWORD_ONLY
        ]

    @property
    def needed_parameters(self) -> list[str]:
        """Names of the parameters that a check must give."""
        given = inspect.signature(self.function).parameters
        return [name for name in self.parameters if given[name].default is inspect.Parameter.empty]

    def kind_of(self, parameter: str) -> tuple[str, Callable[[Any], bool]]:
        """What a parameter is called, and whether a value is that; any is where the function writes it otherwise."""
        written = inspect.signature(self.function).parameters[parameter].annotation
        name = written if isinstance(written, str) else getattr(written, "__name__", "")
        return KINDS_OF_PARAMETERS.get(name, ("value", lambda value: True))

    def error(self, value: float, target: float | None, kind: str) -> float:
        """Distance of a value from its target, "absolute" or "relative"; without a target its size.

        Relative to a target of zero it is infinite.

        Raises
        ------
        NothingToCompareError : value and target are both zero, and the error is relative.
        """
        if target is None:
            return abs(value)
        difference = abs(value - target)
        if self.period:
            difference = min(difference % self.period, -difference % self.period)
        if kind == "absolute":
            return difference
        if target == 0.0:
            if value == 0.0:
                raise NothingToCompareError(
                    f"metric {self.name}: value and target are both zero, which shows nothing; "
                    "judge where there is a value, or the absolute error"
                )
            return math.inf
        return difference / abs(target)


#: all metrics by their names
REGISTERED: dict[str, Metric] = {}


def metric(
    unit: str, meaning: str, *, of: Of = "run", period: float = 0.0, name: str = ""
) -> Callable[[Function], Function]:
    """Enter the function below into the list of metrics, by its own name if no other is given.

    Its keyword-only arguments are the parameters that a check may give. unit, meaning, of, period : as in `Metric`.
    """

    def register(function: Function) -> Function:
        called = name or function.__name__
        if called in REGISTERED:
            raise ValueError(f"two metrics are called {called!r}")
        REGISTERED[called] = Metric(called, unit, meaning, function, of, period)
        return function

    return register


def run_name(run: RunData) -> str:
    """What messages call a run."""
    return f"run {run.info.get('run', '')}".strip()


def require_stored(run: RunData, u: float, wanted: float) -> None:
    """Raise MetricError where fields of u are not those of a wanted displacement, in dynamics of a time.

    They are within an increment, or the time between two records.
    """
    if run.case.dynamics is None:
        near, key, kept_in = max(run.case.load.increments, default=1e-9 * abs(wanted)), "u", "output.snapshots"
    else:
        near, key, kept_in = float(np.diff(history_column(run, "time")).max(initial=0.0)), "t", "output.times"
    if abs(u - wanted) > near:
        said = f"has no fields at {key} = {wanted:g}, the nearest are of {key} = {u:g}"
        raise MetricError(f"{run_name(run)}: {said}; add {wanted:g} to {kept_in}, or name another {key}")


def history_column(run: RunData, name: str) -> np.ndarray:
    """A column (n,) of the run's history; NotGivenError where it has none or no number in it."""
    if name not in run.history or run.history[name].isna().all():
        known = ", ".join(str(column) for column in run.history if run.history[column].notna().any())
        raise NotGivenError(f"{run_name(run)}: its history has no values of {name}; it has {known or 'no rows'}")
    return run.history[name].to_numpy(dtype=float)


def whole_column(run: RunData, name: str) -> np.ndarray:
    """A column (n,) of the run's history with a number in each row; NotGivenError where some row has none."""
    values = history_column(run, name)
    if missing := int(np.isnan(values).sum()):
        raise NotGivenError(f"{run_name(run)}: its history has no {name} in {missing} of {len(values)} rows")
    return values
