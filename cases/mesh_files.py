"""Meshes that the user brings: Gmsh, Abaqus, VTU and whatever else meshio reads."""

from __future__ import annotations

import math
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
    cross,
    edge_table,
    signed_areas,
)
from cases.mesh_groups import CORNERS, only_group, read_mesh
from cases.notches import SlitNotch

# Part of the extent by which a plane mesh may leave its plane: rounding of single precision.
FLATNESS = 1e-6
# Part of the shortest edge within which two places of a mesh are one.
SAME_PLACE = 1e-3


def read_mesh_file(path: Path, body: int = 0, group: str | None = None) -> MeshArrays:
    """The triangles or quadrilaterals of a mesh file or a group of it, given to the body of that index.

    The z coordinate is dropped, points of no element are removed, and elements numbered clockwise are turned round.
    Those of second order with straight edges are taken by their corners, see `second_order_sentence`. Lines and vertices
    in the file are passed over. Edges that stand twice are cracks, see `mesh_slits`.

    Raises MeshError when the file cannot be read, holds no such elements, mixes them, leaves the x-y plane, has
    curved, collapsed or overlapping elements, a node within another element's edge, or parts that only doubled nodes
    hold together.
    """
    mesh = _checked(path, group, path.stat().st_mtime_ns)
    return replace(mesh, body=np.full(len(mesh.cells), body))


def mesh_outline(path: Path, group: str | None = None) -> BaseGeometry:
    """Union of the elements of a mesh file or a group of it, in the file's own numbers; raises as `read_mesh_file`."""
    return _outline(path, group, path.stat().st_mtime_ns)


def second_order_sentence(path: Path, group: str | None = None) -> str:
    """How many elements of a mesh file or a group of it are taken by their corners alone; empty where all are linear."""
    cells = only_group(path, read_mesh(path), group).cells
    count = sum(len(block.data) for block in cells if block.data.shape[1] > CORNERS.get(block.type, math.inf))
    return f"{path.name}: {count} elements of second order are taken by their corners." if count else ""


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
    elements = shapely.polygons(mesh.points[mesh.cells])
    outline, areas = shapely.union_all(elements), shapely.area(elements)
    if areas.sum() - outline.area > 0.5 * areas.min():
        raise MeshError(f"{path}: elements lie upon each other; remove what is drawn twice, or regenerate the mesh")
    return outline


@lru_cache(maxsize=16)
def _slits(path: Path, groups: tuple[str | None, ...], modified: int) -> tuple[SlitNotch, ...]:
    content = read_mesh(path)
    parts = [_plane_cells(path, only_group(path, content, group)) for group in groups]
    if len({part.shape[1] for part in parts}) > 1:
        parts = [part if part.shape[1] == 3 else part[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3) for part in parts]
    cells = np.concatenate(parts)
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
    ways = np.stack([mesh.cells, np.roll(mesh.cells, -1, axis=1)], axis=-1).reshape(-1, 2)
    there, count = np.unique(ways, axis=0, return_counts=True)
    if count.max() > 1:
        x, y = mesh.points[there[count.argmax()]].mean(axis=0)
        raise MeshError(
            f"{path}: two elements lie on the same side of an edge near ({x:.6g}, {y:.6g}); remove elements that overlap,"
            " or regenerate the mesh"
        )
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
    """Corner indices of the triangles or of the quadrilaterals with straight edges, whichever the file holds."""
    blocks = [block for block in content.cells if len(block.data) and CORNERS.get(block.type, 3) > 2]
    if other := sorted({block.type for block in blocks} - set(CORNERS)):
        raise MeshError(
            f"{path}: elements of type {', '.join(other)} are not supported; "
            "export plane triangles or quadrilaterals alone"
        )
    if not blocks:
        raise MeshError(
            f"{path}: the file holds no triangles or quadrilaterals; save its surface elements too"
        )
    if len({CORNERS[block.type] for block in blocks}) > 1:
        raise MeshError(
            f"{path}: triangles and quadrilaterals are mixed; recombine the mesh fully or not at all"
        )
    points = np.asarray(content.points, dtype=np.float64)[:, :2]
    for block in blocks:
        _check_straight(path, points, np.asarray(block.data), CORNERS[block.type])
    return np.concatenate([np.asarray(b.data, dtype=np.int64)[:, : CORNERS[b.type]] for b in blocks])


def _check_straight(path: Path, points: Floats, cells: Integers, corners: int) -> None:
    """The nodes in the middle of edges lie on them, so that nothing of the outline is lost without them."""
    if cells.shape[1] == corners:
        return
    start, end = points[cells[:, :corners]], points[np.roll(cells[:, :corners], -1, axis=1)]
    away = np.abs(cross(points[cells[:, corners : 2 * corners]] - start, end - start)) / ((end - start) ** 2).sum(axis=2)
    curved = np.flatnonzero((away > SAME_PLACE).any(axis=1))
    if len(curved):
        x, y = start[curved[0]].mean(axis=0)
        raise MeshError(
            f"{path}: {len(curved)} second-order elements have curved edges, the first near ({x:.6g}, {y:.6g}); mesh"
            " curves with more elements of first order"
        )


def _plane_points(path: Path, points: Floats) -> Floats:
    extent = np.ptp(points, axis=0)
    if points.shape[1] > 2 and extent[2] > FLATNESS * extent[:2].max():
        raise MeshError(f"{path}: the mesh leaves the x-y plane; export it with one z for all nodes")
    return np.ascontiguousarray(points[:, :2])


def _counter_clockwise(path: Path, points: Floats, cells: Integers) -> Integers:
    """The cells with positive Jacobians, each turned round that is numbered clockwise."""
    cells = np.where(signed_areas(points, cells)[:, None] < 0.0, cells[:, ::-1], cells)
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
