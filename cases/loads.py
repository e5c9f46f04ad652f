"""Tables of a case that say what acts on its bodies: tractions and pressure, body forces, eigenstrains and temperature.

Each acts in full at once, or grows: with the load parameter where ``ramp = "load"``, in dynamics over a time.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, ValidationInfo, field_validator, model_validator

from cases.errors import BrokenRuleError
from cases.table import Name, Table, require_one
from cases.units import Acceleration, ForceDensity, Number, Stress, quantity

WITH_LOAD: Literal["load"] = "load"


def _ramp(value: Any, info: ValidationInfo) -> Any:
    """The word "load", or a time in the units of the case."""
    if value == WITH_LOAD:
        return value
    time = quantity(value, "time", info)
    if isinstance(time, int | float) and time < 0:
        raise BrokenRuleError("must be at least 0", 'give a time, or "load" in a quasi-static case', value=value)
    return time


Ramp = Annotated[float | Literal["load"], BeforeValidator(_ramp, json_schema_input_type=float | str)]


class Acting(Table):
    """Something that acts on bodies.

    Attributes
    ----------
    ramp : "load" multiplies it by the load parameter; left out it acts in full from the first state on
    """

    ramp: Literal["load"] | None = None

    @property
    def follows_load(self) -> bool:
        """It is multiplied by the load parameter."""
        return self.ramp == WITH_LOAD

    @property
    def is_zero(self) -> bool:
        """Nothing acts: all of its amounts are zero."""
        amounts = (getattr(self, key, None) for key in ("value", "pressure", "gravity", "temperature"))
        return not any(np.any(amount) for amount in amounts if amount is not None)


class Traction(Acting):
    """Force per area on the edge of the bodies along a boundary set: a vector, or a pressure against the edge.

    It is that of the first geometry, and goes with the material.

    Attributes
    ----------
    on : name of a boundary set; of a box or a segment, the part of the edges that lies in it
    value : in x and y [stress]
    pressure : along the inward normal of the edge, curved or not [stress]
    ramp : "load" in quasi-static cases; in dynamics the time over which it grows from zero, at once if 0 [time]
    """

    on: Name
    value: tuple[Stress, Stress] | None = None
    pressure: Stress | None = None
    ramp: Ramp = 0.0  # type: ignore[assignment]

    @model_validator(mode="after")
    def _is_one_traction(self) -> Traction:
        require_one(self, "traction", ("value", "pressure"))
        return self

    def share(self, time: float) -> float:
        """The part of the value that acts at a time of a dynamic case."""
        return min(1.0, max(0.0, time / self.ramp)) if isinstance(self.ramp, float) and self.ramp else 1.0

    def on_edges(self, normals: NDArray) -> NDArray:
        """Force per area (n, 2) on edges with outward normals (n, 2) [stress]."""
        if self.pressure is not None:
            return -self.pressure * normals
        assert self.value is not None
        return np.tile(self.value, (len(normals), 1))


class BodyForce(Acting):
    """Force on the volume of bodies: gravity, or a force per volume.

    Attributes
    ----------
    on : name of a body; all of them without
    gravity : acceleration, which acts on the density [length/time²]
    value : force per volume [force/length³]
    """

    on: Name | None = None
    gravity: tuple[Acceleration, Acceleration] | None = None
    value: tuple[ForceDensity, ForceDensity] | None = None

    @model_validator(mode="after")
    def _is_one_force(self) -> BodyForce:
        require_one(self, "force", ("gravity", "value"))
        return self


Pair = tuple[Number, Number]


class Eigenstrain(Acting):
    """Strain that a body would have without stress: the elastic law acts on what the strain is beyond it.

    Attributes
    ----------
    on : name of a body; all of them without
    temperature : change that expands the material by its `expansion` alike in all directions [kelvin]; the energy that
        the stress out of the plane then stores in plane strain is left out and drives no crack
    value : the tensor [[xx, xy], [xy, yy]]; in plane strain it has no component out of the plane
    """

    on: Name | None = None
    temperature: Number | None = None
    value: tuple[Pair, Pair] | None = None

    @field_validator("value")
    @classmethod
    def _is_symmetric(cls, value: tuple[Pair, Pair] | None) -> tuple[Pair, Pair] | None:
        if value is not None and value[0][1] != value[1][0]:
            raise BrokenRuleError("is not symmetric", "write it as [[xx, xy], [xy, yy]]", value=list(map(list, value)))
        return value

    @model_validator(mode="after")
    def _is_one_strain(self) -> Eigenstrain:
        require_one(self, "strain", ("temperature", "value"))
        return self
