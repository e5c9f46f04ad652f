"""Boundary sets: named selections of points."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from cases.errors import BrokenRuleError
from cases.files import existing_file
from cases.geometry import Box, Circle
from cases.mesh_groups import boundary_of_group, names_of_groups
from cases.table import Table, require_one
from cases.units import Point

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

Edge = Literal["left", "right", "bottom", "top"]
EDGES: tuple[Edge, ...] = ("left", "right", "bottom", "top")
# Axis and corner (0 lower, 1 upper) of each edge of a box.
_SIDES: dict[str, tuple[int, int]] = {"left": (0, 0), "right": (0, 1), "bottom": (1, 0), "top": (1, 1)}

# Corners of the polygon that stands for a quarter of a circle.
_QUARTER = 256


class BoundarySet(Table):
    """One of: edge, edges (of the bounding box of all bodies), box (filled), point, circle (line), segment, group.

    A segment is given by its two ends, a group by its name in the mesh of a body; mesh : which one, the first that has it
    without.
    """

    edge: Edge | None = None
    edges: Annotated[tuple[Edge, ...], Field(min_length=1)] | None = None
    box: Box | None = None
    point: Point | None = None
    circle: Circle | None = None
    segment: tuple[Point, Point] | None = None
    group: str | None = None
    mesh: Path | None = None

    @field_validator("mesh")
    @classmethod
    def _is_a_file(cls, mesh: Path | None, info: ValidationInfo) -> Path | None:
        return None if mesh is None else existing_file(mesh, info, "a mesh file")

    @model_validator(mode="after")
    def _is_one_selection(self) -> BoundarySet:
        require_one(self, "selection", tuple(key for key in BoundarySet.model_fields if key != "mesh"))
        if self.mesh is not None and self.group is None:
            raise BrokenRuleError("is the file of a group", "name its group, or remove it", "mesh", self.mesh.name)
        if self.segment and self.segment[0] == self.segment[1]:
            raise BrokenRuleError("has no length", "give two ends, or a 'point'", "segment", list(self.segment))
        return self

    def select(
        self, points: ArrayLike, tolerance: float, box: tuple[ArrayLike, ArrayLike]
    ) -> NDArray[np.bool_]:
        """Mask of the points within `tolerance` of the set.

        Parameters
        ----------
        points : (n, 2) [length]
        tolerance : [length]
        box : lower and upper corner of the bounding box of all bodies, `case.bounding_box()` [length]

        Returns
        -------
        mask : (n,) bool; `edges` selects the union of the edges
        """
        p = np.asarray(points, dtype=float)
        if self.box:
            return self.box.contains(p, tolerance)
        if self.circle:
            return np.abs(self.circle.distance(p) - self.circle.radius) <= tolerance
        if self.segment:
            return np.linalg.norm(p - nearest_on_segment(p, self.segment), axis=1) <= tolerance
        if self.group:
            return shapely.dwithin(self.geometry(), shapely.points(p), tolerance)
        if self.point:
            return np.hypot(p[:, 0] - self.point[0], p[:, 1] - self.point[1]) <= tolerance
        edges = self.edges or ((self.edge,) if self.edge else ())
        return np.logical_or.reduce([_near_edge(p, edge, tolerance, box) for edge in edges])

    def parts_of_lines(
        self, lines: NDArray[np.float64], tolerance: float, box: tuple[ArrayLike, ArrayLike]
    ) -> NDArray[np.float64]:
        """Part (n, 2) of each straight line (n, 2, 2) that lies on the set, from 0 at its start to 1; (0, 0) for none.

        Lines are cut where a box or a segment ends, and lie on any other set with both of their ends. ``tolerance`` and
        ``box`` as in `select`.
        """
        if self.edges:  # a line from one edge to another lies on neither
            each = [BoundarySet(edge=edge).parts_of_lines(lines, tolerance, box) for edge in self.edges]
            return np.maximum.reduce(each)
        ends = np.stack([self.select(lines[:, end], tolerance, box) for end in (0, 1)])
        part = np.outer(ends.all(axis=0), [0.0, 1.0])
        if self.box:
            part = _within(lines, np.subtract(self.box.lower, tolerance), np.add(self.box.upper, tolerance))
        if self.segment:
            start, along = np.asarray(self.segment[0]), np.subtract(self.segment[1], self.segment[0])
            length = float(np.hypot(*along))
            axes = np.array([along, [-along[1], along[0]]]) / length
            slack = np.array([tolerance, tolerance])
            part = _within((lines - start) @ axes.T, -slack, np.array([length, 0.0]) + slack)
        part[np.ptp(part, axis=1) * np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1) <= 4.0 * tolerance] = 0.0
        return part

    def line(self) -> BaseGeometry | None:
        """The segment, circle or flat box as a line; None of what is none."""
        if self.circle:
            return shapely.Point(self.circle.centre).buffer(self.circle.radius, quad_segs=_QUARTER).exterior
        ends = self.segment or ((self.box.lower, self.box.upper) if self.box else None)
        if ends is None or (self.box and np.not_equal(*ends).all()) or tuple(ends[0]) == tuple(ends[1]):
            return None
        return shapely.LineString(ends)

    def in_meshes(self, meshes: Sequence[Path]) -> BoundarySet:
        """The set with the mesh of its group filled in: its own, or the first of those of the bodies that has it."""
        if self.group is None:
            return self
        if not meshes and self.mesh is None:
            raise BrokenRuleError("needs a body with a mesh", "give one, or another selection", "group", self.group)
        of_group = [mesh for mesh in meshes if self.group in names_of_groups(mesh)]
        found = self.model_copy(update={"mesh": self.mesh or (of_group or list(meshes))[0]})
        found.geometry()
        return found

    def geometry(self) -> BaseGeometry:
        """Lines, areas or points of the group."""
        assert self.mesh is not None and self.group is not None
        return boundary_of_group(self.mesh, self.group)

    def nearest(self, points: ArrayLike) -> NDArray[np.float64]:
        """Places (n, 2) of the group that are nearest to the points (n, 2)."""
        lines = shapely.shortest_line(shapely.points(np.asarray(points, dtype=float)), self.geometry())
        return shapely.get_coordinates(lines)[1::2]


def nearest_on_segment(points: ArrayLike, ends: tuple[Point, Point]) -> NDArray[np.float64]:
    """Places (n, 2) on the segment between two ends that are nearest to the points (n, 2)."""
    start, along = np.asarray(ends[0]), np.subtract(ends[1], ends[0])
    share = (np.asarray(points, dtype=float) - start) @ along / (along @ along)
    return start + np.clip(share, 0.0, 1.0)[:, None] * along


def _near_edge(
    points: NDArray[np.float64], edge: str, tolerance: float, box: tuple[ArrayLike, ArrayLike]
) -> NDArray[np.bool_]:
    axis, corner = _SIDES[edge]
    return np.abs(points[:, axis] - np.asarray(box[corner], dtype=float)[axis]) <= tolerance


def _within(
    lines: NDArray[np.float64], lower: NDArray[np.float64], upper: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Part (n, 2) of each line (n, 2, 2) within a box, (0, 0) where it is not in it (Liang and Barsky)."""
    first, last = np.zeros(len(lines)), np.ones(len(lines))
    for axis in (0, 1):
        start, way = lines[:, 0, axis], lines[:, 1, axis] - lines[:, 0, axis]
        with np.errstate(divide="ignore", invalid="ignore"):
            cuts = np.sort(np.stack([(lower[axis] - start) / way, (upper[axis] - start) / way]), axis=0)
        across = way == 0.0
        inside = (start >= lower[axis]) & (start <= upper[axis])
        first = np.where(across, np.where(inside, first, 1.0), np.maximum(first, cuts[0]))
        last = np.where(across, np.where(inside, last, 0.0), np.minimum(last, cuts[1]))
    return np.where((first < last)[:, None], np.column_stack([first, last]), 0.0)
