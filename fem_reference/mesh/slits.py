"""Cracks of no width: the nodes on a slit are doubled so that its two faces come apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from cases.errors import MeshError
from cases.mesh_arrays import (
    EdgeTable,
    Integers,
    MeshArrays,
    cross,
    edge_lengths,
    edge_table,
)
from cases.notches import Segment

# Part of the shortest edge within which a point counts as lying on a slit: meshes read from files carry
# rounding of single precision, and no element is as thin as this.
ON_SLIT = 1e-3


def split_slits(
    mesh: MeshArrays, slits: Mapping[str, Segment], remedy: str = 'set mesh.element = "triangle"'
) -> MeshArrays:
    """`mesh` opened along all the slits, given by their keys in the case file.

    A node on a slit is doubled (or more, where slits cross) when the elements around it fall into groups that
    no edge off the slits connects. So a tip inside the body stays one node and a mouth on the boundary opens.

    Raises MeshError, ending with `remedy`, where a slit cuts an element or ends within an edge, or where one is a single
    edge between its tips.
    """
    if not slits:
        return mesh
    edges = edge_table(mesh.cells)
    opened = np.zeros(len(edges.ends), dtype=bool)
    for key, slit in slits.items():
        on_slit = _edges_on_slit(mesh, edges, slit)
        if on_slit is None:
            raise MeshError(
                f"{key}: the slit from {slit.start} to {slit.end} does not lie along edges of the mesh; {remedy}"
            )
        opened |= on_slit
    parted = _open_edges(mesh, edges, opened)
    doubled = parted.points[len(mesh.points) :]
    for key, slit in slits.items():
        if not len(doubled) or slit.distance(doubled).min() > ON_SLIT * slit.length:
            text = f"{key}: the slit from {slit.start} to {slit.end} has no node between its tips that could open"
            raise MeshError(f"{text}; make mesh.h smaller")
    return parted


def face_pairs(mesh: MeshArrays, slit: Segment) -> Integers:
    """Pairs (n, 2) of nodes that lie on each other on the two faces of a slit, the one to the left of it first."""
    tolerance = ON_SLIT * edge_lengths(mesh.points, mesh.cells).min()
    along, aside = slit.coordinates(mesh.points)
    on_slit = (np.abs(aside) < tolerance) & (along > -tolerance) & (along < slit.length + tolerance)
    _, of_cells = slit.coordinates(mesh.centres())
    side = np.zeros(len(mesh.points))
    np.add.at(side, mesh.cells, np.sign(of_cells)[:, None])
    left, right = np.flatnonzero(on_slit & (side > 0.0)), np.flatnonzero(on_slit & (side < 0.0))
    if not len(left) or not len(right):
        return np.zeros((0, 2), dtype=np.int64)
    distance, nearest = cKDTree(mesh.points[right]).query(mesh.points[left])
    there = distance < tolerance
    return np.column_stack([left[there], right[np.asarray(nearest)[there]]])


def cells_cut_by(mesh: MeshArrays, slit: Segment, tolerance: float) -> np.ndarray:
    """Mask (n_elements,) of the elements that the slit cuts over more than `tolerance` [length]."""
    corners = mesh.points[mesh.cells]
    edges = np.roll(corners, -1, axis=1) - corners
    edges /= np.linalg.norm(edges, axis=-1, keepdims=True)
    # Depth behind each edge's line, linear along the slit: at_start + s * rate, s the length from its start.
    at_start = cross(edges, np.asarray(slit.start) - corners) - tolerance
    rate = cross(edges, slit.direction)
    with np.errstate(divide="ignore", invalid="ignore"):
        zero = -at_start / rate
    parallel = np.abs(rate) < 1e-12
    enter = np.where(parallel, np.where(at_start > 0, -np.inf, np.inf), np.where(rate > 0, zero, -np.inf))
    leave = np.where(~parallel & (rate < 0), zero, np.inf)
    inside = np.minimum(leave.min(axis=1), slit.length) - np.maximum(enter.max(axis=1), 0.0)
    return inside > tolerance


def _edges_on_slit(mesh: MeshArrays, edges: EdgeTable, slit: Segment) -> np.ndarray | None:
    """Mask (n_edges,) of the inner edges that make up the slit; None where the mesh does not follow it."""
    tolerance = ON_SLIT * edge_lengths(mesh.points, mesh.cells).min()
    along, aside = slit.coordinates(mesh.points[edges.ends])
    first, last = along.min(axis=1), along.max(axis=1)
    covered = np.minimum(last, slit.length) - np.maximum(first, 0.0)
    on_slit = (np.abs(aside).max(axis=1) < tolerance) & (covered > tolerance)
    ends_within_edge = on_slit & (covered < last - first - tolerance)
    inner = on_slit & (edges.count > 1)
    if not inner.any() or ends_within_edge.any() or cells_cut_by(mesh, slit, tolerance).any():
        return None
    return inner


def _open_edges(mesh: MeshArrays, edges: EdgeTable, opened: np.ndarray) -> MeshArrays:
    """The mesh with the elements on both sides of the opened edges connected no more."""
    group = _corner_groups(mesh.cells, edges, opened)
    node = mesh.cells.ravel()
    on_slit = np.zeros(len(mesh.points), dtype=bool)
    on_slit[edges.ends[opened]] = True
    corners = np.flatnonzero(on_slit[node])
    copies, copy_of_corner = np.unique(
        np.column_stack([node[corners], group[corners]]), axis=0, return_inverse=True
    )
    # The first group at a node keeps it; each further group gets a point of its own.
    repeated = np.concatenate([[False], copies[1:, 0] == copies[:-1, 0]])
    number = copies[:, 0].copy()
    number[repeated] = len(mesh.points) + np.arange(repeated.sum())
    cells = node.copy()
    cells[corners] = number[copy_of_corner.ravel()]
    points = np.concatenate([mesh.points, mesh.points[copies[repeated, 0]]])
    return replace(mesh, points=points, cells=cells.reshape(mesh.cells.shape))


def _corner_groups(cells: Integers, edges: EdgeTable, opened: np.ndarray) -> Integers:
    """A number for each element corner, equal where closed edges connect corners at one node."""
    corner = np.arange(cells.size).reshape(cells.shape)
    edge = edges.of_corner.ravel()
    # Both ends of each element's edges, as corners, the end of lower node number first.
    ends = np.stack([corner, np.roll(corner, -1, axis=1)], axis=-1).reshape(-1, 2)
    swap = cells.ravel()[ends[:, 0]] > cells.ravel()[ends[:, 1]]
    ends[swap] = ends[swap, ::-1]
    shared = np.flatnonzero((edges.count[edge] == 2) & ~opened[edge])
    pairs = ends[shared[np.argsort(edge[shared], kind="stable")]].reshape(-1, 2, 2)
    one, other = pairs[:, 0].ravel(), pairs[:, 1].ravel()
    graph = coo_array((np.ones(len(one), dtype=bool), (one, other)), shape=(cells.size, cells.size))
    return connected_components(graph, directed=False)[1].astype(np.int64)
