"""What a solver says of itself for a case before anything is computed."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Description:
    """Sizes and words of the discretisation that a solver will set up for a case.

    Attributes
    ----------
    basis : of displacement and phase field, in words
    cells, points : that hold material; integration or material points
    unknowns_displacement, unknowns_phase_field : free ones; no phase field where nothing can break
    order : polynomial order of the phase field's basis, on which the cost of an iteration depends
    iterative : linear systems are solved by iteration
    breaking, rigid : shares of the cells in bodies that can break and that stay rigid
    stable_step : largest time step by the case's rule; None in statics [time]
    fine : where cells are fine and how many fewer there are than at h throughout, in words; empty where they are equal
    """

    basis: str
    cells: int
    points: int
    unknowns_displacement: int
    unknowns_phase_field: int
    order: int
    iterative: bool = False
    breaking: float = 1.0
    rigid: float = 0.0
    stable_step: float | None = None
    fine: str = ""
