"""An increment that prescribes the fracture energy instead of the load, so that a path that snaps back is followed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cases import Case

from .linear_solvers import LinearSolverError
from .staggered import (
    EQUILIBRIUM_SHARE,
    NewtonError,
    QuasiStaticDiscretisation,
    StepOutcome,
    remaining_distance,
    updated_history,
)

#: the fracture energy meets its target within this share of the increment of it
ENERGY_SHARE = 1e-5
#: largest change of the load in one staggered iteration, as a factor
LARGEST_FACTOR = 1.5
#: evaluations of the phase field to find the load's factor
EVALUATIONS = 8
#: shares of the largest advance that are tried in turn
ADVANCES = (1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125)


def longest_dissipation_step(
    discretisation: QuasiStaticDiscretisation, case: Case, load: float, advance: float, refused: Callable[[float], str]
) -> tuple[StepOutcome, float]:
    """As `dissipation_step`, by the largest share of an advance that finds an equilibrium; undone where none does.

    refused : what speaks against the state at a load.
    """
    costs = discretisation.costs
    for share in ADVANCES:
        costs.count["dissipation_increments"] += 1
        try:
            outcome, reached = dissipation_step(discretisation, case, load, share * advance)
        except (NewtonError, LinearSolverError) as error:
            outcome, reached = StepOutcome("stalled", discretisation.history_field, 0, str(error)), load
        outcome = replace(outcome, reason=refused(reached) or outcome.reason)
        if not outcome.reason:
            break
        discretisation.undo()
        costs.count["undone_increments"] += 1
    return outcome, reached


def dissipation_step(
    discretisation: QuasiStaticDiscretisation, case: Case, load: float, advance: float
) -> tuple[StepOutcome, float]:
    """Solve for the load at which the fracture energy has grown by ``advance``; the outcome and that load.

    All that is prescribed grows with the load and the splits are homogeneous: at a given phase field the tensile energy
    goes with the load squared. Each staggered iteration solves equilibrium at the load so far, and then scales it until
    the phase field that it drives has paid the advance. Unlike an increment of the load it has a solution where the
    crack would run by itself.
    """
    settings, committed = case.staggered, discretisation.history_field
    discretisation.begin_step()
    phase_field = discretisation.solve_phase_field(committed)
    target = discretisation.energies()[1] + advance
    history_field, change, before = committed, np.inf, np.inf
    for iteration in range(1, settings.largest_iterations + 1):
        discretisation.costs.begin_iteration()
        tolerance = max(settings.residual_tolerance, EQUILIBRIUM_SHARE * min(change, 1.0))
        tensile_energy = discretisation.solve_displacement(load, tolerance)
        factor, history_field = _factor(discretisation, case, committed, tensile_energy, target, advance)
        load *= factor
        previous, phase_field = phase_field, discretisation.phase_field.copy()
        before, change = change, float(np.abs(phase_field - previous).max())
        at_rest = remaining_distance(change, before) <= settings.tolerance and abs(factor - 1.0) <= settings.tolerance
        if at_rest and tolerance <= 10.0 * settings.residual_tolerance:
            discretisation.solve_displacement(load, tolerance)
            return StepOutcome("converged", history_field, iteration), load
    reason = f"{settings.largest_iterations} staggered iterations under dissipation control"
    return StepOutcome("stalled", history_field, settings.largest_iterations, reason), load


def _factor(
    discretisation: QuasiStaticDiscretisation,
    case: Case,
    committed: NDArray,
    tensile_energy: NDArray,
    target: float,
    advance: float,
) -> tuple[float, NDArray]:
    """Factor on the load whose phase field has the fracture energy ``target``, and its history field (n_points,).

    The energy grows with the factor: regula falsi (Illinois) between bounds; leaves the phase field solved for it.
    """
    bounds, misses = [1.0 / LARGEST_FACTOR, LARGEST_FACTOR], [-advance, advance]
    factor, last_side = 1.0, -1
    for _ in range(EVALUATIONS):
        history_field = updated_history(case, committed, factor**2 * tensile_energy)
        discretisation.solve_phase_field(history_field)
        miss = discretisation.energies()[1] - target
        if abs(miss) <= ENERGY_SHARE * advance:
            break
        side = int(miss > 0.0)
        bounds[side], misses[side] = factor, miss
        if side == last_side:
            misses[1 - side] *= 0.5
        last_side = side
        factor = bounds[0] - misses[0] * (bounds[1] - bounds[0]) / (misses[1] - misses[0])
    return factor, history_field
