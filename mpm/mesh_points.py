"""Material points on the Gauss points of the mesh files that bodies come from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.mesh_arrays import MeshArrays
from cases.mesh_files import read_mesh_file
from numerics.built import BuiltError

#: corners of the square from 0 to 1, counter-clockwise
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
#: points per direction -> barycentric coordinates of as many equal points of a triangle as are exact for order 1 and 2
TRIANGLE = {1: np.full((1, 3), 1.0 / 3.0), 2: np.full((3, 3), 1.0 / 6.0) + 0.5 * np.eye(3)}


def mesh_points(case: Case) -> tuple[NDArray, ...]:
    """Positions (n, 2), volumes (n,), sizes (n, 2), corners (n, 2) and bodies (n,) of points on Gauss points.

    As in `mpm.placement.PointCloud`. The volumes are the weights. The rectangle of a point is around the part of a
    quadrilateral that its weight stands for, or about a point of a triangle.

    Raises BuiltError for triangles with more than two points per direction.
    """
    parts = [_of_mesh(case, name, number) for number, name in enumerate(case.bodies)]
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))


def _of_mesh(case: Case, name: str, number: int) -> tuple[NDArray, ...]:
    body = case.bodies[name]
    assert body.mesh is not None
    mesh, per_direction = read_mesh_file(body.mesh, number, body.group), case.mpm.points_per_cell
    if mesh.cells.shape[1] == 4:
        positions, area, lower, size = _in_quads(mesh, per_direction)
    elif per_direction in TRIANGLE:
        positions, area, lower, size = _in_triangles(mesh, TRIANGLE[per_direction])
    else:
        raise BuiltError(
            f"{case.source}: mpm.points_per_cell = {per_direction}: the triangles of bodies.{name} hold 1 point or 3;"
            " give 1 or 2"
        )
    return positions, area * case.plane.thickness, size, lower - positions, np.full(len(area), number)


def _in_quads(mesh: MeshArrays, per_direction: int) -> tuple[NDArray, ...]:
    abscissae, weights = np.polynomial.legendre.leggauss(per_direction)
    local, weights = 0.5 * (abscissae + 1.0), 0.5 * weights
    starts = np.cumsum(weights) - weights
    at, start, extent = (np.stack(np.meshgrid(a, a, indexing="ij"), -1).reshape(-1, 2) for a in (local, starts, weights))
    corners = mesh.points[mesh.cells]
    places = _bilinear(corners, at)
    along_x, along_y = corners[:, [1, 2]] - corners[:, [0, 3]], corners[:, [3, 2]] - corners[:, [0, 1]]
    tangents = [
        (1.0 - at[:, 1, None]) * along_x[:, None, 0] + at[:, 1, None] * along_x[:, None, 1],
        (1.0 - at[:, 0, None]) * along_y[:, None, 0] + at[:, 0, None] * along_y[:, None, 1],
    ]
    jacobian = np.linalg.det(np.stack(tangents, axis=-1))
    area = jacobian * extent.prod(axis=1)
    around = np.stack([_bilinear(corners, start + extent * corner) for corner in SQUARE])
    lower, size = around.min(axis=0), np.ptp(around, axis=0)
    return places.reshape(-1, 2), area.ravel(), lower.reshape(-1, 2), size.reshape(-1, 2)


def _bilinear(corners: NDArray, local: NDArray) -> NDArray:
    """Places (n, m, 2) of local coordinates (m, 2) from 0 to 1 in quadrilaterals (n, 4, 2)."""
    x, y = local.T
    shape = np.stack([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y])
    return np.einsum("am,nai->nmi", shape, corners)


def _in_triangles(mesh: MeshArrays, barycentric: NDArray) -> tuple[NDArray, ...]:
    corners, count = mesh.points[mesh.cells], len(barycentric)
    places = np.einsum("ma,nai->nmi", barycentric, corners).reshape(-1, 2)
    sides = corners[:, 1:] - corners[:, :1]
    area = np.repeat(0.5 * np.abs(np.linalg.det(sides)) / count, count)
    size = np.repeat(np.ptp(corners, axis=1) / np.sqrt(count), count, axis=0)
    return places, area, places - 0.5 * size, size
