"""Tables of a case that say how its results are judged: runs, references, checks."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from cases.errors import BrokenRuleError
from cases.files import existing_file, read_curve, with_parts
from cases.foreign_fields import ForeignFields
from cases.mapping import parse_mapping
from cases.solvers import IMPORTED, SolverName
from cases.table import Name, Switch, Table
from cases.units import Number

TierName = Literal["quick", "standard", "paper"]
TIERS: tuple[TierName, ...] = ("quick", "standard", "paper")
Scalar = bool | int | float | str
#: what a check may be against besides a run, a reference and a value
TARGETS = ("baseline", "exact", "none")
#: behind the name of a family of runs: each of them
EACH = "[*]"
#: names of runs that differ in a part, each of which is meant: "{fem,mpm}_cubic"
_ALTERNATIVES = re.compile(r"\{([^{}]*)\}")
#: runs that a sweep, or a check by its alternatives, may stand for
MOST_RUNS = 1000
#: bytes in the name of a run: the system's limit of 255 less what the folders beside it are called
LONGEST_RUN = 240
#: size beyond which no parameter of a metric means anything
LARGEST_PARAMETER = 1e30
# Values of a sweep stand in the names of runs and these in the names of folders.
_LABEL = re.compile(r"[A-Za-z0-9_.+-]+")


@dataclass(frozen=True)
class Foreign:
    """A result from elsewhere: table of its history, how its columns are mapped, table x,y of its crack path, fields."""

    history: Path
    map: str = ""
    crack_path: Path | None = None
    fields: ForeignFields | None = None

    def checksum(self) -> str:
        """SHA-256 of all four, in hexadecimal digits."""
        said = [self.map.encode()]
        files = [path for path in (self.history, self.crack_path) if path]
        if self.fields:
            said.append(self.fields.model_dump_json(exclude={"file"}).encode())
            files += with_parts(self.fields.file)
        return hashlib.sha256(b"\0".join([*said, *(file.read_bytes() for file in files)])).hexdigest()


@dataclass(frozen=True)
class RunSpec:
    """One run of a case.

    Attributes
    ----------
    name : with its sweep values, such as "fem_levels[h=0.1]"
    solver : of `cases.solvers.SOLVERS`
    family : the name in the file, such as "fem_levels"
    expect_failure : that it does not converge in the end is a result
    change : nested tables merged over the case for this run, sweep values included
    accepts : indicators of the health record that may be beyond their limits, with the reason
    sweep_values : dotted key -> value of this member of the sweep; empty without a sweep
    foreign : the files of a result from elsewhere
    """

    name: str
    solver: str
    family: str
    expect_failure: bool = False
    change: dict[str, Any] = field(default_factory=dict)
    accepts: dict[str, str] = field(default_factory=dict)
    sweep_values: dict[str, Scalar] = field(default_factory=dict)
    foreign: Foreign | None = None


def _sweep_value(value: Any) -> Any:
    if not isinstance(value, bool | int | float | str) or value in (math.inf, -math.inf) or value != value:
        raise BrokenRuleError("cannot be swept", "give finite numbers, texts, true or false", value=value)
    if isinstance(value, str) and not _LABEL.fullmatch(value):
        remedy = "use letters, digits and _ . + - only, since it becomes part of a folder's name"
        raise BrokenRuleError("cannot be swept", remedy, value=value)
    return value


def _parameter(value: Any) -> Any:
    numbers = value if isinstance(value, list | tuple) else [value]
    for number in numbers:
        plain = isinstance(number, bool | int | float) and abs(number) <= LARGEST_PARAMETER
        if not plain and not isinstance(value, str):
            raise BrokenRuleError(
                "is no parameter",
                f"give a finite number up to {LARGEST_PARAMETER:g}, a list of them, or a text",
                value=value,
            )
    return value


SweepValue = Annotated[Scalar, BeforeValidator(_sweep_value)]
Parameter = Annotated[Scalar | tuple[float, ...], BeforeValidator(_parameter)]


class Run(Table):
    """A run, or a sweep of runs.

    Attributes
    ----------
    expect_failure : that the run does not converge in the end is a result, not a fault
    change : tables merged over the case for this run
    accepts : indicator of the health record that may be beyond its limit in this run -> why
    sweep : dotted key, or "key.0", "key.1" for the entries of an array -> values; expands to one run for each
        combination of values
    history, map, crack_path, fields : of the solver "imported": CSV file of the history, its columns
        (`cases.mapping`), CSV file x,y of the crack path, and the file of its fields
    """

    solver: SolverName
    expect_failure: Switch = False
    change: dict[str, Any] = Field(default_factory=dict)
    accepts: dict[Name, Annotated[str, Field(min_length=1)]] = Field(default_factory=dict)
    sweep: dict[str, Annotated[tuple[SweepValue, ...], Field(min_length=1)]] = Field(default_factory=dict)
    history: Path | None = None
    map: str = ""
    crack_path: Path | None = None
    fields: ForeignFields | None = None

    @field_validator("history", "crack_path")
    @classmethod
    def _is_a_file(cls, path: Path | None, info: ValidationInfo) -> Path | None:
        return None if path is None else existing_file(path, info, "a CSV file")

    @field_validator("map")
    @classmethod
    def _is_a_mapping(cls, text: str) -> str:
        parse_mapping(text)
        return text

    @model_validator(mode="after")
    def _is_imported_or_solved(self) -> Run:
        given = [key for key in ("history", "map", "crack_path", "fields") if getattr(self, key)]
        if self.solver != IMPORTED and given:
            remedy = f'give solver = "{IMPORTED}", or remove it'
            raise BrokenRuleError("belongs to a result from elsewhere", remedy, given[0])
        if self.solver == IMPORTED and (self.history is None or self.sweep or self.change):
            text = "needs the key history, and no sweep or change"
            raise BrokenRuleError(text, "name the CSV file of the result", "solver", self.solver)
        return self

    @field_validator("sweep")
    @classmethod
    def _has_distinct_values(cls, sweep: dict[str, tuple[Scalar, ...]]) -> dict[str, tuple[Scalar, ...]]:
        for key, values in sweep.items():
            if len({_text(value) for value in values}) < len(values):
                raise BrokenRuleError("repeats a value", "remove the repetition", f'"{key}"', list(values))
        if (number := math.prod(map(len, sweep.values()))) > MOST_RUNS:
            raise BrokenRuleError(f"stands for {number} runs", f"sweep no more than {MOST_RUNS}")
        return sweep

    @cached_property
    def _members(self) -> dict[str, list[RunSpec]]:
        """By the name of the family."""
        return {}

    def members(self, family: str) -> list[RunSpec]:
        """All runs that this table stands for."""
        if family not in self._members:
            foreign = Foreign(self.history, self.map, self.crack_path, self.fields) if self.history else None
            plain = RunSpec(family, self.solver, family, self.expect_failure, self.change, self.accepts, foreign=foreign)
            swept = product(*self.sweep.values())
            self._members[family] = [self._member(family, values) for values in swept] if self.sweep else [plain]
        return self._members[family]

    def _member(self, family: str, values: tuple[Scalar, ...]) -> RunSpec:
        swept = dict(zip(self.sweep, values, strict=True))
        change = self.change
        for key, value in swept.items():
            change = merge(change, nest(key, value))
        labels = ",".join(f"{self._label(key)}={_text(value)}" for key, value in swept.items())
        name = f"{family}[{labels}]"
        if len(name.encode()) > LONGEST_RUN:
            text = f"names a run by more than {LONGEST_RUN} bytes, {name[:40]!r}..."
            raise BrokenRuleError(text, "sweep fewer keys, or shorter values", f"runs.{family}.sweep")
        return RunSpec(name, self.solver, family, self.expect_failure, change, self.accepts, swept)

    def _label(self, key: str) -> str:
        last = [_last_word(k) for k in self.sweep]
        short = _last_word(key)
        return short if last.count(short) == 1 else key


def _last_word(dotted: str) -> str:
    """ "c" of "a.b.c", "c.1" of "a.b.c.1"."""
    words = dotted.split(".")
    return ".".join(words[-2:] if words[-1].isdigit() else words[-1:])


def merge(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """Tables `above` laid over tables `below`: tables are merged key by key, everything else is replaced.

    A table of numbers 0, 1, ... laid over an array is laid over these of its entries, which may be tables or arrays too.
    """
    return below | {key: _laid_over(below.get(key), value) for key, value in above.items()}


def _laid_over(under: Any, value: Any) -> Any:
    if isinstance(value, dict) and isinstance(under, dict):
        return merge(under, value)
    if isinstance(value, dict) and isinstance(under, list) and value.keys() <= set(map(str, range(len(under)))):
        return [_laid_over(entry, value[str(i)]) if str(i) in value else entry for i, entry in enumerate(under)]
    return value


def nest(dotted: str, value: Any) -> dict[str, Any]:
    """{"a": {"b": value}} for "a.b"."""
    for key in reversed(dotted.split(".")):
        value = {key: value}
    return value


def _text(value: Scalar) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) and float(f"{value:g}") == value else str(value)


class Reference(Table):
    """Somebody else's result.

    Attributes
    ----------
    source : who published it and where
    uncertainty : of the numbers, in words
    values : metric -> value in the units of the case
    curve : file beside the case with columns u, F in the units of the case
    """

    kind: Literal["read from figure", "table", "measured", "exact"]
    source: Annotated[str, Field(min_length=1)]
    uncertainty: str = ""
    values: dict[str, Number] = Field(default_factory=dict)
    curve: Path | None = None

    @field_validator("curve", mode="after")
    @classmethod
    def _is_readable(cls, curve: Path | None, info: ValidationInfo) -> Path | None:
        if curve is None:
            return None
        path = existing_file(curve, info, "a CSV file with the columns u,F")
        read_curve(path)
        return path


class Check(Table):
    """One judgement of a metric against a target.

    Attributes
    ----------
    run : run or family of runs that the metric is taken from; "FAMILY[*]" stands for a check of each of its runs and
        "{fem,mpm}" for one of either, in `against` for the same
    but : sweep values, such as "h=0.1", of the runs that a check of each leaves out
    against : a run, "baseline", "reference:NAME", "value:NUMBER", "exact" or "none"; a run "OTHER[*]" is that of the
        same sweep values
    measure : "relative": |value - target|/|target| <= limit; "absolute": |value - target| <= limit;
        against none: |value| <= limit
    tiers : in which the check applies
    gate : whether a failure fails the case
    reason : why this limit
    parameters : of the metric
    """

    metric: Name
    run: str
    but: tuple[str, ...] = ()
    against: str
    measure: Literal["relative", "absolute"] = "relative"
    limit: Annotated[Number, Field(ge=0)]
    tiers: Annotated[tuple[TierName, ...], Field(min_length=1)] = TIERS
    gate: Switch = True
    reason: Annotated[str, Field(min_length=1)]
    parameters: dict[str, Parameter] = Field(default_factory=dict)

    @property
    def target(self) -> tuple[str, str]:
        """`against` taken apart: ("value", "2.0"), ("reference", name), ("run", name), ("exact", ""), .."""
        kind, colon, rest = self.against.partition(":")
        if colon and kind in ("value", "reference"):
            return kind, rest.strip()
        return (self.against, "") if self.against in TARGETS else ("run", self.against)

    def each(self, specs: Iterable[RunSpec]) -> list[Check]:
        """The check, or one for each run that it is of; itself where there is no such family."""
        specs, group = list(specs), _ALTERNATIVES.search(self.run)
        if group is not None:
            return [check for name in group[1].split(",") for check in self._of(group[0], name.strip()).each(specs)]
        family = self.run.removesuffix(EACH)
        labels = [spec.name.removeprefix(family) for spec in specs if spec.family == family and spec.sweep_values]
        if family == self.run or not labels:
            return [self]
        return [self._of(EACH, label) for label in labels if label.strip("[]") not in self.but]

    def _of(self, part: str, name: str) -> Check:
        """The check of one run, whose name stands for a part of the runs' names."""
        return self.model_copy(update={key: getattr(self, key).replace(part, name) for key in ("run", "against")})

    @field_validator("run")
    @classmethod
    def _names_few_runs(cls, run: str) -> str:
        if math.prod(group.count(",") + 1 for group in _ALTERNATIVES.findall(run)) > MOST_RUNS:
            raise BrokenRuleError("stands for too many runs", f"name no more than {MOST_RUNS}", value=run)
        return run

    @field_validator("against")
    @classmethod
    def _has_a_number(cls, against: str) -> str:
        if against.startswith("value:"):
            try:
                finite = math.isfinite(float(against.removeprefix("value:")))
            except ValueError:
                finite = False
            if not finite:
                raise BrokenRuleError(
                    "holds no finite number",
                    'write for instance "value:2.0", a plain number in the units of the case', value=against
                )
        return against
