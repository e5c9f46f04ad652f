"""The layout of a case.toml."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, ValidationInfo, field_validator
from shapely.geometry.base import BaseGeometry

from cases.bodies import Body
from cases.boundaries import EDGES, BoundarySet
from cases.discretisation import Mesh, Mpm, Staggered
from cases.errors import BrokenRuleError
from cases.files import read_curve
from cases.geometry import Array, Bounds, slack_of
from cases.judging import TARGETS, Check, Reference, Run, RunSpec, TierName
from cases.loading import AT_REST, Constraint, Contact, Dynamics, Load
from cases.loads import BodyForce, Eigenstrain, Traction
from cases.material import Material
from cases.mesh_files import mesh_slits, second_order_sentence
from cases.notches import CellsNotch, Notch
from cases.output import Output
from cases.rocking import Rocking
from cases.studies import Chart, Map
from cases.table import Name, Table, only_known
from cases.units import Length, Units

# What a tier may change: resolution and loading, nothing of the problem itself.
TIER_TABLES = ("mesh", "mpm", "load", "dynamics", "staggered", "output", "runs", "charts", "maps")
# What a run may not change: what the file is, and how it is judged.
KEPT_BY_RUNS = (
    "title", "section", "requirement", "units", "runs", "tiers", "references", "checks", "exact", "charts", "maps",
)  # fmt: skip


class Plane(Table):
    """The two-dimensional idealisation; thickness [length]."""

    assumption: Literal["strain", "stress"]
    thickness: Annotated[Length, Field(gt=0)] = 1.0


class CaseDescription(Table):
    """Everything that a case.toml holds. Attributes are the keys of the file."""

    title: Annotated[str, Field(min_length=1)]
    section: str = ""
    requirement: Annotated[str, Field(min_length=1, description="what this case verifies")]
    exact: Name | None = Field(default=None, description="name of an exact solution")
    units: Units
    plane: Plane
    materials: Annotated[dict[Name, Material], Field(min_length=1)]
    bodies: Annotated[dict[Name, Body], Field(min_length=1)]
    notches: tuple[Notch, ...] = ()
    boundaries: dict[Name, BoundarySet] = Field(default_factory=dict, validate_default=True)
    constraints: tuple[Constraint, ...] = ()
    load: Load = AT_REST
    dynamics: Dynamics | None = None
    tractions: tuple[Traction, ...] = ()
    body_forces: tuple[BodyForce, ...] = ()
    eigenstrains: tuple[Eigenstrain, ...] = ()
    contact: Contact = Contact()
    rocking: Rocking | None = None
    mesh: Mesh
    mpm: Mpm = Mpm()
    staggered: Staggered = Staggered()
    output: Output = Output()
    runs: dict[Name, Run] = Field(default_factory=dict)
    tiers: dict[TierName, dict[str, Any]] = Field(default_factory=dict)
    references: dict[Name, Reference] = Field(default_factory=dict)
    checks: tuple[Check, ...] = ()
    charts: dict[Name, Chart] = Field(default_factory=dict)
    maps: dict[Name, Map] = Field(default_factory=dict)

    @field_validator("boundaries")
    @classmethod
    def _with_the_four_edges(cls, boundaries: dict[str, BoundarySet], info: ValidationInfo) -> dict[str, BoundarySet]:
        meshes = [body.mesh for body in info.data.get("bodies", {}).values() if body.mesh]
        found: dict[str, BoundarySet] = {edge: BoundarySet(edge=edge) for edge in EDGES}
        for name, boundary in boundaries.items():
            try:
                found[name] = boundary.in_meshes(meshes)
            except BrokenRuleError as error:
                raise BrokenRuleError(error.text, error.remedy, f"{name}.{error.key}", error.value) from None
        return found

    @field_validator("tiers")
    @classmethod
    def _changes_no_physics(cls, tiers: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        for tier, tables in tiers.items():
            only_known(tables, TIER_TABLES, tier, "may not be changed by a tier")
        return tiers

    @field_validator("runs")
    @classmethod
    def _change_known_tables(cls, runs: dict[str, Run]) -> dict[str, Run]:
        changeable = changeable_tables()
        for name, run in runs.items():
            if name in TARGETS:
                raise BrokenRuleError("is what a check is against, and no run", "call the run otherwise", name)
            only_known(run.change, changeable, f"{name}.change", "may not be changed by a run")
            tables = {key.partition(".")[0]: None for key in run.sweep}
            only_known(tables, changeable, f"{name}.sweep", "may not be changed by a run")
        return runs

    @property
    def mesh_remarks(self) -> list[str]:
        """What is made of the mesh files of its bodies other than what they hold, in sentences."""
        meshes = [(body.mesh, body.group) for body in self.bodies.values() if body.mesh]
        return [said for said in (second_order_sentence(*mesh) for mesh in meshes) if said]

    def bounding_box(self) -> Bounds:
        """Lower and upper corner, (2,) each, of the bounding box of all bodies [length]."""
        corners = [body.bounds() for body in self.bodies.values()]
        return np.min([c[0] for c in corners], axis=0), np.max([c[1] for c in corners], axis=0)

    def inside(self, points: ArrayLike) -> NDArray[np.int64]:
        """Index (n,) of the body that contains each of the points (n, 2), -1 outside.

        Outlines belong to the bodies; where two bodies touch, the first one has the point. What notches leave out
        is not removed, see `left_out`.
        """
        p = np.asarray(points, dtype=float).reshape(-1, 2)
        slack = slack_of(self.bounding_box())
        index = np.full(len(p), -1, dtype=np.int64)
        for number, body in enumerate(self.bodies.values()):
            free = np.flatnonzero(index < 0)
            index[free[body.contains(p[free], slack)]] = number
        return index

    def outlines(self) -> list[BaseGeometry]:
        """Areas of the bodies less the notches of left-out cells; discs are polygons of many corners."""
        notches = [notch for notch in self.notches if isinstance(notch, CellsNotch)]
        lines = [(shapely.LineString([notch.start, notch.end]), notch.width) for notch in notches]
        cut = shapely.union_all([line.buffer(0.5 * width, cap_style="flat") for line, width in lines])
        return [body.outline() - cut for body in self.bodies.values()]

    def left_out(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Mask (n,) of the points (n, 2) in notches of kind "cells"."""
        out = np.zeros(len(points), dtype=bool)
        for notch in self.notches:
            if isinstance(notch, CellsNotch):
                out |= notch.contains(points)
        return out

    @property
    def all_notches(self) -> tuple[Notch, ...]:
        """Notches of the case, and the cracks in the mesh files of its bodies that are not drawn again among them."""
        groups: dict[Path, tuple[str | None, ...]] = {}
        for body in self.bodies.values():
            if body.mesh:
                groups[body.mesh] = (*groups.get(body.mesh, ()), body.group)
        in_meshes = [slit for mesh, of_mesh in groups.items() for slit in mesh_slits(mesh, of_mesh)]
        return (*self.notches, *(slit for slit in in_meshes if not any(slit.lies_on(n) for n in self.notches)))

    @property
    def moved_by_load(self) -> bool:
        """Some constraint follows the load parameter of a quasi-static case: F is the force of what it moves."""
        return self.dynamics is None and any(c.follows_load for c in self.constraints)

    @property
    def loaded_by_factor(self) -> bool:
        """Some of what acts on the bodies follows the load parameter of a quasi-static case."""
        acting = (*self.tractions, *self.body_forces, *self.eigenstrains)
        return self.dynamics is None and any(item.follows_load for item in acting)

    @property
    def load_kinds(self) -> tuple[str, str]:
        """Kinds of quantity of the load parameter u and of F, which does work on it.

        Where only loads or tables follow it, u is a number and F an energy: work per load factor.
        """
        by_number = self.loaded_by_factor or any(c.table is not None for c in self.constraints)
        moves = any(c.scale or c.motion for c in self.constraints)
        return ("number", "energy") if self.dynamics is None and by_number and not moves else ("displacement", "force")

    def unit(self, kind: str) -> str:
        """Text of the unit of a kind of quantity; "displacement", "force", "stiffness" are of u, F and F over u."""
        by_factor = dict(zip(("displacement", "force", "stiffness"), (*self.load_kinds, "energy"), strict=True))
        return self.units.label(by_factor.get(kind, kind) if self.load_kinds[0] == "number" else kind)

    @property
    def history_kinds(self) -> tuple[str, str]:
        """Kinds of quantity of u and F in a history: in dynamics u is the time and F the power of what acts."""
        return ("time", "power") if self.dynamics else self.load_kinds

    @property
    def history_units(self) -> dict[str, str]:
        """Column of a history -> text of its unit; the time of a case at rest is a plain number."""
        kinds = dict(zip("uF", self.history_kinds, strict=True)) | {"time": "time" if self.dynamics else "number"}
        kinds |= dict.fromkeys(("E_el", "E_frac", "E_kin", "W_ext"), "energy")
        return {column: self.units.label(kind) for column, kind in kinds.items()}

    @property
    def fracture_enabled(self) -> bool:
        """Some body has a material that can break."""
        return any(self.materials[body.material].fracture is not None for body in self.bodies.values())

    @property
    def snapshots(self) -> tuple[float, ...]:
        """Load parameters, or times of a dynamic case, at which fields are written."""
        return self.output.snapshots if self.dynamics is None else self.output.times

    @property
    def frame_times(self) -> tuple[float, ...]:
        """Times at which frames are written, the first and the last one of the run among them; none in statics."""
        if self.dynamics is None or not self.output.frames:
            return ()
        return tuple(map(float, np.linspace(0.0, self.dynamics.end_time, self.output.frames + 1)))

    def friction(self, first: int, second: int) -> float:
        """Coulomb's coefficient between two bodies, by their numbers."""
        names = list(self.bodies)
        wanted = {names[first], names[second]}
        return next((p.friction for p in self.contact.pairs if set(p.bodies) == wanted), self.contact.friction)

    def run_specs(self) -> dict[str, RunSpec]:
        """Every run by its name, sweeps expanded."""
        members = [spec for family, run in self.runs.items() for spec in run.members(family)]
        return {spec.name: spec for spec in members}

    def expanded_runs(self) -> list[str]:
        """Names of all runs, sweeps expanded."""
        return list(self.run_specs())

    def run_spec(self, run: str) -> RunSpec:
        """The run of this name.

        Raises
        ------
        KeyError : no such run
        """
        return self.run_specs()[run]

    def reference_curve(self, reference: str) -> Array:
        """Published curve (n, 2), columns u [length] and F [force]; (0, 2) when the reference has none."""
        curve = self.references[reference].curve
        return np.zeros((0, 2)) if curve is None else read_curve(curve)


def changeable_tables() -> tuple[str, ...]:
    """Names of the tables that a run, a chart or a map may change."""
    return tuple(key for key in CaseDescription.model_fields if key not in KEPT_BY_RUNS)
