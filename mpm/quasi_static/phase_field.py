"""The phase field on the grid of quasi-static material points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cases import Case
from mpm.grid import Grid, GridCells, GridError
from mpm.quasi_static import phase_field_kernels as kernels
from mpm.quasi_static.active_grid import ActiveGrid
from mpm.quasi_static.constraints import nodes_on
from mpm.quasi_static.point_basis import BasisValues
from numerics.built import check_line_is_followed, holds_a_line_within
from numerics.costs import Costs
from numerics.linear_solvers import lift_empty_diagonal
from numerics.phase_field_equation import PhaseFieldEquation, PhaseFieldTerms, ScalarAtPoints
from numerics.sparse_pattern import LocalSystems, SymmetricPattern
from physics.elasticity import MaterialTable
from physics.phase_field import PhaseFieldCoefficients

#: unknowns whose diagonal is below this share of the usual one matter to nobody, whatever their values
BARELY_SEEN = 1e-6


def _check_smooth(case: Case, grid: Grid, number: int) -> None:
    """Raise GridError where splines that do not take the values of their nodes would hold the phase field."""
    if case.mpm.order > 1 and holds_a_line_within(case, number):
        fourth = any(material.fracture and material.fracture.order == 4 for material in case.materials.values())
        remedy = 'draw a notch of kind "history"' + ("" if fourth else ", or set mpm.order = 1")
        text = f"constraints[{number}].on = '{case.constraints[number].on}': lies within bodies, where splines of order"
        raise GridError(f"{case.source}: {text} {case.mpm.order} do not take the values of nodes; {remedy}")
    grid.check_edges_interpolate(f"constraints[{number}].direction = 'phase'", "mpm.order = 1")


def _check_held(case: Case, grid: Grid, number: int, nodes: NDArray) -> None:
    """Raise GridError or BuiltError where a constraint on the phase field holds no node, or single ones of a line."""
    remedy, on = 'lay it along lines of the grid, or draw a notch of kind "history"', case.constraints[number].on
    if not len(nodes):
        text = f"constraints[{number}].on = '{on}': no node of the grid lies on it, so it would hold nothing"
        raise GridError(f"{case.source}: {text}; {remedy}")
    x, y = (cells.ravel() for cells in np.indices(grid.shape))
    cells = grid.cell_nodes(GridCells(x, y, np.zeros(len(x), int)))
    check_line_is_followed(case, number, grid.nodes, cells, remedy)


class GridPhaseField:
    """Phase field of the points of bodies that can break, on the grid's nodes around them.

    It ends where such a body ends, without flux, whatever the body is bonded to; elsewhere it is 1.
    """

    def __init__(self, case: Case, grid: Grid, materials: MaterialTable, body: NDArray, costs: Costs) -> None:
        self._costs, self._breaking = costs, materials.breakable[body]
        self._coefficients = PhaseFieldCoefficients(materials, body)
        self._is_bounded = bool(materials.is_linear.any())
        self._fourth_order = bool(materials.fourth_order.any())
        if self._fourth_order and (grid.slits or grid.inclined):
            raise GridError(
                f"{case.source}: notches: the grid is not smooth on the line of a slit, as fracture.order = 4 needs;"
                ' use kind = "cells" or "history" instead'
            )
        self._held, self._first = np.zeros(grid.n_nodes, bool), np.ones(grid.n_nodes)
        for number, constraint in enumerate(case.constraints):
            if constraint.direction == "phase":
                _check_smooth(case, grid, number)
                nodes, _ = nodes_on(case, grid.nodes)(case.boundaries[constraint.on])
                _check_held(case, grid, number, nodes)
                # the slope is held at zero with the value, Eq. 5.11
                nodes = grid.beside(nodes) if self._fourth_order else nodes
                self._held[nodes], self._first[nodes] = True, constraint.value

    def first(self) -> NDArray:
        """Values (n_nodes,) of whole material with what is prescribed."""
        return self._first.copy()

    def use_cells(self, active: ActiveGrid) -> None:
        """Number the unknowns of the nodes in use."""
        free = np.zeros(len(self._held), bool)
        free[active.cells.nodes[active.near_breaking]] = True
        # cells of the pattern that hold no points leave empty rows
        self.equation = PhaseFieldEquation(
            active.cells.nodes, free & ~self._held, self._costs, self._is_bounded, keep_barely_seen
        )

    def find_points(self, active: ActiveGrid, basis: BasisValues) -> None:
        """Take the points of each cell that can break."""
        self._cells, self._basis = active.cells.only(self._breaking), basis

    def assemble(self, history_field: NDArray, nodal: NDArray) -> None:
        """Fill the equation's systems for a history field (n_points,) at values (n_nodes,), Eq. 4.16."""
        self._fill(history_field, nodal, self.equation.systems)

    def assemble_residual(self, history_field: NDArray, nodal: NDArray) -> None:
        """The same without the matrices."""
        self._fill(history_field, nodal, self.equation.systems.without_matrices)

    def _fill(self, history_field: NDArray, nodal: NDArray, systems: LocalSystems) -> None:
        coefficients = self._coefficients
        terms = PhaseFieldTerms(
            coefficients.reaction(history_field), coefficients.resistance, coefficients.diffusion, coefficients.bending
        )
        kernels.phase_field_systems(self._cells, self._basis, terms, nodal, *systems)
        if self._fourth_order:
            kernels.add_curvature_terms(self._cells, self._basis, terms, nodal, *systems)

    def map(self, nodal: NDArray, at_points: ScalarAtPoints) -> None:
        """Fill in the values at the points."""
        kernels.scalar_at_points(self._cells, self._basis, nodal, at_points.value, at_points.slope_squared)
        if self._fourth_order:
            kernels.curvature_at_points(self._cells, self._basis, nodal, at_points.curvature_squared)
        for values, whole in zip(at_points, (1.0, 0.0, 0.0), strict=True):
            values[~self._breaking] = whole

    def energy(self, at_points: ScalarAtPoints, volume: NDArray) -> float:
        """Fracture energy [energy] (Eq. 2.49)."""
        return float(self._coefficients.energy_density(*at_points) @ volume)


def keep_barely_seen(pattern: SymmetricPattern, values: NDArray) -> NDArray:
    """`lift_empty_diagonal` that gives unknowns with next to no stiffness a usual diagonal: a correction leaves them.

    Few points at the far edge of their cells determine the values of the functions beyond it badly: these would run away.
    """
    diagonal = values[pattern.diagonal]
    usual = np.median(diagonal[diagonal > 0.0])
    lift_empty_diagonal(pattern, values)[pattern.diagonal[diagonal < BARELY_SEEN * usual]] = usual
    return values
