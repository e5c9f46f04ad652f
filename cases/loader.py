"""Reading case files: find, parse, merge tier and run, validate."""

from __future__ import annotations

import hashlib
import re
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from cases.case import CASE_FILE, Case
from cases.errors import CaseError
from cases.files import read_text
from cases.geometry import SLACK
from cases.judging import TIERS, merge, nest
from cases.messages import case_error, sentence
from cases.schema import KEPT_BY_RUNS, CaseDescription
from cases.table import Table, nearest, unknown_key_remedy
from cases.units import Units

LIBRARY = Path(__file__).parent / "library"
DEFAULT_TIER = "standard"
#: bytes of a case file, and levels of its tables, beyond which it is not read
LARGEST_FILE, DEEPEST = 5_000_000, 200
#: bytes in the name of a case; the system's limit is 255, and its results add to it
LONGEST_NAME = 200
_LONG_KEY = re.compile(rf"""(?<![\w"'-])(?:(?:"[^"\n]*"|'[^'\n]*'|[\w-]+)[ \t]*\.[ \t]*){{{DEEPEST}}}""")

Tables = dict[str, Any]

_read: ContextVar[dict[Any, Case] | None] = ContextVar("_read", default=None)
#: file, digest of its tables, tier, run -> load path of a variant that has been found right; None in dynamics
_right: dict[tuple[str, str, str, str | None], tuple[float, ...] | None] = {}
#: variants that are remembered
MOST_REMEMBERED = 5000


def list_cases() -> list[str]:
    """Names of the cases in the library, sorted."""
    return sorted(path.parent.name for path in LIBRARY.glob(f"*/{CASE_FILE}"))


@contextmanager
def reading_once() -> Iterator[None]:
    """Within it `load_case` reads each variant of a case once: for programs during which no case file changes."""
    token = _read.set({} if _read.get() is None else _read.get())
    try:
        yield
    finally:
        _read.reset(token)


def load_case(
    name_or_path: str | Path, tier: str | None = None, run: str | None = None, change: Tables | None = None
) -> Case:
    """A case of the library, of a folder or of a .toml file, at a tier and for a run.

    Parameters
    ----------
    name_or_path : name in the library, folder that holds a case.toml, or path of a .toml file
    tier : "quick", "standard" (if None) or "paper"; the tables of [tiers.<tier>] are merged over the file
    run : one of `case.expanded_runs()`; its `change` tables and sweep values are merged too
    change : tables laid over those of the run, to vary it, of what a run may change; only with a run

    Raises
    ------
    CaseError : the case does not exist, or something in it is wrong
    """
    read, key = _read.get(), (name_or_path, tier, run, repr(change or {}))
    if read is None:
        return _load(name_or_path, tier, run, change)
    if key not in read:
        read[key] = _load(name_or_path, tier, run, change)
    return read[key]


def case_at(case: Case | str | Path, tier: str | None) -> Case:
    """A case, or the one of a name or path, at a tier: that of the case, or "standard", if None; see `load_case`."""
    if not isinstance(case, Case):
        return load_case(case, tier)
    return case if tier in (None, case.tier) else of_its_file(case, tier, case.run)


def of_its_file(case: Case, tier: str | None, run: str | None) -> Case:
    """The case in the file of another one, at a tier, that of the other one if None, and for a run.

    Raises
    ------
    CaseError : there is no file, or the other one is not what it says, so that what was changed in it would be lost
    """
    if not Path(case.source).is_file():
        raise CaseError(f"{case.source}: is no file, and what runs is a case file; write the case's tables into it.")
    if load_case(case.source, case.tier, case.run) != case:
        text = "is not what this case says, which was changed after it was read, or before"
        remedy = "change the file, or give load_case the run and its change"
        raise sentence(case.source, "", None, text, remedy)
    return load_case(case.source, tier or case.tier, run)


def _load(name_or_path: str | Path, tier: str | None, run: str | None, change: Tables | None = None) -> Case:
    source = _find(name_or_path)
    return case_from_tables(read_tables(source), tier, run, name=_name(source), source=source, change=change)


def case_from_tables(
    tables: Tables,
    tier: str | None = None,
    run: str | None = None,
    name: str = "case",
    source: Path | None = None,
    change: Tables | None = None,
) -> Case:
    """The case that the parsed tables of a case.toml describe; see `load_case`.

    source : the file that the tables come from, whose folder holds the files they refer to

    Raises
    ------
    CaseError : something in the tables is wrong
    """
    file = (source or Path.cwd() / CASE_FILE).resolve()
    change = None if change is None else _varying(file, change)
    builder = _Builder(tables, name, file)
    tier = tier or DEFAULT_TIER
    if tier not in TIERS:
        raise sentence(file, "tier", tier, "is not a tier", f"choose {', '.join(TIERS)}")
    case = builder.case(tier)
    if run is None:
        if change:
            raise sentence(file, "change", None, "is that of a run", "name the run too, whose tables it is laid over")
        builder.check_variants(case)
        return case
    if run not in case.expanded_runs():
        remedy = nearest(str(run), case.expanded_runs(), "choose a run of the case")
        raise sentence(file, "run", run, "is not a run of this case", remedy)
    return builder.case(tier, run, case, change)


def _varying(file: Path, change: Any) -> Tables:
    """A change of a run as plain tables, where it is of what a run may change; CaseError where not."""
    if not isinstance(change, dict):
        raise sentence(file, "change", change, "is not a table", 'give tables as {"mesh": {"h": 0.1}}')
    for key, value in change.items():
        if "." in str(key):
            raise sentence(file, f"change.{key}", None, "is a key with dots", f"give tables as {nest(key, value)}")
        if key in KEPT_BY_RUNS:
            raise sentence(file, f"change.{key}", None, "may not be changed by a run", "write another case file")
    return {key: _plain(value) for key, value in change.items()}


def _plain(value: Any) -> Any:
    """What a case file could hold, of arrays and numbers of numpy and of any sequence."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return [_plain(entry) for entry in value] if isinstance(value, list | tuple | range) else value


class _UnitsOnly(Table):
    """The units come first, because every other number is read in them."""

    units: Units


class _Builder:
    """Builds variants of a case from the tables of one file."""

    def __init__(self, tables: Tables, name: str, source: Path) -> None:
        self.name, self.source = name, source
        self.tables = tables
        self._has_known_tables()
        self.context = {"units": self._units(), "folder": source.parent}
        #: key of the file -> its value there and as the first case has read it
        self.read: dict[str, tuple[Any, Any]] = {}

    def case(
        self, tier: str, run: str | None = None, base: Case | None = None, varied: Tables | None = None
    ) -> Case:
        """The case at a tier, for a run of the case `base`, with the tables `varied` laid over it."""
        tiers = self.tables.get("tiers", {})
        change = tiers.get(tier, {}) if isinstance(tiers, dict) else {}
        origins = [(f"tiers.{tier}", change)]
        tables = merge(self.tables, change) if isinstance(change, dict) else self.tables
        if run is not None and base is not None:
            spec = base.run_spec(run)
            swept = [nest(key, value) for key, value in spec.sweep_values.items()]
            origins = [
                *((f"runs.{spec.family}.sweep", nested) for nested in swept),
                (f"runs.{spec.family}.change", spec.change),
                *origins,
            ]
            tables = merge(tables, spec.change)
        if varied:
            origins = [("change", varied), *origins]
            tables = merge(tables, varied)
        place = {"name": self.name, "folder": self.source.parent, "source": self.source}
        told = {"tier": tier, "run": run, "change": varied or {}}
        try:
            case = Case.model_validate({**self._as_read(tables), **place, **told}, context=self.context)
        except ValidationError as error:
            raise case_error(self.source, error, origins) from None
        self.read = self.read or {key: (value, getattr(case, key)) for key, value in tables.items()}
        return case

    def _as_read(self, tables: Tables) -> Tables:
        """The tables, of which those that no change has touched need not be read again."""
        read = self.read
        return {key: read[key][1] if key in read and read[key][0] is value else value for key, value in tables.items()}

    def check_variants(self, case: Case) -> None:
        """Raise CaseError for a mistake in any run of this tier or in any other tier, or for what none of them does."""
        found = [self._right(case.tier, run, case) for run in case.expanded_runs()]
        found += [self._right(tier) for tier in case.tiers]
        paths = [path for path in found if path is not None]
        for number, u in enumerate(case.output.snapshots):
            slack = SLACK * abs(u)  # 300 um and 0.3 mm differ by rounding
            if paths and not any(min(path) - slack <= u <= max(path) + slack for path in paths):
                remedy = "give a load parameter that load.path passes"
                raise sentence(self.source, f"output.snapshots[{number}]", u, "is off the load path of every run", remedy)

    @cached_property
    def _digest(self) -> str:
        return hashlib.sha256(repr(self.tables).encode("utf-8", "surrogatepass")).hexdigest()

    def _right(self, tier: str, run: str | None = None, base: Case | None = None) -> tuple[float, ...] | None:
        """Load path of a variant, None in dynamics; one that was right is not built again from the same tables."""
        key = (str(self.source), self._digest, tier, run)
        if key not in _right:
            variant = self.case(tier, run, base)
            if len(_right) >= MOST_REMEMBERED:
                _right.clear()
            _right[key] = variant.load.path if variant.dynamics is None else None
        return _right[key]

    def _has_known_tables(self) -> None:
        known = list(CaseDescription.model_fields)
        for key, value in self.tables.items():
            if key not in known:
                shown = None if isinstance(value, dict) else value
                raise sentence(self.source, key, shown, "is unknown", unknown_key_remedy(key, known))

    def _units(self) -> Units:
        if "units" not in self.tables:
            remedy = "add the table [units] with length and force"
            raise sentence(self.source, "units", None, "is missing", remedy)
        try:
            return _UnitsOnly.model_validate({"units": self.tables["units"]}).units
        except ValidationError as error:
            raise case_error(self.source, error, []) from None


def _find(name_or_path: str | Path) -> Path:
    if not isinstance(name_or_path, str | Path):
        remedy = "give the name of a case of the library, a folder or a .toml file"
        raise sentence("load_case", "name_or_path", name_or_path, "is neither a text nor a path", remedy)
    path = Path(name_or_path)
    here, of_library = path / CASE_FILE, LIBRARY / path / CASE_FILE
    if len(path.parts) == 1 and _is_file(of_library):
        if _is_file(here) and not here.samefile(of_library):
            text = "is a case of the library and one in this folder"
            raise sentence(path, "", None, text, f"give {here} for the one here, or {of_library}")
        return of_library
    for candidate in (here, path):
        if _is_file(candidate):
            return candidate.resolve()
    if path.suffix == ".toml" or len(path.parts) != 1:
        remedy = f"name a folder with a {CASE_FILE} or a .toml file"
        raise sentence(path, "", None, "no such case file", remedy)
    remedy = nearest(path.name, list_cases(), "name a case of the library, a folder or a .toml file")
    raise sentence(path, "", None, "no such case", remedy)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError, RuntimeError):  # too long, with a null in it, or a ring of links
        return False


def _name(source: Path) -> str:
    """What the case is called; folders and pages of its results are called so too."""
    name = source.parent.name if source.name == CASE_FILE else source.stem
    if not name or name.startswith(".") or not name.isprintable() or len(name.encode(errors="replace")) > LONGEST_NAME:
        remedy = f"call its {'folder' if source.name == CASE_FILE else 'file'} otherwise"
        text = f"would name its results {name!r}, which must not start with '.', be longer than {LONGEST_NAME} bytes "
        raise sentence(source, "", None, text + "or hold signs that cannot be seen", remedy)
    return name


def read_tables(source: Path) -> Tables:
    """The tables of a case file; CaseError where it cannot be read."""
    try:
        if source.stat().st_size > LARGEST_FILE:
            text = f"is larger than {LARGEST_FILE / 1e6:g} MB"
            raise sentence(source, "", None, text, "describe bodies of many corners by a mesh file")
        tables: Tables = _copied(_parsed(read_text(source)))
    except _TooDeepError as error:
        raise sentence(source, "", None, *error.args) from None
    except UnicodeDecodeError as error:
        raise sentence(source, "", None, f"not UTF-8 text: byte {error.start}", "save it as UTF-8") from None
    except ValueError as error:  # TOMLDecodeError, and Python's own for a number of thousands of digits
        raise sentence(source, "", None, f"not valid TOML: {error}", "correct this line") from None
    except (OSError, RecursionError) as error:
        raise sentence(source, "", None, f"cannot be read: {error}", "correct the file") from None
    if not tables:
        raise sentence(source, "", None, "the file is empty", "describe the case in it")
    return tables


class _TooDeepError(ValueError):
    """Tables that are nested too deep: what is wrong, and the remedy."""


@lru_cache(maxsize=8)
def _parsed(written: str) -> Tables:
    """The tables of a text; each run of a case reads its file again."""
    if _LONG_KEY.search(written):
        raise _TooDeepError(f"has a key of more than {DEEPEST} parts", "shorten it")
    tables = tomllib.loads(written)
    if _is_deeper(tables, DEEPEST):
        raise _TooDeepError(f"nests its tables and lists more than {DEEPEST} deep", "take them apart")
    return tables


def _copied(value: Any) -> Any:
    """Tables and lists anew, what is in them as it is: ``deepcopy`` without its memory of what it has copied."""
    if isinstance(value, dict):
        return {key: _copied(entry) for key, entry in value.items()}
    return [_copied(entry) for entry in value] if isinstance(value, list) else value


def _is_deeper(tables: Tables, most: int) -> bool:
    """Whether tables and lists are nested more than so deep."""
    level: list[Any] = [tables]
    for _ in range(most):
        inside = [entry for holder in level for entry in (holder.values() if isinstance(holder, dict) else holder)]
        level = [entry for entry in inside if isinstance(entry, dict | list)]
    return bool(level)


__all__ = ["CaseError", "case_from_tables", "list_cases", "load_case"]
