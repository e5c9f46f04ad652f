"""Tables of a case that moves: time stepping, tractions, contact, and what is recorded over time."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from cases.errors import BrokenRuleError
from cases.table import Name, Switch, Table
from cases.units import Acceleration, Number, Rate, Stress, Time

#: keys that explicit integration does not look at, with the value that says what it does, None where none does
WITHOUT_EFFECT: dict[str, Any] = {
    "mesh.geometry": "initial",
    "mesh.follow_crack": False,
    "mpm.constraints_on": "edges",
    "mpm.penalty": None,
    "mpm.strain": "updated",
    "mpm.move_points": True,
    "mpm.fill_cells": False,
    "mpm.margin": None,
    "mpm.linear_solver": "direct",
    "staggered.scheme": "passes",
    "staggered.residual_tolerance": None,
    "staggered.memory": None,
    "staggered.largest_iterations": None,
}


class Dynamics(Table):
    """Explicit integration in time; it takes the place of the load.

    Attributes
    ----------
    end_time : the run goes from 0 to here [time]
    time_step : [time]; without it, `time_step_share` of what `time_step_rule` gives
    time_step_rule : the bound that is proven for the basis and any cloud of points, or "courant" = h / c, of
        which the thesis takes 0.8
    gravity : acceleration of all bodies [length/time²]
    damping : rate at which all velocities fall, for bodies that come to rest [1/time]
    flip : 1 updates the points' velocities by increments (FLIP, Eq. 6.43), 0 replaces them (PIC); between, a blend
    affine : map the points' velocity gradients to the grid too, so that a turning body keeps its spin: without it a
        node beside the edge takes the velocity of the points' middle, not that of its own place
    order_of_update : strains before ("usl", as Algorithm 3) or after ("musl") the points' velocities, which are
        then mapped to the grid again
    rotation : "additive" sums small strains in fixed axes (Eq. 6.41); "corotational" turns them with the material
    """

    end_time: Annotated[Time, Field(gt=0)]
    time_step: Annotated[Time, Field(gt=0)] | None = None
    time_step_rule: Literal["proven", "courant"] = "proven"
    time_step_share: Annotated[Number, Field(gt=0)] = 0.8
    gravity: tuple[Acceleration, Acceleration] = (0.0, 0.0)
    damping: Annotated[Rate, Field(ge=0)] = 0.0
    flip: Annotated[Number, Field(ge=0, le=1)] = 1.0
    affine: Switch = False
    order_of_update: Literal["musl", "usl"] = "usl"
    rotation: Literal["additive", "corotational"] = "corotational"

    @model_validator(mode="after")
    def _has_one_time_step(self) -> Dynamics:
        if self.time_step is not None and {"time_step_rule", "time_step_share"} & self.model_fields_set:
            remedy = "leave out time_step_rule and time_step_share, or time_step"
            raise BrokenRuleError("stands beside the rule for it", remedy, "time_step", self.time_step)
        return self

    @model_validator(mode="after")
    def _keeps_gradients_that_are_updated(self) -> Dynamics:
        # mapped again, the points' old gradients would be taken for new ones: no force could ever change them
        if self.affine and self.order_of_update == "musl":
            raise BrokenRuleError("is unstable at any step with the affine map", 'give "usl"', "order_of_update", "musl")
        return self


class Traction(Table):
    """Force per area on the edge of the bodies along a boundary set.

    Attributes
    ----------
    on : name of a boundary set
    value : in x and y [stress]
    ramp : time over which it grows from zero [time]; at once if 0
    """

    on: Name
    value: tuple[Stress, Stress]
    ramp: Annotated[Time, Field(ge=0)] = 0.0

    def share(self, time: float) -> float:
        """The part of the value that acts at a time."""
        return min(1.0, time / self.ramp) if self.ramp else 1.0


class ContactPair(Table):
    """Friction between two bodies that differs from that of the others."""

    bodies: tuple[Name, Name]
    friction: Annotated[Number, Field(ge=0)]


class Contact(Table):
    """Contact of the bodies in the material point method (Eqs. 6.29-6.40).

    Attributes
    ----------
    friction : Coulomb's coefficient of all pairs of bodies that `pairs` does not name
    by_distance : bodies push only where their points are no further apart than inside a body; without it they
        push as soon as they share a grid node, a cell or more too early
    """

    friction: Annotated[Number, Field(ge=0)] = 0.0
    pairs: tuple[ContactPair, ...] = ()
    by_distance: Switch = True
