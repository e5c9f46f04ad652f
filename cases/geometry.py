"""Shapes of bodies: what they cover, their bounds, their outlines."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, field_validator, model_validator
from shapely.geometry.base import BaseGeometry

from cases.errors import BrokenRuleError
from cases.table import Table, require_one
from cases.units import Angle, Length, Point

Array = NDArray[np.float64]
Bounds = tuple[Array, Array]

# Points this near to an outline, in shares of the size of the shape, count as being on it.
SLACK = 1e-9
# Lines nearer to each other than this share of h are one line.
SAME_LINE = 1e-3
# Rounding of a few operations on coordinates, in units of their last digit.
ROUNDED = 64
# Chords in a quarter of a circle where a disc has to become a polygon (overlap checks only).
CHORDS = 128


class Box(Table):
    """An axis-parallel box between two corners [length]."""

    lower: Point
    upper: Point

    @model_validator(mode="after")
    def _is_ordered(self) -> Box:
        if self.lower[0] > self.upper[0] or self.lower[1] > self.upper[1]:
            raise BrokenRuleError(
                "must not be below 'lower'", "exchange the corners", "upper", list(self.upper)
            )
        return self

    def contains(self, points: ArrayLike, slack: float = 0.0) -> NDArray[np.bool_]:
        """Mask of the points (n, 2) inside the box widened by `slack` [length] on every side."""
        p = np.asarray(points, dtype=float)
        return np.all((p >= np.subtract(self.lower, slack)) & (p <= np.add(self.upper, slack)), axis=1)

    @property
    def is_flat(self) -> bool:
        """The box has no area."""
        return self.lower[0] == self.upper[0] or self.lower[1] == self.upper[1]


class Circle(Table):
    """A circle [length]."""

    centre: Point
    radius: Annotated[Length, Field(gt=0)]

    def distance(self, points: ArrayLike) -> Array:
        """Distance (n,) of points (n, 2) from the centre."""
        offset = np.asarray(points, dtype=float) - self.centre
        return np.hypot(offset[:, 0], offset[:, 1])


class Rectangle(Box):
    """A rectangular body."""

    @model_validator(mode="after")
    def _has_area(self) -> Rectangle:
        if self.is_flat:
            raise BrokenRuleError(
                "encloses no area", "move 'upper' away from 'lower'", "upper", list(self.upper)
            )
        return self


class Polygon(Table):
    """A simple polygon; the last point joins the first."""

    points: Annotated[tuple[Point, ...], Field(min_length=3)]

    @field_validator("points")
    @classmethod
    def _is_simple(cls, points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        polygon = shapely.Polygon(points)
        if not polygon.is_valid or polygon.area == 0.0:
            why = shapely.is_valid_reason(polygon) if not polygon.is_valid else "it encloses no area"
            raise BrokenRuleError(f"is not a simple polygon ({why})", "list the corners once around the body")
        return points


class Arch(Table):
    """A circular vault on two buttresses of rectangular section [length].

    Attributes
    ----------
    crown : of the intrados. radius : of the intrados. thickness : of the vault, along the radius
    half_angle : between the crown and where the intrados meets its buttresses [degrees]
    buttress_width, buttress_height : a buttress begins there, at the intrados; the vault ends on its top
    """

    crown: Point
    radius: Annotated[Length, Field(gt=0)]
    half_angle: Annotated[Angle, Field(gt=0, le=90)]
    thickness: Annotated[Length, Field(gt=0)]
    buttress_width: Annotated[Length, Field(gt=0)]
    buttress_height: Annotated[Length, Field(gt=0)]

    @property
    def centre(self) -> Array:
        """Centre (2,) of the circle."""
        return np.array([self.crown[0], self.crown[1] - self.radius])

    @property
    def springing(self) -> float:
        """Height at which the vault meets its buttresses [length]."""
        return float(self.centre[1] + self.radius * np.cos(np.radians(self.half_angle)))

    def polar(self, points: ArrayLike) -> tuple[Array, Array]:
        """Angle from the crown towards +x [degrees] and radius [length] of points (n, 2), both (n,)."""
        x, y = (np.asarray(points, dtype=float) - self.centre).T
        return np.degrees(np.arctan2(x, y)), np.hypot(x, y)

    def middle(self, angles: ArrayLike) -> Array:
        """Points (n, 2) on the vault's middle line at angles (n,) from the crown towards +x [degrees]."""
        turned = np.radians(np.asarray(angles, dtype=float))
        return self.centre + (self.radius + 0.5 * self.thickness) * np.stack([np.sin(turned), np.cos(turned)], axis=-1)

    def in_vault(self, points: ArrayLike, slack: float = 0.0) -> NDArray[np.bool_]:
        """Mask (n,) of the points (n, 2) in the vault, its outline moved outwards by `slack` [length]."""
        _, radius = self.polar(points)
        inside = (radius >= self.radius - slack) & (radius <= self.radius + self.thickness + slack)
        return inside & (np.asarray(points, dtype=float)[:, 1] >= self.springing - slack)

    def buttresses(self) -> tuple[Box, Box]:
        """The left one and the right one."""
        inner = self.radius * np.sin(np.radians(self.half_angle))
        sides = [sorted((side * inner, side * (inner + self.buttress_width))) for side in (-1.0, 1.0)]
        levels = self.springing - self.buttress_height, self.springing
        left, right = (
            Box(lower=(self.crown[0] + low, levels[0]), upper=(self.crown[0] + high, levels[1])) for low, high in sides
        )
        return left, right

    def outline(self) -> BaseGeometry:
        """The shape for shapely, arcs as polygons."""
        radii = self.radius + self.thickness, self.radius
        outer, inner = (shapely.Point(self.centre).buffer(radius, quad_segs=CHORDS) for radius in radii)
        boxes = self.buttresses()
        top = self.crown[1] + 2.0 * self.thickness
        above = shapely.box(boxes[0].lower[0], self.springing, boxes[1].upper[0], top)
        return shapely.union_all([(outer - inner) & above, *(shapely.box(*box.lower, *box.upper) for box in boxes)])


class Difference(Table):
    """A shape with others cut out of it."""

    of: Shape
    minus: Annotated[tuple[Shape, ...], Field(min_length=1)]


class Shape(Table):
    """Exactly one of rectangle, polygon, disc, arch, difference."""

    rectangle: Rectangle | None = None
    polygon: Polygon | None = None
    disc: Circle | None = None
    arch: Arch | None = None
    difference: Difference | None = None

    @model_validator(mode="after")
    def _is_one_shape(self) -> Shape:
        require_one(self, "shape", tuple(Shape.model_fields))
        if self.difference and self.outline().is_empty:
            raise BrokenRuleError("leaves nothing of the body", "cut out less", "difference")
        return self

    def bounds(self) -> Bounds:
        """Corners (2,), (2,) of the bounding box [length]."""
        if self.disc:
            return np.subtract(self.disc.centre, self.disc.radius), np.add(self.disc.centre, self.disc.radius)
        box = self.outline().bounds
        return np.array(box[:2]), np.array(box[2:])

    def outline(self) -> BaseGeometry:
        """The shape for shapely; a disc becomes an inscribed polygon."""
        return self._outline

    @cached_property
    def _outline(self) -> BaseGeometry:
        if self.rectangle:
            return shapely.box(*self.rectangle.lower, *self.rectangle.upper)
        if self.polygon:
            return shapely.Polygon(self.polygon.points)
        if self.disc:
            return shapely.Point(self.disc.centre).buffer(self.disc.radius, quad_segs=CHORDS)
        if self.arch:
            return self.arch.outline()
        assert self.difference is not None
        return self.difference.of.outline() - shapely.union_all([s.outline() for s in self.difference.minus])

    def contains(self, points: ArrayLike, slack: float = 0.0) -> NDArray[np.bool_]:
        """Mask (n,) of the points (n, 2) in the shape.

        slack : signed distance [length] that the outline is moved outwards by; discs are exact circles.
        """
        if self.rectangle:
            return self.rectangle.contains(points, slack)
        if self.disc:
            return self.disc.distance(points) <= self.disc.radius + slack
        if self.polygon:
            return _polygon_contains(self.outline(), np.asarray(points, dtype=float), slack)
        if self.arch:
            boxes = [box.contains(points, slack) for box in self.arch.buttresses()]
            return self.arch.in_vault(points, slack) | boxes[0] | boxes[1]
        assert self.difference is not None
        inside = self.difference.of.contains(points, slack)
        for hole in self.difference.minus:
            inside &= ~hole.contains(points, -slack)
        return inside

    @property
    def is_rectilinear(self) -> bool:
        """All edges lie along x or y."""
        if self.difference:
            return all(part.is_rectilinear for part in (self.difference.of, *self.difference.minus))
        if self.disc:
            return False
        corners = np.array(self.outline().exterior.coords)
        return bool((corners[1:] == corners[:-1]).any(axis=1).all())

    def straight_lines(self) -> tuple[list[float], list[float]]:
        """Coordinates x of vertical and y of horizontal edges of the outline, holes included [length]."""
        if self.difference:
            parts = [self.difference.of, *self.difference.minus]
            lines = [part.straight_lines() for part in parts]
            return [x for xs, _ in lines for x in xs], [y for _, ys in lines for y in ys]
        if self.disc:
            return [], []
        corners = np.array(self.outline().exterior.coords)
        same = corners[1:] == corners[:-1]
        return list(map(float, corners[1:][same[:, 0], 0])), list(map(float, corners[1:][same[:, 1], 1]))


def _polygon_contains(polygon: BaseGeometry, points: Array, slack: float) -> NDArray[np.bool_]:
    grown = polygon.buffer(slack, join_style="mitre") if slack else polygon
    shapely.prepare(grown)
    return shapely.intersects_xy(grown, points[:, 0], points[:, 1])


def slack_of(bounds: Bounds) -> float:
    """Distance within which places in a bounding box count as one [length]."""
    lower, upper = bounds
    return max(SLACK * float(np.max(upper - lower)), rounding_of(bounds))


def rounding_of(bounds: Bounds) -> float:
    """What a few operations leave places in a bounding box off by: more, the farther from the origin [length]."""
    return ROUNDED * float(np.spacing(np.abs(bounds).max()))


Difference.model_rebuild()
