"""Meshes that the user brings: Gmsh, Abaqus, VTU and whatever else meshio reads."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from cases.errors import MeshError
from cases.mesh_arrays import (
    Floats,
    Integers,
    MeshArrays,
    corner_jacobians,
    edge_table,
    signed_areas,
)
from cases.mesh_groups import only_group, read_mesh
from cases.notches import SlitNotch

FIRST_ORDER = ("triangle", "quad")
WITHOUT_AREA = ("vertex", "line", "line3")
# Part of the extent by which a plane mesh may leave its plane: rounding of single precision.
FLATNESS = 1e-6
# Part of the shortest edge within which two places of a mesh are one.
SAME_PLACE = 1e-3


def read_mesh_file(path: Path, body: int = 0, group: str | None = None) -> MeshArrays:
    """The first-order triangles or quadrilaterals of a mesh file or a group of it, given to the body of that index.

    The z coordinate is dropped, points of no element are removed, and a mesh numbered clockwise throughout is
    turned round. Lines and vertices in the file are passed over. Edges that stand twice are cracks, see `mesh_slits`.

    Raises MeshError when the file cannot be read, holds no such elements, mixes them, leaves the x-y plane, has
    inverted or collapsed elements, a node within another element's edge, or parts that only doubled nodes hold together.
    """
    mesh = _checked(path, group, path.stat().st_mtime_ns)
    return replace(mesh, body=np.full(len(mesh.cells), body))


def mesh_outline(path: Path, group: str | None = None) -> BaseGeometry:
    """Union of the elements of a mesh file or a group of it, in the file's own numbers; raises as `read_mesh_file`."""
    return _outline(path, group, path.stat().st_mtime_ns)


def mesh_slits(path: Path, groups: tuple[str | None, ...] = (None,)) -> tuple[SlitNotch, ...]:
    """Straight cracks in groups of a mesh file and between them, where elements on both sides have nodes of their own.

    Each starts at its end that is nearer to the outline. What nothing else connects is not parted by a crack.
    """
    return _slits(path, groups, path.stat().st_mtime_ns)


def _elements(path: Path, group: str | None) -> MeshArrays:
    content = only_group(path, read_mesh(path), group)
    cells = _plane_cells(path, content)
    points = np.asarray(content.points, dtype=np.float64)
    mesh = MeshArrays(points, cells, np.zeros(len(cells), dtype=np.int64)).without_unused_points()
    if not (finite := np.isfinite(mesh.points).all(axis=1)).all():
        raise MeshError(f"{path}: has {(~finite).sum()} nodes that are no finite numbers; export the mesh again")
    points = _plane_points(path, mesh.points)
    return replace(mesh, points=points, cells=_counter_clockwise(path, points, mesh.cells))


@lru_cache(maxsize=16)
def _checked(path: Path, group: str | None, modified: int) -> MeshArrays:
    mesh = _elements(path, group)
    _check_conforming(path, mesh)
    return mesh


@lru_cache(maxsize=16)
def _outline(path: Path, group: str | None, modified: int) -> BaseGeometry:
    mesh = _checked(path, group, modified)
    return shapely.union_all(shapely.polygons(mesh.points[mesh.cells]))


@lru_cache(maxsize=16)
def _slits(path: Path, groups: tuple[str | None, ...], modified: int) -> tuple[SlitNotch, ...]:
    content = read_mesh(path)
    cells = np.concatenate([_plane_cells(path, only_group(path, content, group)) for group in groups])
    points = np.asarray(content.points, dtype=np.float64)[:, :2]
    mesh = MeshArrays(points, cells, np.zeros(len(cells), dtype=np.int64)).without_unused_points()
    if number_of_parts(mesh.cells) > 1:
        return ()
    ends, hull = _doubled_edges(mesh), shapely.MultiPoint(mesh.points).convex_hull.exterior
    lines = shapely.line_merge(shapely.union_all(shapely.linestrings(ends)))
    corners = [shapely.get_coordinates(line.simplify(SAME_PLACE * line.length)) for line in shapely.get_parts(lines)]
    straight = [sorted(pair, key=lambda end: hull.distance(shapely.Point(end))) for c in corners for pair in pairwise(c)]
    return tuple(
        SlitNotch.model_construct(kind="slit", start=tuple(map(float, a)), end=tuple(map(float, b))) for a, b in straight
    )


def _doubled_edges(mesh: MeshArrays) -> Floats:
    """Ends (n, 2, 2) of the edges on the outline that another one lies upon, each once."""
    edges = edge_table(mesh.cells)
    ends = mesh.points[edges.ends[edges.count == 1]]
    step = SAME_PLACE * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).min()
    keys = np.round(ends / step).astype(np.int64)
    turned = (keys[:, 0] > keys[:, 1])[:, 0] | ((keys[:, 0, 0] == keys[:, 1, 0]) & (keys[:, 0, 1] > keys[:, 1, 1]))
    keys[turned] = keys[turned, ::-1]
    _, first, number = np.unique(keys.reshape(-1, 4), axis=0, return_index=True, return_counts=True)
    return ends[first[number > 1]]


def _check_conforming(path: Path, mesh: MeshArrays) -> None:
    """Elements meet in whole edges, and what doubled nodes part hangs together elsewhere."""
    edges = edge_table(mesh.cells)
    if edges.count.max() > 2:
        raise MeshError(f"{path}: an edge belongs to more than two elements; remove the elements that overlap")
    if (place := hanging_node(mesh)) is not None:
        raise MeshError(
            f"{path}: the node at ({place[0]:.6g}, {place[1]:.6g}) lies within the edge of another element, which does"
            " not hold it (a hanging node); mesh the two sides with common nodes"
        )
    if len(_doubled_edges(mesh)) and (parts := number_of_parts(mesh.cells)) > 1:
        raise MeshError(
            f"{path}: the mesh falls into {parts} parts along nodes that stand twice; merge the duplicate nodes, or"
            " make each part a body with a mesh file of its own"
        )


def hanging_node(mesh: MeshArrays) -> Floats | None:
    """A node (2,) within an edge of an element that does not hold it; None where all elements meet in whole edges."""
    edges = edge_table(mesh.cells)
    outer = edges.ends[edges.count == 1]
    lines, nodes = shapely.linestrings(mesh.points[outer]), np.unique(outer)
    near = SAME_PLACE * shapely.length(lines).min()
    places = shapely.points(mesh.points[nodes])
    node, line = shapely.STRtree(lines).query(places, predicate="dwithin", distance=near)
    from_ends = np.linalg.norm(mesh.points[nodes[node], None] - mesh.points[outer[line]], axis=-1).min(axis=1)
    within = nodes[node[from_ends > near]]
    return mesh.points[within[0]] if len(within) else None


def number_of_parts(cells: Integers) -> int:
    """Parts that no element connects."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    first, other = np.repeat(cells[:, 0], cells.shape[1] - 1), cells[:, 1:].ravel()
    size = int(cells.max()) + 1
    graph = coo_array((np.ones(len(first), dtype=bool), (first, other)), shape=(size, size))
    _, label = connected_components(graph, directed=False)
    return len(np.unique(label[cells[:, 0]]))


def _plane_cells(path: Path, content) -> Integers:  # type: ignore[no-untyped-def]
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
