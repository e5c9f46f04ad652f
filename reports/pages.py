"""Case pages: Markdown whose numbers are placeholders, filled from the case, its baseline, its prices and records.

A placeholder is a Jinja expression over five names, each a table of tables:

- ``case.TIER…``: the case file at a tier, as ``case.paper.mesh.h``
- ``baseline.TIER.RUN.METRIC``: our own accepted value
- ``prices.TIER.RUN["SAVING"].QUANTITY``: what a saving changes, with ``with``, ``without`` and ``change``; beside the
  quantities ``seconds``, ``work`` and ``unknowns`` with ``with`` and ``without``
- ``printed.REFERENCE.METRIC``: a published number of the case file
- ``measured.STUDY.KEY``: a recorded measurement that no baseline holds, of ``measured.toml`` beside the page

A measurement is written as text, ``"0.620 kN"``, and appears as it is written. The filters ``digits(n)``, ``unit`` and
``percent(n)`` format a number. Nothing else is within a page's reach: pages are data.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import StrictUndefined, TemplateError, Undefined
from jinja2.sandbox import ImmutableSandboxedEnvironment

from cases import Case, UserError, load_case
from cases.judging import TIERS
from verify.judging.baseline import read_baseline
from verify.planning.recorded_prices import read_prices

PAGE_FILE = "README.md"
MEASURED_FILE = "measured.toml"
#: what a study in a file of measurements says of itself; all else in it is a measurement
STUDY_KEYS = ("how", "date", "version", "processor")
_QUANTITY = re.compile(r"([+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?)(?: (\S.*))?")
_MARKED = re.compile(r"<!--([\w.]+)-->(.*?)<!--/-->")


class PageError(UserError):
    """A page or a file of measurements cannot be read or filled."""


class Quantity(float):
    """A number with its unit and the text that it appears as."""

    unit: str
    text: str

    def __new__(cls, value: float, unit: str = "", text: str = "") -> Quantity:
        """A number in its unit; ``text`` is how it is written, the number itself if empty."""
        made = super().__new__(cls, value)
        made.unit, made.text = unit, text or f"{float(value):g}"
        return made

    def __str__(self) -> str:
        return self.text


def fill_page(case: Case) -> str:
    """The case's page with its placeholders filled, Markdown; empty without a page.

    Raises
    ------
    PageError : a placeholder names something that is not there, or a file of the page is damaged.
    """
    file = case.kept_folder / PAGE_FILE
    if not file.is_file():
        return ""
    try:
        return _Environment().from_string(file.read_text(encoding="utf-8")).render(_sources(case))
    except (TemplateError, ArithmeticError, TypeError, ValueError) as problem:
        raise PageError(f"{file}: {problem}; correct the placeholder.") from problem


def read_measured(file: Path) -> dict[str, Any]:
    """The studies of a file of measurements, their values as `Quantity`; none without a file.

    Raises
    ------
    PageError : no TOML, a study that does not say how and when, or a value that is no number with a unit.
    """
    if not file.is_file():
        return {}
    try:
        studies = tomllib.loads(file.read_text(encoding="utf-8"))
    except ValueError as problem:
        raise PageError(f"{file}: {problem}; correct this line.") from problem
    return {name: _study(study, f"{file}: {name}") for name, study in studies.items()}


def fill_marked(text: str, measured: Mapping[str, Any]) -> str:
    """A text with each ``<!--STUDY.KEY-->…<!--/-->`` holding the measurement of that name, for pages without Jinja.

    Raises
    ------
    PageError : there is no such measurement.
    """
    return _MARKED.sub(lambda found: f"<!--{found[1]}-->{_named(measured, found[1])}<!--/-->", text)


def write_marked(file: Path, measured: Path) -> None:
    """Fill the marked numbers of a file from a file of measurements, in place.

    Raises
    ------
    PageError : a marked number is not measured.
    """
    file.write_text(fill_marked(file.read_text(encoding="utf-8"), read_measured(measured)), encoding="utf-8")


def _named(measured: Mapping[str, Any], key: str) -> Quantity:
    value: Any = measured
    for part in key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    if not isinstance(value, Quantity):
        raise PageError(f"{key} is not measured; add it to the file of measurements.")
    return value


# ------------------------------------------------------------------------------------------ sources


def _sources(case: Case) -> dict[str, Any]:
    return {
        "case": {tier: load_case(case.source, tier).model_dump() for tier in TIERS},
        "baseline": _baseline(case),
        "prices": _prices(case),
        "printed": {name: reference.values for name, reference in case.references.items()},
        "measured": read_measured(case.kept_folder / MEASURED_FILE),
    }


def _baseline(case: Case) -> dict[str, Any]:
    tiers: dict[str, Any] = {}
    for row in read_baseline(case):
        tiers.setdefault(row.tier, {}).setdefault(row.run, {})[row.metric] = Quantity(row.value, row.unit)
    return tiers


def _prices(case: Case) -> dict[str, Any]:
    tiers: dict[str, Any] = {}
    for row in read_prices(case).to_dict("records"):
        saving = tiers.setdefault(row["tier"], {}).setdefault(row["run"], {}).setdefault(row["saving"], {})
        saving[row["quantity"]] = {key: Quantity(row[key], row["unit"]) for key in ("with", "without")}
        saving[row["quantity"]]["change"] = Quantity(row["change"])
        for cost in ("seconds", "work", "unknowns"):
            saving[cost] = {key: Quantity(row[f"{cost}_{key}"]) for key in ("with", "without")}
    return tiers


def _study(study: Any, where: str) -> Any:
    if not isinstance(study, dict) or "how" not in study or "date" not in study:
        raise PageError(f"{where}: a study is a table with how and date; add them.")
    return {key: value if key in STUDY_KEYS else _measurement(value, f"{where}.{key}") for key, value in study.items()}


def _measurement(value: Any, where: str) -> Any:
    if isinstance(value, dict):
        return {key: _measurement(inner, f"{where}.{key}") for key, inner in value.items()}
    if isinstance(value, list):
        return [_measurement(inner, where) for inner in value]
    found = _QUANTITY.fullmatch(value) if isinstance(value, str) else None
    if not found:
        raise PageError(f'{where}: {value!r} is no measurement; write a number and its unit such as "0.62 kN".')
    return Quantity(float(found[1]), found[2] or "", found[1])


# ---------------------------------------------------------------------------------------- placeholders


class _Environment(ImmutableSandboxedEnvironment):
    """Expressions over tables and lists; no attribute, method, function or file is reachable."""

    def __init__(self) -> None:
        super().__init__(undefined=StrictUndefined, keep_trailing_newline=True, trim_blocks=True)
        self.globals.clear()
        self.filters = {"abs": abs, "digits": _digits, "percent": _percent, "unit": _unit}

    def getitem(self, obj: Any, argument: Any) -> Any:
        """The entry of a table or a list; StrictUndefined, which names those that there are, without it."""
        if isinstance(obj, Undefined):  # what is missing is said of the first name
            return obj
        if isinstance(obj, Mapping):
            known = ", ".join(map(str, obj)) or "nothing"
            return obj[argument] if argument in obj else self.undefined(hint=f"{argument!r} is none of: {known}")
        if isinstance(obj, Sequence) and isinstance(argument, int) and -len(obj) <= argument < len(obj):
            return obj[argument]
        return self.undefined(hint=f"{argument!r} cannot be taken from {type(obj).__name__}")

    def getattr(self, obj: Any, attribute: str) -> Any:
        """The entry of that name; no attribute is looked for."""
        return self.getitem(obj, attribute)


def _digits(value: float, digits: int) -> Quantity:
    """The number with so many significant digits, in its unit."""
    text = f"{value:#.{digits}g}".rstrip(".")
    if "e+" in text:
        text = f"{value:.0f}"
    return Quantity(value, getattr(value, "unit", ""), text)


def _percent(value: float, digits: int = 2) -> str:
    """A share as percent with so many significant digits."""
    return f"{_digits(100.0 * value, digits)} %"


def _unit(value: Quantity) -> str:
    """The number with its unit."""
    return f"{value}{'' if value.unit == '°' else ' '}{value.unit}"
