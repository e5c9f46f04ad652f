"""Mutants of case files: what a hostile or hasty writer might hand in."""

from __future__ import annotations

import copy
import math
import random
import shutil
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

from cases.loader import CASE_FILE, LIBRARY, list_cases

from .toml_text import toml_text

Tables = dict[str, Any]
Place = tuple[Any, Any]  # a table or list, and the key or number in it

NAMES = [
    "", "..", ".", "a/b", "a.b", "__class__", "x" * 300, "Größe", "断裂", "\u202eexe", "a b", "[h=10]", "CON", "-rf",
    "'", '"', "\n", "young", "h", "fem", "mpm", "baseline", "none",
]  # fmt: skip
TEXTS = [
    "", " ", "nan", "1e999 mm", "5 kg", "3 mm", "210 GPa", "9.81 m/s^2", "1 m^9", "1e300 mm", "-1 mm", "3 °C",
    "x" * 100_000,
    "{fem,mpm}", "{" * 200, "{a,{b,c}}", "FAMILY[*]", "value:nan", "value:1e400", "reference:", "run:fem",
    "[*]", "\x00", "\x7f",
    "é" * 300, "😀", "../../etc/passwd", "/etc/passwd", "/dev/zero", "case.toml", "a.msh", "%s%n", "{0.__class__}",
    "<b>&amp;</b>",
]  # fmt: skip
NUMBERS = [
    0, 1, -1, 2, 0.0, -0.0, 1e-300, 5e-324, 1e300, -1e300, 1.7e308, 1e15, 1e9, -1e9, 1e-9, 0.5, 3, 7, 10**6, 2**63,
    -(2**63), 10**400,
    math.nan, math.inf, -math.inf, True, False,
]  # fmt: skip


@cache
def base(name: str) -> Tables:
    """The parsed file of a case of the library."""
    return tomllib.loads((LIBRARY / name / CASE_FILE).read_text(encoding="utf-8"))


def written_mutant(rng: random.Random, folder: Path) -> Path:
    """The file of a mutant of a case of the library, with the files that it refers to beside it."""
    name = rng.choice(list_cases())
    home = folder / rng.choice([name, name, name, "..x", "a b", "ü", "-rf", "[h=10]", "x" * 200])
    shutil.copytree(LIBRARY / name, home)
    path = home / rng.choice([CASE_FILE, CASE_FILE, CASE_FILE, "other.toml", "...toml", ".toml", "a=b.toml"])
    tables = mutated(rng, base(name))
    path.write_bytes(_spoiled(rng, toml_text(tables)))
    return path


def mutated(rng: random.Random, tables: Tables) -> Tables:
    """A copy of the tables with one to three mutations."""
    tables = copy.deepcopy(tables)
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        rng.choice([_drop, _replace, _replace, _scale, _scale, _rename, _add, _repeat, _swap, _nest])(rng, tables)
    return tables


def _places(tables: Any) -> list[Place]:
    keys = tables if isinstance(tables, dict) else range(len(tables)) if isinstance(tables, list) else ()
    return [place for key in keys for place in ((tables, key), *_places(tables[key]))]


def _place(rng: random.Random, tables: Tables) -> Place:
    """Of the whole file; prose is seldom worth it, and a table of the file is as likely as another."""
    top = rng.choice(list(tables) or [""])
    if top not in tables:
        return tables, top
    return rng.choice([(tables, top), *_places(tables[top]) * 4])


def _drop(rng: random.Random, tables: Tables) -> None:
    holder, key = _place(rng, tables)
    if key in holder or isinstance(holder, list):
        del holder[key]


def _replace(rng: random.Random, tables: Tables) -> None:
    holder, key = _place(rng, tables)
    holder[key] = hostile(rng)


def _scale(rng: random.Random, tables: Tables) -> None:
    numbers = [(h, k) for h, k in _places(tables) if isinstance(h[k], int | float) and not isinstance(h[k], bool)]
    if numbers:
        holder, key = rng.choice(numbers)
        factor = rng.choice([-1, 0, 0.5, 2, 3, 10, 0.1, 1e3, 1e-3, 1e6, 1e-6, 1e12, 1e-12, 1e300, -1e300])
        # a number of an earlier mutation may have no float
        scaled = holder[key] * factor if abs(holder[key]) < 2**64 else 0
        holder[key] = rng.choice([scaled, rng.choice(NUMBERS)])


def _rename(rng: random.Random, tables: Tables) -> None:
    holder, key = _place(rng, tables)
    if isinstance(holder, dict) and key in holder:
        holder[rng.choice([*NAMES, str(key).upper(), f"{key}s", str(key)[:-1]])] = holder.pop(key)


def _add(rng: random.Random, tables: Tables) -> None:
    holder, _ = _place(rng, tables)
    if isinstance(holder, dict):
        others = [key for h, key in _places(tables) if isinstance(h, dict)]
        holder[rng.choice([*NAMES, *others])] = hostile(rng)
    else:
        holder.append(hostile(rng))


def _repeat(rng: random.Random, tables: Tables) -> None:
    lists = [(h, k) for h, k in _places(tables) if isinstance(h[k], list)]
    if lists:
        holder, key = rng.choice(lists)
        holder[key] = holder[key] * rng.choice([0, 2, 3, 100])


def _swap(rng: random.Random, tables: Tables) -> None:
    (first, a), (second, b) = _place(rng, tables), _place(rng, tables)
    if a in first if isinstance(first, dict) else True:
        second[b] = copy.deepcopy(first[a])


def _nest(rng: random.Random, tables: Tables) -> None:
    holder, key = _place(rng, tables)
    value: Any = hostile(rng)
    for _ in range(rng.choice([1, 3, 60, 300])):
        value = [value] if rng.random() < 0.5 else {rng.choice(["a", str(key) or "a", "difference", "of"]): value}
    holder[key] = value


def hostile(rng: random.Random) -> Any:
    """A value that seldom fits."""
    kinds = [NUMBERS, NUMBERS, TEXTS, [[], {}, [[]], [1, 2], [1e300, -1e300], [0, 0, 0], [True], ["x"], {"a": 1}, [{}]]]
    return copy.deepcopy(rng.choice(rng.choice(kinds)))


def _spoiled(rng: random.Random, text: str) -> bytes:
    """The text as bytes, one time in ten damaged."""
    data = text.encode("utf-8", "surrogatepass")
    if rng.random() > 0.1:
        return data
    at = rng.randrange(len(data) + 1)
    return rng.choice([
        b"\xef\xbb\xbf" + data, text.encode("utf-16", "surrogatepass"), data[:at],
        data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :],
        data + data, data[:at] + b"\x00" + data[at:], data.replace(b"\n", b"\r\n"), data.replace(b"=", b":", 1), b"",
    ])  # fmt: skip
