"""The energy release rate of a crack of a case: what its bodies, forces on them and tractions on its faces give."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from cases.geometry import SAME_LINE
from cases.notches import Segment
from cases.seams import seams
from cases.spacing import cell_sizes
from verify.metrics.energy_release import energy_release_rate, release_rate_of_faces
from verify.metrics.metric import MetricError

if TYPE_CHECKING:
    from cases import Case

#: share of the outer box that the bodies must fill: a machined notch may take some of it
FILLED = 0.9
#: a seam or a traced crack is parallel to a direction where it goes aside by no more than this share of its way
SLANT = 0.1

#: parts of the way from point to point along a face, each of them loaded or not
PARTS = 16


def release_rate(
    data: Mapping[str, NDArray], case: Case, load: float, tip: ArrayLike, direction: ArrayLike, inner: float, outer: float
) -> float:
    """Energy release rate J around a tip (2,), with what body forces and tractions on slits add [force / length].

    data : fields of the points of a snapshot. load : its load parameter. direction, inner, outer : as of
        `verify.metrics.energy_release`.

    Raises MetricError where the outer box goes out of the bodies, holds another end of a slit, edges of the bodies that
    bear tractions, or a seam of two materials that the crack's direction crosses: what moves these along would release
    energy too.
    """
    _require_box(case, np.asarray(tip, dtype=float), np.asarray(direction, dtype=float), outer)
    points, volume = np.asarray(data["reference"])[:, :2], np.asarray(data["volume"])
    gradient = np.asarray(data["gradient"])
    rate = energy_release_rate(
        points, volume, case.plane.thickness, np.asarray(data["stress"]), gradient, np.asarray(data["energy_density"]),
        tip, inner, outer, direction,
    )  # fmt: skip
    if case.body_forces or case.dynamics:
        rate += _of_body_forces(case, load, data, points - np.asarray(tip, dtype=float), direction, inner, outer)
    if not case.tractions:
        return rate
    slits = (notch for notch in case.all_notches if notch.kind == "slit")
    loaded = (_of_faces(case, slit, load, data, tip, direction, inner, outer) for slit in slits)
    return rate + sum(loaded)


def _require_box(case: Case, tip: NDArray, direction: NDArray, outer: float) -> None:
    box = shapely.box(*(tip - outer), *(tip + outer))
    bodies = shapely.union_all(case.outlines())
    filled = bodies.intersection(box).area / box.area
    place = f"around the tip at ({tip[0]:g}, {tip[1]:g})"
    if filled < FILLED:
        said = f"{place} the bodies fill {filled:.0%} of the box of outer = {outer:g}"
        raise MetricError(f"case {case.name}: {said}; make it smaller, or give the whole body")
    along = direction / np.linalg.norm(direction)
    for slit in (notch for notch in case.all_notches if notch.kind == "slit"):
        ends = np.array([slit.start, slit.end])
        at_tip = np.abs(ends - tip).max(axis=1) < SAME_LINE * case.mesh.h
        for end in ends[~at_tip]:
            inside = box.contains(shapely.Point(end)) and bodies.contains(shapely.Point(end))
            if inside and at_tip.any():
                said = f"{place} the box of outer = {outer:g} holds the other end of the slit too"
                raise MetricError(f"case {case.name}: {said}; make it smaller than the slit is long")
            if inside and not _is_behind(end - tip, along):
                said = f"{place} the box of outer = {outer:g} holds an end of another slit, at ({end[0]:g}, {end[1]:g})"
                raise MetricError(f"case {case.name}: {said}; make it smaller than they are apart")
    number = _loaded_edge(case, shapely.intersection(bodies.boundary, box))
    if number is not None:
        said = f"{place} tractions[{number}] acts on an edge of the bodies in the box of outer = {outer:g}"
        remedy = 'make it smaller, or draw a notch that is loaded inside with kind = "slit"'
        raise MetricError(f"case {case.name}: {said}, which releases energy too; {remedy}")
    if seam := _seam_across(case, box, along):
        said = f"{place} the crack's direction crosses the seam of {seam} in the box of outer = {outer:g}"
        raise MetricError(f"case {case.name}: {said}, which releases energy too; make it smaller than they are apart")


def _loaded_edge(case: Case, edges: BaseGeometry) -> int | None:
    """Number of the first traction that acts on one of these edges; None where none does."""
    corners = [shapely.get_coordinates(part) for part in shapely.get_parts(edges)]
    lines = np.concatenate([np.zeros((0, 2, 2)), *(np.stack([c[:-1], c[1:]], axis=1) for c in corners)])
    for number, traction in enumerate(case.tractions):
        parts = case.boundaries[traction.on].parts_of_lines(lines, SAME_LINE * case.mesh.h, case.bounding_box())
        if parts.any():
            return number
    return None


def _is_behind(offset: NDArray, along: NDArray) -> bool:
    """A place by its offset (2,) from the tip is on the crack behind it, straight but for a little."""
    ahead, aside = float(offset @ along), float(along[0] * offset[1] - along[1] * offset[0])
    return ahead < 0.0 and abs(aside) <= SLANT * abs(ahead)


def _seam_across(case: Case, box: shapely.Polygon, along: NDArray) -> str:
    """Names of two bodies with other elastic laws whose seam in the box goes across a direction (2,); empty without."""
    for seam in seams(case):
        inside = shapely.get_parts(shapely.intersection(shapely.linestrings(seam.stretches), box))
        ends = [shapely.get_coordinates(part)[[0, -1]] for part in inside if part.length > 0.0]
        way = np.array([np.subtract(*pair) for pair in ends]).reshape(-1, 2)
        length, across = np.linalg.norm(way, axis=1).sum(), np.abs(along[0] * way[:, 1] - along[1] * way[:, 0]).sum()
        if across > SLANT * length:
            return f"{seam.one} and {seam.other}"
    return ""


def _of_body_forces(
    case: Case, load: float, data: Mapping[str, NDArray], offset: NDArray,
    direction: ArrayLike, inner: float, outer: float,
) -> float:  # fmt: skip
    """What forces per volume add at points by their offset (n, 2) from the tip, as tractions do on faces."""
    from physics.acting import body_forces  # judging does without compiled laws

    if case.dynamics:
        densities = [case.materials[body.material].density or 0.0 for body in case.bodies.values()]
        acting = np.outer(densities, case.dynamics.gravity)
    else:
        acting = body_forces(case).at(load)
    force, area = acting[np.asarray(data["body"], dtype=int)], np.asarray(data["volume"]) / case.plane.thickness
    return release_rate_of_faces(offset, area, force, data["gradient"], inner, outer, direction)


def _of_faces(
    case: Case, slit: Segment, load: float, data: Mapping[str, NDArray],
    tip: ArrayLike, direction: ArrayLike, inner: float, outer: float,
) -> float:  # fmt: skip
    """What tractions on both faces of a slit add, by the rise of their displacement from point to point beside them."""
    faces = _faces(case, slit, data)
    total, e = 0.0, np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    for side, places, moved in faces:
        # the faces meet at the tip, and go on as they are elsewhere
        meet = [np.abs(np.subtract(place, tip)).max() < SAME_LINE * case.mesh.h for place in (slit.start, slit.end)]
        first, last = (
            np.mean([other[end] for *_, other in faces], axis=0) if at_tip else moved[end]
            for end, at_tip in zip((0, -1), meet, strict=True)
        )
        places, moved = _in_parts(np.array([0.0, *places, slit.length]), np.vstack([first, moved, last]))
        middle, length = 0.5 * (places[1:] + places[:-1]), np.diff(places)
        traction = tractions_on_faces(case, slit, middle, np.full(len(middle), side), load)
        rise = np.sign(e @ slit.direction) * np.diff(moved, axis=0)
        gradient = np.einsum("ni,j->nij", rise / length[:, None], e).reshape(-1, 4)
        offset = np.array(slit.start) + middle[:, None] * slit.direction - np.asarray(tip)
        total += release_rate_of_faces(offset, length, traction, gradient, inner, outer, e)
    return total


def _in_parts(places: NDArray, moved: NDArray) -> tuple[NDArray, NDArray]:
    """Places (n,) along a face and their displacement (n, 2) with others between them, as loads end between points."""
    number = np.arange(len(places))
    between = np.linspace(0.0, number[-1], PARTS * number[-1] + 1)
    return np.interp(between, number, places), np.stack([np.interp(between, number, u) for u in moved.T], axis=1)


def _faces(case: Case, slit: Segment, data: Mapping[str, NDArray]) -> list[tuple[float, NDArray, NDArray]]:
    """Of each face the side on which its body is, places along it (n,) and their displacement (n, 2) [length]."""
    points, displacement = np.asarray(data["reference"])[:, :2], np.asarray(data["displacement"])[:, :2]
    along, aside = slit.coordinates(points)
    normal = np.array([-slit.direction[1], slit.direction[0]])
    slope = np.asarray(data["gradient"]).reshape(-1, 2, 2) @ normal
    near = (along > 0.0) & (along < slit.length) & (np.abs(aside) < cell_sizes(case, points).min(axis=1))
    faces, slack = [], SAME_LINE * case.mesh.h
    for side in (-1.0, 1.0):
        on = near & (side * aside > 0.0)
        if on.any():
            places, rows = np.unique(np.round(along[on] / slack), return_inverse=True)
            moved = displacement[on] - aside[on, None] * slope[on]
            moved = np.stack([np.bincount(rows, part) for part in moved.T], axis=1) / np.bincount(rows)[:, None]
            faces.append((side, places * slack, moved))
    return faces


def tractions_on_faces(case: Case, slit: Segment, along: NDArray, aside: NDArray, load: float) -> NDArray:
    """Tractions (n, 2) on the faces of a slit at places along it (n,), on the side of `aside` (n,) [stress]."""
    place = np.array(slit.start) + along[:, None] * slit.direction
    x, y = slit.direction
    outward = -np.sign(aside)[:, None] * np.array([-y, x])
    total = np.zeros_like(place)
    for traction in case.tractions:
        on = case.boundaries[traction.on].select(place, 1e-6 * case.mesh.h, case.bounding_box())
        factor = traction.share(load) if case.dynamics else load if traction.follows_load else 1.0
        total += on[:, None] * factor * traction.on_edges(outward)
    return total
