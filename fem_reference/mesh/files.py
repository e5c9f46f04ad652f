"""Meshes that the user brings: Gmsh, Abaqus, VTU and whatever else meshio reads."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import meshio
import numpy as np

from cases.mesh_groups import only_group
from fem_reference.mesh.arrays import (
    Floats,
    Integers,
    MeshArrays,
    MeshError,
    corner_jacobians,
    edge_table,
    signed_areas,
)

FIRST_ORDER = ("triangle", "quad")
WITHOUT_AREA = ("vertex", "line", "line3")
# Part of the extent by which a plane mesh may leave its plane: rounding of single precision.
FLATNESS = 1e-6


def read_mesh_file(path: Path, body: int, group: str | None = None) -> MeshArrays:
    """The first-order triangles or quadrilaterals of a mesh file or a group of it, given to the body of that index.

    The z coordinate is dropped, points of no element are removed, and a mesh numbered clockwise throughout is
    turned round. Lines and vertices in the file are passed over.

    Raises MeshError when the file cannot be read, holds no such elements, mixes them, leaves the x-y plane,
    or has inverted or collapsed elements.
    """
    content = only_group(path, _read(path), group)
    cells = _plane_cells(path, content)
    points = np.asarray(content.points, dtype=np.float64)
    mesh = MeshArrays(points, cells, np.full(len(cells), body)).without_unused_points()
    points = _plane_points(path, mesh.points)
    cells = _counter_clockwise(path, points, mesh.cells)
    if edge_table(cells).count.max() > 2:
        raise MeshError(
            f"{path}: an edge belongs to more than two elements; remove the elements that overlap"
        )
    return MeshArrays(points, cells, mesh.body)


def _read(path: Path) -> meshio.Mesh:
    """meshio prints its complaints and leaves the program; both become one sentence here."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            return meshio.read(path)
    except (Exception, SystemExit) as problem:
        raise MeshError(
            f"{path}: the mesh cannot be read; export it again as Gmsh .msh, Abaqus .inp or VTU"
        ) from problem


def _plane_cells(path: Path, content: meshio.Mesh) -> Integers:
    """Corner indices of the triangles or of the quadrilaterals, whichever the file holds."""
    present = {block.type for block in content.cells if len(block.data)} - set(WITHOUT_AREA)
    if other := sorted(present - set(FIRST_ORDER)):
        raise MeshError(
            f"{path}: elements of type {', '.join(other)} are not supported; "
            "export plane first-order triangles or quadrilaterals alone"
        )
    if not present:
        raise MeshError(
            f"{path}: the file holds no triangles or quadrilaterals; save its surface elements too"
        )
    if len(present) > 1:
        raise MeshError(
            f"{path}: triangles and quadrilaterals are mixed; recombine the mesh fully or not at all"
        )
    return np.concatenate([np.asarray(b.data, dtype=np.int64) for b in content.cells if b.type in present])


def _plane_points(path: Path, points: Floats) -> Floats:
    extent = np.ptp(points, axis=0)
    if points.shape[1] > 2 and extent[2] > FLATNESS * extent[:2].max():
        raise MeshError(f"{path}: the mesh leaves the x-y plane; export it with one z for all nodes")
    return np.ascontiguousarray(points[:, :2])


def _counter_clockwise(path: Path, points: Floats, cells: Integers) -> Integers:
    """The cells with positive Jacobians; one that is clockwise among others counts as inverted."""
    if (signed_areas(points, cells) < 0.0).all():
        cells = cells[:, ::-1]
    jacobians = corner_jacobians(points, cells)
    scale = np.ptp(points, axis=0).max() ** 2
    bad = np.flatnonzero((jacobians <= 1e-14 * scale).any(axis=1))
    if len(bad):
        x, y = points[cells[bad[0]]].mean(axis=0)
        raise MeshError(
            f"{path}: {len(bad)} elements are inverted or collapsed, the first near ({x:.6g}, {y:.6g}); "
            "repair or regenerate the mesh"
        )
    return cells
