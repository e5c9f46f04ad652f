"""Places on the drawn edges of bodies that tractions load, each with the material point that carries it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from cases import Case
from mpm.grid import Grid
from mpm.placement import PointCloud
from numerics.surface import Edges, check_loaded_length, drawn_edges

#: stretches of edge are integrated by so many Gauss points: exact for splines of order 3
GAUSS_POINTS = 3
#: a place is loaded where a material point lies no further than this from it, in multiples of its extent
NEAR = 2.0
#: points are asked from a place so far within the edge, in multiples of a point's extent across it
INSIDE = 0.25
#: so many points are asked; slits at an angle leave small parts of points beside large ones
CANDIDATES = 8


class LoadedPlaces(NamedTuple):
    """Material points (n,), the offsets (n, 2) of loaded places from them, the forces (n, 2) there, length of edge."""

    points: NDArray
    offset: NDArray
    force: NDArray
    length: float


def loaded_places(case: Case, number: int, cloud: PointCloud, divided: Callable[[Edges], Edges]) -> LoadedPlaces:
    """Of a traction in full, its edges divided into stretches on which each function of a point is one polynomial.

    Raises BuiltError where it acts on nothing, or where points are missing along its edge.
    """
    traction, drawn = case.tractions[number], drawn_edges(case)
    edges = divided(drawn.cut(drawn.on(case, case.boundaries[traction.on])))
    places, length, normal = _gauss_points(edges)
    # asked from a little inside, so that the nearest one is of the body; the points at the place tell how little
    nearest, tree = min(CANDIDATES, len(cloud.volume)), KDTree(cloud.positions)
    extent = np.sum(np.abs(normal) * cloud.size[tree.query(places)[1]], axis=1)
    found = tree.query(places - INSIDE * extent[:, None] * normal, k=nearest)
    distance, candidates = (np.asarray(part).reshape(len(places), nearest) for part in found)
    # points across a slit may be nearer than those whose face is loaded
    away = np.einsum("nci,ni->nc", cloud.positions[candidates] - places[:, None], normal)
    chosen = np.arange(len(places)), np.argmax(away < 0.0, axis=1)
    points = candidates[chosen]
    near = distance[chosen] <= NEAR * cloud.size[candidates].max(axis=(1, 2))
    check_loaded_length(case, number, float(length[near].sum()))
    force = case.plane.thickness * length[:, None] * traction.on_edges(normal)
    offset = places - cloud.positions[points]
    return LoadedPlaces(points[near], offset[near], force[near], float(length[near].sum()))


def by_cells(grid: Grid, edges: Edges) -> Edges:
    """The edges cut where they cross lines of the grid."""
    pieces = []
    for start, end in edges.lines:
        with np.errstate(divide="ignore", invalid="ignore"):
            crossings = [(axis.breakpoints - start[d]) / (end[d] - start[d]) for d, axis in enumerate(grid.axes)]
        inside = np.concatenate(crossings)
        inside = np.unique(np.concatenate([[0.0, 1.0], inside[(inside > 1e-9) & (inside < 1.0 - 1e-9)]]))
        # lines in x and in y may cross it at one place
        inside = inside[np.diff(inside, prepend=-1.0) > 1e-9]
        corners = start + inside[:, None] * (end - start)
        pieces.append(np.stack([corners[:-1], corners[1:]], axis=1))
    return Edges.around(np.concatenate([np.zeros((0, 2, 2)), *pieces]))


def into_pieces(length: float, edges: Edges) -> Edges:
    """The edges cut into equal pieces no longer than a length."""
    pieces = []
    for (start, end), whole in zip(edges.lines, edges.lengths, strict=True):
        share = np.linspace(0.0, 1.0, int(np.ceil(whole / length * (1.0 - 1e-9))) + 1)[:, None]
        corners = start + share * (end - start)
        pieces.append(np.stack([corners[:-1], corners[1:]], axis=1))
    return Edges.around(np.concatenate([np.zeros((0, 2, 2)), *pieces]))


def _gauss_points(edges: Edges) -> tuple[NDArray, NDArray, NDArray]:
    """Places (n, 2) on edges, the length (n,) of edge that each stands for, and the outward normals (n, 2)."""
    abscissae, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    share = 0.5 * (abscissae + 1.0)
    start, end = edges.lines[:, None, 0], edges.lines[:, None, 1]
    places = start + share[:, None] * (end - start)
    lengths = 0.5 * weights * edges.lengths[:, None]
    return places.reshape(-1, 2), lengths.ravel(), np.repeat(edges.normals, GAUSS_POINTS, axis=0)
