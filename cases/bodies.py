"""Bodies: their shapes, or meshes that the user brings, and how they move at the start."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from pydantic import ValidationInfo, field_validator, model_validator

from cases.errors import BrokenRuleError
from cases.files import existing_file
from cases.geometry import Array, Bounds, Shape
from cases.mesh_files import mesh_outline
from cases.mesh_groups import groups_of_areas, read_mesh
from cases.table import Name, Switch, Table, require_one
from cases.units import Rate, Velocity

MESH_SUFFIXES = (".msh", ".vtk", ".vtu", ".inp", ".bdf", ".mesh", ".xdmf", ".e", ".exo")


class Body(Table):
    """A body of one material: a shape, or a mesh file with coordinates in the units of the case.

    At rest, bodies that touch hold together, and those apart go through each other where they meet; moving ones press on
    each other and part.

    mesh : absolute path
    group : name of the group of the mesh's cells that the body is made of; all of them without
    rigid : does not deform in a dynamic run: true keeps its velocity whatever it meets, "free" moves and turns as
        gravity, the motion of the ground and contact have it
    velocity : at the start of a dynamic run, at the middle of the body's bounding box [length/time]
    unbreakable : parts in which the phase field of a dynamic run by material points stays 1
    velocity_gradient : and its change with x and y from there, [[vx,x, vx,y], [vy,x, vy,y]]; of a free rigid body its
        spin, [[0, -w], [w, 0]] [1/time]
    """

    material: Name
    shape: Shape | None = None
    mesh: Path | None = None
    group: str | None = None
    rigid: Switch | Literal["free"] = False
    unbreakable: tuple[Shape, ...] = ()
    velocity: tuple[Velocity, Velocity] = (0.0, 0.0)
    velocity_gradient: tuple[tuple[Rate, Rate], tuple[Rate, Rate]] = ((0.0, 0.0), (0.0, 0.0))

    @field_validator("mesh")
    @classmethod
    def _is_a_mesh_file(cls, mesh: Path | None, info: ValidationInfo) -> Path | None:
        if mesh is None:
            return None
        if mesh.suffix.lower() not in MESH_SUFFIXES:
            raise BrokenRuleError(
                "is not a mesh file", f"give one of {', '.join(MESH_SUFFIXES)}", value=str(mesh)
            )
        return existing_file(mesh, info, "a mesh file")

    @field_validator("rigid", mode="before")
    @classmethod
    def _is_rigid_or_not(cls, rigid: object) -> object:
        if not isinstance(rigid, bool) and rigid != "free":
            raise BrokenRuleError("is no way for a body to move", 'give true, false or "free"', value=rigid)
        return rigid

    @model_validator(mode="after")
    def _has_one_geometry(self) -> Body:
        require_one(self, "geometry", ("shape", "mesh"))
        if self.group is not None and self.mesh is None:
            raise BrokenRuleError("is of a body without a mesh", "name its mesh", "group", self.group)
        if self.group is not None and self.mesh is not None:
            known = groups_of_areas(read_mesh(self.mesh))
            if self.group not in known:
                remedy = f"name one of {', '.join(known)}" if known else "name the groups of the file's surfaces"
                raise BrokenRuleError("is no group of plane cells of the mesh", remedy, "group", self.group)
        return self

    @model_validator(mode="after")
    def _moves_as_a_whole_if_rigid(self) -> Body:
        gradient = np.array(self.velocity_gradient)
        if self.keeps_velocity and gradient.any():
            remedy = "give rigid = false, or the velocity alone"
            text = "does not apply to a rigid body, which keeps one velocity"
            raise BrokenRuleError(text, remedy, "velocity_gradient", self.velocity_gradient)
        if self.is_free_rigid and (gradient + gradient.T).any():
            text, remedy = "deforms a rigid body", "give a spin, [[0, -w], [w, 0]], or rigid = false"
            raise BrokenRuleError(text, remedy, "velocity_gradient", self.velocity_gradient)
        if self.is_free_rigid and self.unbreakable:
            remedy = "remove it, or give rigid = false"
            raise BrokenRuleError("is a part of a rigid body, which cannot break", remedy, "unbreakable")
        return self

    @property
    def deforms(self) -> bool:
        """It is not rigid."""
        return self.rigid is False

    @property
    def keeps_velocity(self) -> bool:
        """It is rigid, and nothing changes its velocity."""
        return self.rigid is True

    @property
    def is_free_rigid(self) -> bool:
        """It is rigid, and moves as gravity, the motion of the ground and contact have it."""
        return self.rigid == "free"

    def can_break(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Mask (n,) of the points (n, 2) in none of the unbreakable parts."""
        outside = np.ones(len(np.asarray(points)), dtype=bool)
        for part in self.unbreakable:
            outside &= ~part.contains(points)
        return outside

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

    def outline(self) -> shapely.geometry.base.BaseGeometry:
        """The area that it fills at the start [length]."""
        return self.shape.outline() if self.shape else self._mesh_outline()

    def initial_velocity(self, points: ArrayLike) -> Array:
        """Velocity (n, 2) at points (n, 2) of the body at the start [length/time]."""
        middle = np.mean(self.bounds(), axis=0)
        return np.asarray(self.velocity) + (np.asarray(points) - middle) @ np.asarray(self.velocity_gradient).T

    def _mesh_outline(self) -> shapely.geometry.base.BaseGeometry:
        assert self.mesh is not None
        return mesh_outline(self.mesh, self.group)
