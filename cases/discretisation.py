"""Tables of a case that say how it is solved: mesh, material points and grid, staggering."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from cases.errors import BrokenRuleError
from cases.geometry import Box
from cases.table import Switch, Table, Whole
from cases.units import Length, Number


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
    locking_free : the change of area of a quadrilateral is the same all over it (B-bar), for nearly incompressible bodies
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
    locking_free: Switch = False
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
        circles of discs and rings, other bodies having regular ones; in quasi-static cases whose bodies are mesh files
        also on the Gauss points of these ("mesh"), with their weights as volumes, which fill_cells leaves as they are;
        exact for a uniform stress only where the elements are cells of the grid (the health record tells)
    points_per_cell : per direction; of triangles of a mesh, 1 point or 2 for 3 points
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
    placement: Literal["gauss", "regular", "random", "rings", "mesh"] = "gauss"
    points_per_cell: Annotated[Whole, Field(ge=1, le=16)] = 2
    seed: Annotated[Whole, Field(ge=0, lt=2**32)] = 0
    constraints_on: Literal["edges", "points", "nodes"] = "edges"
    penalty: Annotated[Number, Field(gt=0)] = 1e4
    move_points: Switch = True
    strain: Literal["initial", "updated"] = "initial"
    fill_cells: Switch = True
    margin: Annotated[Whole, Field(ge=0, le=100)] = 5
    linear_solver: Literal["direct", "gmres"] = "direct"


class Staggered(Table):
    """Alternate minimisation, Algorithm 1.

    Attributes
    ----------
    scheme : iterate until converged, or a fixed number of `passes` per increment (the thesis's N_staggs); dynamics has
        passes only; "bfgs" solves for displacement and phase field together by a quasi-Newton method, to the same
        tolerances, and leaves an increment that does not converge to the converged scheme; that one is asked, too,
        whether a crack that runs away has stepped over an equilibrium
    passes : in dynamics further ones repeat a step; material points from the same forces, so that the second one has the
        phase field of the step's end and more change nothing, finite elements from forces that see it a step ahead
    tolerance : on max |c - its limit|, the limit estimated from how the changes of c fall; where a crack has advanced by
        more than l0, three further sweeps tell whether it rests or is held at a saddle point, which is then left
    residual_tolerance : on the relative residual of equilibrium
    acceleration : of the converged scheme: "none" alternates plainly; "anderson" over-relaxes while the phase field
        changes much and guesses from past iterations once it settles; "momentum" does so too, and carries a crack that
        runs on by the last move
    memory : past iterations that Anderson's method uses; 0 for over-relaxation alone
    irreversible : drive the phase field by the largest tensile energy ever met (Eq. 2.59), not by the present one
    """

    scheme: Literal["converged", "passes", "bfgs"] = "converged"
    passes: Annotated[Whole, Field(ge=1, le=10_000)] = 1
    tolerance: Annotated[Number, Field(gt=0)] = 1e-4
    residual_tolerance: Annotated[Number, Field(gt=0)] = 1e-6
    acceleration: Literal["anderson", "momentum", "none"] = "momentum"
    memory: Annotated[Whole, Field(ge=0, le=20)] = 5
    largest_iterations: Annotated[Whole, Field(ge=1, le=1_000_000)] = 2000
    irreversible: Switch = True
