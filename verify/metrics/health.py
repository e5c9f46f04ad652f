"""The health record of a run: whether its method stayed within the range in which its numbers mean something.

Each indicator is a number with a limit; a run beyond one is suspect, which fails its case with the sentence what to do.
A case that shows a failure on purpose says so at the run, in its table ``accepts``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray

from cases import Case
from cases.notches import HistoryNotch, Segment
from cases.solvers import SOLVERS
from cases.spacing import cell_sizes
from numerics.fields import Fields
from verify.metrics.energy_release import energy_release_rate, release_rate_of_faces
from verify.metrics.histories import largest_energy, missing_energy
from verify.metrics.meeting import meeting
from verify.metrics.peak import lagging_crack, missed_peak
from verify.metrics.release import tractions_on_faces


@dataclass(frozen=True)
class Indicator:
    """A number of the health record: what it means, up to where a run is sound, why there, and what to do beyond."""

    meaning: str
    limit: float
    why: str
    remedy: str


INDICATORS = {
    "energy_balance": Indicator(
        "largest energy that is missing or too much, over the largest that there is",
        0.1, "runs that lost an answer were 0.14 to 0.85 off; sound ones are mostly below 0.02",
        'shorten the load increment or the time step, make mesh.h smaller, or set dynamics.order_of_update = "musl"',
    ),
    "missed_peak": Indicator(
        "share by which the largest force may be larger between two increments",
        0.03, "0.06 to 0.3 in bars that were 4 to 26 % too weak, 0.015 at most where the crack announces itself",
        "shorten load.increment and load.smallest, so that increments are short where it breaks",
    ),
    "lagging_crack": Indicator(
        "share by which the largest force is too large because fixed passes leave the crack behind its load",
        0.03, "0.05, 0.12 and 0.24 where it was 0.06, 0.13 and 0.23 too large",
        'shorten load.increment, raise staggered.passes, or set staggered.scheme = "converged"',
    ),
    "phase_field_range": Indicator(
        "how far the phase field leaves 0 to 1",
        0.05, "the fourth order overshoots by up to 0.05 beside a sound crack",
        "make mesh.h smaller than a quarter of the length scale",
    ),
    "face_overlap": Indicator(
        "how far the faces of a slit have gone through each other, over the largest displacement",
        0.01, "faces in contact overlap by 0.003 at most, free ones under pressure by more than 0.03",
        'give the slit contact = true in a quasi-static case, or draw it with kind = "history"',
    ),
    "closed_notch": Indicator(
        "share of the elastic energy that a notch drawn by its history or phase field loses although it is closed",
        0.05, "no_tension loses none of it, spectral a third, others more; an open notch is not asked",
        'draw the notch as a slit in a quasi-static case, or set fracture.split = "no_tension"',
    ),
    "sheared_notch": Indicator(
        "share of the elastic energy that a torn notch drawn by its history or phase field carries in shear while open",
        0.02, "a slit carries none, a notch pulled open 1e-5; sheared, the spectral split a tenth: no crack sets out",
        'draw the notch as a slit, or set fracture.split = "volumetric_deviatoric"',
    ),
    "whole_notch": Indicator(
        "share of the length of a notch drawn by its history field along which the material beside it is whole",
        0.1, "0 where cells are no larger than the length scale; all of it where no integration point lies in the notch",
        "make mesh.h no more than the length scale, or the notch's factor larger",
    ),
    "locking": Indicator(
        "share of the elastic energy in volume changes that alternate from point to point",
        0.05, "0.78 in quadrilaterals that lock, 0.42 in triangles, 0.002 in those that do not",
        "set mesh.locking_free = true in a quasi-static case, or take material points with mpm.order = 2",
    ),
    "resolution": Indicator(
        "share of the squared stress that jumps from cell to cell, where eigenstrains act and F is an energy",
        0.02, "a warm plate clamped on one edge is 8 % off with ten cells along it",
        "make mesh.h smaller",
    ),
    "coarse_cells": Indicator(
        "share of the elastic energy of whole bodies in stress that jumps from cell to cell, about which F is off",
        0.05, "0.17 in a beam of one cell across, 56 % off, 0.03 with four, 4 % off; 0.09 where a point is moved",
        "make mesh.h, or the elements of a mesh file, smaller there, and hold or load a length of edge, not a point",
    ),
    "coarse_tips": Indicator(
        "what the cells at the tips of slits make a whole body too stiff by, as a share of its energy",
        0.03, "solvers whose bases differ part by 2 % there", "make mesh.h smaller at the tips, as by mesh.refine",
    ),
    "coarse_circle": Indicator(
        "largest cell on a circle that hat functions of material points hold, over its radius",
        0.25, "what surrounds a held hole was 2 % too stiff at 0.2, 16 % at 0.4, 14 to 21 % at 0.6",
        "make mesh.h smaller there, as by mesh.refine, or set mpm.order = 2",
    ),
    "coarse_crack": Indicator(
        "share of the new crack's energy in cells larger than the length scale, where cracks take too much force",
        0.05, "0.02 where a crack stays in fine cells, 0.4 to 1 where it bore too much",
        "enlarge mesh.fine, or set mesh.follow_crack = true in a quasi-static case",
    ),
    "held_crack": Indicator(
        "share of the torn crack's energy within a length scale of edges held in x and y, where half a crack's is enough",
        0.25, "0 to 0.2 where it only ends there; along a held edge its profile has one side, so it tears there first",
        "hold the phase field at 1 along it, weld a body of several times the toughness to it, or hold one direction",
    ),
    "unbroken_beside": Indicator(
        "share of the torn crack's energy within a length scale of bodies that cannot break, where half of it is enough",
        0.25, "0 to 0.2 where it only ends there; along such a body it has one side and 0.57 of the energy",
        "give that body's material fracture of several times the toughness, or hold the phase field at 1 along it",
    ),
    "quadrature": Indicator(
        "share of the volume in cells with fewer than 2 x 2 material points",
        0.1, "curved edges leave up to 0.03 in sound runs; with one point a cell all of it",
        "set mpm.points_per_cell = 2, or 3 where edges are slanted or curved",
    ),
    "scatter": Indicator(
        "how far the points' middle lies from the cell's middle, over h (root mean square)",
        0.05, "0 for points in order; points at random were 7 to 25 % off",
        'set mpm.placement = "regular" or "gauss"',
    ),
    "bridged_gap": Indicator(
        "length in cells over which material points on both sides of a gap in or between bodies hang together",
        2.5, "2 at the bottom of a V-notch of 30 degrees, 5 to 9 % off; 4 in one of 20, 8 to 15 % off",
        'make mesh.h smaller or the gap wider; at rest a narrow notch may be drawn with kind = "slit" or "cells"',
    ),
    "met_across_gap": Indicator(
        "length in cells of edges that have met others across a gap, where bodies at rest do not press on each other",
        0.0, "elements go through each other at no force, material points hang together, pulled apart as well",
        'load it less far, draw a gap that closes as kind = "slit", or give the table dynamics and solver = "mpm"',
    ),
    "turned": Indicator(
        "angle by which a body has turned whose strains are small ones on its first geometry [radians]",
        0.1, "by 0.1 it has grown by one percent, by 1 to twice its area",
        'run it with solver = "mpm", whose points turn with their stress',
    ),
    "turned_at_rest": Indicator(
        "angle by which whole material at rest has turned whose strains are small ones on its first geometry [radians]",
        0.1, "by 0.1 it has grown by half a percent, and solvers part by 4 % of the force that bends a beam",
        'load it less far, or give the table dynamics and solver = "mpm", whose points turn with their stress',
    ),
    "numerical_fracture": Indicator(
        "pieces that a body which cannot break has fallen into",
        0.0, "what cannot break stays in one piece",
        "make mesh.h smaller, set mpm.points_per_cell = 3 or a larger mpm.order, or load it less far",
    ),
    "left_behind": Indicator(
        "how far material has moved from the grid's nodes that hold its phase field broken, over h",
        0.02, "the force was 0.05 % off at 0.03, 6 % at 0.07: the points beside the crack take another phase field",
        'set mpm.move_points = false, or draw the notch with kind = "history" or "slit"',
    ),
    "crossed_edge": Indicator(
        "share of the material points carrying tractions that have moved into cells of the grid that were empty at first",
        0.0, "few points hold the functions there: F was 10 to 80 % off with splines, 1 % with hats, or had no bound",
        "set mpm.move_points = false, or load it less far",
    ),
    "constraint_error": Indicator(
        "largest distance of a held place from where it should be, over the largest displacement",
        0.01, "1e-4 at most in sound runs",
        "raise mpm.penalty",
    ),
}  # fmt: skip


def health(case: Case, history: pd.DataFrame, fields: Fields | None, measures: Mapping[str, float]) -> dict[str, float]:
    """The indicators that apply to a run, from its history, its last state and what its solver tells."""
    found = {name: value for name, value in measures.items() if name in INDICATORS}
    found |= _of_history(case, history, fields)
    if fields is not None:
        load = float(history["u"].iloc[-1]) if len(history) else 0.0
        found |= _of_fields(case, fields, history) | _coarse_cells(case, fields, history)
        found |= _coarse_tips(case, fields, load)
    return {name: float(value) for name, value in found.items() if np.isfinite(value)}


def suspicions(found: Mapping[str, float | None], accepted: Mapping[str, str]) -> list[str]:
    """One sentence for each indicator beyond its limit that is not accepted."""
    return [
        f"{indicator.meaning} is {value:.3g}, more than {indicator.limit:g}; {indicator.remedy}"
        for name, indicator in INDICATORS.items()
        if name not in accepted and (value := found.get(name)) is not None and value > indicator.limit
    ]


def _of_history(case: Case, history: pd.DataFrame, fields: Fields | None) -> dict[str, float]:
    if not len(history):
        return {}
    found = {"phase_field_range": max(0.0, -float(history["c_min"].min()))} if case.fracture_enabled else {}
    rows = history if case.dynamics else history[history["c_min"].to_numpy() >= _WHOLE]
    if len(rows) > 1 and case.exact is None:
        scale = max(largest_energy(rows), _ROUND_OFF * _held_back(case, rows), _LEAST * _stretched(case, fields))
        if scale > 0.0:
            found["energy_balance"] = float(np.abs(missing_energy(rows)).max() / scale)
    fields_move = case.exact is not None or any(constraint.motion for constraint in case.constraints)
    if case.fracture_enabled and not case.dynamics and not fields_move:
        found["missed_peak"] = missed_peak(history)
        found |= {"lagging_crack": lagging_crack(history)} if case.staggered.scheme == "passes" else {}
    return found


#: energies below this share of that which eigenstrains would store in bodies that are held all round are none
_ROUND_OFF = 1e-5


#: and below this share of that which would stretch a body by as much as it is moved
_LEAST = 1e-9


def _stretched(case: Case, fields: Fields | None) -> float:
    """Energy that would stretch bodies at rest by the largest displacement [energy]; 0 in dynamics."""
    if fields is None or case.dynamics:
        return 0.0
    used = [case.materials[body.material] for body in case.bodies.values()]
    stiffest = max(float(m.stiffness.matrix().max()) if m.stiffness else m.lam + 2.0 * m.mu for m in used)
    return stiffest * case.plane.thickness * float((fields.displacement**2).max(initial=0.0))


def _held_back(case: Case, history: pd.DataFrame) -> float:
    """Energy that eigenstrains would store in bodies that are held all round [energy]; 0 without any."""
    if not case.eigenstrains:
        return 0.0
    from physics.acting import eigenstrains, eigenstress, work_density  # judging does without compiled laws
    from physics.elasticity import MaterialTable

    gradient = eigenstrains(case).at(history["u"].abs().max())
    stress = eigenstress(MaterialTable(case), gradient, np.arange(len(case.bodies)))
    lower, upper = case.bounding_box()
    return float(0.5 * work_density(stress, gradient).max() * np.prod(upper - lower) * case.plane.thickness)


#: a state that holds a smaller share of the largest elastic energy has been unloaded
_LOADED = 0.05
#: a quasi-static run is held to its balance while nothing is broken: what a crack sets free in a jump, no state keeps
_WHOLE = 0.5


def _of_fields(case: Case, fields: Fields, history: pd.DataFrame) -> dict[str, float]:
    found, loaded = {}, not _is_unloaded(case, history)
    if case.fracture_enabled:
        found["phase_field_range"] = float(max(0.0, fields.phase_field.max() - 1.0, -fields.phase_field.min()))
    slits = [notch for notch in case.all_notches if notch.kind == "slit"]
    if slits and loaded and (scale := np.linalg.norm(fields.displacement, axis=1).max()) > 0.0:
        found["face_overlap"] = max(0.0, *(-_least_opening(slit, fields, case.mesh.h) / scale for slit in slits))
    found |= _torn_notches(case, fields) if loaded and _rests(case, history) else {}
    for indicators in (_locking, _resolution, _coarse_crack, _held_crack, _left_behind, _turned, _whole_notch, meeting):
        found |= indicators(case, fields)
    by_points = SOLVERS[case.run_spec(case.run or "").solver].by_points
    found |= _coarse_circles(case) if by_points and not case.dynamics else {}
    pieces = [_pieces(case, fields, body) for body in _whole_bodies(case, fields) if by_points]
    return found | ({"numerical_fracture": float(sum(pieces))} if pieces else {})


def _is_unloaded(case: Case, history: pd.DataFrame) -> bool:
    """Whether the last state of a run at rest is left without load and stress, so that round-off moves faces."""
    if case.dynamics or not len(history):
        return False
    last = (np.abs(history[name].to_numpy(float)) for name in ("u", "E_el"))
    return all(size[-1] < _LOADED * size.max() for size in last)


def _least_opening(slit: Segment, fields: Fields, h: float) -> float:
    """Least distance of the faces of a slit [length], averaged over stretches of two cells; 0 where none is seen.

    Displacements next to the slit are carried on to the middle of their stretch by their gradients.
    """
    along, aside = slit.coordinates(fields.reference)
    near = (along > 0.0) & (along < slit.length) & (np.abs(aside) < h)
    if not near.any():
        return 0.0
    number = max(1, int(slit.length / (2.0 * h)))
    stretch = np.minimum((along[near] / slit.length * number).astype(int), number - 1)
    x, y = slit.direction
    middle = np.asarray(slit.start) + ((stretch + 0.5) * slit.length / number)[:, None] * slit.direction
    away = np.einsum("nij,nj->ni", fields.gradient[near].reshape(-1, 2, 2), fields.reference[near] - middle)
    face = (fields.displacement[near] - away) @ np.array([-y, x])
    upper, lower = (_means(stretch[side], face[side]) for side in (aside[near] > 0, aside[near] < 0))
    return min((upper[key] - lower[key] for key in upper.keys() & lower.keys()), default=0.0)


#: kinetic energy over the elastic one below which bodies are at rest: no wave closes a notch on its way
_AT_REST = 1e-4


def _rests(case: Case, history: pd.DataFrame) -> bool:
    """The last state is one of equilibrium."""
    return not case.dynamics or (len(history) > 0 and history["E_kin"].iloc[-1] < _AT_REST * history["E_el"].iloc[-1])


def _torn_from_the_start(case: Case) -> list[Segment]:
    """Notches drawn by the history field, and the pieces of lines on which the phase field is held broken."""
    broken = [c.on for c in case.constraints if c.direction == "phase" and c.value is not None and c.value < _WHOLE]
    lines = [case.boundaries[on].line() for on in broken]
    ends = [pair for line in lines if line is not None for pair in pairwise(line.coords)]
    drawn = [notch for notch in case.all_notches if isinstance(notch, HistoryNotch)]
    return [*drawn, *(Segment(start=start, end=end) for start, end in ends)]


def _torn_notches(case: Case, fields: Fields) -> dict[str, float]:
    """Of bodies at rest: what notches of torn material lose where they are closed, but in sliding, and carry in
    sliding where they are not, of the energy of whole material at their strain."""
    notches = _torn_from_the_start(case)
    if case.eigenstrains or not notches:
        return {}
    from physics.elasticity import MaterialTable  # judging does without compiled laws

    ux, uxy, uyx, uy = fields.gradient.T
    strain = np.column_stack([ux, uy, uxy + uyx])
    whole = np.einsum("nij,nj->ni", MaterialTable(case).stiffness[fields.body], strain)
    lost = carried = total = 0.0
    for notch in notches:
        along, aside = notch.coordinates(fields.reference)
        within = (along > 0.0) & (along < notch.length) & (fields.phase_field < _WHOLE)
        near = within & (np.abs(aside) < cell_sizes(case, fields.reference).max(axis=1))
        x, y = notch.direction
        closed = near & (whole @ np.array([y * y, x * x, -2.0 * x * y]) < 0.0)
        along_it = np.array([-x * y, x * y, x * x - y * y])
        slide = strain @ (along_it * [2.0, 2.0, 1.0])
        missing = whole - fields.stress
        work = ((missing * strain).sum(axis=1) - (missing @ along_it) * slide) * fields.volume
        total += float(((whole * strain).sum(axis=1) * fields.volume)[near].sum())
        lost += float(work[closed].sum())
        carried += float(((fields.stress @ along_it) * slide * fields.volume)[near & ~closed].sum())
    return {"closed_notch": lost / total, "sheared_notch": carried / total} if total > 0.0 else {}


def _whole_notch(case: Case, fields: Fields) -> dict[str, float]:
    """Along stretches of two cells, the largest near a notch, with material that can break."""
    breaks, whole, number = np.isfinite(_length_scales(case, fields)), 0, 0
    for notch in case.all_notches:
        if isinstance(notch, HistoryNotch):
            sizes = cell_sizes(case, fields.reference).max(axis=1)
            near = breaks & (notch.distance(fields.reference) < sizes)
            along, _ = notch.coordinates(fields.reference[near])
            stretches = (along / (2.0 * sizes[near].max(initial=case.mesh.h))).astype(int)
            seen = np.unique(stretches)
            torn = np.unique(stretches[fields.phase_field[near] < _WHOLE])
            whole, number = whole + len(seen) - len(torn), number + len(seen)
    return {"whole_notch": whole / number} if number else {}


def _means(key: NDArray, value: NDArray) -> dict[int, float]:
    return {int(k): float(value[key == k].mean()) for k in np.unique(key)}


def _locking(case: Case, fields: Fields) -> dict[str, float]:
    """Of bodies that hardly change their volume; cells of 2 h are large enough to hold some triangles.

    Where waves come and go the last state alone tells too little: moving elements then lock by what they are.
    """
    by_points = SOLVERS[case.run_spec(case.run or "").solver].by_points
    if case.dynamics and not by_points and _bulk_modulus(case, _LOCKS_IN_MOTION).any():
        return {"locking": 1.0}
    bulk = _bulk_modulus(case)[fields.body]
    stiff = bulk > 0.0
    total = float((fields.energy_density * fields.volume)[stiff].sum())
    if total <= 0.0:
        return {}
    change = fields.gradient[:, 0] + fields.gradient[:, 3]
    _, cell = np.unique(np.floor(fields.reference / (2.0 * case.mesh.h)).astype(int), axis=0, return_inverse=True)
    volume = np.bincount(cell.ravel(), fields.volume)
    mean = np.bincount(cell.ravel(), fields.volume * change) / volume
    alternating = 0.5 * bulk * (change - mean[cell.ravel()]) ** 2 * fields.volume
    return {"locking": float(alternating[stiff].sum()) / total}


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
    if case.dynamics or case.eigenstrains or not slits or total <= 0.0 or fields.phase_field.min() <= _WHOLE:
        return {}
    by_points = SOLVERS[case.run_spec(case.run or "").solver].by_points
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
    if np.abs(fields.stress).max(initial=0.0) <= _ROUND_OFF * _most_stress(case, np.abs(fields.gradient)):
        return {}
    whole = np.isin(fields.body, list(_whole_bodies(case, fields)))
    return _jumping("resolution", fields, whole, np.full(len(whole), case.mesh.h), fields.stress * np.sqrt(_SQUARE))


def _coarse_cells(case: Case, fields: Fields, history: pd.DataFrame) -> dict[str, float]:
    """Of bodies at rest of which nothing is broken, in a state that holds a good part of the largest elastic energy.

    Where their strains are round-off of how far they have moved, there is no stress to ask for.
    """
    if case.dynamics or case.eigenstrains or case.exact or not len(history) or fields.phase_field.min() <= _WHOLE:
        return {}
    elastic = history["E_el"].to_numpy(float)
    moved = np.abs(fields.displacement) / max(np.ptp(case.bounding_box(), axis=0))
    least = _ROUND_OFF * _most_stress(case, moved)
    if not elastic[-1] > _LOADED * elastic.max() or np.abs(fields.stress).max(initial=0.0) <= least:
        return {}
    from physics.elasticity import MaterialTable  # judging does without compiled laws

    roots = np.linalg.inv(np.linalg.cholesky(MaterialTable(case).stiffness))  # squares of what they give are energies
    of_energy = np.einsum("nij,nj->ni", roots[fields.body], fields.stress)
    return _jumping("coarse_cells", fields, np.ones(len(moved), bool), _sizes(case, fields), of_energy)


def _most_stress(case: Case, strain: NDArray) -> float:
    """What strains could make of stress [stress]."""
    from physics.elasticity import MaterialTable  # judging does without compiled laws

    return float(MaterialTable(case).stiffness.max() * strain.max(initial=0.0))


def _sizes(case: Case, fields: Fields) -> NDArray:
    """Sizes (n,) of the cells or elements around the points, h times powers of two [length]."""
    if SOLVERS[case.run_spec(case.run or "").solver].by_points:
        sizes = cell_sizes(case, fields.reference).max(axis=1)
    else:
        number, corners = fields.grid_cells.shape
        of_element = fields.volume * len(fields.volume) / number / case.plane.thickness
        sizes = np.sqrt(of_element * (2.0 if corners == 3 else 1.0))
    return case.mesh.h * 2.0 ** np.round(np.log2(sizes / case.mesh.h))


def _jumping(
    name: str, fields: Fields, asked: NDArray[np.bool_], sizes: NDArray, stress: NDArray
) -> dict[str, float]:
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


#: below this phase field material softens: where AT2 in one dimension bears its largest stress
_SOFTENS = 0.75
#: below this one it is torn
_TORN = 0.25
#: a notch drawn by its history field damages what is nearer than so many length scales, and the cell beyond
_BESIDE_NOTCH = 4.0


def _coarse_crack(case: Case, fields: Fields) -> dict[str, float]:
    """Of what softens outside the notches; a grid that follows the crack, or may be too coarse by name, is not asked."""
    mesh, by_points = case.mesh, SOLVERS[case.run_spec(case.run or "").solver].by_points
    if mesh.fine is None or mesh.follow_crack or mesh.under_resolved:
        return {}
    lengths = _length_scales(case, fields)
    if not by_points:  # elements of a mesh file are not those of the grid
        lengths[np.isin(fields.body, [n for n, body in enumerate(case.bodies.values()) if body.mesh])] = np.inf
    coarse = cell_sizes(case, fields.reference).max(axis=1) > _ROUNDED * lengths
    return _share("coarse_crack", _new_crack(case, fields, lengths, _SOFTENS), coarse)


def _held_crack(case: Case, fields: Fields) -> dict[str, float]:
    """Of what is torn outside the notches; nothing is held where the phase field is."""
    if not case.fracture_enabled:
        return {}
    lengths, held = _length_scales(case, fields), np.zeros(len(fields.body), bool)
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


def _turned(case: Case, fields: Fields) -> dict[str, float]:
    """Of bodies at rest: the root mean square over what is not broken, of strains that do not turn with the material."""
    by_points = SOLVERS[case.run_spec(case.run or "").solver].by_points
    whole, measured_on = fields.phase_field > _WHOLE, case.mpm.strain if by_points else case.mesh.geometry
    if case.dynamics or case.exact or measured_on != "initial" or not whole.any():
        return {}
    angle = 0.5 * (fields.gradient[:, 2] - fields.gradient[:, 1])
    return {"turned_at_rest": float(np.sqrt(np.average(angle[whole] ** 2, weights=fields.volume[whole])))}


#: places on a circle at which the cells are asked
_ROUND = 64


def _coarse_circles(case: Case) -> dict[str, float]:
    """Of circles on which hat functions hold a displacement: all corners of a cell that one crosses are held with it."""
    held = {c.on for c in case.constraints if c.direction != "phase"} if case.mpm.order == 1 else set()
    angle = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
    around, (lower, upper) = np.column_stack([np.cos(angle), np.sin(angle)]), case.bounding_box()
    largest = []
    for circle in (case.boundaries[on].circle for on in held):
        if circle is not None:
            places = np.asarray(circle.centre) + circle.radius * around
            sizes = cell_sizes(case, places)[np.all((places >= lower) & (places <= upper), axis=1)]
            largest.append(float(sizes.max(initial=0.0)) / circle.radius)
    return {"coarse_circle": max(largest)} if largest else {}


def _left_behind(case: Case, fields: Fields) -> dict[str, float]:
    """Of points at rest that move through a grid whose nodes hold the phase field."""
    held = [c.on for c in case.constraints if c.direction == "phase" and c.value is not None and c.value < _WHOLE]
    by_points = SOLVERS[case.run_spec(case.run or "").solver].by_points
    if case.dynamics or not by_points or not case.mpm.move_points or not held:
        return {}
    size, box = cell_sizes(case, fields.reference).max(axis=1), case.bounding_box()
    near = np.logical_or.reduce([case.boundaries[on].select(fields.reference, case.mesh.h, box) for on in held])
    moved = np.linalg.norm(fields.points - fields.reference, axis=1) / size
    return {"left_behind": float(moved[near].max(initial=0.0))}


def _within(case: Case, fields: Fields, on: str, lengths: NDArray) -> NDArray[np.bool_]:
    """Points (n,) within a length scale of a boundary set."""
    near = np.zeros(len(lengths), bool)
    for length in np.unique(lengths[np.isfinite(lengths)]):
        of_scale = lengths == length
        near[of_scale] = case.boundaries[on].select(fields.reference[of_scale], length, case.bounding_box())
    return near


def _length_scales(case: Case, fields: Fields) -> NDArray:
    """Of the points (n,) [length]; infinite where nothing breaks."""
    fractures = [case.materials[body.material].fracture for body in case.bodies.values()]
    return np.array([np.inf if of is None else of.length_scale for of in fractures])[fields.body]


def _new_crack(case: Case, fields: Fields, lengths: NDArray, below: float) -> NDArray:
    """What the phase field below a value holds of energy at the points (n,), up to a factor; none in torn notches."""
    cracked = (fields.phase_field < below) & np.isfinite(lengths)
    cell = cell_sizes(case, fields.reference).max(axis=1)
    for notch in _torn_from_the_start(case):
        cracked &= notch.distance(fields.reference) > _BESIDE_NOTCH * lengths + cell
    return np.where(cracked, (1.0 - fields.phase_field) ** 2 * fields.volume, 0.0)


def _share(name: str, energy: NDArray, part: NDArray) -> dict[str, float]:
    return {name: float(energy[part].sum() / energy.sum())} if energy.any() else {}


#: a cell as large as the length scale is not larger
_ROUNDED = 1.01

#: Poisson's ratio above which plane strain may lock, and above which elements without a remedy do
_NEARLY_INCOMPRESSIBLE, _LOCKS_IN_MOTION = 0.45, 0.495


def _bulk_modulus(case: Case, beyond: float = _NEARLY_INCOMPRESSIBLE) -> NDArray:
    """Of each body whose Poisson's ratio is beyond one in plane strain [stress]; 0 where it can change its volume."""
    from physics.elasticity import MaterialTable  # judging does without compiled laws

    table = MaterialTable(case)
    ratio = table.lame_lambda / (2.0 * (table.lame_lambda + table.shear_modulus))
    locks = (ratio > beyond) & (case.plane.assumption == "strain")
    return np.where(locks, table.lame_lambda + table.shear_modulus, 0.0)


def _whole_bodies(case: Case, fields: Fields) -> Iterator[int]:
    """Bodies that have not broken anywhere."""
    for number in range(len(case.bodies)):
        of_body = fields.body == number
        if of_body.any() and fields.phase_field[of_body].min() > _WHOLE:
            yield number


def _pieces(case: Case, fields: Fields, body: int) -> int:
    """Pieces of a body's points as they lie now beyond those of the start, by cells of h that touch."""
    of_body = fields.body == body
    now, before = (_connected(p[of_body] / case.mesh.h) for p in (fields.points, fields.reference))
    return max(0, now - before)


def _connected(places: NDArray) -> int:
    """Connected groups of the unit cells that places (n, 2) lie in, across corners too."""
    from scipy.ndimage import label

    cells = np.unique(np.floor(places + _ASIDE).astype(np.int64), axis=0)
    size = np.ptp(cells, axis=0) + 1
    if np.prod(size, dtype=float) > _MOST_CELLS:
        return len(cells)
    filled = np.zeros(size, bool)
    filled[tuple((cells - cells.min(axis=0)).T)] = True
    return int(label(filled, np.ones((3, 3)))[1])


_MOST_CELLS = 20_000_000
#: shifts the cells from round places, on which rounding would decide
_ASIDE = 0.2137
