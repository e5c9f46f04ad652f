"""From the errors of pydantic to one sentence that names file, key, value and remedy."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from cases.errors import BrokenRuleError, CaseError
from cases.notches import NOTCH_KINDS

# Error type of pydantic -> (what is wrong, remedy), filled in with the error's context.
_PHRASES: dict[str, tuple[str, str]] = {
    "missing": ("is missing", "add it"),
    "finite_number": ("is not finite", "give a finite number"),
    "greater_than": ("must be above {gt}", "give a larger number"),
    "greater_than_equal": ("must be at least {ge}", "give a larger number"),
    "less_than": ("must be below {lt}", "give a smaller number"),
    "less_than_equal": ("must be at most {le}", "give a smaller number"),
    "literal_error": ("is not one of the choices", "choose {expected}"),
    "union_tag_invalid": ("is not one of the choices", "choose {expected_tags}"),
    "union_tag_not_found": ("has no kind", "add the key 'kind'"),
    "model_type": ("is not a table", "write it as a table"),
    "dict_type": ("is not a table", "write it as a table"),
    "float_type": ("is not a number", "give a number"),
    "float_parsing": ("is not a number", "give a number"),
    "int_type": ("is not a whole number", "give a whole number"),
    "int_parsing": ("is not a whole number", "give a whole number"),
    "int_from_float": ("is not a whole number", "give a whole number"),
    "bool_type": ("is neither true nor false", "give true or false"),
    "bool_parsing": ("is neither true nor false", "give true or false"),
    "string_type": ("is not a text", 'write it in quotes "..."'),
    "string_too_short": ("is empty", "write at least {min_length} character"),
    "string_pattern_mismatch": ("is not a name", "use letters, digits and _, starting with a letter"),
    "tuple_type": ("is not a list", "write it as [..]"),
    "string_too_long": ("is too long", "use at most {max_length} characters"),
    "too_short": ("has too few entries", "give at least {min_length}"),
    "too_long": ("has too many entries", "give at most {max_length}"),
}
_LONGEST_VALUE = 60
# A default that depends on a field which is itself wrong.
_UNAVAILABLE_DEFAULT = "default_factory_not_called"


def case_error(file: Any, error: ValidationError, origins: list[tuple[str, dict[str, Any]]]) -> CaseError:
    """The sentence for the first error of a validation; unknown keys come first, they explain the others.

    Parameters
    ----------
    file : what to call the file
    origins : (prefix, tables) of changes that were merged; a key found in them is named with the prefix
    """
    details = _causes(error.errors(include_url=False))
    first = min(details, key=lambda detail: "is unknown" not in detail["msg"])
    key, value, text, remedy = _parts(first)
    more = f" ({len(details) - 1} more to correct)" if len(details) > 1 else ""
    return sentence(file, _original(key, origins), value, text, remedy + more)


def sentence(file: Any, key: str, value: Any, text: str, remedy: str) -> CaseError:
    """CaseError with the sentence "file: key = value text; remedy."."""
    shown = "" if value is None else f" = {_shown(value)}"
    subject = f"{key!r}{shown} " if key else ""
    return CaseError(f"{file}: {subject}{text}; {remedy}.")


def _causes(details: list[Any]) -> list[Any]:
    """Details less those that follow from others: a list whose entry is wrong, a missing default."""
    places = [detail["loc"] for detail in details]

    def follows(place: tuple[int | str, ...]) -> bool:
        """Something inside of it is wrong."""
        return any(other[: len(place)] == place and len(other) > len(place) for other in places)

    first = [d for d in details if d["type"] != _UNAVAILABLE_DEFAULT and not follows(d["loc"])]
    return first or details


def _parts(detail: Any) -> tuple[str, Any, str, str]:
    key = _dotted(detail["loc"])
    cause = detail.get("ctx", {}).get("error")
    if isinstance(cause, BrokenRuleError):
        full = ".".join(part for part in (key, cause.key) if part)
        return full, cause.value, cause.text, cause.remedy
    value = detail.get("input")
    if detail["type"] == "union_tag_invalid":
        key, value = f"{key}.kind", detail["ctx"]["tag"]
    if detail["type"] in ("missing", "model_type", "dict_type") or isinstance(value, dict):
        value = None
    text, remedy = _PHRASES.get(detail["type"], (detail["msg"].removeprefix("Input ").lower(), "correct it"))
    context = {key: _tidy(item) for key, item in detail.get("ctx", {}).items()}
    return key, value, text.format(**context), remedy.format(**context)


def _tidy(item: Any) -> Any:
    return f"{item:g}" if isinstance(item, float) else item


def _dotted(location: tuple[int | str, ...]) -> str:
    """ "notches[0].width" for ("notches", 0, "slit", "width"): tags of unions and "[key]" are no keys."""
    key = ""
    for position, part in enumerate(location):
        if isinstance(part, int):
            key += f"[{part}]"
        elif part != "[key]" and not (part in NOTCH_KINDS and location[0] == "notches" and position == 2):
            key += f".{part}" if key else part
    return key


def _original(key: str, origins: list[tuple[str, dict[str, Any]]]) -> str:
    for prefix, tables in origins:
        found: Any = tables
        for part in key.partition("[")[0].split("."):
            found = found.get(part) if isinstance(found, dict) else None
        if found is not None:
            return f"{prefix}.{key}"
    return key


def _shown(value: Any) -> str:
    try:
        text = str(value).lower() if isinstance(value, bool) else repr(value)
    except (ValueError, RecursionError):  # Python writes no whole number of thousands of digits
        return "..."
    return text if len(text) <= _LONGEST_VALUE else text[: _LONGEST_VALUE - 3] + "..."
