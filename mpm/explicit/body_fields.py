"""What can be seen of moving bodies: their points in the order of the cloud, and the occupied cells of the lattice."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mpm.explicit.moving_body import MovingBody
from mpm.placement import PointCloud
from numerics.fields import Fields


def fields_of(bodies: Sequence[MovingBody], cloud: PointCloud) -> Fields:
    """Points as they stand, in the order in which they were placed, and the occupied cells of the grid."""
    n = len(cloud.positions)
    gathered: dict[str, NDArray] = {}
    for body in bodies:
        for name, values in _point_fields(body).items():
            gathered.setdefault(name, np.zeros((n, *values.shape[1:])))[body.points.number] = values
    corners, cells, phase_field = _occupied_cells(bodies)
    return Fields(
        **gathered,
        reference=cloud.positions,
        volume=cloud.volume,
        displacement=gathered["points"] - cloud.positions,
        body=cloud.body,
        grid_points=corners,
        grid_cells=cells,
        grid_displacement=np.full_like(corners, np.nan),
        grid_phase_field=phase_field,
    )


def _point_fields(body: MovingBody) -> dict[str, NDArray]:
    """Arrays over a body's points; the gradient is that of the strain alone, without turning."""
    elastic, crack = body.points.elastic, body.points.crack
    return {
        "points": body.positions(),
        "gradient": np.column_stack([elastic.exx, 0.5 * elastic.gxy, 0.5 * elastic.gxy, elastic.eyy]),
        "phase_field": crack.c,
        "history_field": crack.history,
        "stress": np.column_stack([elastic.sxx, elastic.syy, elastic.sxy]),
        "energy_density": body.energy_density(),
        "broken_at": crack.broken_at,
    }


def _occupied_cells(bodies: Sequence[MovingBody]) -> tuple[NDArray, NDArray, NDArray]:
    """Corners (4 n, 2), quads (n, 4) and the mean phase field at the corners (4 n,) of cells that hold points."""
    motions = [body.points.motion for body in bodies]
    cells = np.concatenate(
        [
            np.column_stack([np.floor(motion.x), np.floor(motion.y)]).astype(int) + body.window.corner
            for body, motion in zip(bodies, motions, strict=True)
        ]
    )
    phase_field = np.concatenate([body.points.crack.c for body in bodies])
    lower, upper = cells.min(axis=0), cells.max(axis=0)
    number = np.ravel_multi_index((cells - lower).T, upper - lower + 1)
    occupied, place, count = np.unique(number, return_inverse=True, return_counts=True)
    mean = np.bincount(place, weights=phase_field) / count
    first = np.column_stack(np.unravel_index(occupied, upper - lower + 1)) + lower
    steps = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    corners = (first[:, None, :] + steps).reshape(-1, 2)
    lattice = bodies[0].lattice
    return lattice.origin + lattice.h * corners, np.arange(len(corners)).reshape(-1, 4), np.repeat(mean, 4)
