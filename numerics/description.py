"""What a solver says of itself for a case before anything is computed."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module

import numpy as np
import shapely
from numpy.typing import NDArray

from cases import Case
from cases.solvers import SOLVERS
from cases.spacing import grid_blocks

#: cells of a grid up to which a solver sets it up to describe itself; beyond, its sizes are estimated
MOST_SET_UP = 200_000
#: blocks along each axis of the grid over which cells are summed where they are estimated
BLOCKS = 500


@dataclass(frozen=True)
class Description:
    """Sizes and words of the discretisation that a solver will set up for a case.

    Attributes
    ----------
    basis : of displacement and phase field, in words
    fine : where cells are fine, in words
    cells, points : that hold material; integration or material points
    unknowns_displacement, unknowns_phase_field : free ones; no phase field where nothing can break
    order : polynomial order of the phase field's basis, on which the cost of an iteration depends
    iterative : linear systems are solved by iteration
    breaking, rigid : shares of the cells in bodies that can break and that are rigid
    stable_step : largest time step by the case's rule; None in statics [time]
    """

    basis: str
    fine: str
    cells: int
    points: int
    unknowns_displacement: int
    unknowns_phase_field: int
    order: int
    iterative: bool = False
    breaking: float = 1.0
    rigid: float = 0.0
    stable_step: float | None = None


def describe(case: Case, solver: str) -> Description:
    """What the solver of this name says of itself for a case, the changes of its run merged in."""
    module, _, name = SOLVERS[solver].describe.partition(":")
    return getattr(import_module(module), name)(case)


def remarks(case: Case) -> list[str]:
    """What the reader of a case, its run merged in, should know of the run's solver before it computes, in sentences."""
    module, _, name = SOLVERS[case.run_spec(case.run).solver].remarks.partition(":") if case.run else ("", "", "")
    return list(getattr(import_module(module), name)(case)) if module else []


def breakable(case: Case) -> NDArray[np.bool_]:
    """Mask (n_bodies,) of the bodies that can break."""
    return np.array([case.materials[body.material].fracture is not None for body in case.bodies.values()])


def shares(case: Case, cells: NDArray) -> tuple[float, float]:
    """``breaking`` and ``rigid`` of a `Description`, from the cells (n_bodies,) of each body."""
    rigid = np.array([not body.deforms for body in case.bodies.values()])
    of_all = cells / max(cells.sum(), 1.0)
    return float(of_all[breakable(case)].sum()), float(of_all[rigid].sum())


def fourth_order(case: Case) -> bool:
    """Some body has a phase field of fourth order."""
    return any((f := case.materials[body.material].fracture) and f.order == 4 for body in case.bodies.values())


def estimated_cells(case: Case) -> NDArray[np.float64]:
    """Cells (n_bodies,) of the case's grid in each body, summed over blocks of it: at no cost, however many there are."""
    blocks = grid_blocks(case, BLOCKS)
    return np.array([blocks.cells[shapely.contains_xy(outline, *blocks.centres.T)].sum() for outline in case.outlines()])


def where_fine(case: Case, cells: float) -> str:
    """Where the cells of a grid are fine, and how many there would be with the spacing h throughout."""
    mesh = case.mesh
    if mesh.fine is None:
        return f"h = {mesh.h:g} throughout"
    where = "mesh.fine and mesh.refine" if mesh.refine else "mesh.fine"
    throughout = sum(outline.area for outline in case.outlines()) / mesh.h**2
    return f"{where}; h = {mesh.h:g} throughout would be about {max(1.0, throughout / max(cells, 1.0)):.2g} times as many"
