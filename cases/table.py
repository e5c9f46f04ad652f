"""Base of every table of a case description: frozen, finite, without unknown keys."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Strict, StringConstraints, model_validator

from cases.errors import BrokenRuleError

# Without the conversions that pydantic allows by default: "3" is no number, "yes" is not true.
Whole = Annotated[int, Strict()]
Switch = Annotated[bool, Strict()]

# Names become parts of keys and of folder names.
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=64)]

# A key written after a [table] header belongs to that table; these are the ones that this happens to.
_KEYS_ABOVE_TABLES = ("title", "section", "requirement", "exact")


class Table(BaseModel):
    """One table of the file."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _has_known_keys_only(cls, data: Any) -> Any:
        for key, value in data.items() if isinstance(data, dict) else ():
            if key not in cls.model_fields:
                remedy = unknown_key_remedy(key, list(cls.model_fields))
                shown = None if isinstance(value, dict) else value
                raise BrokenRuleError("is unknown", remedy, str(key), shown)
        return data


def unknown_key_remedy(key: Any, known: list[str]) -> str:
    """What to do about an unknown key: the nearest known one, or the list of all."""
    if key in _KEYS_ABOVE_TABLES:
        return f"move '{key}' above the first [table] of the file"
    return nearest(str(key), known, "remove it")


def nearest(word: str, known: list[str], otherwise: str) -> str:
    """A suggestion: the nearest known word if one is near, all known words if not."""
    near = get_close_matches(word, known, n=1)
    if near:
        return f"did you mean '{near[0]}'"
    return f"{otherwise} (known: {', '.join(known)})" if known else otherwise


def only_known(tables: dict[str, Any], known: tuple[str, ...], prefix: str, text: str) -> None:
    """Raise BrokenRuleError for the first key that is not known, with `prefix` as its table's key."""
    for key in tables:
        if key not in known:
            raise BrokenRuleError(text, nearest(key, list(known), "change another table"), f"{prefix}.{key}")


def require_one(table: Table, what: str, keys: tuple[str, ...]) -> None:
    """Raise BrokenRuleError unless exactly one of the optional keys of the table is given."""
    given = [key for key in keys if getattr(table, key) is not None and getattr(table, key) is not False]
    if len(given) != 1:
        has = " and ".join(given) or "none"
        raise BrokenRuleError(f"must have exactly one {what} but has {has}", f"give one of {', '.join(keys)}")
