"""What the material points of a case and their grid will be, before anything is computed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.spacing import count_cells
from mpm.explicit.step_bound import stable_step
from mpm.grid import Grid
from mpm.placement import cells_in_bodies, place_points
from mpm.quasi_static.active_grid import ActiveGrid
from mpm.quasi_static.constraints import node_motions
from numerics import description
from numerics.description import MOST_SET_UP, Description


class _Counts(NamedTuple):
    """Cells with points (n_bodies,) of each body, free unknowns of displacement and phase field."""

    cells: NDArray
    displacement: float
    phase_field: float


def describe(case: Case) -> Description:
    """Sizes, basis and step of the material points.

    A quasi-static grid that is not very large is set up, with one point in each cell; else sizes follow from areas.

    Raises GridError where a grid that is set up cannot be.
    """
    if case.dynamics is not None:
        counts = _moving(case)
    else:
        counts = _set_up(case) if count_cells(case) <= MOST_SET_UP else _estimated(case)
    cells, (breaking, rigid) = float(counts.cells.sum()), description.shares(case, counts.cells)
    return Description(
        basis=f"B-splines of order {case.mpm.order}, points placed {case.mpm.placement}",
        fine=description.where_fine(case, cells),
        cells=round(cells),
        points=_points(case, cells),
        unknowns_displacement=round(counts.displacement),
        unknowns_phase_field=round(counts.phase_field),
        order=case.mpm.order,
        iterative=case.mpm.linear_solver == "gmres",
        breaking=breaking,
        rigid=rigid,
        stable_step=None if case.dynamics is None else stable_step(case),
    )


def _points(case: Case, cells: float) -> int:
    if case.mpm.placement == "mesh":
        return len(place_points(case).volume)
    return round(cells * case.mpm.points_per_cell**2)


def _set_up(case: Case) -> _Counts:
    """The grid, and its cells that a point in their middle lies in, with the rings of cells that are kept around them."""
    middles = case.model_copy(update={"mpm": case.mpm.model_copy(update={"points_per_cell": 1, "placement": "regular"})})
    grid, cloud = Grid(case), place_points(middles)
    places = grid.locate(cloud.positions, grid.sides(cloud.positions))
    active = ActiveGrid(grid, places, description.breakable(case)[cloud.body])
    used, breaks = np.zeros(grid.n_nodes, bool), np.zeros(grid.n_nodes, bool)
    used[active.cells.nodes], breaks[active.cells.nodes[active.near_breaking]] = True, True
    prescribed, master = node_motions(case, grid).bind(2 * grid.n_nodes)
    free = np.repeat(used, 2) & ~prescribed & (master == np.arange(len(master)))
    return _Counts(np.bincount(cloud.body, minlength=len(case.bodies)), int(free.sum()), int(breaks.sum()))


def _estimated(case: Case) -> _Counts:
    """One function of the grid for each cell."""
    cells = description.estimated_cells(case)
    return _Counts(cells, 2.0 * cells.sum(), float(cells[description.breakable(case)].sum()))


def _moving(case: Case) -> _Counts:
    """The bodies' cells, and as many functions as reach over those of a rectangle of the same area and perimeter."""
    order, cells, breaks = case.mpm.order, cells_in_bodies(case), description.breakable(case)
    around = np.array([outline.length for outline in case.outlines()]) / case.mesh.h
    functions = cells + 0.5 * order * around + order**2
    return _Counts(cells, 2.0 * float(functions.sum()), float(functions[breaks].sum()))
