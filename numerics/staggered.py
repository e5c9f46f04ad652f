"""The staggered scheme of thesis Algorithm 1, once for both solvers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
import shapely
from numpy.typing import NDArray

from cases import Case
from cases.material import Fracture
from physics.phase_field import update_history

from .acceleration import acceleration_of
from .costs import Costs
from .fields import Fields


class LoadWork(NamedTuple):
    """What acts on the bodies, as the displacement of a step and its end let it work [energy].

    constant, following : of the forces that act in full, and of those at load factor one, on the step's displacement.
    heat : of the present stress on the eigenstrain at load factor one.
    """

    constant: float
    following: float
    heat: float


class QuasiStaticDiscretisation(Protocol):
    """What a solver offers to the staggered scheme.

    A step works on a trial state; ``commit`` makes it the state, ``undo`` forgets it.
    """

    costs: Costs
    #: (n_points,) history field of the last committed state [stress]
    history_field: NDArray
    #: (n_points,) phase field of the trial state
    phase_field: NDArray
    #: (n_nodes,) its unknowns
    nodal_phase_field: NDArray

    def begin_step(self) -> None:
        """Prepare the basis for the current positions.

        Raises NewtonError where the moved mesh cannot be measured on.
        """

    def solve_phase_field(self, history_field: NDArray) -> NDArray:
        """Phase field (n_points,) for a history field (n_points,)."""

    def set_phase_field(self, nodal: NDArray) -> NDArray:
        """Phase field (n_points,) for given unknowns (n_nodes,)."""

    def solve_displacement(self, load: float, tolerance: float) -> NDArray:
        """Tensile energy density (n_points,) in equilibrium at the load, for the trial phase field."""

    def commit(self, history_field: NDArray) -> None:
        """Make the trial state the state; the MPM moves its points."""

    def undo(self) -> None:
        """Back to the last committed state."""

    def reaction_force(self, towards: float) -> float:
        """Force of the constraints that is conjugate to the load parameter on its way to another load, trial state."""

    def work_of_loads(self) -> LoadWork:
        """Of what acts on the bodies, since the last committed state."""

    def energies(self) -> tuple[float, float]:
        """Elastic and fracture energy of the trial state."""

    def fields(self) -> Fields:
        """Everything to be seen of the trial state."""

    def measures(self) -> dict[str, float]:
        """Scalars that only the solver can tell, such as the constraint error."""

    def checkpoint(self) -> dict[str, NDArray]:
        """Arrays from which `restore` makes the last committed state again."""

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to the state of a checkpoint of the same case."""


#: relative residual of equilibrium allowed while the phase field still changes by one
EQUILIBRIUM_SHARE = 1e-2
#: the same while a crack runs by momentum: one correction of the displacement, seldom two
EQUILIBRIUM_SHARE_OF_RUNNING = 0.3
#: ratio of successive changes near a limit load
SLOW_RATIO = 0.99
#: changes of the phase field below this are round-off
NOISE = 1e-11
#: advance of the crack in one increment, in multiples of l0, behind which an equilibrium is tried
TRUSTED_ADVANCE = 1.0
#: sweeps by which it is tried, and share of the tolerance below which their changes say nothing
SWEEPS, SWEEPS_NOISE = 3, 1e-4


class NewtonError(RuntimeError):
    """Equilibrium was not reached."""


@dataclass(frozen=True)
class StepOutcome:
    """How a staggered step ended.

    ``verdict`` is "converged", "interrupted" (``give_up`` said so) or "stalled" (too many iterations).
    """

    verdict: str
    history_field: NDArray
    iterations: int
    reason: str = ""


def staggered_step(
    discretisation: QuasiStaticDiscretisation,
    case: Case,
    load: float,
    give_up: Callable[[int], str] = lambda iteration: "",
) -> StepOutcome:
    """Solve one increment.

    ``give_up(iteration)`` is asked after every iteration; a non-empty reason ends the step as "interrupted".
    """
    discretisation.begin_step()
    if case.staggered.scheme == "passes":
        return _passes(discretisation, case, load, give_up)
    before = discretisation.energies()[1]
    # points that have moved see last step's nodes elsewhere: map the phase field anew
    discretisation.solve_phase_field(discretisation.history_field)
    return settle(discretisation, case, load, give_up, before)


def settle(
    discretisation: QuasiStaticDiscretisation,
    case: Case,
    load: float,
    give_up: Callable[[int], str],
    energy_before: float,
    iterations: int = 0,
) -> StepOutcome:
    """Displacement and phase field in turn, from the trial one on, until it rests, at a minimum where a crack has run.

    energy_before : fracture energy before the increment. iterations : of the increment so far.
    """
    while True:
        outcome = _until_converged(discretisation, case, load, give_up)
        iterations += outcome.iterations
        if outcome.verdict != "converged" or not has_run(discretisation, case, energy_before):
            return replace(outcome, iterations=iterations)
        history_field, changes = outcome.history_field, []
        for _ in range(SWEEPS):
            before = discretisation.phase_field.copy()
            tensile_energy = discretisation.solve_displacement(load, case.staggered.residual_tolerance)
            history_field = updated_history(case, discretisation.history_field, tensile_energy)
            changes.append(float(np.abs(discretisation.solve_phase_field(history_field) - before).max()))
        iterations += SWEEPS
        if not lead_away(discretisation, case, changes):
            return StepOutcome("converged", history_field, iterations)
        if iterations >= case.staggered.largest_iterations:
            return StepOutcome("stalled", history_field, iterations, f"{iterations} staggered iterations")


def has_run(discretisation: QuasiStaticDiscretisation, case: Case, energy_before: float) -> bool:
    """Whether the crack has advanced so far in an increment that what it came to may be no minimum."""
    return discretisation.energies()[1] > energy_before + TRUSTED_ADVANCE * energy_of_advance(case)


def lead_away(discretisation: QuasiStaticDiscretisation, case: Case, changes: Sequence[float]) -> bool:
    """Whether sweeps by these changes of the phase field lead away from an equilibrium, which is counted.

    Residuals vanish at a saddle point too, between two places in which the tip would rest: one sweep after the other
    leaves it by a larger change.
    """
    away = changes[-1] > max(changes[-2], SWEEPS_NOISE * case.staggered.tolerance)
    discretisation.costs.count["unstable_equilibria"] += int(away)
    return away


def energy_of_advance(case: Case) -> float:
    """Fracture energy of a crack that advances by l0, where it is least [energy]; inf where nothing breaks."""
    return case.plane.thickness * min((f.toughness * f.length_scale for f in _fractures(case)), default=np.inf)


def energy_across(case: Case) -> float:
    """Fracture energy of a crack straight through the narrowest piece, where it is least [energy]; else inf."""
    pieces = shapely.get_parts(shapely.union_all(case.outlines()))
    sides = [np.diff(piece.minimum_rotated_rectangle.exterior.coords, axis=0)[:2] for piece in pieces]
    toughness = min((f.toughness for f in _fractures(case)), default=np.inf)
    return case.plane.thickness * toughness * float(np.linalg.norm(sides, axis=2).min())


def _fractures(case: Case) -> list[Fracture]:
    """Of the bodies that can break."""
    materials = [case.materials[body.material].fracture for body in case.bodies.values()]
    return [fracture for fracture in materials if fracture is not None]


def _passes(discretisation: QuasiStaticDiscretisation, case: Case, load: float, give_up) -> StepOutcome:
    """The thesis's N_staggs passes: phase field from the history so far, then displacement."""
    committed = history_field = discretisation.history_field
    for _ in range(case.staggered.passes):
        discretisation.costs.begin_iteration()
        discretisation.solve_phase_field(history_field)
        tensile_energy = discretisation.solve_displacement(load, case.staggered.residual_tolerance)
        history_field = updated_history(case, committed, tensile_energy)
    return StepOutcome("converged", history_field, case.staggered.passes)


def _until_converged(discretisation: QuasiStaticDiscretisation, case: Case, load: float, give_up) -> StepOutcome:
    """Displacement and phase field in turn, from the trial one on, until it rests."""
    settings, phase_field = case.staggered, discretisation.phase_field
    committed = discretisation.history_field
    history_field, change, before = committed, np.inf, np.inf
    acceleration = acceleration_of(settings, discretisation.costs)
    for iteration in range(1, settings.largest_iterations + 1):
        discretisation.costs.begin_iteration()
        # equilibrium only as exact as the phase field has come to rest
        share = EQUILIBRIUM_SHARE_OF_RUNNING if acceleration.crack_runs else EQUILIBRIUM_SHARE
        tolerance = max(settings.residual_tolerance, share * min(change, 1.0))
        tensile_energy = discretisation.solve_displacement(load, tolerance)
        history_field = updated_history(case, committed, tensile_energy)
        start = discretisation.nodal_phase_field
        previous, phase_field = phase_field, discretisation.solve_phase_field(history_field)
        before, change = change, float(np.abs(phase_field - previous).max())
        image = discretisation.nodal_phase_field
        ahead = acceleration.next(start, image)
        # it may leave the range that the equation itself would keep to
        ahead = np.clip(ahead, np.minimum(image, 0.0), np.maximum(image, 1.0))
        if remaining_distance(change, before) <= settings.tolerance and tolerance <= 10.0 * settings.residual_tolerance:
            # an accelerated step is itself an estimate of the distance
            accelerated = float(np.abs(discretisation.set_phase_field(ahead) - previous).max())
            phase_field = discretisation.set_phase_field(image)
            if accelerated <= settings.tolerance:
                return StepOutcome("converged", history_field, iteration)
        reason = give_up(iteration)
        if reason:
            return StepOutcome("interrupted", history_field, iteration, reason)
        phase_field = discretisation.set_phase_field(ahead)
    return StepOutcome("stalled", history_field, settings.largest_iterations, f"{iteration} staggered iterations")


def remaining_distance(change: float, before: float) -> float:
    """Distance to the limit of a sequence whose changes fall in proportion, but not below its last change.

    Near a limit load the changes are small long before the phase field rests. A first change says nothing of the
    next ones: slow ones are assumed.
    """
    if change < NOISE:
        return change
    ratio = change / before if 0.0 < before < np.inf else SLOW_RATIO
    return change * max(1.0, ratio / (1.0 - ratio)) if ratio < 1.0 else np.inf


def updated_history(case: Case, committed: NDArray, tensile_energy: NDArray) -> NDArray:
    """History field (n_points,): the largest tensile energy so far, or that of now where cracks may heal."""
    return update_history(committed, tensile_energy) if case.staggered.irreversible else tensile_energy
