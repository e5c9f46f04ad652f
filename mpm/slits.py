"""Cracks of no width along lines of the grid: where each line is open, and where material holds it together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby

import numpy as np
import shapely
from numpy.typing import NDArray

from cases import Case, CaseError
from cases.geometry import SAME_LINE
from cases.notches import SlitNotch


class GridError(CaseError):
    """No grid can be made as the case asks; the message is one sentence that ends with the remedy."""


def is_level(case: Case, notch: SlitNotch) -> bool:
    """Whether a slit lies along a line of the grid: its ends are no further off it than lines that are one."""
    away = np.abs(np.asarray(notch.end) - np.asarray(notch.start)).min()
    return bool(away <= SAME_LINE * case.mesh.h)


class GridSlit:
    """An axis-parallel crack of no width on a grid line.

    ``normal`` is the direction across it (0 for x, 1 for y), ``position`` its place there, ``start`` and ``end``
    its extent along the other direction.
    """

    def __init__(self, notch: SlitNotch) -> None:
        start, end, self.contact = np.array(notch.start, float), np.array(notch.end, float), notch.contact
        self.normal = int(np.argmin(np.abs(end - start)))
        self.position = float(start[self.normal])
        self.start, self.end = sorted((float(start[1 - self.normal]), float(end[1 - self.normal])))

    def sides(self, reference: NDArray) -> NDArray:
        """-1 below, +1 above, 0 beside the slit (n,), from reference positions (n, 2)."""
        along, across = reference[:, 1 - self.normal], reference[:, self.normal]
        beside = (along < self.start) | (along > self.end)
        return np.where(beside, 0, np.where(across < self.position, -1, 1))


class SlitLine:
    """A line of the grid with all the slits on it.

    Attributes
    ----------
    normal, position : as of the slits. slits : those on the line.
    whole : (n, 2) stretches along the line with material on both sides that no slit parts.
    tips : (n, 2) ends of slits within the material [length]; one that ends on an edge, or where another begins, has none.
    """

    def __init__(self, case: Case, slits: list[GridSlit]) -> None:
        self._case, self.slits = case, slits
        self.normal, self.position = slits[0].normal, slits[0].position
        self._slack = SAME_LINE * case.mesh.h
        self.whole = np.array(list(self._whole_stretches()), float).reshape(-1, 2)
        ends = np.array([end for slit in slits for end in (slit.start, slit.end)])
        within = np.isclose(ends[:, None], self.whole.ravel(), rtol=0.0, atol=self._slack).any(axis=1)
        self.tips = np.array([self._at(end) for end in ends[within]]).reshape(-1, 2)

    def _whole_stretches(self) -> Iterator[tuple[float, float]]:
        lower, upper = self._case.bounding_box()
        line = shapely.LineString([self._at(corner[1 - self.normal]) for corner in (lower, upper)])
        # bodies that touch are one; material on one side alone, along an edge of a body, holds nothing together
        inside = shapely.union_all(self._case.outlines()).buffer(0.1 * self._slack).buffer(-0.2 * self._slack)
        cracks = [shapely.LineString([self._at(slit.start), self._at(slit.end)]) for slit in self.slits]
        cut = shapely.union_all([crack.buffer(0.1 * self._slack) for crack in cracks])
        for part in shapely.get_parts(line.intersection(inside).difference(cut)):
            if part.length > self._slack:
                yield tuple(sorted(shapely.get_coordinates(part)[[0, -1], 1 - self.normal]))

    def _at(self, along: float) -> NDArray:
        """The point (2,) at a place along the line."""
        return np.array([along, self.position] if self.normal == 1 else [self.position, along])

    def parted(self, left: NDArray, right: NDArray) -> NDArray:
        """Mask (n,) of the functions from left to right along the line which a slit parts wholly.

        Raises GridError where a function reaches from a slit that ends on an edge over the gap into other material, or
        where a slit parts none.
        """
        held = _meets(left, right, self.whole, self._slack)
        on_slit = _meets(left, right, np.array([(slit.start, slit.end) for slit in self.slits]), self._slack)
        tips = self.tips[:, 1 - self.normal]
        at_tip = ((left[:, None] < tips - self._slack) & (right[:, None] > tips + self._slack)).any(axis=1)
        bridging = np.flatnonzero(on_slit & held & ~at_tip)
        if len(bridging):
            place = self._at(0.5 * (left[bridging[0]] + right[bridging[0]])).tolist()
            why = f"a slit ends near {place} in a gap that is narrower than the grid's functions reach"
            self._refuse(why, ", or let the slit go on to the other side")
        parted = on_slit & ~held
        for slit in self.slits:
            if not _meets(left[parted], right[parted], [(slit.start, slit.end)], self._slack).any():
                ends = self._at(slit.start).tolist(), self._at(slit.end).tolist()
                self._refuse(f"the slit from {ends[0]} to {ends[1]} is shorter than the grid's functions reach")
        return parted

    def _refuse(self, why: str, otherwise: str = "") -> None:
        h = self._case.mesh.h
        raise GridError(f"{self._case.source}: notches: {why} with mesh.h = {h:g}; make mesh.h smaller{otherwise}")


def slit_lines(case: Case) -> list[SlitLine]:
    """The lines of a case's slits, each once."""
    slits = [GridSlit(notch) for notch in case.all_notches if isinstance(notch, SlitNotch) and is_level(case, notch)]
    step = SAME_LINE * case.mesh.h
    on_line = lambda slit: (slit.normal, round(slit.position / step))  # noqa: E731
    return [SlitLine(case, list(of_line)) for _, of_line in groupby(sorted(slits, key=on_line), key=on_line)]


def _meets(left: NDArray, right: NDArray, stretches: Iterable, slack: float) -> NDArray:
    """Mask (n,) of the intervals that share a length with one of the stretches (m, 2)."""
    start, end = np.asarray(stretches, float).reshape(-1, 2).T
    return (np.minimum(right[:, None], end) - np.maximum(left[:, None], start) > slack).any(axis=1)
