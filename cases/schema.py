"""The layout of a case.toml and what can be asked of a case."""

from __future__ import annotations

import hashlib
import json
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from cases.boundaries import EDGES, BoundarySet
from cases.dynamics import WITHOUT_EFFECT, Contact, Dynamics, Traction
from cases.errors import BrokenRuleError
from cases.files import existing_file, read_curve
from cases.geometry import SLACK, Array, Bounds, Shape, mesh_outline, size_of
from cases.judging import TIERS, Check, Reference, Run, RunSpec, TierName
from cases.material import Material
from cases.notches import Notch
from cases.numerical import Constraint, Load, Mesh, Mpm, Output, Staggered
from cases.studies import Chart, Map, Varied
from cases.table import Name, Switch, Table, nearest, require_one
from cases.units import Length, Rate, Units, Velocity

MESH_SUFFIXES = (".msh", ".vtk", ".vtu", ".inp", ".bdf", ".mesh", ".xdmf", ".e", ".exo")
# What a tier may change: resolution and loading, nothing of the problem itself.
TIER_TABLES = ("mesh", "mpm", "load", "dynamics", "staggered", "output", "runs", "charts", "maps")
# What a run may not change: what the file is, and how it is judged.
KEPT_BY_RUNS = (
    "title", "section", "requirement", "units", "runs", "tiers", "references", "checks", "exact", "charts", "maps",
)  # fmt: skip
# Keys that say nothing about what is computed.
_PROSE_AND_JUDGING = {"title", "section", "requirement", "runs", "tiers", "references", "checks", "charts", "maps"}
_NOT_HASHED = _PROSE_AND_JUDGING | {"name", "tier", "run", "change", "folder", "source"}
# Cells of spacing h in one direction; more is a slip of the pen.
MOST_CELLS = 100_000
# The load of a case that gives dynamics instead.
AT_REST = Load(path=(0.0,))
# Bodies overlap when they share more than this part of the smaller one.
_OVERLAP = 1e-6


class Plane(Table):
    """The two-dimensional idealisation; thickness [length]."""

    assumption: Literal["strain", "stress"]
    thickness: Annotated[Length, Field(gt=0)] = 1.0


class Body(Table):
    """A body of one material: a shape, or a mesh file with coordinates in the units of the case.

    mesh : absolute path
    rigid : keeps its velocity in a dynamic run, whatever it meets
    velocity : at the start of a dynamic run, at the middle of the body's bounding box [length/time]
    velocity_gradient : and its change with x and y from there, [[vx,x, vx,y], [vy,x, vy,y]] [1/time]
    """

    material: Name
    shape: Shape | None = None
    mesh: Path | None = None
    rigid: Switch = False
    velocity: tuple[Velocity, Velocity] = (0.0, 0.0)
    velocity_gradient: tuple[tuple[Rate, Rate], tuple[Rate, Rate]] = ((0.0, 0.0), (0.0, 0.0))

    @field_validator("mesh")
    @classmethod
    def _is_a_mesh_file(cls, mesh: Path | None, info: ValidationInfo) -> Path | None:
        if mesh is None:
            return None
        if mesh.suffix not in MESH_SUFFIXES:
            raise BrokenRuleError(
                "is not a mesh file", f"give one of {', '.join(MESH_SUFFIXES)}", value=str(mesh)
            )
        return existing_file(mesh, info, "a mesh file")

    @model_validator(mode="after")
    def _has_one_geometry(self) -> Body:
        require_one(self, "geometry", ("shape", "mesh"))
        return self

    @model_validator(mode="after")
    def _moves_as_a_whole_if_rigid(self) -> Body:
        if self.rigid and np.any(self.velocity_gradient):
            remedy = "give rigid = false, or the velocity alone"
            text = "does not apply to a rigid body, which keeps one velocity"
            raise BrokenRuleError(text, remedy, "velocity_gradient", self.velocity_gradient)
        return self

    def bounds(self) -> Bounds:
        """Corners (2,), (2,) of the bounding box [length]."""
        if self.shape:
            return self.shape.bounds()
        box = self._mesh_outline().bounds
        return np.array(box[:2]), np.array(box[2:])

    def contains(self, points: ArrayLike, slack: float = 0.0) -> NDArray[np.bool_]:
        """Mask (n,) of the points (n, 2) in the body, its outline moved outwards by `slack` [length]."""
        if self.shape:
            return self.shape.contains(points, slack)
        return shapely.dwithin(self._mesh_outline(), shapely.points(np.asarray(points, dtype=float)), slack)

    def initial_velocity(self, points: ArrayLike) -> Array:
        """Velocity (n, 2) at points (n, 2) of the body at the start [length/time]."""
        middle = np.mean(self.bounds(), axis=0)
        return np.asarray(self.velocity) + (np.asarray(points) - middle) @ np.asarray(self.velocity_gradient).T

    def _mesh_outline(self) -> shapely.geometry.base.BaseGeometry:
        assert self.mesh is not None
        return mesh_outline(self.mesh)


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
    contact: Contact = Contact()
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
    def _with_the_four_edges(cls, boundaries: dict[str, BoundarySet]) -> dict[str, BoundarySet]:
        return {edge: BoundarySet(edge=edge) for edge in EDGES} | boundaries

    @field_validator("tiers")
    @classmethod
    def _changes_no_physics(cls, tiers: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        for tier, tables in tiers.items():
            _only_known(tables, TIER_TABLES, tier, "may not be changed by a tier")
        return tiers

    @field_validator("runs")
    @classmethod
    def _change_known_tables(cls, runs: dict[str, Run]) -> dict[str, Run]:
        changeable = changeable_tables()
        for name, run in runs.items():
            _only_known(run.change, changeable, f"{name}.change", "may not be changed by a run")
            tables = {key.partition(".")[0]: None for key in run.sweep}
            _only_known(tables, changeable, f"{name}.sweep", "may not be changed by a run")
        return runs

    @model_validator(mode="after")
    def _fits_together(self) -> CaseDescription:
        self._names_are_defined()
        self._is_static_or_dynamic()
        self._stiffnesses_apply()
        self._length_scales_are_resolved()
        self._basis_is_smooth_enough()
        self._bodies_are_apart()
        self._notches_are_in_bodies()
        self._spacing_fits_the_bodies()
        self._checks_have_targets()
        self._studies_vary_runs()
        return self

    def bounding_box(self) -> Bounds:
        """Lower and upper corner, (2,) each, of the bounding box of all bodies [length]."""
        corners = [body.bounds() for body in self.bodies.values()]
        return np.min([c[0] for c in corners], axis=0), np.max([c[1] for c in corners], axis=0)

    def inside(self, points: ArrayLike) -> NDArray[np.int64]:
        """Index (n,) of the body that contains each of the points (n, 2), -1 outside.

        Outlines belong to the bodies; where two bodies touch, the first one has the point. Cells left out by
        notches are not removed.
        """
        p = np.asarray(points, dtype=float).reshape(-1, 2)
        slack = SLACK * size_of(self.bounding_box())
        index = np.full(len(p), -1, dtype=np.int64)
        for number, body in enumerate(self.bodies.values()):
            free = np.flatnonzero(index < 0)
            index[free[body.contains(p[free], slack)]] = number
        return index

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

    def _names_are_defined(self) -> None:
        for name, body in self.bodies.items():
            _defined(body.material, list(self.materials), f"bodies.{name}.material", "material")
        prescribed = set()
        for number, constraint in enumerate(self.constraints):
            _defined(constraint.on, list(self.boundaries), f"constraints[{number}].on", "boundary")
            if (constraint.on, constraint.direction) in prescribed:
                text = f"prescribes direction {constraint.direction} of '{constraint.on}' again"
                raise BrokenRuleError(text, "remove one of the two", f"constraints[{number}]")
            prescribed.add((constraint.on, constraint.direction))
        for number, traction in enumerate(self.tractions):
            _defined(traction.on, list(self.boundaries), f"tractions[{number}].on", "boundary")
        for number, pair in enumerate(self.contact.pairs):
            for name in pair.bodies:
                _defined(name, list(self.bodies), f"contact.pairs[{number}].bodies", "body")

    def _is_static_or_dynamic(self) -> None:
        if ("load" in self.model_fields_set) == (self.dynamics is not None):
            has = "both" if self.dynamics else "neither"
            raise BrokenRuleError(
                f"has {has} of the tables load and dynamics", "give one of them", "load" if self.dynamics else ""
            )
        (self._fits_dynamics if self.dynamics else self._fits_statics)()

    def _fits_statics(self) -> None:
        moving = ["tractions"] if self.tractions else []
        moving += [f"constraints[{n}].velocity" for n, c in enumerate(self.constraints) if c.velocity is not None]
        moving += ["output.times"] if self.output.times or self.output.frames else []
        if moving:
            raise BrokenRuleError("acts in dynamics only", "remove it or give the table dynamics", moving[0])

    def _fits_dynamics(self) -> None:
        for name in {body.material: None for body in self.bodies.values()}:
            if self.materials[name].density is None:
                raise BrokenRuleError("is missing", "add it, since dynamics needs mass", f"materials.{name}.density")
        if all(body.rigid for body in self.bodies.values()):
            key = f"bodies.{next(iter(self.bodies))}.rigid"
            raise BrokenRuleError("leaves nothing that moves freely", "give rigid = false", key, True)
        for number, constraint in enumerate(self.constraints):
            if constraint.velocity is None and constraint.value is None:
                text = "does not apply in dynamics"
                raise BrokenRuleError(text, "give value = 0 or a velocity", f"constraints[{number}]")
            if constraint.value and constraint.direction != "phase":
                remedy = "give value = 0 or a velocity"
                raise BrokenRuleError("is a jump in time", remedy, f"constraints[{number}].value", constraint.value)
        if self.output.snapshots:
            raise BrokenRuleError("are load parameters", "give output.times instead", "output.snapshots")
        self._is_not_passed_over()

    def _is_not_passed_over(self) -> None:
        """Nothing in a dynamic case asks for what will not be done."""
        for key, done in WITHOUT_EFFECT.items():
            table, name = key.split(".")
            value = getattr(getattr(self, table), name)
            if name in getattr(self, table).model_fields_set and value != done:
                remedy = "remove it" if done is None else f"remove it or give {json.dumps(done)}"
                raise BrokenRuleError("has no effect in dynamics", remedy, key, value)
        assert self.dynamics is not None
        end = self.dynamics.end_time
        for number, time in enumerate(self.output.times):
            if time > end * (1.0 + SLACK):
                remedy = f"give a time up to dynamics.end_time = {end:g}"
                raise BrokenRuleError("comes after the end", remedy, f"output.times[{number}]", time)

    def _stiffnesses_apply(self) -> None:
        for name in {body.material: None for body in self.bodies.values()}:
            stiffness, fracture = self.materials[name].stiffness, self.materials[name].fracture
            if stiffness is not None and stiffness.is_engineering and self.plane.assumption == "strain":
                remedy = 'give C11, C22, C66, C12 of plane strain, or plane.assumption = "stress"'
                raise BrokenRuleError(
                    "has engineering constants, which leave plane strain open", remedy, f"materials.{name}.stiffness"
                )
            if self.dynamics is None:
                continue
            if stiffness is not None:
                remedy = "give an isotropic pair, or the table load instead of dynamics"
                raise BrokenRuleError("applies in quasi-static cases only", remedy, f"materials.{name}.stiffness")
            if fracture is not None and fracture.split == "orthogonal":
                remedy = "give another split, or the table load instead of dynamics"
                key = f"materials.{name}.fracture.split"
                raise BrokenRuleError("applies in quasi-static cases only", remedy, key, fracture.split)

    def _length_scales_are_resolved(self) -> None:
        for name, material in self.materials.items():
            if self.mesh.under_resolved or material.fracture is None:
                continue
            if material.fracture.length_scale < self.mesh.h:
                remedy = f"make mesh.h = {self.mesh.h:g} no more than the length scale"
                key = f"materials.{name}.fracture.length_scale"
                raise BrokenRuleError(
                    "is below the mesh spacing", remedy, key, material.fracture.length_scale
                )

    def _basis_is_smooth_enough(self) -> None:
        if self.mpm.order > 1:
            return
        for name, material in self.materials.items():
            if material.fracture is not None and material.fracture.order == 4:
                text = f"has no second derivatives, which materials.{name}.fracture.order = 4 asks for"
                raise BrokenRuleError(text, "set it to 2 or 3", "mpm.order", self.mpm.order)

    def _bodies_are_apart(self) -> None:
        outlines = [(name, body.shape.outline()) for name, body in self.bodies.items() if body.shape]
        for (first, a), (second, b) in combinations(outlines, 2):
            if a.intersection(b).area > _OVERLAP * min(a.area, b.area):
                remedy = "move them apart or cut one out of the other with 'difference'"
                raise BrokenRuleError(f"overlaps the body '{first}'", remedy, f"bodies.{second}")

    def _notches_are_in_bodies(self) -> None:
        if any(body.mesh for body in self.bodies.values()):
            return  # reading meshes is left to whoever needs them
        # a slit may go on through a gap that is narrower than the cells, such as a notch that tapers
        outlines = [body.shape.outline() for body in self.bodies.values() if body.shape]
        hull = shapely.union_all(outlines).convex_hull.buffer(SLACK * size_of(self.bounding_box()))
        for number, notch in enumerate(self.notches):
            for end, point in (("start", notch.start), ("end", notch.end)):
                if not hull.covers(shapely.Point(point)):
                    key = f"notches[{number}].{end}"
                    raise BrokenRuleError(
                        "lies outside the bodies", "move it into or onto one", key, list(point)
                    )

    def _spacing_fits_the_bodies(self) -> None:
        if any(body.mesh for body in self.bodies.values()):
            return
        lower, upper = self.bounding_box()
        if self.mesh.fine is not None:
            remedy = f"place it inside {lower.tolist()} to {upper.tolist()}"
            for number, box in enumerate(self.mesh.refine):
                if np.any(np.asarray(box.upper) < lower) or np.any(np.asarray(box.lower) > upper):
                    raise BrokenRuleError("lies outside the bodies", remedy, f"mesh.refine[{number}]")
            lower, upper = np.maximum(lower, self.mesh.fine.lower), np.minimum(upper, self.mesh.fine.upper)
            if np.any(lower >= upper):
                raise BrokenRuleError("lies outside the bodies", remedy, "mesh.fine")
        if np.max(upper - lower) > MOST_CELLS * self.mesh.h:
            text = f"asks for more than {MOST_CELLS} cells in one direction"
            raise BrokenRuleError(text, "give a larger spacing or a smaller fine box", "mesh.h", self.mesh.h)

    def _checks_have_targets(self) -> None:
        runs = list(dict.fromkeys([*self.runs, *self.expanded_runs()]))
        for number, check in self.applying_checks():
            _defined(check.run, runs, f"checks[{number}].run", "run")
            kind, name = check.target
            if kind == "run":
                _defined(name, runs, f"checks[{number}].against", "run")
            if kind == "reference":
                self._reference_has_the_metric(name, check.metric, f"checks[{number}].against")
            if kind == "exact" and self.exact is None and not any(c.motion for c in self.constraints):
                key = f"checks[{number}].against"
                raise BrokenRuleError(
                    "has no exact solution to compare with", "add the key 'exact'", key, check.against
                )

    def _studies_vary_runs(self) -> None:
        for name, chart in self.charts.items():
            _only_known(chart.change, changeable_tables(), f"charts.{name}.change", "may not be varied")
            varied: dict[str, Varied] = {f"ladders.{key}": ladder for key, ladder in chart.ladders.items()}
            varied |= {"reference": chart.reference} if chart.reference else {}
            for key, table in varied.items():
                self._varies_a_run(table, f"charts.{name}.{key}")
        for name, chosen in self.maps.items():
            if chosen.run is not None:
                self._varies_a_run(chosen, f"maps.{name}")

    def _varies_a_run(self, varied: Varied | Map, place: str) -> None:
        _defined(str(varied.run), self.expanded_runs(), f"{place}.run", "run")
        _only_known(varied.change, changeable_tables(), f"{place}.change", "may not be varied")
        tables = {key.partition(".")[0]: None for key in varied.varied_keys()}
        _only_known(tables, changeable_tables(), place, "may not be varied")

    def applying_checks(self) -> list[tuple[int, Check]]:
        """Checks with their numbers, those of all runs of a family taken apart."""
        specs = self.run_specs().values()
        return [(number, each) for number, check in enumerate(self.checks) for each in check.each(specs)]

    def _reference_has_the_metric(self, name: str, metric: str, key: str) -> None:
        _defined(name, list(self.references), key, "reference", f"reference:{name}")
        reference = self.references[name]
        if metric not in reference.values and reference.curve is None:
            remedy = f"add {metric} to references.{name}.values, or a curve"
            raise BrokenRuleError(f"has no value of {metric}", remedy, key, f"reference:{name}")


class Case(CaseDescription):
    """A case at one tier, for one run or for none.

    Attributes
    ----------
    name : of the folder in the library, or of the file
    tier : whose tables were merged
    run : whose change was merged; None for the case as it stands
    change : tables merged over that run's by whoever varies the case
    folder, source : where the file lies, and the file
    """

    name: str
    tier: TierName = "standard"
    run: str | None = None
    change: dict[str, Any] = Field(default_factory=dict)
    folder: Path
    source: Path

    def applying_checks(self) -> list[tuple[int, Check]]:
        """Checks of this tier, which may have runs of its own, with their numbers."""
        return [(number, check) for number, check in super().applying_checks() if self.tier in check.tiers]

    def hash(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of what is computed.

        Equal hashes mean equal computations: prose, references, checks and the other runs do not enter, so
        that results can be judged anew without computing again; mesh files enter with their content.
        """
        tables = self.model_dump(mode="json", exclude=_NOT_HASHED)
        for name, body in self.bodies.items():
            if body.mesh:
                tables["bodies"][name]["mesh"] = hashlib.sha256(body.mesh.read_bytes()).hexdigest()
        tables["solver"] = self.run_spec(self.run).solver if self.run else None
        return hashlib.sha256(json.dumps(tables, sort_keys=True).encode()).hexdigest()[:16]


def changeable_tables() -> tuple[str, ...]:
    """Names of the tables that a run, a chart or a map may change."""
    return tuple(key for key in CaseDescription.model_fields if key not in KEPT_BY_RUNS)


def _only_known(tables: dict[str, Any], known: tuple[str, ...], prefix: str, text: str) -> None:
    for key in tables:
        if key not in known:
            raise BrokenRuleError(text, nearest(key, list(known), "change another table"), f"{prefix}.{key}")


def _defined(name: str, known: list[str], key: str, what: str, value: str | None = None) -> None:
    if name not in known:
        remedy = nearest(name, known, f"define the {what}")
        raise BrokenRuleError(f"is not a {what} of this case", remedy, key, value or name)


__all__ = ["TIERS", "Case", "CaseDescription"]
