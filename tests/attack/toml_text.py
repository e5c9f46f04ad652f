"""Tables written as TOML, mutants and all."""

from __future__ import annotations

import json
import math
import sys
from typing import Any


def toml_text(tables: dict[str, Any]) -> str:
    """One line for each key of the file; tables inside are inline."""
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(20 * limit)  # mutants of mutants are as deep as a thousand braces
    try:
        return "".join(f"{_quoted(key)} = {_value(value)}\n" for key, value in tables.items())
    finally:
        sys.setrecursionlimit(limit)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else str(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_quoted(key)} = {_value(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return _quoted(value) if isinstance(value, str) else str(value)


def _quoted(text: str) -> str:
    # JSON's escapes are TOML's but for those of halves of a character and of delete
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
