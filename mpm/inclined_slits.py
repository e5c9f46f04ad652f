"""Cracks of no width at an angle to the grid: each function that one parts wholly is doubled, a copy for each side."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from cases import Case
from cases.geometry import SAME_LINE
from cases.notches import Segment, SlitNotch
from mpm.slits import GridError, is_level

#: parts of a rectangle smaller than this share of it are none
SMALLEST_PART = 1e-6

#: places on each stretch of a slit in a cell where its faces may not go through each other; splines do so between fewer
FACE_POINTS = 3


class Halves(NamedTuple):
    """Rectangles that a slit parts: number (m,), area (m, 2) and middle (m, 2, 2) of what lies below and above."""

    number: NDArray
    area: NDArray
    middle: NDArray


class InclinedSlit:
    """A slit with the material about it; what lies to the left of it is above.

    Attributes
    ----------
    notch : as drawn. tips : (n, 2) its ends within the material [length].
    """

    def __init__(self, case: Case, notch: SlitNotch) -> None:
        self._case, self.notch = case, notch
        self._slack = slack = SAME_LINE * case.mesh.h
        # bodies that touch are one
        self._body = shapely.union_all(case.outlines()).buffer(0.1 * slack).buffer(-0.2 * slack)
        ends = np.array([notch.start, notch.end])
        self.tips = ends[shapely.contains_xy(self._body.buffer(-slack), ends)]
        along, size = notch.direction, sum(case.bounding_box()[1] - case.bounding_box()[0])
        corners = [ends[0] - size * along, ends[1] + size * along]
        aside = size * np.array([-along[1], along[0]])
        self._sides = [shapely.Polygon([*corners, corners[1] + way, corners[0] + way]) for way in (-aside, aside)]
        longer = shapely.LineString([ends[0] - slack * along, ends[1] + slack * along])
        self._cut = longer.buffer(0.1 * slack, cap_style="flat")

    def above(self, reference: NDArray) -> NDArray:
        """Mask (n,) of the places (n, 2) to the left of the slit and of its line beyond the ends."""
        return self.notch.coordinates(reference)[1] > 0.0

    def halves(self, lower: NDArray, upper: NDArray) -> Halves:
        """Of the rectangles with these corners (n, 2), those that the slit parts from one side to another."""
        near = np.flatnonzero(self._within(lower, upper))
        boxes = shapely.box(*lower[near].T, *upper[near].T)
        halves = shapely.intersection(boxes[:, None], self._sides)
        area = shapely.area(halves)
        parted = (area > SMALLEST_PART * shapely.area(boxes)[:, None]).all(axis=1)
        parted[parted] = ~self._bridged(boxes[parted])
        middles = shapely.centroid(halves[parted])
        return Halves(near[parted], area[parted], np.stack([shapely.get_x(middles), shapely.get_y(middles)], axis=-1))

    def parted(self, lower: NDArray, upper: NDArray) -> NDArray:
        """Mask (n,) of the functions on rectangles with these corners (n, 2) whose material the slit parts wholly.

        Raises GridError where a function reaches over the slit's end through a gap, or where the slit parts none.
        """
        near = np.flatnonzero(self._within(lower, upper))
        material = shapely.intersection(shapely.box(*lower[near].T, *upper[near].T), self._body)
        size = (upper[near] - lower[near]).prod(axis=1)
        seen = (shapely.area(shapely.intersection(material[:, None], self._sides)) > SMALLEST_PART * size[:, None]).all(1)
        held = self._bridged(material)
        tips = self.tips[None]
        at_tip = ((tips > lower[near, None] + self._slack) & (tips < upper[near, None] - self._slack)).all(2).any(1)
        if (seen & held & ~at_tip).any():
            self._refuse("ends in a gap that is narrower than the grid's functions reach")
        parted = np.zeros(len(lower), bool)
        parted[near] = seen & ~held
        if not parted.any():
            self._refuse("is shorter than the grid's functions reach")
        return parted

    def places_on_faces(self, *lines: NDArray) -> NDArray:
        """Gauss points (n, 2) of the stretches of the slit between the grid's lines in x and in y, where material is."""
        start, way = np.asarray(self.notch.start), self.notch.direction
        cuts = np.concatenate([(places - start[d]) / way[d] for d, places in enumerate(lines)])
        cuts = np.unique(np.clip(cuts, 0.0, self.notch.length))
        share = 0.5 * (np.polynomial.legendre.leggauss(FACE_POINTS)[0] + 1.0)
        along = cuts[:-1, None] + share * np.diff(cuts)[:, None]
        places = start + along[np.diff(cuts) > self._slack].reshape(-1, 1) * way
        return places[shapely.contains_xy(self._body, places)]

    def _within(self, lower: NDArray, upper: NDArray) -> NDArray:
        """Mask (n,) of the rectangles in whose inside a length of the slit lies."""
        line = shapely.LineString([self.notch.start, self.notch.end])
        return shapely.length(shapely.intersection(shapely.box(*lower.T, *upper.T), line)) > self._slack

    def _bridged(self, material: NDArray) -> NDArray:
        """Mask (n,) of the shapes (n,) of which one piece that the slit leaves lies on both of its sides."""
        pieces, shape = shapely.get_parts(shapely.difference(material, self._cut), return_index=True)
        of_sides = shapely.area(shapely.intersection(pieces[:, None], self._sides))
        held = (of_sides > SMALLEST_PART * shapely.area(material)[shape, None]).all(axis=1)
        return np.bincount(shape, held, minlength=len(material)) > 0

    def _refuse(self, why: str) -> None:
        raise GridError(
            f"{self._case.source}: notches: {_words(self.notch)} {why} with mesh.h = {self._case.mesh.h:g}; make mesh.h"
            " smaller"
        )


def inclined_slits(case: Case) -> list[InclinedSlit]:
    """The case's slits at an angle to the grid's lines.

    Raises GridError where one meets another slit, where points are too few, or where a grid that follows the crack would
    have to take it over.
    """
    slits = [notch for notch in case.all_notches if isinstance(notch, SlitNotch)]
    inclined = [notch for notch in slits if not is_level(case, notch)]
    if inclined and case.mesh.follow_crack:
        raise GridError(
            f"{case.source}: mesh.follow_crack: {_words(inclined[0])} is inclined, and a grid that follows the crack"
            " keeps slits along its lines only; leave follow_crack out and let mesh.fine hold the whole crack"
        )
    if inclined and case.mpm.points_per_cell < case.mpm.order:
        raise GridError(
            f"{case.source}: mpm.points_per_cell = {case.mpm.points_per_cell}: {_words(inclined[0])} is inclined and"
            f" leaves parts of cells too few points for splines of order {case.mpm.order}; set mpm.points_per_cell ="
            f" {case.mpm.order}, or mpm.order = {case.mpm.points_per_cell}"
        )
    for one, other in combinations(slits, 2):
        lines = [shapely.LineString([notch.start, notch.end]) for notch in (one, other)]
        if (one in inclined or other in inclined) and shapely.distance(*lines) <= SAME_LINE * case.mesh.h:
            raise GridError(
                f"{case.source}: notches: {_words(one)} meets {_words(other)}, and a slit at an angle to the grid can"
                f' meet no other; give one of them kind = "cells" with a width of {(case.mpm.order + 2) * case.mesh.h:g}'
            )
    return [InclinedSlit(case, notch) for notch in inclined]


def check_apart(case: Case, groups: Iterable[NDArray]) -> None:
    """Raise GridError where slits part functions of one cell; each group is a mask of what one of them parts."""
    if (np.sum([np.asarray(group, int) for group in groups], axis=0) > 1).any():
        raise GridError(
            f"{case.source}: notches: slits are nearer to each other than the grid's functions reach with mesh.h ="
            f" {case.mesh.h:g}; make mesh.h smaller"
        )


def _words(slit: Segment) -> str:
    return f"the slit from {list(slit.start)} to {list(slit.end)}"
