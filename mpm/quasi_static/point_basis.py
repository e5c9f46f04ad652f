"""Where the material points stand in the grid, and the basis by which they measure and integrate there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cases import Case
from mpm.grid import Grid, GridCells
from mpm.placement import PointCloud
from mpm.quasi_static.active_grid import ActiveGrid
from mpm.quasi_static.integration import Rectangles, integrate_cells
from mpm.quasi_static.point_state import PointState
from physics.elasticity import MaterialTable

#: below this phase field, material tears: its own deformation means less and less
TORN_PHASE_FIELD = 0.4
#: and no more than this much of it is taken, so that nothing turns inside out
LARGEST_GRADIENT = 0.5


class BasisValues(NamedTuple):
    """Functions of the points' cells where the points integrate, as compiled loops take them.

    value : (n_points, k). slope : (n_points, k, 2) by which strain is measured [1/length].
    curvature : (n_points, k, 3) second derivatives in the material's axes, weighted so that the sum of their squares is
    the quadratic form of gamma; none where no material is of order 4. volume : (n_points,) of the points.
    """

    value: NDArray
    slope: NDArray
    curvature: NDArray
    volume: NDArray


class PointBasis:
    """Basis at the points, made anew for each place of theirs.

    Attributes
    ----------
    own_value : (n_points, k) functions at the points' own places.
    values : functions where the points integrate.
    filled_volume : (n_points,) that each point stands for on the first geometry.
    is_current : the points have not moved since.
    """

    def __init__(self, case: Case, grid: Grid, cloud: PointCloud, materials: MaterialTable) -> None:
        self.grid, self.cloud, self._case = grid, cloud, case
        self._breaking = materials.breakable[cloud.body]
        self._tip_points = grid.points_at_tips(cloud.positions)
        self._sides = grid.sides(cloud.positions)
        fourth_order = bool(materials.fourth_order.any())
        self._curvature_operator = materials.curvature[cloud.body] if fourth_order else np.zeros((0, 3, 3))
        self._active: ActiveGrid | None = None
        self.is_current = False

    @property
    def active(self) -> ActiveGrid:
        """The cells in use and the points in them, from the first step on."""
        assert self._active is not None
        return self._active

    def use_cells(self, places: GridCells) -> None:
        """Take cells for points in those at ``places``, and around them."""
        self._active = ActiveGrid(self.grid, places, self._breaking)

    def find_points(self, state: PointState) -> bool:
        """Find the points in the grid; whether the cells in use are others than before."""
        shift = self._grid_shift(state.displacement)
        positions = state.positions - shift
        places = self.grid.locate(positions, self._sides)
        others = self._active is None or not self._active.holds(places)
        if others:
            self.use_cells(places)
        self.active.sort_points(places)
        self.active.shift = shift
        self._positions, self._places = positions, places
        self.own_value, _ = self.grid.evaluate(positions, places)
        self.values = self._values(state)
        self.is_current = True
        return others

    def newly_filled(self, state: PointState, points: NDArray) -> float:
        """Share of some points (n,) that have moved into cells in which no point was at first."""
        now = state.positions - self._grid_shift(state.displacement)
        first, last = (self.grid.locate(places, self._sides) for places in (self.cloud.positions, now))
        number = [cells.x * self.grid.shape[1] + cells.y for cells in (first, last)]
        return float(np.mean(~np.isin(number[1][points], number[0])))

    def _values(self, state: PointState) -> BasisValues:
        intact = _intact(state.phase_field)
        deformation = _deformation(state.gradient, intact)
        filling, places = self._integration(intact, deformation)
        value, slope = self.grid.evaluate(places, self._places)
        curvature = np.zeros((0, 0, 3))
        if len(self._curvature_operator):
            second = self.grid.second_derivatives(places, self._places)
            curvature = second @ self._material_axes(deformation).transpose(0, 2, 1)
        # torn material (c -> 0) keeps the grid's own slopes and its own volume
        self.filled_volume = volume = self.cloud.volume * filling
        if self._case.mpm.strain == "initial":
            return BasisValues(value, slope @ deformation, curvature, volume)
        return BasisValues(value, slope, curvature, volume * _determinant(deformation))

    def values_beside(self, points: NDArray, offset: NDArray) -> NDArray:
        """Functions (n, k) of the cells of some points (n,) at places that are an offset (n, 2) away."""
        cells = GridCells(*(part[points] for part in self._places))
        return self.grid.evaluate(self._positions[points] + offset, cells)[0]

    def displacement(self, nodal: NDArray) -> NDArray:
        """Displacement (n_points, 2) of the points for one of the nodes (n_nodes, 2)."""
        return np.einsum("pa,pai->pi", self.own_value, nodal[self.active.nodes_of_points()])

    def _grid_shift(self, displacement: NDArray) -> NDArray:
        """Where the grid is put in this step, as a shift (2,): it goes with the material at the slits' tips.

        A slit is part of the grid but must stay in the material. Grids without slits, or held at nodes, stay.
        """
        if not len(self._tip_points) or self._case.mpm.constraints_on == "nodes":
            return np.zeros(2)
        return displacement[self._tip_points].mean(axis=0)

    def _integration(self, intact: NDArray, deformation: NDArray) -> tuple[NDArray, NDArray]:
        """Factors (n_points,) on the points' volumes and places (n_points, 2) where they integrate.

        Torn material (c -> 0) keeps its own.
        """
        positions = self._positions
        if not self._case.mpm.fill_cells or self._case.mpm.placement == "mesh":
            return np.ones(len(positions)), positions
        stretches = deformation[:, [0, 1], [0, 1]]
        lower = positions + stretches * self.cloud.corner
        area = _determinant(deformation) * self.cloud.volume / self._case.plane.thickness
        rectangles = Rectangles(lower, lower + stretches * self.cloud.size, area)
        filling, places = integrate_cells(self.grid, self.active, positions, rectangles, self._sides)
        return 1.0 + intact * (filling - 1.0), positions + intact[:, None] * (places - positions)

    def _material_axes(self, deformation: NDArray) -> NDArray:
        """Matrices (n_points, 3, 3) from second derivatives xx, yy, xy on the grid to those that gamma weighs."""
        if self._case.mpm.strain == "updated":
            return self._curvature_operator
        return self._curvature_operator @ pulled_back(deformation)


def _intact(phase_field: NDArray) -> NDArray:
    """1 for material that still holds together, falling to 0 as it tears (n_points,)."""
    return np.clip(phase_field / TORN_PHASE_FIELD, 0.0, 1.0) ** 2


def _deformation(gradient: NDArray, intact: NDArray) -> NDArray:
    """Deformation gradient (n_points, 2, 2), as far as the material is intact (n_points,)."""
    size = np.linalg.norm(gradient, axis=1)
    share = intact * np.minimum(1.0, LARGEST_GRADIENT / np.maximum(size, LARGEST_GRADIENT))
    return np.eye(2) + (gradient * share[:, None]).reshape(-1, 2, 2)


def _determinant(matrices: NDArray) -> NDArray:
    """Determinants (n,) of matrices (n, 2, 2)."""
    return matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0]


def pulled_back(deformation: NDArray) -> NDArray:
    """Matrices (n, 3, 3) that take second derivatives xx, yy, xy to coordinates before a deformation F (n, 2, 2).

    H -> F^T H F; that F varies in space is left out, as small strains allow.
    """
    (a, b), (c, d) = deformation.transpose(1, 2, 0)
    rows = [[a * a, c * c, 2 * a * c], [b * b, d * d, 2 * b * d], [a * b, c * d, a * d + b * c]]
    return np.array(rows).transpose(2, 0, 1)
