"""Boundary sets: named selections of points."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from cases.errors import BrokenRuleError
from cases.geometry import Box, Circle
from cases.table import Table, require_one
from cases.units import Point

Edge = Literal["left", "right", "bottom", "top"]
EDGES: tuple[Edge, ...] = ("left", "right", "bottom", "top")
# Axis and corner (0 lower, 1 upper) of each edge of a box.
_SIDES: dict[str, tuple[int, int]] = {"left": (0, 0), "right": (0, 1), "bottom": (1, 0), "top": (1, 1)}


class BoundarySet(Table):
    """Exactly one of: edge, edges (of the bounding box of all bodies), box (filled), point, circle (line), segment.

    A segment is given by its two ends.
    """

    edge: Edge | None = None
    edges: Annotated[tuple[Edge, ...], Field(min_length=1)] | None = None
    box: Box | None = None
    point: Point | None = None
    circle: Circle | None = None
    segment: tuple[Point, Point] | None = None

    @model_validator(mode="after")
    def _is_one_selection(self) -> BoundarySet:
        require_one(self, "selection", tuple(BoundarySet.model_fields))
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
        if self.point:
            return np.hypot(p[:, 0] - self.point[0], p[:, 1] - self.point[1]) <= tolerance
        edges = self.edges or ((self.edge,) if self.edge else ())
        return np.logical_or.reduce([_near_edge(p, edge, tolerance, box) for edge in edges])


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
