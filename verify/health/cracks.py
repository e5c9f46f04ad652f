"""Indicators of cracks that take another energy than theirs: in coarse cells, along what holds or cannot break."""

from __future__ import annotations

from itertools import product

import numpy as np
import shapely
from numpy.typing import NDArray

from cases import Case
from cases.spacing import cell_sizes
from numerics.fields import Fields
from verify.health.state import length_scales, torn_from_the_start, uses_points


def of_cracks(case: Case, fields: Fields) -> dict[str, float]:
    """`coarse_crack`, `held_crack`, `unbroken_beside` and `torn_load`."""
    return _coarse_crack(case, fields) | _held_crack(case, fields) | _torn_load(case, fields)


#: below this phase field material softens: where AT2 in one dimension bears its largest stress
_SOFTENS = 0.75
#: below this one it is torn
_TORN = 0.25
#: a notch drawn by its history field damages what is nearer than so many length scales, and the cell beyond
_BESIDE_NOTCH = 4.0
#: a cell as large as the length scale is not larger
_ROUNDED = 1.01


def _coarse_crack(case: Case, fields: Fields) -> dict[str, float]:
    """Of what softens outside the notches; a grid that follows the crack, or may be too coarse by name, is not asked."""
    mesh, by_points = case.mesh, uses_points(case)
    if mesh.fine is None or mesh.follow_crack or mesh.under_resolved:
        return {}
    lengths = length_scales(case, fields)
    if not by_points:  # elements of a mesh file are not those of the grid
        lengths[np.isin(fields.body, [n for n, body in enumerate(case.bodies.values()) if body.mesh])] = np.inf
    coarse = cell_sizes(case, fields.reference).max(axis=1) > _ROUNDED * lengths
    return _share("coarse_crack", _new_crack(case, fields, lengths, _SOFTENS), coarse)


def _held_crack(case: Case, fields: Fields) -> dict[str, float]:
    """Of what is torn outside the notches; nothing is held where the phase field is."""
    if not case.fracture_enabled:
        return {}
    lengths, held = length_scales(case, fields), np.zeros(len(fields.body), bool)
    near: dict[str, list[NDArray]] = {"x": [], "y": []}
    for constraint in case.constraints:
        for direction in near.keys() & ({"x", "y"} if constraint.motion else {constraint.direction}):
            near[direction].append(_within(case, fields, constraint.on, lengths))
    for one, other in product(near["x"], near["y"]):
        if 2 * (one & other).sum() > min(one.sum(), other.sum()):  # edges that only meet in a corner are two
            held |= one & other
    for constraint in case.constraints:
        if constraint.direction == "phase":
            held &= ~_within(case, fields, constraint.on, lengths)
    found = _share("held_crack", _new_crack(case, fields, lengths, _TORN), held)
    whole = [body.outline() for body in case.bodies.values() if case.materials[body.material].fracture is None]
    if whole and not case.dynamics:
        beside = shapely.dwithin(shapely.union_all(whole), shapely.points(fields.reference), lengths)
        found |= _share("unbroken_beside", _new_crack(case, fields, lengths, _TORN), beside)
    return found


def _torn_load(case: Case, fields: Fields) -> dict[str, float]:
    """Of what is loaded where the most of it is torn; nothing where no material that may break is loaded."""
    lengths = length_scales(case, fields)
    near = [_within(case, fields, on, lengths) for on in {traction.on for traction in case.tractions}]
    volumes = [np.where(loaded, fields.volume, 0.0) for loaded in near if loaded.any()]
    torn = fields.phase_field < _TORN
    return {"torn_load": max(float(volume[torn].sum() / volume.sum()) for volume in volumes)} if volumes else {}


def _within(case: Case, fields: Fields, on: str, lengths: NDArray) -> NDArray[np.bool_]:
    """Points (n,) within a length scale of a boundary set."""
    near = np.zeros(len(lengths), bool)
    for length in np.unique(lengths[np.isfinite(lengths)]):
        of_scale = lengths == length
        near[of_scale] = case.boundaries[on].select(fields.reference[of_scale], length, case.bounding_box())
    return near


def _new_crack(case: Case, fields: Fields, lengths: NDArray, below: float) -> NDArray:
    """What the phase field below a value holds of energy at the points (n,), up to a factor; none in torn notches."""
    cracked = (fields.phase_field < below) & np.isfinite(lengths)
    cell = cell_sizes(case, fields.reference).max(axis=1)
    for notch in torn_from_the_start(case):
        cracked &= notch.distance(fields.reference) > _BESIDE_NOTCH * lengths + cell
    return np.where(cracked, (1.0 - fields.phase_field) ** 2 * fields.volume, 0.0)


def _share(name: str, energy: NDArray, part: NDArray) -> dict[str, float]:
    return {name: float(energy[part].sum() / energy.sum())} if energy.any() else {}
