"""From the columns of somebody else's table to those of a history: a short text that is parsed, never evaluated.

    u = U2, F = -2 * RF2 [N], d = DAMAGE, half model

An entry names a column of the history, and the column of the table that holds it with a factor and, in brackets, its
unit; names with signs other than letters, digits, _ . : ( ) and spaces stand in quotes. A word says what the table is of.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from cases.errors import BrokenRuleError
from cases.units import Units

#: words of a mapping -> what they say
WORDS = {
    "half model": "forces and energies are those of one half, and count twice",
    "per thickness": "forces and energies are those of a unit of thickness",
    "damage": "the column of c_min is the largest damage d = 1 - c",
}
_ALIASES = {"half": "half model", "force per thickness": "per thickness", "per unit thickness": "per thickness"}
#: columns of a history -> kind of quantity, as in `cases.units.KINDS`
KINDS_OF_COLUMNS = {
    "time": "time", "u": "length", "F": "force", "c_min": "number",
    "E_el": "energy", "E_frac": "energy", "E_kin": "energy", "W_ext": "energy",
}  # fmt: skip
#: the largest damage d, which is 1 - c_min
DAMAGE = "d"
FORCE_LIKE = ("F", "E_el", "E_frac", "E_kin", "W_ext")
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_COLUMN = r"\"[^\"]+\"|'[^']+'|[^\W\d][\w.:() ]*?"
_ENTRY = re.compile(
    rf"\s*(?P<target>[A-Za-z]\w*)\s*=\s*(?P<sign>[+-])?\s*(?:(?P<before>{_NUMBER})\s*\*\s*)?"
    rf"(?P<column>{_COLUMN})\s*(?:(?P<operator>[*/])\s*(?P<after>{_NUMBER})\s*)?(?:\[(?P<unit>[^\]]*)\])?\s*"
)
_LONGEST = 2000
REMEDY = 'write entries such as "u = U2, F = -2 * RF2 [N]", or a word: ' + ", ".join(WORDS)


@dataclass(frozen=True)
class Source:
    """Where a column of a history comes from: a column of the table, times a factor, in a unit if one is given."""

    column: str
    factor: float = 1.0
    unit: str = ""


@dataclass(frozen=True)
class Mapping:
    """A parsed mapping: column of the history -> source, and words of `WORDS`."""

    sources: dict[str, Source]
    words: tuple[str, ...] = ()


def parse_mapping(text: str) -> Mapping:
    """The mapping that a text describes; the empty text maps nothing.

    Raises
    ------
    BrokenRuleError : a part is neither an entry nor a word, or a column is given twice
    """
    if len(text) > _LONGEST:
        raise BrokenRuleError(f"is longer than {_LONGEST} letters", REMEDY)
    sources: dict[str, Source] = {}
    words: list[str] = []
    for part in filter(None, (part.strip() for part in _parts(text))):
        word = " ".join(part.replace("-", " ").replace("_", " ").split()).lower()
        if _ALIASES.get(word, word) in WORDS:
            words.append(_ALIASES.get(word, word))
            continue
        target, source = _entry(part)
        if target in sources:
            raise BrokenRuleError(f"maps {target!r} twice", "remove one of the two", value=text)
        sources[target] = source
    return Mapping(sources, tuple(words))


def _parts(text: str) -> list[str]:
    """The text cut at commas and semicolons outside quotes and brackets."""
    return re.findall(r"(?:\"[^\"]*\"|'[^']*'|\[[^\]]*\]|[^,;])+", text)


def _entry(part: str) -> tuple[str, Source]:
    match = _ENTRY.fullmatch(part)
    if match is None:
        raise BrokenRuleError("is not understood", REMEDY, value=part)
    factor = -1.0 if match["sign"] == "-" else 1.0
    factor *= float(match["before"] or 1.0)
    if match["after"]:
        after = float(match["after"])
        if after == 0.0:
            raise BrokenRuleError("has the factor 0", "give another one", value=part)
        factor *= after if match["operator"] == "*" else 1.0 / after
    return match["target"], Source(match["column"].strip("\"' "), factor, (match["unit"] or "").strip())


def unit_factor(unit: str, column: str, units: Units, kinds: dict[str, str]) -> float:
    """By what a number in a unit is multiplied to be in those of the case.

    kinds : of quantity of the columns, those of KINDS_OF_COLUMNS or of a case

    Raises
    ------
    BrokenRuleError : an unknown unit, one of another quantity, or a column of which no unit is known
    """
    kind = kinds.get(column)
    if kind is None:
        text = "has a unit, which is only known of " + ", ".join(kinds)
        raise BrokenRuleError(text, "give a factor instead", column, f"[{unit}]")
    if kind == "number":
        raise BrokenRuleError("is the unit of what is a plain number here", "leave it out", column, f"[{unit}]")
    try:
        return units.convert(f"1 {unit}", kind)
    except BrokenRuleError as error:
        wanted = units.label(kind)
        raise BrokenRuleError(error.text, f"give a unit of {kind}, such as [{wanted}]", column, f"[{unit}]") from None
