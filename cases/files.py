"""Files that a case refers to: they lie beside it, exist, and hold what they should."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationInfo

from cases.errors import BrokenRuleError

#: files that name others, and how names look in them
_LISTS = (".pvd", ".pvtu", ".xdmf", ".xmf")
_NAMED = re.compile(r"""[>"']\s*([^<>"':]+?\.(?:p?vtu|vtk|vtp|h5|hdf5|bin))(?=[<"':\s])""")


def existing_file(path: Path, info: ValidationInfo, what: str) -> Path:
    """Absolute path of a file that the case names.

    It is relative to the folder of the case, context key "folder", and stays inside it.

    Raises
    ------
    BrokenRuleError : the path leaves the folder or is that of one machine, or there is no such file
    """
    folder = Path((info.context or {}).get("folder", ".")).resolve()
    if path.is_absolute():
        raise BrokenRuleError("holds on one machine only", f"put {what} beside the case", value=str(path))
    try:
        full = (folder / path).resolve()
        is_file = full.is_file()
    except (OSError, ValueError, RuntimeError):  # too long, with a null in it, or a ring of links
        full, is_file = folder / path, False
    if not full.is_relative_to(folder):
        raise BrokenRuleError("leaves the folder of the case", f"put {what} into it", value=str(path))
    if not is_file:
        raise BrokenRuleError("is not a file", f"name {what} in the folder of the case", value=str(path))
    return full


def with_parts(path: Path) -> list[Path]:
    """A file of fields and those beside it that it names: the states of a .pvd, the heavy data of an .xdmf."""
    if path.suffix.lower() not in _LISTS:
        return [path]
    named = dict.fromkeys(_NAMED.findall(path.read_text(encoding="utf-8", errors="replace")))
    folder = path.parent.resolve()
    found = [folder / name for name in named]
    inside = (part for part in found if part.is_file() and part.resolve().is_relative_to(folder))
    return [path, *(more for part in inside for more in with_parts(part))]


def read_text(path: Path) -> str:
    """Text of a file, with or without the mark that some editors put before it.

    Raises OSError; UnicodeDecodeError : not UTF-8.
    """
    return path.read_text(encoding="utf-8-sig")


def read_curve(path: Path, columns: tuple[str, str] = ("u", "F")) -> NDArray[np.float64]:
    """Two columns (n, 2), force over displacement if not others, of a CSV file; lines starting with # are comments.

    Raises
    ------
    BrokenRuleError : columns are missing or there twice, there are no rows, one of them has more or fewer cells, or a
        number is missing or not finite
    """
    try:
        lines = [line.strip() for line in read_text(path).splitlines()]
    except (OSError, UnicodeDecodeError):
        raise BrokenRuleError("cannot be read as text", "save it as UTF-8 CSV", value=path.name) from None
    rows = [line.split(",") for line in lines if line and not line.startswith("#")]
    header = [name.strip() for name in ",".join(rows[0]).rstrip(", ").split(",")] if rows else []
    rows = [row[: len(header)] if not "".join(row[len(header) :]).strip() else row for row in rows]
    if not set(columns) <= set(header):
        remedy = f'start it with the line "{",".join(columns)}"'
        text = f"has no columns {' and '.join(columns)}" if header else "is empty"
        raise BrokenRuleError(text, remedy, value=path.name)
    if len(rows) == 1:
        raise BrokenRuleError("has no rows", "add the points of the curve", value=path.name)
    if twice := next((name for name in columns if header.count(name) > 1), None):
        raise BrokenRuleError(f"names the column {twice} twice", "rename one", value=path.name)
    for number, row in enumerate(rows[1:], 1):
        if len(row) != len(header):
            text = f"has {len(row)} cells in row {number} and {len(header)} in its header"
            raise BrokenRuleError(text, "correct it, and write decimals with a point", value=path.name)
    places = header.index(columns[0]), header.index(columns[1])
    values = [_row(row, places) for row in rows[1:]]
    wrong = next((number for number, row in enumerate(values, 1) if not np.all(np.isfinite(row))), None)
    if wrong is not None:
        text = f"has no finite {' and '.join(columns)} in row {wrong}"
        raise BrokenRuleError(text, "correct or remove the row", value=path.name)
    return np.array(values)


def _row(row: list[str], places: tuple[int, int]) -> tuple[float, ...]:
    try:
        return tuple(float(row[place]) for place in places)
    except (ValueError, IndexError):
        return (float("nan"),)
