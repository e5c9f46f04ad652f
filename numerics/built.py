"""Whether what was built is what was drawn: notches that part the body, bodies that are held.

Each discretisation asks before anything is computed, by places that see unknowns: elements their nodes, material points
the functions of their cells.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely import LineString
from shapely.geometry.base import BaseGeometry

from cases import Case, CaseError
from cases.notches import CellsNotch

#: below this share of the largest, a singular value of the constraints on rigid motions is none
_RANK = 1e-7


class BuiltError(CaseError):
    """What was built is not what was drawn; the message is one sentence that ends with the remedy."""


@dataclass(frozen=True)
class Holds:
    """What constraints hold: n components of places.

    place : (n, 2) [length]. component : (n,) 0 for x, 1 for y. part : (n,) of the body that the place belongs to.
    tied : (n,) number of the group that shares one free displacement, -1 where it is prescribed.
    """

    place: NDArray
    component: NDArray
    part: NDArray
    tied: NDArray

    def joined(self, other: Holds) -> Holds:
        """Both; groups of tied places must be of one of the two alone."""
        return Holds(*(np.concatenate([getattr(self, f.name), getattr(other, f.name)]) for f in fields(self)))


def parts_of_nodes(nodes: NDArray, n_nodes: int) -> NDArray:
    """Number (n_nodes,) of the connected part of each node, from those (n, k) that each place sees."""
    first, other = np.repeat(nodes[:, 0], nodes.shape[1] - 1), nodes[:, 1:].ravel()
    graph = coo_array((np.ones(len(first), dtype=bool), (first, other)), shape=(n_nodes, n_nodes))
    return connected_components(graph, directed=False)[1]


def check_notches_part(case: Case, places: NDArray, nodes: NDArray, reach: float, remedy: str) -> None:
    """Raise BuiltError where places on both sides of a notch of left-out cells see the same node.

    places : (n, 2) of what is left. nodes : (n, k) that each of them sees. reach : [length] how far a node is seen; so
    near to an end within a body a notch need not part anything.
    """
    for number, notch in enumerate(case.notches):
        if not isinstance(notch, CellsNotch):
            continue
        along, aside = notch.coordinates(places)
        first, last = (reach * within for within in _ends_within(case, notch))
        beside = (along > first) & (along < notch.length - last) & (np.abs(aside) < 0.5 * notch.width + reach)
        left, right = (np.unique(nodes[beside & side]) for side in (aside > 0.0, aside < 0.0))
        if len(np.intersect1d(left, right)):
            raise BuiltError(
                f"{case.source}: notches[{number}].width = {notch.width:g}: with mesh.h = {case.mesh.h:g} the two sides"
                f" of the left-out cells hang together; {remedy}"
            )


def _ends_within(case: Case, notch: CellsNotch) -> NDArray:
    """Mask (2,) of the ends of a notch that lie in a body by more than half a cell."""
    ends, depth = np.array([notch.start, notch.end]), 0.5 * case.mesh.h
    return np.logical_or.reduce([body.contains(ends, -depth) for body in case.bodies.values()])


def check_line_is_followed(case: Case, number: int, places: NDArray, cells: NDArray, remedy: str) -> None:
    """Raise BuiltError where nodes that a constraint holds on a line within bodies are single ones, not side by side.

    places : (n, 2) of the nodes. cells : (n_cells, k) nodes of each
    """
    on, slack = case.constraints[number].on, 1e-6 * case.mesh.h
    line, aside = _drawn_line(case, number)
    if line is None:
        return
    inside = line.intersection(shapely.union_all(case.outlines()).buffer(slack))
    inside = shapely.line_merge(inside) if inside.geom_type == "MultiLineString" else inside
    held = np.flatnonzero(case.boundaries[on].select(places, slack, case.bounding_box()))
    for part in shapely.get_parts(inside)[shapely.length(shapely.get_parts(inside)) > 0.0]:
        near = held[shapely.dwithin(part, shapely.points(places[held]), aside + 0.01 * case.mesh.h)]
        gap = _first_gap(part, shapely.line_locate_point(part, shapely.points(places[near])), near, cells, places)
        if gap is not None:
            start, end = (shapely.get_coordinates(part.interpolate(at))[0] for at in gap)
            raise BuiltError(
                f"{case.source}: constraints[{number}].on = '{on}': no node lies on it from ({start[0]:.6g},"
                f" {start[1]:.6g}) to ({end[0]:.6g}, {end[1]:.6g}), so that it would hold single points; {remedy}"
            )


def holds_a_line_within(case: Case, number: int) -> bool:
    """Whether a constraint holds a line of which a part lies within bodies, rather than an area or their edge."""
    line, _ = _drawn_line(case, number)
    slack = 1e-3 * case.mesh.h
    return line is not None and line.intersection(shapely.union_all(case.outlines()).buffer(-slack)).length > slack


def _drawn_line(case: Case, number: int) -> tuple[BaseGeometry | None, float]:
    """Line that a constraint holds, and how far it reaches beside it: that of a crack may be a box thinner than cells."""
    boundary = case.boundaries[case.constraints[number].on]
    if boundary.line() is not None or boundary.box is None or case.constraints[number].direction != "phase":
        return boundary.line(), 0.0
    lower, upper = np.asarray(boundary.box.lower), np.asarray(boundary.box.upper)
    thin = int(np.argmin(upper - lower))
    width = upper[thin] - lower[thin]
    if not 0.0 < width < case.mesh.h:
        return None, 0.0
    lower[thin] = upper[thin] = 0.5 * (lower[thin] + upper[thin])
    return shapely.LineString([lower, upper]), 0.5 * width


def _first_gap(
    line: LineString, along: NDArray, nodes: NDArray, cells: NDArray, places: NDArray
) -> tuple[float, float] | None:
    """Where on a line no cell has nodes at both ends of a stretch between the nodes (n,), which lie along (n,) it.

    What is left at the line's ends is no longer than a cell there.
    """
    stops, rank_of = np.unique(np.round(along, 9 - int(np.ceil(np.log10(line.length)))), return_inverse=True)
    ranks = np.full(len(places), -1)
    ranks[nodes] = rank_of
    of_cells = ranks[cells]
    seen = cells[(of_cells >= 0).any(axis=1)]
    size = float(np.ptp(places[seen], axis=1).max(initial=0.0)) or float(np.ptp(places[cells], axis=1).max())
    joined = np.zeros(max(0, len(stops) - 1), bool)
    for row in of_cells[(of_cells >= 0).sum(axis=1) > 1]:
        joined[[rank for rank in set(row) if rank >= 0 and rank + 1 in row]] = True
    for rank in np.flatnonzero(~joined):
        return float(stops[rank]), float(stops[rank + 1])
    first, last = (stops[0], stops[-1]) if len(stops) else (line.length, line.length)
    if first > 1.5 * size:
        return 0.0, float(first)
    return (float(last), line.length) if line.length - last > 1.5 * size else None


def check_support(case: Case, holds: Holds, part: NDArray, body: NDArray) -> None:
    """Raise BuiltError where a part can move as a rigid body.

    part, body : (n,) the connected part and the body of each place
    """
    names = list(case.bodies)
    for number in np.unique(part):
        of_part = holds.part == number
        free = _free_motions(holds.place[of_part], holds.component[of_part], holds.tied[of_part])
        if free:
            of_bodies = np.unique(body[part == number])
            bodies = ", ".join(names[index] for index in of_bodies)
            if np.isin(body[part != number], of_bodies).any():
                bodies = f"a part of {bodies}, cut off from the rest,"
            raise BuiltError(
                f"{case.source}: constraints: {bodies} can {free} freely; hold it there, or join it to a body that is"
                " held"
            )


def _free_motions(place: NDArray, component: NDArray, tied: NDArray) -> str:
    """The rigid motions that nothing holds, in words; empty where there are none."""
    middle = place.mean(axis=0) if len(place) else np.zeros(2)
    from_middle = place - middle
    scale = np.abs(from_middle).max(initial=0.0) or 1.0
    turning = np.where(component == 0, -from_middle[:, 1], from_middle[:, 0]) / scale
    rows = np.column_stack([component == 0, component == 1, turning]).astype(float)
    held = np.concatenate([rows[tied < 0], *_differences(rows, tied), np.zeros((1, 3))])
    if np.linalg.matrix_rank(held, tol=_RANK * max(1.0, np.abs(held).max()) * np.sqrt(len(held))) == 3:
        return ""
    free = [word for column, word in ((0, "move in x"), (1, "move in y")) if not np.any(held[:, column])]
    return " and ".join(free) or "turn"


def _differences(rows: NDArray, tied: NDArray) -> Iterator[NDArray]:
    """What is held by tying: rows less the first one of their group."""
    for group in np.unique(tied[tied >= 0]):
        members = rows[tied == group]
        yield members[1:] - members[:1]
