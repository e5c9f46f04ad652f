"""Tables of a case that say how it is loaded: what is held and moved, by load or in time, contact."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from cases.course import Course, CourseTable
from cases.errors import BrokenRuleError
from cases.ground import Ground, Settling
from cases.table import Name, Switch, Table
from cases.units import Acceleration, Length, Number, Rate, Time, Velocity, quantity

# smallest increment = increment / SMALLEST_SHARE where the file gives none: six halvings.
SMALLEST_SHARE = 64
# Increments of a load and steps in time beyond which a number is a slip of the pen.
MOST_INCREMENTS, MOST_STEPS = 1_000_000, 1_000_000_000


class Constraint(Table):
    """What is prescribed on a boundary set: exactly one of scale, value, velocity, table, motion, tied.

    Attributes
    ----------
    on : name of a boundary set
    direction : "x", "y" (displacement) or "phase" (phase field); left out with `motion`
    scale : displacement = scale * load parameter u
    value : constant displacement [length] or phase field
    velocity : constant velocity, in dynamics only [length/time]
    table : over the load parameter, in dynamics over time, linear between its rows: [[time, value], ...], or a CSV file
        beside the case; both in the units of the case
    columns : names of the file's columns, time and the name of what it is a table of if left out
    of : what the table holds, displacement [length], or in dynamics also velocity [length/time]
    motion : name of an exact field that prescribes both displacements
    tied : all points of the set share one free displacement in this direction
    """

    on: Name
    direction: Literal["x", "y", "phase"] | None = None
    scale: Number | None = None
    value: Annotated[float, Field(json_schema_extra={"type": ["number", "string"]})] | None = None
    velocity: Velocity | None = None
    table: CourseTable | None = None
    columns: tuple[str, str] | None = None
    of: Literal["displacement", "velocity"] = "displacement"
    motion: Name | None = None
    tied: Switch = False

    @field_validator("value", mode="before")
    @classmethod
    def _in_units(cls, value: Any, info: ValidationInfo) -> Any:
        return quantity(value, "number" if info.data.get("direction") == "phase" else "length", info)

    @model_validator(mode="after")
    def _prescribes_one_thing(self) -> Constraint:
        keys = ("scale", "value", "velocity", "table", "motion")
        given = [key for key in keys if getattr(self, key) is not None]
        given += ["tied"] if self.tied else []
        if len(given) != 1:
            text = f"prescribes {' and '.join(given) or 'nothing'}"
            raise BrokenRuleError(text, "give exactly one of scale, value, velocity, table, motion, tied")
        self._direction_fits(given[0])
        if self.table is not None:
            assert self.course is not None
        for key in {"columns", "of"} & self.model_fields_set if self.table is None else ():
            raise BrokenRuleError("is that of a table only", "remove it, or give a table", key, getattr(self, key))
        if self.columns is not None and not isinstance(self.table, Path):
            raise BrokenRuleError("is that of a file only", "remove it", "columns", list(self.columns))
        return self

    @cached_property
    def course(self) -> Course | None:
        """The table, read; None without."""
        return None if self.table is None else Course.of(self.table, self.columns or ("time", self.of), self.of)

    @property
    def follows_load(self) -> bool:
        """What it prescribes changes with the load parameter of a quasi-static case."""
        return bool(self.scale or self.motion or self.table is not None)

    def asks_the_same(self, other: Constraint) -> bool:
        """Whether a place that both hold in one direction can do what each asks."""
        if self.tied or other.tied:
            return False
        asked = [(c.scale or 0.0, c.value or 0.0, c.velocity or 0.0, c.motion, c.table) for c in (self, other)]
        return asked[0] == asked[1]

    def _direction_fits(self, prescribed: str) -> None:
        if prescribed == "motion":
            if self.direction is not None:
                remedy = "leave it out, since a motion prescribes both directions"
                raise BrokenRuleError("stands beside a motion", remedy, "direction", self.direction)
        elif self.direction is None:
            raise BrokenRuleError("is missing", 'add "x", "y" or "phase"', "direction")
        elif self.direction == "phase":
            self._is_a_phase_field(prescribed)

    def _is_a_phase_field(self, prescribed: str) -> None:
        if self.value is None:
            raise BrokenRuleError("does not apply to the phase field", "give 'value' instead", prescribed)
        if not 0.0 <= self.value <= 1.0:
            raise BrokenRuleError(
                "is not a phase field", "give 0 (broken) to 1 (intact)", "value", self.value
            )


class Load(Table):
    """Path of the load parameter u.

    Attributes
    ----------
    path : values that u runs through, starting at the first [length; a plain number where no constraint has a scale or
        motion: the factor on loads with ramp = "load", the place in tables]
    increment : first and largest increment of u [length]; may be left out for a path of one point
    later_increments : the same for each further leg of the path, where they differ
    smallest : smallest increment [length]; increment/64 if left out
    prologue : share of the way to the path's first target that the first increment takes at once, staggered to
        convergence, because nothing breaks there
    adaptive : False for constant increments
    control : what an increment prescribes where the crack would advance further than `largest_advance`: the load still,
        shortened, or in the end the fracture energy of that advance or less, so that a path on which the load falls back
        is followed
    largest_advance : of the crack in one increment, in multiples of l0; beyond it the increment is undone and
        shortened, down to `smallest`; under dissipation control it is at most a quarter of the narrowest piece's width
    stop_when_broken : end when |F| falls under `broken_fraction` of its peak
    """

    path: Annotated[tuple[Length, ...], Field(min_length=1)]
    increment: Annotated[Length, Field(gt=0)] = 1.0
    later_increments: tuple[Annotated[Length, Field(gt=0)], ...] = ()
    smallest: Annotated[Length, Field(gt=0)] = Field(
        default_factory=lambda data: data.get("increment", 1.0) / SMALLEST_SHARE
    )
    prologue: Annotated[Number, Field(ge=0, lt=1)] = 0.0
    adaptive: Switch = True
    control: Literal["displacement", "dissipation"] = "displacement"
    largest_advance: Annotated[Number, Field(gt=0)] = 4.0
    stop_when_broken: Switch = True
    broken_fraction: Annotated[Number, Field(gt=0, lt=1)] = 0.02

    @model_validator(mode="after")
    def _is_a_path(self) -> Load:
        if len(self.path) > 1 and "increment" not in self.model_fields_set:
            raise BrokenRuleError(
                "is missing", "add the first and largest increment of the load", "increment"
            )
        self._fits_its_legs()
        for before, after in pairwise(self.path):
            if before == after:
                raise BrokenRuleError("stands still", "remove the repeated value", "path", list(self.path))
        if self.control == "dissipation" and (len(self.path) > 2 or not self.adaptive):
            remedy = "give a path of two values and adaptive increments"
            raise BrokenRuleError("follows one way of loading only", remedy, "control", self.control)
        return self

    @property
    def increments(self) -> tuple[float, ...]:
        """First and largest increment on each leg of the path [length]."""
        later = self.later_increments or (self.increment,) * (len(self.path) - 2)
        return (self.increment, *later)[: len(self.path) - 1]

    def _fits_its_legs(self) -> None:
        legs = [abs(after - before) for before, after in pairwise(self.path)]
        if self.later_increments and len(self.later_increments) != len(legs) - 1:
            remedy = f"give {max(len(legs) - 1, 0)}, one for each leg after the first, or leave it out"
            given = list(self.later_increments)
            raise BrokenRuleError("does not fit the path", remedy, "later_increments", given)
        least = min((self.increment, *self.later_increments))
        if self.smallest > least:
            remedy = f"make it no more than increment = {least:g}"
            raise BrokenRuleError("is above the increment", remedy, "smallest", self.smallest)
        longest = max(legs[:1] if self.later_increments else legs, default=self.increment)
        if self.increment > longest * (1.0 + 1e-9):
            remedy = f"make it no more than {longest:g}"
            raise BrokenRuleError("is longer than every leg of the path", remedy, "increment", self.increment)
        if sum(legs) > MOST_INCREMENTS * least:
            text = f"asks for more than {MOST_INCREMENTS} increments on a path of {sum(legs):g}"
            raise BrokenRuleError(text, "make it larger", "increment", least)
        for number, (later, leg) in enumerate(zip(self.later_increments, legs[1:], strict=False)):
            if later > leg * (1.0 + 1e-9):
                remedy = f"make it no more than {leg:g}"
                raise BrokenRuleError("is longer than its leg of the path", remedy, f"later_increments[{number}]", later)


# The load of a case that gives dynamics instead.
AT_REST = Load(path=(0.0,))


class Dynamics(Table):
    """Explicit integration in time; it takes the place of the load.

    Attributes
    ----------
    end_time : the run goes from 0, or from the start of the settling, to here [time]
    time_step : [time]; without it, `time_step_share` of what `time_step_rule` gives
    time_step_rule : the bound that is proven for the basis and any cloud of points, or "courant" = h / c, of
        which the thesis takes 0.8
    gravity : acceleration of all bodies [length/time²]
    damping : rate at which all velocities fall, for bodies that come to rest [1/time]
    flip : 1 updates the points' velocities by increments (FLIP, Eq. 6.43), 0 replaces them (PIC); between, a blend
    affine : map the points' velocity gradients to the grid too, so that a turning body keeps its spin: without it a
        node beside the edge takes the velocity of the points' middle, not that of its own place
    order_of_update : strains before ("usl", as Algorithm 3) or after ("musl") the points' velocities, which are
        then mapped to the grid again: a light node at a free edge takes no speed that its points do not have, and energy
        is balanced better where bodies break; a block that rocks on deformable ground has blown up so
    rotation : "additive" sums small strains in fixed axes (Eq. 6.41); "corotational" turns them with the material.
        Strains of material points come to be logarithmic, and their stresses are per area at the start: both part from
        those of small strains by a share of the order of the strain, and so does the force
    settling : a damped stage before time 0 in which gravity comes on
    ground : how the ground moves from time 0 on
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
    settling: Settling | None = None
    ground: Ground | None = None

    @property
    def start_time(self) -> float:
        """Time at which the run begins: that of the motion is counted from 0 [time]."""
        return -self.settling.duration if self.settling else 0.0

    @model_validator(mode="after")
    def _has_one_time_step(self) -> Dynamics:
        if self.time_step is not None and {"time_step_rule", "time_step_share"} & self.model_fields_set:
            remedy = "leave out time_step_rule and time_step_share, or time_step"
            raise BrokenRuleError("stands beside the rule for it", remedy, "time_step", self.time_step)
        if self.time_step is not None and self.end_time > MOST_STEPS * self.time_step:
            text = f"asks for more than {MOST_STEPS} steps to end_time = {self.end_time:g}"
            raise BrokenRuleError(text, "make it larger, or leave it out", "time_step", self.time_step)
        return self

    @model_validator(mode="after")
    def _keeps_gradients_that_are_updated(self) -> Dynamics:
        # mapped again, the points' old gradients would be taken for new ones: no force could ever change them
        if self.affine and self.order_of_update == "musl":
            raise BrokenRuleError("is unstable at any step with the affine map", 'give "usl"', "order_of_update", "musl")
        return self


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
    normals_of : a body with a smooth surface, whose normal alone holds where others meet it; without, both bodies' are
        averaged, and the grid rounds the corners of either. That of a rigid body that keeps its velocity holds anyway
    """

    friction: Annotated[Number, Field(ge=0)] = 0.0
    pairs: tuple[ContactPair, ...] = ()
    by_distance: Switch = True
    normals_of: Name | None = None
