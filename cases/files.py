"""Files that a case refers to: they lie beside it, exist, and hold what they should."""

from __future__ import annotations

import csv
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


def read_columns(path: Path) -> tuple[list[str], NDArray[np.float64]]:
    """Names (m) and rows (n, m) of a table of numbers, columns parted by commas, semicolons, tabs or spaces.

    Lines that begin with # are comments; where no other line is a header, the last of them before the numbers is. A cell
    that is empty or no number is NaN, and empty ones behind the last name are passed over.

    Raises
    ------
    BrokenRuleError : no text, without a header or rows, or a row has more or fewer cells than the header
    """
    try:
        lines = [line.strip() for line in read_text(path).splitlines() if line.strip()]
    except UnicodeDecodeError as error:
        text = f"is no UTF-8 text (byte {error.start})"
        raise BrokenRuleError(text, "save it as CSV in UTF-8", value=path.name) from None
    except OSError:
        raise BrokenRuleError("cannot be read", "allow reading it", value=path.name) from None
    rows = [line for line in lines if not line.startswith("#")]
    if not rows:
        raise BrokenRuleError("is empty", "give a header such as u,F and a row for each state", value=path.name)
    delimiter = next((sign for sign in (",", ";", "\t") if sign in rows[0]), None)
    header = _cells(rows[0], delimiter)
    if all(_is_number(cell) for cell in header):
        header, rows = _commented_header(path, lines, len(header), delimiter), ["", *rows]
    while header and not header[-1]:
        header.pop()
    values = [_cells(row, delimiter) for row in rows[1:]]
    values = [row[: len(header)] if not any(row[len(header) :]) else row for row in values]
    if not values:
        text = f"has no rows under its header {', '.join(header)}"
        raise BrokenRuleError(text, "give one for each state", value=path.name)
    for number, row in enumerate(values, 1):
        if len(row) != len(header):
            text = f"has {len(row)} cells in row {number} and {len(header)} in its header"
            raise BrokenRuleError(text, "correct it, and write decimals with a point", value=path.name)
    return header, np.array([[_number(cell) for cell in row] for row in values])


def _cells(line: str, delimiter: str | None) -> list[str]:
    cells = line.split() if delimiter is None else next(csv.reader([line], delimiter=delimiter))
    return [cell.strip() for cell in cells]


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def _is_number(cell: str) -> bool:
    return bool(np.isfinite(_number(cell))) or cell.lower() in ("nan", "inf", "-inf")


def _commented_header(path: Path, lines: list[str], count: int, delimiter: str | None) -> list[str]:
    comments = [_cells(line.lstrip("# "), delimiter) for line in lines if line.startswith("#")]
    fitting = [cells for cells in comments if len(cells) == count and not any(map(_is_number, cells))]
    if not fitting:
        text = f"has no header, its first line is {count} numbers"
        raise BrokenRuleError(text, "write one above it, such as u,F", value=path.name)
    return fitting[-1]


def read_curve(path: Path, columns: tuple[str, str] = ("u", "F")) -> NDArray[np.float64]:
    """Two columns (n, 2) of a table, force over displacement if not others; see `read_columns`.

    Raises
    ------
    BrokenRuleError : it is no table, columns are missing or there twice, or a number is missing or not finite
    """
    header, values = read_columns(path)
    if not set(columns) <= set(header):
        remedy = f'start it with the line "{",".join(columns)}"'
        raise BrokenRuleError(f"has no columns {' and '.join(columns)}", remedy, value=path.name)
    if twice := next((name for name in columns if header.count(name) > 1), None):
        raise BrokenRuleError(f"names the column {twice} twice", "rename one", value=path.name)
    curve = values[:, [header.index(name) for name in columns]]
    wrong = np.flatnonzero(~np.isfinite(curve).all(axis=1))
    if len(wrong):
        text = f"has no finite {' and '.join(columns)} in row {wrong[0] + 1}"
        raise BrokenRuleError(text, "correct or remove the row, with a point for decimals", value=path.name)
    return curve
