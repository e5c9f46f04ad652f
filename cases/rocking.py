"""The table of a case that says which body rocks, and how it is modelled where it is taken as rigid."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from cases.errors import BrokenRuleError
from cases.table import Name, Switch, Table
from cases.units import Number, quantity


def _stiffness(value: object, info: ValidationInfo) -> object:
    """A mode of the half-space, or a number: stiffness over length has the unit of stress over length."""
    if isinstance(value, str) and value in ("vertical", "rocking"):
        return value
    return quantity(value, "number", info)


class Rocking(Table):
    """The block that rocks, for the angle, the verdict and the rigid models.

    Attributes
    ----------
    body : a rectangle
    on : the body beneath, whose material the Winkler model takes for a half-space
    stiffness : of the Winkler springs, force per area and depth in the units of the case, or that of a rigid rectangle on
        the half-space in "vertical" motion or in "rocking" (Pais and Kausel 1988)
    damping : of the dampers, force per area and velocity; without, waves into the half-space carry it, density times
        the speed of pressure waves
    restitution : rate after an impact of the pendulum over that before; Housner's without
    step_share : factor on the time step of the pendulum and of the Winkler model
    stop_when_settled : end a run where the verdict on the body can change no longer
    borders : amplitudes over that which lifts the block, rising, between which a pendulum or a Winkler run looks for
        every change of its verdict; none without
    """

    body: Name
    on: Name | None = None
    stiffness: Annotated[float | Literal["vertical", "rocking"], BeforeValidator(_stiffness)] = "vertical"
    damping: Annotated[Number, Field(ge=0)] | None = None
    restitution: Annotated[Number, Field(gt=0, le=1)] | None = None
    step_share: Annotated[Number, Field(gt=0)] = 1.0
    stop_when_settled: Switch = True
    borders: tuple[Annotated[Number, Field(gt=0)], ...] = ()

    @model_validator(mode="after")
    def _borders_rise(self) -> Rocking:
        if any(b <= a for a, b in zip(self.borders, self.borders[1:], strict=False)) or len(self.borders) == 1:
            raise BrokenRuleError("are not two or more rising amplitudes", "sort them", "borders", list(self.borders))
        if not isinstance(self.stiffness, str) and self.stiffness <= 0.0:
            raise BrokenRuleError("holds nothing", "make it positive", "stiffness", self.stiffness)
        return self
