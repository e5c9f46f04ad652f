"""Runs that need more memory than the machine has are refused before anything of them is made."""

from typing import Any

import psutil

from cases import Case, UserError
from cases.discretisation import Mesh
from cases.spacing import count_cells
from numerics.description import describe
from verify.runs.costs import Cost, demand_of, predict

MEGABYTE = 1e6
#: cells of the grid that fit into the memory of any machine
FEW_CELLS = 20_000


class TooLargeError(UserError):
    """A run needs more memory than there is; its text names key, value and remedy."""


def require_memory(case: Case, run: str) -> None:
    """Raise TooLargeError for a run that needs more memory than this machine has, the run's changes merged in."""
    if count_cells(case) > FEW_CELLS:
        predicted_cost(case, run)


def predicted_cost(case: Case, run: str) -> Cost:
    """Predicted cost of a run, its case with the run's changes merged in.

    Raises TooLargeError where this machine has too little memory.
    """
    solver = case.run_spec(run).solver
    described = describe(case, solver)
    cost = predict(demand_of(case, solver, described))
    check_memory(case, described.cells, cost)
    return cost


def check_memory(case: Case, cells: int, cost: Cost) -> None:
    """Raise TooLargeError for a run of so many cells where this machine has less memory than it is predicted to need."""
    there = psutil.virtual_memory().total / MEGABYTE
    if cost.memory_mb <= there:
        return
    key, value = _cause(case)
    needs = f"{cost.memory_mb / 1e3:.3g} GB of memory are needed and this machine has {there / 1e3:.3g} GB"
    raise TooLargeError(
        f"{case.source}: {key} = {value:g} gives about {cells:.2g} cells, for which {needs}; make it larger."
    )


def _cause(case: Case) -> tuple[str, float]:
    """Key and value of the spacing, or of its growth, without which the grid would have the fewest cells."""
    mesh = case.mesh
    usual = max(mesh.growth, Mesh.model_fields["growth"].default)
    without: dict[tuple[str, float], dict[str, Any]] = {
        ("mesh.h", mesh.h): {"h": 2.0 * mesh.h},
        ("mesh.growth", mesh.growth): {"growth": usual},
    }
    for number, box in enumerate(mesh.refine):
        without[f"mesh.refine[{number}].h", box.h] = {"refine": mesh.refine[:number] + mesh.refine[number + 1 :]}

    def cells(change: dict[str, Any]) -> int:
        """Cells with a changed mesh."""
        return count_cells(case.model_copy(update={"mesh": mesh.model_copy(update=change)}))

    return min(without, key=lambda place: cells(without[place]))
