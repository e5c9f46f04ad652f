"""Indicators of notches: slits whose faces overlap, torn material that carries too much or too little, or is whole."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from cases import Case
from cases.notches import HistoryNotch, Segment
from cases.spacing import cell_sizes
from numerics.fields import Fields
from verify.health.state import WHOLE, is_unloaded, length_scales, rests, torn_from_the_start, uses_points


def of_notches(case: Case, fields: Fields, history: pd.DataFrame) -> dict[str, float]:
    """`face_overlap`, `closed_notch`, `sheared_notch`, `whole_notch` and `left_behind`."""
    found, loaded = _whole_notch(case, fields) | _left_behind(case, fields), not is_unloaded(case, history)
    slits = [notch for notch in case.all_notches if notch.kind == "slit"]
    if slits and loaded and (scale := np.linalg.norm(fields.displacement, axis=1).max()) > 0.0:
        found["face_overlap"] = max(0.0, *(-_least_opening(slit, fields, case.mesh.h) / scale for slit in slits))
    return found | (_torn_notches(case, fields) if loaded and rests(case, history) else {})


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


def _means(key: NDArray, value: NDArray) -> dict[int, float]:
    return {int(k): float(value[key == k].mean()) for k in np.unique(key)}


def _torn_notches(case: Case, fields: Fields) -> dict[str, float]:
    """Of bodies at rest: what notches of torn material lose where they are closed, but in sliding, and carry in
    sliding where they are not, of the energy of whole material at their strain."""
    notches = torn_from_the_start(case)
    if case.eigenstrains or not notches:
        return {}
    from physics.elasticity import MaterialTable  # judging does without compiled laws

    ux, uxy, uyx, uy = fields.gradient.T
    strain = np.column_stack([ux, uy, uxy + uyx])
    whole = np.einsum("nij,nj->ni", MaterialTable(case).stiffness[fields.body], strain)
    lost = carried = total = 0.0
    for notch in notches:
        along, aside = notch.coordinates(fields.reference)
        within = (along > 0.0) & (along < notch.length) & (fields.phase_field < WHOLE)
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
    breaks, whole, number = np.isfinite(length_scales(case, fields)), 0, 0
    for notch in case.all_notches:
        if isinstance(notch, HistoryNotch):
            sizes = cell_sizes(case, fields.reference).max(axis=1)
            near = breaks & (notch.distance(fields.reference) < sizes)
            along, _ = notch.coordinates(fields.reference[near])
            stretches = (along / (2.0 * sizes[near].max(initial=case.mesh.h))).astype(int)
            seen = np.unique(stretches)
            torn = np.unique(stretches[fields.phase_field[near] < WHOLE])
            whole, number = whole + len(seen) - len(torn), number + len(seen)
    return {"whole_notch": whole / number} if number else {}


def _left_behind(case: Case, fields: Fields) -> dict[str, float]:
    """Of points at rest that move through a grid whose nodes hold the phase field."""
    held = [c.on for c in case.constraints if c.direction == "phase" and c.value is not None and c.value < WHOLE]
    by_points = uses_points(case)
    if case.dynamics or not by_points or not case.mpm.move_points or not held:
        return {}
    size, box = cell_sizes(case, fields.reference).max(axis=1), case.bounding_box()
    near = np.logical_or.reduce([case.boundaries[on].select(fields.reference, case.mesh.h, box) for on in held])
    moved = np.linalg.norm(fields.points - fields.reference, axis=1) / size
    return {"left_behind": float(moved[near].max(initial=0.0))}
