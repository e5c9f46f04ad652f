"""Quadrilaterals between grid lines."""

from __future__ import annotations

import numpy as np

from cases import Case
from cases.errors import MeshError
from cases.geometry import SAME_LINE
from cases.mesh_arrays import Floats, MeshArrays
from cases.spacing import grid_lines

# Part of h by which the mesh of a rectangle may miss its sides: both of two lines may have been drawn to one between.
SIDES_MISSED = 2 * SAME_LINE


def rectilinear(x_lines: Floats, y_lines: Floats) -> MeshArrays:
    """All cells between the lines, row by row from the bottom, as elements of body 0."""
    x, y = np.meshgrid(x_lines, y_lines)
    corner = np.arange(x.size).reshape(x.shape)
    below, above = corner[:-1], corner[1:]
    cells = np.stack([below[:, :-1], below[:, 1:], above[:, 1:], above[:, :-1]], axis=-1).reshape(-1, 4)
    return MeshArrays(np.column_stack([x.ravel(), y.ravel()]), cells, np.zeros(len(cells), dtype=np.int64))


def rectangles(case: Case, bodies: list[int]) -> MeshArrays:
    """The bodies of these indices, all with axis-parallel edges, as cells of the grid; those that touch share nodes.

    Raises MeshError when a body's edges are not grid lines.
    """
    grid = rectilinear(*grid_lines(case))
    body = case.inside(grid.centres())
    mesh = MeshArrays(grid.points, grid.cells, body).keep(np.isin(body, bodies))
    for index in bodies:
        _check_sides(case, mesh, index)
    return mesh


def _check_sides(case: Case, mesh: MeshArrays, index: int) -> None:
    name = list(case.bodies)[index]
    corners = mesh.points[mesh.cells[mesh.body == index]].reshape(-1, 2)
    sides = np.concatenate(case.bodies[name].bounds())
    reached = np.concatenate([corners.min(axis=0), corners.max(axis=0)]) if len(corners) else np.inf
    if np.abs(reached - sides).max() > SIDES_MISSED * case.mesh.h:
        raise MeshError(f'bodies.{name}: its sides fit no grid lines; set mesh.element = "triangle"')
