"""Where material points start, and the volume that each of them stands for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.spacing import grid_lines


@dataclass(frozen=True)
class PointCloud:
    """Material points before loading.

    Attributes
    ----------
    positions : (n, 2).
    volume : (n,) area times thickness.
    size : (n, 2) extent of the point in x and y: its cell's over the points per direction.
    body : (n,) number of the body.
    """

    positions: NDArray
    volume: NDArray
    size: NDArray
    body: NDArray


def place_points(case: Case) -> PointCloud:
    """Points of a case: at Gauss points, regularly or at random (seeded) in each cell, kept where a body is.

    The volume is the point's share of its cell by the Gauss weights, or an equal share.
    """
    x_lines, y_lines = (np.asarray(lines) for lines in grid_lines(case))
    widths = np.stack(np.meshgrid(np.diff(x_lines), np.diff(y_lines), indexing="ij"), -1).reshape(-1, 1, 2)
    corners = np.stack(np.meshgrid(x_lines[:-1], y_lines[:-1], indexing="ij"), -1).reshape(-1, 1, 2)
    local, weights = _local_points(case, len(corners))
    positions = (corners + widths * local).reshape(-1, 2)
    volume = (widths.prod(axis=2) * weights).ravel() * case.plane.thickness
    extent = np.broadcast_to(widths / case.mpm.points_per_cell, (len(corners), local.shape[1], 2))
    body = case.inside(positions)
    kept = (body >= 0) & ~_in_notch(case, positions)
    return PointCloud(positions[kept], volume[kept], extent.reshape(-1, 2)[kept], body[kept])


def _local_points(case: Case, n_cells: int) -> tuple[NDArray, NDArray]:
    """Positions in the unit cell, (1 or n_cells, n, 2), and their shares of its area (n,)."""
    per_direction = case.mpm.points_per_cell
    if case.mpm.placement == "random":
        generator = np.random.default_rng(case.mpm.seed)
        count = per_direction**2
        return generator.random((n_cells, count, 2)), np.full(count, 1.0 / count)
    if case.mpm.placement == "gauss":
        abscissae, weights = np.polynomial.legendre.leggauss(per_direction)
        abscissae, weights = 0.5 * (abscissae + 1.0), 0.5 * weights
    else:
        abscissae = (np.arange(per_direction) + 0.5) / per_direction
        weights = np.full(per_direction, 1.0 / per_direction)
    points = np.stack(np.meshgrid(abscissae, abscissae, indexing="ij"), -1).reshape(1, -1, 2)
    return points, np.outer(weights, weights).ravel()


def _in_notch(case: Case, positions: NDArray) -> NDArray:
    """Points (n,) in the notches that are left out of the body."""
    out = np.zeros(len(positions), bool)
    for notch in case.notches:
        if notch.kind == "cells":
            start, end = np.array(notch.start, float), np.array(notch.end, float)
            length = np.linalg.norm(end - start)
            tangent = (end - start) / length
            along = (positions - start) @ tangent
            across = (positions - start) @ np.array([-tangent[1], tangent[0]])
            out |= (along >= 0) & (along <= length) & (np.abs(across) <= 0.5 * notch.width)
    return out
