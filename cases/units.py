"""Units of a case: plain numbers are in the units of the file, strings such as "210 GPa" are converted."""

from __future__ import annotations

import math
import re
from functools import cache, cached_property
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator

from cases.errors import BrokenRuleError
from cases.table import Table

if TYPE_CHECKING:
    from pint import Quantity, UnitRegistry

# Exponents of force, length and time in each kind of quantity.
KINDS: dict[str, tuple[int, int, int]] = {
    "number": (0, 0, 0),
    "angle": (0, 0, 0),
    "length": (0, 1, 0),
    "displacement": (0, 1, 0),
    "force": (1, 0, 0),
    "stress": (1, -2, 0),
    "toughness": (1, -1, 0),
    "stiffness": (1, -1, 0),
    "energy": (1, 1, 0),
    "power": (1, 1, -1),
    "time": (0, 0, 1),
    "density": (1, -4, 2),
    "force_density": (1, -3, 0),
    "velocity": (0, 1, -1),
    "acceleration": (0, 1, -2),
    "rate": (0, 0, -1),
    "momentum": (1, 0, 1),
}

#: largest and smallest size other than 0 that a number of a kind can have, in SI units: from less than an atom's nucleus
#: to planets, light and neutron stars; what lies beyond is a slip, and its powers leave the range of numbers
SIZES: dict[str, tuple[float, float]] = {
    "number": (1e18, 1e-30),
    "angle": (1e18, 1e-30),
    "length": (1e9, 1e-24),
    "stress": (1e18, 1e-18),
    "toughness": (1e18, 1e-24),
    "time": (1e18, 1e-30),
    "density": (1e18, 1e-18),
    "force_density": (1e18, 1e-18),
    "velocity": (3e8, 1e-30),
    "acceleration": (1e15, 1e-30),
    "rate": (1e18, 1e-30),
}

#: units that most cases name, in SI units: for them alone pint is not loaded, which takes longer than the case
COMMON: dict[str, dict[str, float]] = {
    "force": {"N": 1.0, "kN": 1e3, "MN": 1e6},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
}

_EXAMPLES = {"length": "0.5 mm", "stress": "210 GPa", "toughness": "2.7 N/mm", "density": "7850 kg/m^3",
             "time": "1 s", "force": "1 kN", "number": "0.3", "velocity": "1 m/s",
             "acceleration": "9.81 m/s^2", "rate": "2 s^-1", "angle": "30 deg", "force_density": "25 kN/m^3"}  # fmt: skip
# A number and a product of units; exponents are single digits, so that no string can ask for a huge power.
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_UNIT = r"[A-Za-zµμ%°]+(?:(?:\^|\*\*)-?[1-9]|[²³⁴])?"
_QUANTITY = re.compile(rf"({_NUMBER})\s*((?:{_UNIT})(?:(?:\s*[*/·]\s*|\s+){_UNIT})*)?")
_LONGEST_QUANTITY = 64
_SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


@cache
def unit_registry() -> UnitRegistry:
    """The registry of units, loaded and built at the first unit that needs it (it takes most of a second)."""
    from pint import UnitRegistry

    return UnitRegistry()


class Units(Table):
    """Units of every plain number in the file and of every result.

    Attributes
    ----------
    length, force, time : unit names that pint knows, such as "mm", "kN", "s"
    """

    length: str = Field(description="unit of length, such as mm")
    force: str = Field(description="unit of force, such as kN")
    time: str = Field(default="s", description="unit of time")

    @field_validator("length", "force", "time")
    @classmethod
    def _is_a_unit(cls, name: str, info: ValidationInfo) -> str:
        kind = str(info.field_name)
        example = {"length": "mm", "force": "kN", "time": "s"}[kind]
        remedy = f'name one unit of {kind}, such as "{example}"'
        if not re.fullmatch(r"[A-Za-zµμ]{1,24}", name):
            raise BrokenRuleError("is not the name of a unit", remedy, value=name)
        try:
            fits = name in COMMON[kind] or _are_of_one_kind(name, example)
        except Exception:  # pint raises many kinds of error for a name that it does not know
            raise BrokenRuleError("is not a known unit", remedy, value=name) from None
        if not fits:
            raise BrokenRuleError(f"is not a unit of {kind}", remedy, value=name)
        return name

    def label(self, kind: str) -> str:
        """Text of the unit of a kind of quantity, such as "kN/mm²" for "stress".

        Raises
        ------
        KeyError : the kind is none of `KINDS`
        """
        if kind == "angle":
            return "degrees"
        names = (self.force, self.length, self.time)
        powers = list(zip(names, KINDS[kind], strict=True))
        above = [_power(name, power) for name, power in powers if power > 0]
        below = [_power(name, -power) for name, power in powers if power < 0]
        return "/".join(["·".join(above) or "1", *below]) if above or below else "1"

    def expression(self, kind: str) -> str:
        """The unit of a kind of quantity as pint reads it."""
        if kind == "angle":
            return "degree"
        force, length, time = KINDS[kind]
        return f"{self.force}**({force}) * {self.length}**({length}) * {self.time}**({time})"

    @cached_property
    def sizes(self) -> dict[str, tuple[float, float]]:
        """`SIZES` in the units of the case."""
        units = {kind: self.in_si(kind) for kind in SIZES}
        return {kind: (most / units[kind], least / units[kind]) for kind, (most, least) in SIZES.items()}

    def in_si(self, kind: str) -> float:
        """The unit of a kind of quantity in SI units."""
        known = [COMMON[key].get(getattr(self, key)) for key in COMMON]
        if None in known and any(KINDS[kind]):
            return _in_si(self.expression(kind))
        return math.prod(unit**power for unit, power in zip(known, KINDS[kind], strict=True) if unit is not None)

    def convert(self, text: str, kind: str) -> float:
        """Number in the units of the case for a string such as "210 GPa".

        Raises
        ------
        BrokenRuleError : not a number with a unit, or a unit of another dimension
        """
        from pint.errors import DimensionalityError

        example = _EXAMPLES.get(kind, "1 mm")
        unit = "without a unit" if kind == "number" else f"in {self.label(kind)}"
        remedy = f'write a plain number {unit} or a string such as "{example}"'
        match = _QUANTITY.fullmatch(text.strip()) if len(text) <= _LONGEST_QUANTITY else None
        if not match:
            raise BrokenRuleError("is not a number with a unit", remedy, value=text)
        try:
            quantity = unit_registry().Quantity(float(match[1]), (match[2] or "").replace("·", "*"))
            number = float(quantity.to(self.expression(kind)).magnitude)
        except DimensionalityError:
            what = "plain number" if kind == "number" else f"quantity of {kind}"
            raise BrokenRuleError(f"is not a {what}", remedy, value=text) from None
        except Exception:  # pint raises many kinds of error for a malformed unit, some of them Python's own
            raise BrokenRuleError("has an unknown unit", remedy, value=text) from None
        _require_turns(quantity, kind, text, remedy)
        if kind == "stress" and re.search(r"\bmPa\b", match[2] or ""):
            raise BrokenRuleError("is in millipascals", 'write "MPa" for megapascals', value=text)
        return number


def _require_turns(quantity: Quantity[float], kind: str, text: str, remedy: str) -> None:
    """An angle is no plain number, a plain number no angle, cycles no radians, though pint takes them for each other."""
    if kind in ("number", "angle") and (str(quantity.to_base_units().units) == "radian") != (kind == "angle"):
        what = "an angle" if kind == "angle" else "a plain number"
        raise BrokenRuleError(f"is not {what}", remedy, value=text)
    if kind == "rate" and re.search("hertz|counts_per", str(quantity.units)):
        turned = 2.0 * math.pi * quantity.m_as("1/s")
        remedy = f'write 2 pi times as much, such as "{turned:.6g} rad/s"'
        raise BrokenRuleError("counts cycles, and rates are those of radians", remedy, value=text)


@cache
def _are_of_one_kind(name: str, other: str) -> bool:
    return bool(unit_registry().Unit(name).is_compatible_with(other))


@cache
def _in_si(expression: str) -> float:
    """A unit in SI units."""
    return float(unit_registry().Quantity(1.0, expression).to_base_units().magnitude)


def _power(name: str, power: int) -> str:
    return name if power == 1 else name + str(power).translate(_SUPERSCRIPTS)


def quantity(value: Any, kind: str, info: ValidationInfo) -> Any:
    """A value of the file in the units of the case; numbers pass, strings are converted.

    The units come in the validation context under "units"; without them only plain numbers are accepted.
    """
    if isinstance(value, bool):
        raise BrokenRuleError(
            "is not a number", f"write a number or a string with a unit of {kind}", value=value
        )
    units: Units | None = (info.context or {}).get("units")
    if isinstance(value, str):
        if units is None:
            raise BrokenRuleError("has a unit but the case states none", "add the table [units]", value=value)
        return _bounded(units.convert(value, kind), value, kind, units)
    return value if units is None else _bounded(value, value, kind, units)


def _bounded(number: Any, written: Any, kind: str, units: Units) -> Any:
    """The number where its size can be that of its kind; what is none, or is not finite, is left to pydantic."""
    if not isinstance(number, int | float) or number == 0 or (isinstance(number, float) and not math.isfinite(number)):
        return number
    most, least = units.sizes[kind]
    if not least <= abs(number) <= most:
        remedy = f"give a number of size {least:.0e} to {most:.0e} {units.label(kind).removeprefix('1')}".rstrip()
        raise BrokenRuleError(f"is beyond every {kind}", remedy, value=written)
    return number


def _reader(kind: str) -> BeforeValidator:
    def read(value: Any, info: ValidationInfo) -> Any:
        """The value in the units of the case."""
        return quantity(value, kind, info)

    return BeforeValidator(read, json_schema_input_type=float | str)


Number = Annotated[float, _reader("number")]
Angle = Annotated[float, _reader("angle")]
Length = Annotated[float, _reader("length")]
Stress = Annotated[float, _reader("stress")]
Toughness = Annotated[float, _reader("toughness")]
Density = Annotated[float, _reader("density")]
ForceDensity = Annotated[float, _reader("force_density")]
Time = Annotated[float, _reader("time")]
Velocity = Annotated[float, _reader("velocity")]
Acceleration = Annotated[float, _reader("acceleration")]
Rate = Annotated[float, _reader("rate")]
Point = tuple[Length, Length]
