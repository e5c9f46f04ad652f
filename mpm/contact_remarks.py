"""What is to be said of how moving bodies touch, before they move."""

from __future__ import annotations

from itertools import combinations, permutations
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray

from cases import Case

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

#: turn of an outline [radians] from which on it is a corner, and cells from one within which another body's is met
_TURN, _BESIDE = np.radians(30.0), 2.0


def contact_remarks(case: Case) -> list[str]:
    """A sentence for each body that slides or rolls too little as the case describes it."""
    return [*_corners_on_edges(case), *_square_discs(case)]


def _square_discs(case: Case) -> list[str]:
    """Discs that gravity may roll, of points in a square pattern: those are polygons, which lie on a side."""
    pulled = case.dynamics is not None and any(case.dynamics.gravity)
    rubs = any(case.friction(*pair) for pair in combinations(range(len(case.bodies)), 2))
    if case.mpm.placement == "rings" or not (pulled and rubs):
        return []
    return [
        f"bodies.{name}: is a disc of points in a {case.mpm.placement!r} pattern, which rolls too slowly or not at all;"
        ' give mpm.placement = "rings".'
        for name, body in case.bodies.items()
        if body.deforms and body.shape is not None and body.shape.disc is not None
    ]


def _corners_on_edges(case: Case) -> list[str]:
    """Bodies that stand with their corners on the edge of another one, both of whose normals count.

    The grid rounds the corners, whose normals then lean: what slides is held up there.
    """
    free = {name: body.outline() for name, body in case.bodies.items() if not body.keeps_velocity}
    return [
        f"bodies.{name}: stands with its corners on {other!r}, where the grid mixes the normals of both, so that it may"
        f" slide too little or not at all; give contact.normals_of = {other!r} where the edge of that is smooth."
        for name, other in permutations(free, 2)
        if case.contact.normals_of not in (name, other) and _stands_on(free[name], free[other], case.mesh.h)
    ]


def _stands_on(outline: BaseGeometry, other: BaseGeometry, h: float) -> bool:
    """Whether corners of an outline lie within a cell of the other's edge, away from its own corners."""
    corners, others = shapely.points(_corners(outline)), shapely.multipoints(_corners(other))
    on_edge = shapely.dwithin(corners, other.boundary, h)
    beside = shapely.dwithin(corners, others, _BESIDE * h)
    return bool((on_edge & ~beside).any())


def _corners(outline: BaseGeometry) -> NDArray[np.float64]:
    """Places (n, 2) at which an outline turns sharply."""
    found = [np.empty((0, 2))]
    for ring in shapely.get_parts(shapely.get_rings(outline)):
        places = shapely.get_coordinates(ring)[:-1]
        ahead = np.roll(places, -1, axis=0) - places
        angles = np.arctan2(ahead[:, 1], ahead[:, 0])
        turns = np.abs((angles - np.roll(angles, 1) + np.pi) % (2.0 * np.pi) - np.pi)
        found.append(places[turns > _TURN])
    return np.concatenate(found)
