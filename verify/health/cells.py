"""Indicators of cells that are too large: locking, stress that jumps from cell to cell, tips of slits."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from cases import Case
from cases.notches import Segment
from cases.spacing import cell_sizes
from numerics.fields import Fields
from verify.health.state import LOADED, ROUND_OFF, WHOLE, most_stress, uses_points, whole_bodies
from verify.metrics.energy_release import energy_release_rate, release_rate_of_faces
from verify.metrics.release import tractions_on_faces


def of_cells(case: Case, fields: Fields, history: pd.DataFrame) -> dict[str, float]:
    """`locking`, `resolution`, `coarse_cells`, `coarse_tips` and `coarse_circle`."""
    load = float(history["u"].iloc[-1]) if len(history) else 0.0
    of_stress = _resolution(case, fields) | _coarse_cells(case, fields, history)
    return _locking(case, fields) | of_stress | _coarse_tips(case, fields, load) | _coarse_circles(case)


#: Poisson's ratio above which plane strain may lock, and above which elements without a remedy do
_NEARLY_INCOMPRESSIBLE, _LOCKS_IN_MOTION = 0.45, 0.495
#: bulk over shear modulus (ν = 0.499) beyond which linear functions that lock may change no volume any more: their shear
#: then holds the energy, and the pressures that alternate tell instead; a beam 16 times too stiff has a share of 0.02
_NO_VOLUME_CHANGE = 500.0
#: error of the force over the measure by splines of higher order at rest, 4 for beams and squeezed blocks, 7 for punches
_OF_SPLINES = 5.0


def _locking(case: Case, fields: Fields) -> dict[str, float]:
    """Of bodies that hardly change their volume; blocks of two cells are large enough to hold some triangles.

    Where waves come and go the last state alone tells too little: moving elements then lock by what they are.
    """
    by_points = uses_points(case)
    if case.dynamics and not by_points and _bulk_modulus(case, _LOCKS_IN_MOTION).any():
        return {"locking": 1.0}
    bulk = _bulk_modulus(case)[fields.body]
    stiff = bulk > 0.0
    total = float((fields.energy_density * fields.volume)[stiff].sum())
    if total <= 0.0:
        return {}
    change = fields.gradient[:, 0] + fields.gradient[:, 3]
    size = _sizes(case, fields)
    block = np.column_stack([np.floor(fields.reference / (2.0 * size[:, None])), size])
    _, cell = np.unique(block, axis=0, return_inverse=True)
    volume = np.bincount(cell.ravel(), fields.volume)
    mean = np.bincount(cell.ravel(), fields.volume * change) / volume
    alternating = 0.5 * bulk * (change - mean[cell.ravel()]) ** 2 * fields.volume
    return {"locking": min(1.0, float((alternating * _weight(case)[fields.body])[stiff].sum()) / total)}


def _weight(case: Case) -> NDArray:
    """How much an alternating pressure counts in each body (n_bodies,), by the functions of its displacement.

    Of linear ones bulk over shear modulus in multiples of `_NO_VOLUME_CHANGE`, at least 1.
    """
    from physics.elasticity import MaterialTable  # judging does without compiled laws

    table, by_points = MaterialTable(case), uses_points(case)
    if case.mpm.order > 1 if by_points else case.mesh.locking_free:
        return np.full(len(table.density), _OF_SPLINES if by_points and not case.dynamics else 1.0)
    return np.maximum(1.0, (table.lame_lambda / table.shear_modulus + 1.0) / _NO_VOLUME_CHANGE)


def _bulk_modulus(case: Case, beyond: float = _NEARLY_INCOMPRESSIBLE) -> NDArray:
    """Of each body whose Poisson's ratio is beyond one in plane strain [stress]; 0 where it can change its volume."""
    from physics.elasticity import MaterialTable  # judging does without compiled laws

    table = MaterialTable(case)
    ratio = table.lame_lambda / (2.0 * (table.lame_lambda + table.shear_modulus))
    locks = (ratio > beyond) & (case.plane.assumption == "strain")
    return np.where(locks, table.lame_lambda + table.shear_modulus, 0.0)


#: half sizes of the boxes about a tip between which its energy release rate is found, over h
_TIP_BOXES = (1.0, 2.0)
#: part of the outer box that a body must fill about a tip; half of it is filled where a slit begins on an edge
_FILLED = 0.9
#: by what share of h a slit of linear elements ends too early, and one of splines of their order
_TIP_SHIFT = {1: 0.28, 2: 0.095, 3: 0.056}
#: and at most one in triangles at an angle to the grid's lines: 0.25 where it opens, more where it slides or is short
_INCLINED_TIP_SHIFT = 0.7


def _coarse_tips(case: Case, fields: Fields, load: float) -> dict[str, float]:
    """What the energy of whole bodies at rest, and with it the force, is off by the cells at the tips of slits.

    Splines that know nothing of a tip give the energy of a crack that is a share of h shorter, so that energy is off by
    this share times h times the energy release rate: an experiment, right within a tenth for cracks of four cells.
    """
    slits = [notch for notch in case.all_notches if notch.kind == "slit"]
    total = float((fields.energy_density * fields.volume).sum())
    if case.dynamics or case.eigenstrains or not slits or total <= 0.0 or fields.phase_field.min() <= WHOLE:
        return {}
    by_points = uses_points(case)
    if not by_points and any(body.mesh for body in case.bodies.values()):  # their elements are not those of the grid
        return {}
    released = 0.0
    for slit in slits:
        inclined = not by_points and slit.level_axis is None
        shift = _INCLINED_TIP_SHIFT if inclined else _TIP_SHIFT[case.mpm.order if by_points else 1]
        sizes = cell_sizes(case, np.array([slit.start, slit.end])).max(axis=1)
        for tip, sign, h in zip((slit.start, slit.end), (-1.0, 1.0), sizes, strict=True):
            released += shift * h * _released(case, fields, load, slit, tip, sign, h)
    return {"coarse_tips": released / total}


def _released(
    case: Case, fields: Fields, load: float, slit: Segment, tip: tuple[float, float], sign: float, h: float
) -> float:
    """Energy per length of growth of a slit at one of its ends [energy / length]; 0 where it ends on an edge."""
    inner, outer = (size * h for size in _TIP_BOXES)
    offset, thickness, direction = fields.reference - tip, case.plane.thickness, sign * slit.direction
    within = (np.abs(offset) < outer).all(axis=1)
    if fields.volume[within].sum() < _FILLED * (2.0 * outer) ** 2 * thickness:
        return 0.0
    rate = energy_release_rate(
        fields.reference, fields.volume, thickness, fields.stress, fields.gradient, fields.energy_density,
        tip, inner, outer, direction,
    )  # fmt: skip
    along, aside = slit.coordinates(fields.reference)
    near = np.flatnonzero(within & (along > 0.0) & (along < slit.length) & (np.abs(aside) < h))
    traction = tractions_on_faces(case, slit, along[near], aside[near], load)
    rate += release_rate_of_faces(
        offset[near], fields.volume[near] / (thickness * h), traction, fields.gradient[near], inner, outer, direction
    )
    return abs(rate) * thickness


#: weights of xx, yy, xy in the square of a stress
_SQUARE = np.array([1.0, 1.0, 2.0])


def _resolution(case: Case, fields: Fields) -> dict[str, float]:
    """Of whole bodies on which eigenstrains act: F is their energy, which is off by what their stress is off, squared.

    A body that expands freely has none.
    """
    if not case.eigenstrains or case.load_kinds[1] != "energy":
        return {}
    if np.abs(fields.stress).max(initial=0.0) <= ROUND_OFF * most_stress(case, np.abs(fields.gradient)):
        return {}
    whole = np.isin(fields.body, list(whole_bodies(case, fields)))
    return _jumping("resolution", fields, whole, _sizes(case, fields), fields.stress * np.sqrt(_SQUARE))


def _coarse_cells(case: Case, fields: Fields, history: pd.DataFrame) -> dict[str, float]:
    """Of bodies at rest of which nothing is broken, in a state that holds a good part of the largest elastic energy.

    Where their strains are round-off of how far they have moved, there is no stress to ask for.
    """
    if case.dynamics or case.eigenstrains or case.exact or not len(history) or fields.phase_field.min() <= WHOLE:
        return {}
    elastic = history["E_el"].to_numpy(float)
    moved = np.abs(fields.displacement) / max(np.ptp(case.bounding_box(), axis=0))
    least = ROUND_OFF * most_stress(case, moved)
    if not elastic[-1] > LOADED * elastic.max() or np.abs(fields.stress).max(initial=0.0) <= least:
        return {}
    from physics.elasticity import MaterialTable  # judging does without compiled laws

    roots = np.linalg.inv(np.linalg.cholesky(MaterialTable(case).stiffness))  # squares of what they give are energies
    of_energy = np.einsum("nij,nj->ni", roots[fields.body], fields.stress)
    return _jumping("coarse_cells", fields, np.ones(len(moved), bool), _sizes(case, fields), of_energy)


def _sizes(case: Case, fields: Fields) -> NDArray:
    """Sizes (n,) of the cells or elements around the points, h times powers of two [length]."""
    if uses_points(case):
        sizes = cell_sizes(case, fields.reference).max(axis=1)
    else:
        number, corners = fields.grid_cells.shape
        of_element = fields.volume * len(fields.volume) / number / case.plane.thickness
        sizes = np.sqrt(of_element * (2.0 if corners == 3 else 1.0))
    return case.mesh.h * 2.0 ** np.round(np.log2(sizes / case.mesh.h))


def _jumping(name: str, fields: Fields, asked: NDArray[np.bool_], sizes: NDArray, stress: NDArray) -> dict[str, float]:
    """Share of the squared stress (n, 3) at the points asked (n,) that is beside the best plane over blocks of two cells.

    The stress of a good solution is nearly linear over such blocks; what is left of it is about what it is off, as in
    the estimate of Zienkiewicz and Zhu (1987). sizes : (n,) of the cells around the points [length].
    """
    if not asked.any():
        return {}
    place, stress, weight, size = fields.reference[asked], stress[asked], fields.volume[asked], sizes[asked]
    block = np.column_stack([np.floor(place / (2.0 * size[:, None]) + 1e-9), fields.body[asked], size])
    _, block = np.unique(block, axis=0, return_inverse=True)
    left, terms = stress, [np.ones((len(place), 1)), place[:, :1], place[:, 1:]]
    while terms:
        term, *terms = terms
        of_term = [_projection(other, term, block.ravel(), weight) for other in (left, *terms)]
        left, *terms = (other - part for other, part in zip((left, *terms), of_term, strict=True))
    jumping, all_of_it = (float((of**2 * weight[:, None]).sum()) for of in (left, stress))
    return {name: jumping / all_of_it} if all_of_it > 0.0 else {}


def _projection(values: NDArray, term: NDArray, block: NDArray, weight: NDArray) -> NDArray:
    """Part (n, k) of values along a term (n, 1), by least squares in each block (n,)."""
    square = np.bincount(block, weight * term[:, 0] ** 2)
    along = np.column_stack([np.bincount(block, weight * term[:, 0] * column) for column in values.T])
    share = np.divide(along, square[:, None], out=np.zeros_like(along), where=square[:, None] > 0.0)
    return term * share[block]


#: places on a circle at which the cells are asked
_ROUND = 64


def _coarse_circles(case: Case) -> dict[str, float]:
    """Of circles at rest on which hat functions hold a displacement: all corners of a cell that one crosses are held."""
    if case.dynamics or case.mpm.order > 1 or not uses_points(case):
        return {}
    angle = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
    around, (lower, upper) = np.column_stack([np.cos(angle), np.sin(angle)]), case.bounding_box()
    largest = []
    for circle in (case.boundaries[on].circle for on in {c.on for c in case.constraints if c.direction != "phase"}):
        if circle is not None:
            places = np.asarray(circle.centre) + circle.radius * around
            sizes = cell_sizes(case, places)[np.all((places >= lower) & (places <= upper), axis=1)]
            largest.append(float(sizes.max(initial=0.0)) / circle.radius)
    return {"coarse_circle": max(largest)} if largest else {}
