"""The drawn edges of a case's bodies, and the parts of them on which tractions act or constraints hold."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.polygon import orient

from cases import Case
from cases.boundaries import BoundarySet
from cases.notches import SlitNotch

from .built import BuiltError

#: a boundary set ends this near to a place, in multiples of h, where it ends on it
ON_SET = 1e-6
#: the edges that a discretisation loads or holds may be shorter or longer than the drawn ones by this share of them
LENGTH_SHARE = 0.05


class Edges(NamedTuple):
    """Straight stretches of edge: lines (n, 2, 2) from start to end [length], outward normals (n, 2)."""

    lines: NDArray
    normals: NDArray

    @property
    def lengths(self) -> NDArray:
        """Of the lines (n,) [length]."""
        return np.linalg.norm(self.lines[:, 1] - self.lines[:, 0], axis=1)

    @classmethod
    def around(cls, lines: NDArray) -> Edges:
        """Of lines (n, 2, 2) that have the body on their left."""
        way = lines[:, 1] - lines[:, 0]
        return cls(lines, np.column_stack([way[:, 1], -way[:, 0]]) / np.linalg.norm(way, axis=1)[:, None])

    def cut(self, parts: NDArray) -> Edges:
        """The parts (n, 2) of the lines, from 0 at their start to 1, that have a length."""
        on = parts[:, 1] > parts[:, 0]
        start, way = self.lines[on, :1], self.lines[on, 1:] - self.lines[on, :1]
        return Edges(start + parts[on, :, None] * way, self.normals[on])

    def on(self, case: Case, boundary: BoundarySet) -> NDArray:
        """The part (n, 2) of each line that lies on a boundary set."""
        return boundary.parts_of_lines(self.lines, ON_SET * case.mesh.h, case.bounding_box())


def drawn_edges(case: Case) -> Edges:
    """Edges of the bodies and both faces of slits; where bodies touch they are one in a quasi-static case."""
    shapes = case.outlines()
    body = shapely.union_all(shapes)
    rings = [ring for shape in ([body] if case.dynamics is None else shapes) for ring in _rings(shape)]
    faces = [face for notch in case.all_notches if isinstance(notch, SlitNotch) for face in _faces(notch, body)]
    return Edges.around(np.concatenate([np.stack([r[:-1], r[1:]], axis=1) for r in (*rings, *faces)]))


def _rings(shape: shapely.Geometry) -> Iterator[NDArray]:
    """Corners (n, 2) of the closed rings, the body on their left."""
    for part in shapely.get_parts(shape):
        if isinstance(part, shapely.Polygon):
            oriented = orient(part)
            for ring in (oriented.exterior, *oriented.interiors):
                yield np.asarray(ring.coords)


def _faces(notch: SlitNotch, body: shapely.Geometry) -> Iterator[NDArray]:
    """Ends (2, 2) of the stretches of a slit that lie in the body, there and back."""
    for part in shapely.get_parts(shapely.LineString([notch.start, notch.end]).intersection(body)):
        ends = np.asarray(part.coords)[[0, -1]]
        if np.ptp(ends, axis=0).any():
            yield from (ends, ends[::-1])


def loaded_lengths(lengths: Iterable[float]) -> dict[str, float]:
    """What a run tells of the edges that its tractions act on, in the order of the case [length]."""
    return {f"loaded_length_{number}": float(length) for number, length in enumerate(lengths)}


def drawn_length(case: Case, boundary: str) -> float:
    """Length of the drawn edges that lie on a boundary set [length]."""
    edges = drawn_edges(case)
    return float(edges.cut(edges.on(case, case.boundaries[boundary])).lengths.sum())


def check_loaded_length(case: Case, number: int, loaded: float) -> None:
    """Raise BuiltError where a traction acts on nothing, or on edges of another length than the drawn ones."""
    on = case.tractions[number].on
    drawn, name = drawn_length(case, on), f"{case.source}: tractions[{number}].on = '{on}'"
    if loaded <= 0.0:
        raise BuiltError(
            f"{name}: no edge of a body lies on it, so it would load nothing; move it onto an edge, or let it enclose a"
            " part of one"
        )
    if abs(loaded - drawn) > LENGTH_SHARE * drawn:
        raise BuiltError(
            f"{name}: {loaded:.4g} {case.units.length} of edge are loaded of {drawn:.4g} drawn; make mesh.h smaller, or"
            " let it end where edges end"
        )
    _check_free(case, number, name)


def _check_free(case: Case, number: int, name: str) -> None:
    """Raise BuiltError where all edges of a traction are held in the directions in which it acts."""
    traction, edges = case.tractions[number], drawn_edges(case)
    if traction.is_zero:
        return
    loaded = edges.cut(edges.on(case, case.boundaries[traction.on]))
    force = np.abs(traction.on_edges(loaded.normals)) * loaded.lengths[:, None]
    holding = []
    for key, constraint in enumerate(case.constraints):
        if constraint.direction in ("x", "y") and not constraint.tied:
            axis = "xy".index(constraint.direction)
            parts = loaded.on(case, case.boundaries[constraint.on])
            if force[:, axis].any():
                holding.append(f"constraints[{key}]")
            force[:, axis] *= 1.0 - np.clip(parts[:, 1] - parts[:, 0], 0.0, 1.0)
    if force.sum() <= ON_SET * loaded.lengths.sum() * np.abs(traction.on_edges(loaded.normals)).max():
        raise BuiltError(
            f"{name}: {' and '.join(holding)} hold all that it would load, so it would do nothing; remove one of them, or"
            " load an edge that can move"
        )


def check_held_length(case: Case, number: int, held: float, remedy: str) -> None:
    """Raise BuiltError where a constraint holds edges of another length than the drawn ones.

    A set that is shorter than a cell is meant as a point.
    """
    on = case.constraints[number].on
    drawn = drawn_length(case, on)
    if drawn > case.mesh.h and abs(held - drawn) > LENGTH_SHARE * drawn:
        raise BuiltError(
            f"{case.source}: constraints[{number}].on = '{on}': {held:.4g} {case.units.length} of edge are held of"
            f" {drawn:.4g} drawn; {remedy}"
        )
