"""Indicators of whole bodies: how far they have turned, pieces of what cannot break."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.spacing import grid_lines
from numerics.fields import Fields
from verify.health.state import WHOLE, uses_points, whole_bodies

_MOST_CELLS = 20_000_000
#: shifts the cells from round places, on which rounding would decide
_ASIDE = 0.2137


def of_bodies(case: Case, fields: Fields) -> dict[str, float]:
    """`turned_at_rest` and `numerical_fracture`."""
    pieces = [_pieces(case, fields, body) for body in whole_bodies(case, fields) if uses_points(case)]
    return _turned(case, fields) | ({"numerical_fracture": float(sum(pieces))} if pieces else {})


def _turned(case: Case, fields: Fields) -> dict[str, float]:
    """Of bodies at rest: the root mean square over what is not broken, of strains that do not turn with the material."""
    by_points = uses_points(case)
    whole, measured_on = fields.phase_field > WHOLE, case.mpm.strain if by_points else case.mesh.geometry
    if case.dynamics or case.exact or measured_on != "initial" or not whole.any():
        return {}
    angle = 0.5 * (fields.gradient[:, 2] - fields.gradient[:, 1])
    return {"turned_at_rest": float(np.sqrt(np.average(angle[whole] ** 2, weights=fields.volume[whole])))}


def _pieces(case: Case, fields: Fields, body: int) -> int:
    """Pieces of a body's points as they lie now beyond those of the start, by cells of the grid that touch."""
    of_body = fields.body == body
    now, before = (_connected(_in_cells(case, p[of_body])) for p in (fields.points, fields.reference))
    return max(0, now - before)


def _in_cells(case: Case, places: NDArray) -> NDArray:
    """Places (n, 2) counted in cells of the grid, whose outermost ones go on beside it."""
    counted = []
    for lines, x in zip(grid_lines(case), places.T, strict=True):
        beside = np.minimum(x - lines[0], 0.0) / (lines[1] - lines[0])
        beside += np.maximum(x - lines[-1], 0.0) / (lines[-1] - lines[-2])
        counted.append(np.interp(x, lines, np.arange(len(lines))) + beside)
    return np.stack(counted, axis=1)


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
