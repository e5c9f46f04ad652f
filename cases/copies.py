"""Copies of cases with all files that they refer to, changed or as they are."""

from __future__ import annotations

import json
import shutil
from itertools import count
from pathlib import Path
from typing import Any

from cases.case import Case
from cases.files import with_parts
from cases.loader import CASE_FILE, read_tables

#: keys whose values are files beside the case
FILE_KEYS = ("curve", "mesh", "history", "crack_path", "file", "table")
#: key whose value is the name of a CSV file beside the case, where there is one, without its ending
RECORD_KEY = "record"
#: what else belongs to a case of the library
BESIDE = ("README.md", "measured.toml", "baseline.csv", "prices.csv", "results")


def write_copy(case: Case, folder: Path, tables: dict[str, Any] | None = None) -> Path:
    """Write a case into ``folder/<its name>`` with its files beside it, and return the case file.

    tables : of the case file, where they are to be others than its own
    """
    target = folder / case.name
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir(parents=True)
    own = read_tables(case.source)
    moved = _with_files(tables or own, case.folder, target, {})
    path = target / CASE_FILE
    if tables is None and moved == own:
        shutil.copyfile(case.source, path)
    else:
        path.write_text(toml_text(moved), encoding="utf-8")
    for kept in (case.kept_folder / name for name in BESIDE):
        if kept.is_dir():
            shutil.copytree(kept, target / kept.name)
        elif kept.is_file():
            shutil.copyfile(kept, target / kept.name)
    return path


def _with_files(value: Any, source: Path, target: Path, elsewhere: dict[Path, str], key: str = "") -> Any:
    """The tables with the files that they name copied; those of each other folder lie in one beside the case then.

    elsewhere : other folder -> what it is called there, filled
    """
    if isinstance(value, dict):
        return {name: _with_files(each, source, target, elsewhere, name) for name, each in value.items()}
    if isinstance(value, list):
        return [_with_files(each, source, target, elsewhere) for each in value]
    if key == RECORD_KEY and isinstance(value, str):
        _with_files(f"{value}.csv", source, target, elsewhere, "file")
        return value
    if key not in FILE_KEYS or not isinstance(value, str) or not (source / value).is_file():
        return value
    place = Path(value)
    if place.is_absolute():
        folder = elsewhere.setdefault(place.parent, _free_name(source, len(elsewhere)))
        place = Path(folder) / place.name
    for part in with_parts((source / value).resolve()):
        beside = (target / place).parent / part.relative_to((source / value).resolve().parent)
        beside.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(part, beside)
    return place.as_posix()


def _free_name(source: Path, taken: int) -> str:
    """Name of a folder that the case has not got, so that no file of another folder takes the place of its own."""
    names = (f"given{number}" for number in count(taken + 1))
    return next(name for name in names if not (source / name).exists())


def toml_text(tables: dict[str, Any]) -> str:
    """Tables as TOML: a line for each key of the outermost tables, inline below."""
    lines = [f"{_key(name)} = {toml_value(value)}" for name, value in tables.items() if not isinstance(value, dict)]
    for name, table in tables.items():
        if isinstance(table, dict):
            lines += ["", f"[{_key(name)}]", *(f"{_key(key)} = {toml_value(value)}" for key, value in table.items())]
    return "\n".join(lines) + "\n"


def toml_value(value: Any) -> str:
    """A value as TOML in one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(key)} = {toml_value(each)}" for key, each in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _key(name: str) -> str:
    return name if name.replace("_", "").replace("-", "").isalnum() and name.isascii() else toml_value(name)
