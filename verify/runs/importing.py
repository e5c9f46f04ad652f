"""Results from elsewhere become the table of a history: columns, units and signs by the mapping of the case's run."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from cases import Case
from cases.errors import BrokenRuleError
from cases.files import read_columns
from cases.judging import Foreign
from cases.mapping import DAMAGE, FORCE_LIKE, KINDS_OF_COLUMNS, Mapping, Source, parse_mapping, unit_factor
from cases.table import nearest
from verify.runs.imported_error import ImportedError, listed
from verify.runs.run_folder import HISTORY_COLUMNS

if TYPE_CHECKING:
    from numerics.fields import Fields

#: columns of a history that count the work of our own solvers
_COUNTS = ("staggered", "newton", "seconds")
#: how far a phase field may leave 0 to 1
_OVERSHOOT = 0.2
#: share of the first u down to which a table goes back that is sorted from its end
_BACK = 0.05
#: rows are out of order where more than this share of them turns by steps of more than that share of the range of u
_TURNS, _STEP = 1 / 3, 0.01
#: a column that carries its unit in its name: "u_mm", "F [kN]"
_WITH_UNIT = re.compile(r"(?P<name>[A-Za-z]\w*?)(?:_(?P<plain>[A-Za-zµμ]+)|\s*[\[(](?P<unit>[^\])]+)[\])])")


def read_foreign(case: Case) -> tuple[pd.DataFrame, np.ndarray, dict[int, Fields]]:
    """Table, crack path (n, 2) and row -> fields of the imported run of a case, as its files have them.

    Raises ImportedError.
    """
    foreign = _foreign(case)
    assert foreign is not None
    table = read_table(foreign.history)
    path = read_path(foreign.crack_path) if foreign.crack_path else np.empty((0, 2))
    return table, path, _states(foreign, table, case)


def _states(foreign: Foreign, table: pd.DataFrame, case: Case) -> dict[int, Fields]:
    """Row of the table -> fields there: by the column of time, row by row, or those of the end."""
    if foreign.fields is None:
        return {}
    from verify.runs.foreign_fields import read_states

    history = history_of(table, case)
    states = read_states(foreign.fields, case)
    timed = "time" in {**_named(table, case), **parse_mapping(foreign.map).sources}
    if len(states) == 1:
        return {len(history) - 1: states[0][1]}
    if timed:
        times = history["time"].to_numpy(float)
        return {int(np.abs(times - (time or 0.0)).argmin()): state for time, state in states}
    if len(states) == len(history):
        return {row: state for row, (_, state) in enumerate(states)}
    raise ImportedError(
        f"{foreign.fields.file}: holds {len(states)} states and {foreign.history.name} {len(history)} rows without a"
        " column of time, so that it cannot be told at which u they were; map time, or give the file of the last state."
    )


def history_of(table: pd.DataFrame, case: Case) -> pd.DataFrame:
    """The history that the table of a case's run tells, in the units of the case; see `mapped`."""
    foreign = _foreign(case)
    if foreign is None:
        return mapped(table, Mapping({}), case, f"run {case.run}")
    return mapped(table, parse_mapping(foreign.map), case, str(foreign.history))


def _foreign(case: Case) -> Foreign | None:
    assert case.run is not None
    return case.run_spec(case.run).foreign


# ------------------------------------------------------------------------------------------------ reading


def read_table(path: Path) -> pd.DataFrame:
    """A table as `cases.files.read_columns` reads it. Raises ImportedError for what is none, or names a column twice."""
    try:
        header, values = read_columns(path)
    except BrokenRuleError as error:
        raise ImportedError(f"{path}: {error.text}; {error.remedy}.") from None
    if len(set(header)) < len(header):
        raise ImportedError(f"{path}: names a column twice ({listed(header)}); rename one.")
    return pd.DataFrame(values, columns=header)


def read_path(path: Path) -> np.ndarray:
    """Crack path (n, 2) of a CSV file with the columns x and y, from the start of the crack to its tip [length]."""
    table = read_table(path)
    if not {"x", "y"} <= set(table.columns):
        raise ImportedError(f"{path}: has no columns x and y; it has {listed(table.columns)}.")
    points = table[["x", "y"]].to_numpy(dtype=float)
    bad = ~np.isfinite(points).all(axis=1)
    if bad.any():
        raise ImportedError(f"{path}: row {int(bad.argmax()) + 1} has no finite x and y; correct or remove it.")
    return points


# ------------------------------------------------------------------------------------------------ mapping


def mapped(table: pd.DataFrame, mapping: Mapping, case: Case, file: str) -> pd.DataFrame:
    """The history that a table tells, in the units of a case: mapped columns, and those that have their names already.

    What follows from others is added: the external work of a quasi-static case from F and u, and that it has no kinetic
    energy; the other columns of a history that are not there are NaN.

    Raises
    ------
    ImportedError : a column is missing, of another unit or not finite, or the time does not grow
    """
    _require_columns(table, file)
    columns: dict[str, np.ndarray] = {}
    for target, source in {**_named(table, case), **mapping.sources}.items():
        columns[target] = _values(table, target, source, case, file)
    _apply_words(columns, mapping, case)
    _require_phase_field(columns, file)
    _require_curve(columns, table, file, case)
    _require_loading(columns, file, case)
    return _completed(columns, case)


def _require_columns(table: Any, file: str) -> None:
    if not isinstance(table, pd.DataFrame):
        kind = type(table).__name__
        raise ImportedError(f"{file}: is no table but of the kind {kind}; give a pandas table with a row for each state.")
    names = list(map(str, table.columns))
    if len(set(names)) < len(names):
        raise ImportedError(f"{file}: names a column twice ({listed(names)}); rename one.")


def _named(table: pd.DataFrame, case: Case) -> dict[str, Source]:
    """Columns that have a history's names, with or without a unit behind them."""
    found = {}
    for column in map(str, table.columns):
        match = _WITH_UNIT.fullmatch(column)
        if column in KINDS_OF_COLUMNS or column in (*_COUNTS, DAMAGE):
            found[column] = Source(column)
        elif match and match["name"] in KINDS_OF_COLUMNS:
            found.setdefault(match["name"], Source(column, unit=match["plain"] or match["unit"]))
        elif case.dynamics and column not in HISTORY_COLUMNS:
            found[column] = Source(column)
    return found


def _values(table: pd.DataFrame, target: str, source: Source, case: Case, file: str) -> np.ndarray:
    if source.column not in table:
        remedy = nearest(source.column, list(map(str, table.columns)), "").partition(" (")[0]
        said = f"has no column {source.column!r} for {target}; it has {listed(table)}"
        raise ImportedError(f"{file}: {said}{'; ' if remedy else ''}{remedy}.")
    values = _real_numbers(table[source.column])
    bad = ~np.isfinite(values)
    if bad.any():
        where = f"{source.column!r} is no finite number in row {int(bad.argmax()) + 1} ({bad.sum()} of {len(bad)} rows)"
        raise ImportedError(f"{file}: column {where}; correct or remove what is not, with a point for decimals.")
    try:
        factor = unit_factor(source.unit, target, case.units, _kinds(case)) if source.unit else 1.0
    except BrokenRuleError as error:
        said = f"column {source.column!r} for {target}: {error.value or source.unit} {error.text}"
        if target in ("u", "F") and case.load_kinds[0] == "number":
            said += ", since u is the factor of this case's loads and F their work per factor"
        raise ImportedError(f"{file}: {said}; {error.remedy}.") from None
    return values * source.factor * factor


def _real_numbers(column: pd.Series) -> np.ndarray:
    """A column (n,) as numbers, NaN where it holds texts, times or complex numbers."""
    if column.dtype.kind in "cmM":
        return np.full(len(column), np.nan)
    return pd.to_numeric(column, errors="coerce").to_numpy(dtype=float, na_value=np.nan)


def _kinds(case: Case) -> dict[str, str]:
    """Kind of quantity of each column of a history: u is a number where loads follow it."""
    u, power = case.history_kinds
    return KINDS_OF_COLUMNS | {"u": "length" if u == "displacement" else u, "F": power}


def _apply_words(columns: dict[str, np.ndarray], mapping: Mapping, case: Case) -> None:
    factor = (2.0 if "half model" in mapping.words else 1.0) * (
        case.plane.thickness if "per thickness" in mapping.words else 1.0
    )
    for name in FORCE_LIKE:
        if name in columns:
            columns[name] = columns[name] * factor
    if DAMAGE in columns:
        columns["c_min"] = 1.0 - columns.pop(DAMAGE)
    elif "damage" in mapping.words and "c_min" in columns:
        columns["c_min"] = 1.0 - columns["c_min"]


def _require_phase_field(columns: dict[str, np.ndarray], file: str) -> None:
    least, largest = (float(find(columns.get("c_min", np.ones(1)))) for find in (np.min, np.max))
    if least < -_OVERSHOOT or largest > 1.0 + _OVERSHOOT:
        said = f"the phase field goes from {least:g} to {largest:g}, or the damage from {1 - largest:g} to {1 - least:g}"
        raise ImportedError(f'{file}: {said}; give a share of 1, such as "d = COLUMN / 100" of a damage in percent.')


def _require_curve(columns: dict[str, np.ndarray], table: pd.DataFrame, file: str, case: Case) -> None:
    needed = ("time",) if case.dynamics else ("u", "F")
    if case.dynamics and "time" not in columns and "u" in columns:
        columns["time"] = columns["u"]
    missing = [name for name in needed if name not in columns]
    if missing:
        names = " and ".join(missing)
        example = ", ".join(f"{name} = COLUMN" for name in missing)
        raise ImportedError(
            f'{file}: no column is {names}; say which with a map such as "{example}"; it has {listed(table.columns)}.'
        )
    if len(table) < 2:
        raise ImportedError(f"{file}: has one row, of which there is no curve; give one for each state.")
    times = columns.get("time", np.zeros(2))
    fall = np.diff(times) < 0
    if fall.any():
        row = int(fall.argmax()) + 2
        said = f"the time falls in row {row}, from {times[row - 2]:g} to {times[row - 1]:g}"
        raise ImportedError(f"{file}: {said}; sort the rows or give one run alone.")


def _require_loading(columns: dict[str, np.ndarray], file: str, case: Case) -> None:
    """A case that loads from 0 on has no table that begins loaded and does nothing but go back there, one that is loaded
    one way none that turns time and again."""
    if case.dynamics or case.load.path[0] != 0.0:
        return
    steps = np.diff(columns["u"])
    steps = np.sign(steps) * (np.abs(steps) > _STEP * np.ptp(columns["u"]))
    turns = int((steps[1:] * steps[:-1] < 0.0).sum())
    if len(case.load.path) == 2 and turns > max(_TURNS * len(steps), 2):
        said = f"u turns back in {turns} of {len(steps) + 1} rows, as it does in rows that are out of order"
        raise ImportedError(f"{file}: {said}; sort them from the first state to the last.")
    way = np.abs(columns["u"])
    if way[-1] < _BACK * way[0] and not (np.diff(way) > 0.0).any():
        said = f"the rows go back from u = {columns['u'][0]:g} to {columns['u'][-1]:g}"
        raise ImportedError(f"{file}: {said}; sort them from the first state to the last.")


def _completed(columns: dict[str, np.ndarray], case: Case) -> pd.DataFrame:
    count = len(next(iter(columns.values())))
    if case.dynamics:
        columns.setdefault("u", columns["time"])
    else:
        columns.setdefault("E_kin", np.zeros(count))
        u, F = columns["u"], columns["F"]
        work = np.concatenate([[0.0], np.cumsum(0.5 * (F[1:] + F[:-1]) * np.diff(u))])
        columns.setdefault("W_ext", work)
        columns.setdefault("time", np.arange(count, dtype=float))
    columns["step"] = np.arange(count)
    for name in _COUNTS:
        columns.setdefault(name, np.zeros(count))
    further = [name for name in columns if name not in HISTORY_COLUMNS]
    return pd.DataFrame(columns, columns=[*HISTORY_COLUMNS, *further])
