"""What acts on material points from outside: tractions on the drawn edges, forces on the volume."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from cases import Case
from mpm.grid import Grid
from mpm.placement import PointCloud
from mpm.quasi_static.equilibrium import GridEquilibrium
from mpm.quasi_static.point_basis import PointBasis
from numerics.sparse_pattern import gather_vector
from numerics.surface import Edges, check_loaded_length, drawn_edges
from physics.acting import Acts, body_forces
from physics.exact import SOLUTIONS

#: edges are integrated by so many Gauss points in each cell that they cross: exact for splines of order 3
GAUSS_POINTS = 3
#: a place on an edge is loaded where a material point lies no further than this from it, in multiples of its extent
NEAR = 2.0


class PointLoads:
    """Tractions at places on the drawn edges, which go with the nearest material points, and forces on the points.

    Nothing of the traction depends on where the points stand but the cell whose functions it works on: the whole drawn
    length is loaded, straight or curved.
    """

    def __init__(self, case: Case, grid: Grid, cloud: PointCloud) -> None:
        """Raises BuiltError where a traction acts on nothing, or where points are missing along its edge."""
        self._case = case
        self._densities = Acts(*(density[cloud.body] for density in body_forces(case)))
        solution = SOLUTIONS.get(case.exact or "")
        self._exact = solution.body_force if solution else None
        self._acts_nowhere = not case.tractions and self._densities.is_none and self._exact is None
        parts = list(self._tractions(grid, cloud))
        empty = np.zeros((0, 2))
        self._points = np.concatenate([np.zeros(0, int), *(p[0] for p in parts)])
        self._offset = np.concatenate([empty, *(p[1] for p in parts)])
        self._forces = Acts(*(np.concatenate([empty, *(p[2][part] for p in parts)]) for part in (0, 1)))

    def _tractions(self, grid: Grid, cloud: PointCloud) -> Iterator[tuple[NDArray, NDArray, Acts]]:
        """Points (n,), offsets (n, 2) of loaded places from them, and forces (n, 2) of each traction."""
        case = self._case
        if not case.tractions:
            return
        drawn, tree = drawn_edges(case), KDTree(cloud.positions)
        for number, traction in enumerate(case.tractions):
            edges = _by_cells(drawn.cut(drawn.on(case, case.boundaries[traction.on])), grid)
            places, length, normal = _gauss_points(edges)
            # asked from a little inside, so that the nearest one is on the right side of a slit
            distance, points = tree.query(places - 0.25 * case.mesh.h * normal)
            near = distance <= NEAR * cloud.size[np.minimum(points, len(cloud.size) - 1)].max(axis=1)
            check_loaded_length(case, number, float(length[near].sum()))
            force = (case.plane.thickness * length[:, None] * traction.on_edges(normal))[near]
            acts = Acts(np.zeros_like(force), force) if traction.follows_load else Acts(force, np.zeros_like(force))
            yield points[near], places[near] - cloud.positions[points[near]], acts

    def on_nodes(self, basis: PointBasis, equilibrium: GridEquilibrium, positions: NDArray) -> Acts:
        """Forces (2 n_nodes,) on the grid, from points at positions (n_points, 2)."""
        if self._acts_nowhere:
            return Acts(np.zeros(len(equilibrium.equations)), np.zeros(len(equilibrium.equations)))
        constant, following = self._densities
        if self._exact is not None:
            following = following + self._exact(self._case, positions, 1.0)
        cell = basis.active.cells.cell
        of_edges = basis.values_beside(self._points, self._offset)

        def gathered(on_edges: NDArray, densities: NDArray) -> NDArray:
            size, unknowns = len(equilibrium.equations), equilibrium.unknowns
            forces = densities * basis.filled_volume[:, None]
            total = gather_vector(unknowns[cell], basis.values.value[:, :, None] * forces[:, None, :], size)
            local = of_edges[:, :, None] * on_edges[:, None, :]
            return total + gather_vector(unknowns[cell[self._points]], local, size)

        return Acts(gathered(self._forces.constant, constant), gathered(self._forces.following, following))


def _by_cells(edges: Edges, grid: Grid) -> Edges:
    """The edges cut where they cross lines of the grid."""
    pieces = []
    for start, end in edges.lines:
        with np.errstate(divide="ignore", invalid="ignore"):
            crossings = [(axis.breakpoints - start[d]) / (end[d] - start[d]) for d, axis in enumerate(grid.axes)]
        inside = np.concatenate(crossings)
        inside = np.unique(np.concatenate([[0.0, 1.0], inside[(inside > 1e-9) & (inside < 1.0 - 1e-9)]]))
        corners = start + inside[:, None] * (end - start)
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
