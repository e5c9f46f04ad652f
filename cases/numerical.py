"""Tables of a case that say how it is loaded and solved."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from cases.errors import BrokenRuleError
from cases.geometry import Box
from cases.table import Name, Switch, Table, Whole
from cases.units import Length, Number, Time, Velocity, quantity

# smallest increment = increment / SMALLEST_SHARE where the file gives none: six halvings.
SMALLEST_SHARE = 64


class Constraint(Table):
    """What is prescribed on a boundary set: exactly one of scale, value, velocity, motion, tied.

    Attributes
    ----------
    on : name of a boundary set
    direction : "x", "y" (displacement) or "phase" (phase field); left out with `motion`
    scale : displacement = scale * load parameter u
    value : constant displacement [length] or phase field
    velocity : constant velocity, in dynamics only [length/time]
    motion : name of an exact field that prescribes both displacements
    tied : all points of the set share one free displacement in this direction
    """

    on: Name
    direction: Literal["x", "y", "phase"] | None = None
    scale: Number | None = None
    value: Annotated[float, Field(json_schema_extra={"type": ["number", "string"]})] | None = None
    velocity: Velocity | None = None
    motion: Name | None = None
    tied: Switch = False

    @field_validator("value", mode="before")
    @classmethod
    def _in_units(cls, value: Any, info: ValidationInfo) -> Any:
        return quantity(value, "number" if info.data.get("direction") == "phase" else "length", info)

    @model_validator(mode="after")
    def _prescribes_one_thing(self) -> Constraint:
        given = [key for key in ("scale", "value", "velocity", "motion") if getattr(self, key) is not None]
        given += ["tied"] if self.tied else []
        if len(given) != 1:
            text = f"prescribes {' and '.join(given) or 'nothing'}"
            raise BrokenRuleError(text, "give exactly one of scale, value, velocity, motion, tied")
        self._direction_fits(given[0])
        return self

    def asks_the_same(self, other: Constraint) -> bool:
        """Whether a place that both hold in one direction can do what each asks."""
        if self.tied or other.tied:
            return False
        asked = [(c.scale or 0.0, c.value or 0.0, c.velocity or 0.0, c.motion) for c in (self, other)]
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
    path : values that u runs through, starting at the first [length]
    increment : first and largest increment of u [length]; may be left out for a path of one point
    smallest : smallest increment [length]; increment/64 if left out
    prologue : share of the way to the path's first target that the first increment takes at once, staggered to
        convergence, because nothing breaks there
    adaptive : False for constant increments
    control : what an increment prescribes where the crack would advance further than `largest_advance`: the load still,
        shortened, or the fracture energy of that advance, so that a path on which the load falls back is followed
    largest_advance : of the crack in one increment, in multiples of l0; beyond it the increment is undone and
        shortened, down to `smallest`
    stop_when_broken : end when |F| falls under `broken_fraction` of its peak
    """

    path: Annotated[tuple[Length, ...], Field(min_length=1)]
    increment: Annotated[Length, Field(gt=0)] = 1.0
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
        if self.smallest > self.increment:
            remedy = f"make it no more than increment = {self.increment:g}"
            raise BrokenRuleError("is above the increment", remedy, "smallest", self.smallest)
        for before, after in pairwise(self.path):
            if before == after:
                raise BrokenRuleError("stands still", "remove the repeated value", "path", list(self.path))
        if self.control == "dissipation" and (len(self.path) > 2 or not self.adaptive):
            remedy = "give a path of two values and adaptive increments"
            raise BrokenRuleError("follows one way of loading only", remedy, "control", self.control)
        return self


class RefinedBox(Box):
    """A box, or a line or point, with a spacing of its own, such as a support or a loaded edge.

    Attributes
    ----------
    h : spacing in the box, from which it grows as from the fine box [length]
    """

    h: Annotated[Length, Field(gt=0)]


class Mesh(Table):
    """Resolution of both discretisations.

    Attributes
    ----------
    h : spacing in the fine box, or everywhere without one [length]
    coarse : largest spacing outside the fine box [length]; None for no limit
    growth : largest ratio of neighbouring spacings outside the fine box
    fine : the fine box
    refine : further boxes with spacings of their own, where the body's stiffness is decided rather than the crack's way
    follow_crack : enlarge the fine box, and redo the increment, where the crack has gone out of it
    element : shape of the finite elements
    geometry : on which the finite elements measure strain: as meshed, or as they have moved after each increment
    under_resolved : allow h above the length scale, to study what it costs
    """

    h: Annotated[Length, Field(gt=0)]
    coarse: Annotated[Length, Field(gt=0)] | None = None
    growth: Annotated[Number, Field(gt=1, le=10)] = 1.3
    fine: Box | None = None
    refine: tuple[RefinedBox, ...] = ()
    follow_crack: Switch = False
    element: Literal["quad", "triangle"] = "quad"
    geometry: Literal["initial", "updated"] = "initial"
    under_resolved: Switch = False

    @model_validator(mode="after")
    def _is_graded_outwards(self) -> Mesh:
        if self.coarse is not None and self.fine is None:
            remedy = "add mesh.fine or remove it"
            raise BrokenRuleError("has no effect without a fine box", remedy, "coarse", self.coarse)
        if self.refine and self.fine is None:
            raise BrokenRuleError("has no effect without a fine box", "add mesh.fine or remove it", "refine")
        for number, box in enumerate(self.refine):
            if box.h > (self.coarse or math.inf):
                remedy = f"make it less than coarse = {self.coarse:g}, or remove the box"
                raise BrokenRuleError("is above coarse, so it refines nothing", remedy, f"refine[{number}].h", box.h)
        if self.follow_crack and (self.fine is None or self.geometry == "updated"):
            remedy = 'add mesh.fine, and leave mesh.geometry at "initial"'
            raise BrokenRuleError("has no fine box to enlarge on a geometry that stays", remedy, "follow_crack", True)
        if self.coarse is not None and self.coarse < self.h:
            raise BrokenRuleError("is below h", f"make it at least h = {self.h:g}", "coarse", self.coarse)
        if self.fine is not None and self.fine.is_flat:
            remedy = "move 'upper' away from 'lower'"
            raise BrokenRuleError("encloses no area", remedy, "fine.upper", list(self.fine.upper))
        return self


class Mpm(Table):
    """Material points and their grid.

    Attributes
    ----------
    order : polynomial order of the B-splines
    placement : of the points in their cells: on Gauss points, regularly, or at random; in dynamics also on the
        circles of discs and rings, other bodies having regular ones
    points_per_cell : per direction
    constraints_on : the edges of the points at the boundary or the points themselves, both by a penalty, or
        the nodes of the grid
    penalty : in multiples of the stiffness, dimensionless
    move_points : carry the points with the displacement
    strain : measured on the initial geometry, as small strain theory and the FEM have it, or on the updated one
    fill_cells : let the points integrate each cell of the grid as far as the body covers it, by weights and places
        fitted to the area covered and its moments
    margin : cells of grid around the body
    """

    order: Literal[1, 2, 3] = 2
    placement: Literal["gauss", "regular", "random", "rings"] = "gauss"
    points_per_cell: Annotated[Whole, Field(ge=1, le=16)] = 2
    seed: Annotated[Whole, Field(ge=0)] = 0
    constraints_on: Literal["edges", "points", "nodes"] = "edges"
    penalty: Annotated[Number, Field(gt=0)] = 1e4
    move_points: Switch = True
    strain: Literal["initial", "updated"] = "initial"
    fill_cells: Switch = True
    margin: Annotated[Whole, Field(ge=0)] = 5
    linear_solver: Literal["direct", "gmres"] = "direct"


class Staggered(Table):
    """Alternate minimisation, Algorithm 1.

    Attributes
    ----------
    scheme : iterate until converged, or a fixed number of `passes` per increment (the thesis's N_staggs); dynamics has
        passes only
    tolerance : on max |c - its limit|, the limit estimated from how the changes of c fall
    residual_tolerance : on the relative residual of equilibrium
    memory : past iterations that the acceleration uses; 0 for over-relaxation alone
    irreversible : drive the phase field by the largest tensile energy ever met (Eq. 2.59), not by the present one
    """

    scheme: Literal["converged", "passes"] = "converged"
    passes: Annotated[Whole, Field(ge=1)] = 1
    tolerance: Annotated[Number, Field(gt=0)] = 1e-4
    residual_tolerance: Annotated[Number, Field(gt=0)] = 1e-6
    memory: Annotated[Whole, Field(ge=0, le=20)] = 5
    largest_iterations: Annotated[Whole, Field(ge=1)] = 2000
    irreversible: Switch = True


class Output(Table):
    """What is written.

    snapshots : load parameters at which fields are written, besides the last state [length]
    times : the same for dynamics [time]
    frames : number of pictures of a dynamic run for its animation, evenly spaced in time, besides the first state
    records : number of evenly spaced rows of the history of a dynamic run
    """

    snapshots: tuple[Length, ...] = ()
    times: tuple[Annotated[Time, Field(ge=0)], ...] = ()
    frames: Annotated[Whole, Field(ge=0)] = 0
    records: Annotated[Whole, Field(ge=1)] = 200
