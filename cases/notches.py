"""Notches: cracks that exist before loading."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from cases.errors import BrokenRuleError
from cases.table import Switch, Table
from cases.units import Length, Number, Point


class Segment(Table):
    """A straight notch between two points [length]."""

    start: Point
    end: Point

    @model_validator(mode="after")
    def _has_length(self) -> Segment:
        if self.start == self.end:
            raise BrokenRuleError("is where the notch starts", "move one of the ends", "end", list(self.end))
        return self

    @property
    def level_axis(self) -> int | None:
        """Axis along which the notch does not extend: 1 if horizontal, 0 if vertical, None if oblique."""
        if self.start[1] == self.end[1]:
            return 1
        return 0 if self.start[0] == self.end[0] else None

    @property
    def length(self) -> float:
        """Distance of the ends [length]."""
        return float(np.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]))

    @property
    def direction(self) -> NDArray[np.float64]:
        """Unit vector (2,) from start to end."""
        return (np.asarray(self.end) - np.asarray(self.start)) / self.length

    def coordinates(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Distance of points (..., 2) along the notch from its start, and to the left of it [length]."""
        offset, (x, y) = points - np.asarray(self.start), self.direction
        return offset @ self.direction, x * offset[..., 1] - y * offset[..., 0]

    def distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of points (n, 2) from the segment (n,) [length]."""
        along, aside = self.coordinates(points)
        return np.hypot(along - np.clip(along, 0.0, self.length), aside)

    def lies_on(self, other: Segment) -> bool:
        """Both ends are on the other segment, to a thousandth of the length."""
        along, aside = other.coordinates(np.array([self.start, self.end]))
        slack = 1e-3 * self.length
        return bool(np.all((np.abs(aside) <= slack) & (along >= -slack) & (along <= other.length + slack)))


class SlitNotch(Segment):
    """Two faces without a gap: nodes, or the functions of a grid that the segment parts, are doubled, one for each side.

    contact : where the faces close they press on each other, without friction; else they go through each other, and so do
        those of the material points where mesh.follow_crack makes new grids
    """

    kind: Literal["slit"]
    contact: Switch = True


class CellsNotch(Segment):
    """Cells left out of the body along the segment.

    width : full width across the segment [length]
    """

    kind: Literal["cells"]
    width: Annotated[Length, Field(gt=0)]

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Mask (n,) of the points (n, 2) in the rectangle of the width about the segment, its sides included."""
        along, aside = self.coordinates(points)
        return (along >= 0.0) & (along <= self.length) & (np.abs(aside) <= self.width / 2.0)


class HistoryNotch(Segment):
    """Initial history field along the segment, Eq. 6.51.

    factor : B, the height of the initial history field, dimensionless
    """

    kind: Literal["history"]
    factor: Annotated[Number, Field(gt=0)] = 1000.0


Notch = Annotated[SlitNotch | CellsNotch | HistoryNotch, Field(discriminator="kind")]
NOTCH_KINDS = ("slit", "cells", "history")
