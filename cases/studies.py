"""Tables of a case that vary it on purpose: charts of accuracy against cost, maps of where a method fails."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from cases.errors import BrokenRuleError
from cases.judging import Parameter, merge, nest
from cases.table import Name, Switch, Table, Whole, require_one
from cases.units import Number

Tables = dict[str, Any]
#: levels of a map that are not keys of the case: the run itself, and a displacement that a run must reach
RUN, REACHED = "run", "history.u"


def _equally_many(levels: dict[str, tuple[Any, ...]]) -> dict[str, tuple[Any, ...]]:
    counts = {key: len(values) for key, values in levels.items()}
    if len(set(counts.values())) != 1:
        said = ", ".join(f"{key}: {count}" for key, count in counts.items()) or "no key"
        raise BrokenRuleError(f"has not equally many values of each key ({said})", "give as many of each")
    return levels


def _as_list(value: Any) -> Any:
    return [value] if isinstance(value, int | float) else value


#: dotted key -> values; level n takes the n-th value of every key, and the first key is the coordinate
Levels = Annotated[
    dict[str, Annotated[tuple[Any, ...], Field(min_length=1)]],
    Field(min_length=1),
    AfterValidator(_equally_many),
]


def level_changes(levels: dict[str, tuple[Any, ...]]) -> list[Tables]:
    """The tables that each level lays over the case."""
    count = len(next(iter(levels.values())))
    changes: list[Tables] = [{} for _ in range(count)]
    for key, values in levels.items():
        changes = [merge(change, nest(key, value)) for change, value in zip(changes, values, strict=True)]
    return changes


def coordinates(levels: dict[str, tuple[Any, ...]]) -> list[Any]:
    """What each level is called and drawn at: the first key's values, of lists the last entry."""
    return [value[-1] if isinstance(value, list | tuple) and value else value for value in next(iter(levels.values()))]


def _coordinate(levels: dict[str, tuple[Any, ...]]) -> tuple[str, list[Any]]:
    return next(iter(levels)), coordinates(levels)


def _three_numbers(levels: dict[str, tuple[Any, ...]]) -> dict[str, tuple[Any, ...]]:
    at = coordinates(levels)
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) and value > 0 for value in at)
    if not numbers or len(set(at)) < 3:
        raise BrokenRuleError("cannot be extrapolated", "give three or more different positive numbers")
    return levels


class Varied(Table):
    """A run of the case with tables laid over it, level by level.

    Attributes
    ----------
    run : whose case is changed; of a sweep one run by its whole name
    change : tables merged over that run's, before those of the levels
    """

    run: str
    change: Tables = Field(default_factory=dict)
    levels: Levels

    def varied_keys(self) -> list[str]:
        """Dotted keys that differ from level to level."""
        return list(self.levels)


class ChartedMetric(Table):
    """A metric whose error is charted, with its parameters.

    value : what it is exactly; left out, the chart's reference or the case's exact solution tells
    """

    metric: Name
    value: Number | None = None
    parameters: dict[str, Parameter] = Field(default_factory=dict)


class Ladder(Varied):
    """Runs that differ by their levels, the cheapest first."""


class Finest(Varied):
    """Runs of which the last is finer than every contestant, in order of refinement; the limit is extrapolated.

    order : of convergence in the levels' first key; one where a crack is as wide as an element
    """

    levels: Annotated[Levels, AfterValidator(_three_numbers)]
    order: Annotated[Number, Field(gt=0)] = 1.0


class Chart(Table):
    """Error in checked quantities against cost.

    Attributes
    ----------
    change : tables merged over those of every run of the chart
    reference : what the errors are measured from; left out where the case has an exact solution
    targets : errors for which the chart says what to choose
    """

    title: str = ""
    change: Tables = Field(default_factory=dict)
    quantities: Annotated[tuple[ChartedMetric, ...], Field(min_length=1)]
    reference: Finest | None = None
    ladders: Annotated[dict[Name, Ladder], Field(min_length=1)]
    targets: Annotated[tuple[Annotated[Number, Field(gt=0)], ...], Field(min_length=1)] = (0.05, 0.01, 0.002)

    @model_validator(mode="after")
    def _reference_is_finest(self) -> Chart:
        if self.reference is None:
            return self
        key, values = _coordinate(self.reference.levels)
        for name, ladder in self.ladders.items():
            other, contestants = _coordinate(ladder.levels)
            direction = values[0] > values[-1]
            if other != key:
                continue
            numbers = all(isinstance(value, int | float) for value in contestants)
            if not numbers or any((values[-1] < value) != direction for value in contestants):
                raise BrokenRuleError(
                    f"is not finer than every level of '{name}'", "refine it further", f"reference.levels.{key}"
                )
        return self


class Judged(Table):
    """What decides whether a cell of a map is accurate.

    Attributes
    ----------
    against : as in a check, or "run" for the map's reference
    within : errors allowed, the smallest first; a single number stands for itself
    """

    metric: Name
    against: str
    measure: Literal["relative", "absolute"] = "relative"
    within: Annotated[tuple[Annotated[Number, Field(gt=0)], ...], BeforeValidator(_as_list), Field(min_length=1)]
    parameters: dict[str, Parameter] = Field(default_factory=dict)


class Map(Table):
    """A verdict for every pair of two levels, and where it changes.

    Attributes
    ----------
    run, change : what is run in every cell; or
    probe : name of a measurement that needs no run, with the levels' keys as its parameters
    judged : accuracy asked of a run that ends well
    reference : tables laid over the map's own; judged.against = "run" then means the run that they give
    drift : share of the work that may become no energy before a cell counts as "energy drift"
    borders : names of the theories whose borders are drawn
    bisections : of x between neighbours with different verdicts
    timeout : seconds after which a cell is given up
    """

    title: str = ""
    run: str | None = None
    probe: Name | None = None
    change: Tables = Field(default_factory=dict)
    x: Levels
    y: Levels
    judged: Judged | None = None
    drift: Annotated[Number, Field(gt=0)] | None = None
    reference: Tables | None = None
    borders: tuple[Name, ...] = ()
    bisections: Annotated[Whole, Field(ge=0, le=20)] = 0
    timeout: Annotated[Number, Field(gt=0)] = 120.0
    logarithmic: Switch = True

    @model_validator(mode="after")
    def _measures_one_thing(self) -> Map:
        require_one(self, "way to measure", ("run", "probe"))
        if (self.reference is not None) != (self.judged is not None and self.judged.against == "run"):
            raise BrokenRuleError("needs judged.against = 'run', and that a reference", "give both or none", "reference")
        return self

    def varied_keys(self) -> list[str]:
        """Dotted keys that differ from cell to cell."""
        return [key for key in (*self.x, *self.y) if key not in (RUN, REACHED)]
