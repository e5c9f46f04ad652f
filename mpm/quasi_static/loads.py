"""What acts on material points from outside: tractions on the drawn edges, forces on the volume."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from cases import Case
from mpm.grid import Grid
from mpm.loaded_places import by_cells, loaded_places
from mpm.placement import PointCloud
from mpm.quasi_static.equilibrium import GridEquilibrium
from mpm.quasi_static.point_basis import PointBasis
from mpm.quasi_static.point_state import PointState
from numerics.sparse_pattern import gather_vector
from numerics.surface import loaded_lengths
from physics.acting import Acts, body_forces
from physics.exact import SOLUTIONS


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
        places = [loaded_places(case, number, cloud, partial(by_cells, grid)) for number in range(len(case.tractions))]
        #: of edge that each traction acts on [length]
        self.lengths = [p.length for p in places]
        #: material points (n,) that carry loaded places
        self.points = np.concatenate([np.zeros(0, int), *(p.points for p in places)])
        self._offset, force = (np.concatenate([np.zeros((0, 2)), *parts]) for parts in (
            [p.offset for p in places], [p.force for p in places]))  # fmt: skip
        follows = [np.full((len(p.points), 1), t.follows_load) for p, t in zip(places, case.tractions, strict=True)]
        share = np.concatenate([np.zeros((0, 1)), *follows])
        self._forces = Acts((1.0 - share) * force, share * force)

    def measures(self, basis: PointBasis, state: PointState) -> dict[str, float]:
        """Length of edge that each traction acts on [length], and the share of its points that have left their cells."""
        crossed = {"crossed_edge": basis.newly_filled(state, self.points)} if len(self.points) else {}
        return loaded_lengths(self.lengths) | crossed

    def on_nodes(self, basis: PointBasis, equilibrium: GridEquilibrium, positions: NDArray) -> Acts:
        """Forces (2 n_nodes,) on the grid, from points at positions (n_points, 2)."""
        if self._acts_nowhere:
            return Acts(np.zeros(len(equilibrium.equations)), np.zeros(len(equilibrium.equations)))
        constant, following = self._densities
        if self._exact is not None:
            following = following + self._exact(self._case, positions, 1.0)
        cell = basis.active.cells.cell
        of_edges = basis.values_beside(self.points, self._offset)

        def gathered(on_edges: NDArray, densities: NDArray) -> NDArray:
            size, unknowns = len(equilibrium.equations), equilibrium.unknowns
            forces = densities * basis.filled_volume[:, None]
            total = gather_vector(unknowns[cell], basis.values.value[:, :, None] * forces[:, None, :], size)
            local = of_edges[:, :, None] * on_edges[:, None, :]
            return total + gather_vector(unknowns[cell[self.points]], local, size)

        return Acts(gathered(self._forces.constant, constant), gathered(self._forces.following, following))
