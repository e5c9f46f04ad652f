"""Displacement and phase field together, by a quasi-Newton method whose factors serve many iterations."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cases import Case

from .displacement_equations import DisplacementEquations
from .linear_solvers import LinearSolverError
from .newton import search
from .phase_field_equation import PhaseFieldEquation
from .staggered import (
    SWEEPS,
    NewtonError,
    QuasiStaticDiscretisation,
    StepOutcome,
    has_run,
    lead_away,
    remaining_distance,
    settle,
    staggered_step,
    updated_history,
)

#: last moves that the inverse Jacobian learns from
MEMORY = 10
#: iterations that the factors serve before they are made anew; each increment begins with its own
LARGEST_USES = 30
#: share of the phase field's tolerance that equilibrium may be off, in relative residual, as it is after such a change
EQUILIBRIUM_SHARE = 0.1
#: iterations after which an increment is left to the staggered scheme
LARGEST_ITERATIONS = 500
#: longest step, as a change of the phase field
LONGEST_STEP = 0.5
#: iterations between two questions whether the crack runs away, which take a tenth of an iteration
ITERATIONS_BETWEEN = 5
#: why iterations end before they have converged
RUNS_AWAY = "the crack runs away"
#: a move teaches nothing whose residual's change along it is less than this share of the first slope
SMALLEST_CURVATURE = 1e-8


class Fracture(Protocol):
    """The phase field of a discretisation."""

    equation: PhaseFieldEquation

    def assemble(self, history_field: NDArray, nodal: NDArray) -> None:
        """Fill the equation's systems for a history field (n_points,) at unknowns (n_nodes,)."""

    def assemble_residual(self, history_field: NDArray, nodal: NDArray) -> None:
        """The same without the matrices, where these take work of their own."""


class CoupledDiscretisation(QuasiStaticDiscretisation, Protocol):
    """What a solver offers beyond the staggered scheme."""

    equilibrium: DisplacementEquations
    #: None where nothing can break
    fracture: Fracture | None

    def go_to(self, load: float) -> NDArray:
        """Prescribe what a load does; unknowns (n,) of the displacement to begin with."""

    def residual(self, unknowns: NDArray) -> tuple[NDArray, float]:
        """Out-of-balance forces (n,) for the trial phase field and the scale of the forces."""

    def tangent(self) -> NDArray:
        """Stored entries of the displacement's matrix at the trial state."""

    def tensile_energy(self) -> NDArray:
        """Tensile energy density (n_points,) of the trial state [stress]."""


class Move(NamedTuple):
    """A move of the unknowns (n,), the change of the residual (n,) over it, and their product."""

    step: NDArray
    change: NDArray
    product: float


def quasi_newton_step(
    discretisation: CoupledDiscretisation,
    case: Case,
    load: float,
    give_up: Callable[[int], str],
    runs_away: Callable[[], bool],
    cautious: bool,
) -> StepOutcome:
    """Solve one increment by L-BFGS (Wu, Huang and Nguyen 2020, doi 10.1016/j.cma.2019.112704; Nocedal 1980).

    The other arguments are those of `staggered_step`, to which an increment is left, and counted, that does not converge;
    from an equilibrium that is not stable its iterations go on. ``runs_away()`` tells whether the trial state's crack has
    run too far: then ``cautious`` iterations end, and others' result is only taken where the staggered scheme finds no
    equilibrium before it.
    """
    if discretisation.fracture is None:
        return staggered_step(discretisation, case, load, give_up)
    discretisation.begin_step()
    before, equations = discretisation.energies()[1], CoupledEquations(discretisation, case, load)
    try:
        outcome = _minimised(equations, case, give_up, runs_away, cautious)
        if outcome is not None and not cautious and runs_away():
            reached = equations.reached
            nearer = _before_it_runs(discretisation, case, load, give_up, runs_away)
            if nearer is not None:
                return nearer
            discretisation.undo()
            discretisation.begin_step()
            discretisation.go_to(load)
            equations.residual(reached)
        if outcome is not None and outcome.verdict == "converged" and has_run(discretisation, case, before):
            at_rest, iterations = equations.reached, outcome.iterations + SWEEPS
            if lead_away(discretisation, case, equations.sweep(SWEEPS)):
                return settle(discretisation, case, load, give_up, before, iterations)
            equations.residual(at_rest)  # where sweeps lead is only looked at
            outcome = StepOutcome("converged", equations.history_field, iterations)
    except NewtonError:
        outcome = None
    if outcome is not None:
        return outcome
    discretisation.costs.count["left_to_staggering"] += 1
    discretisation.undo()
    return staggered_step(discretisation, case, load, give_up)


def _before_it_runs(
    discretisation: CoupledDiscretisation,
    case: Case,
    load: float,
    give_up: Callable[[int], str],
    runs_away: Callable[[], bool],
) -> StepOutcome | None:
    """The equilibrium, then counted, that the staggered scheme finds before the crack runs away; None without one.

    A line search looks at the energy where it lands and not on the way: it may step over what holds a crack back.
    """
    discretisation.undo()
    try:
        outcome = staggered_step(discretisation, case, load, lambda n: RUNS_AWAY if runs_away() else give_up(n))
    except (NewtonError, LinearSolverError):
        return None
    if outcome.verdict != "converged" or runs_away():
        return None
    discretisation.costs.count["nearer_equilibria"] += 1
    return outcome


class CoupledEquations:
    """Equations R(x) = 0 of the free unknowns of the displacement and, behind them, of the phase field.

    Both residuals are derivatives of one energy but where the history field is above the present tensile energy.
    """

    def __init__(self, discretisation: CoupledDiscretisation, case: Case, load: float) -> None:
        assert discretisation.fracture is not None
        self.discretisation, self._case, self._load = discretisation, case, load
        self._fracture = discretisation.fracture
        self._equation, self._equilibrium = discretisation.fracture.equation, discretisation.equilibrium
        self._committed = self.history_field = discretisation.history_field
        displacement = discretisation.go_to(load)
        self.start = self.reached = np.concatenate([displacement, discretisation.nodal_phase_field[self._equation.free]])

    def phase_field(self, unknowns: NDArray) -> NDArray:
        """The part of the phase field of unknowns (n,), or of residuals."""
        return unknowns[self._equilibrium.size :]

    def residual(self, unknowns: NDArray) -> tuple[NDArray, float]:
        """Residual (n,) and the scale of the forces; the trial state becomes that of the unknowns (n,).

        Raises NewtonError where it is not finite.
        """
        discretisation, self.reached = self.discretisation, unknowns
        nodal = discretisation.nodal_phase_field.copy()
        nodal[self._equation.free] = self.phase_field(unknowns)
        discretisation.set_phase_field(nodal)
        forces, scale = discretisation.residual(unknowns[: self._equilibrium.size])
        self.history_field = updated_history(self._case, self._committed, discretisation.tensile_energy())
        with discretisation.costs.timed("phase_field"):
            self._fracture.assemble_residual(self.history_field, nodal)
            residual = np.concatenate([forces, self._equation.residual()])
        if not np.isfinite(residual).all():
            raise NewtonError("the quasi-Newton iteration met a value that is not finite")
        return residual, scale

    def imbalance(self, residual: NDArray) -> float:
        """Norm of the forces out of balance."""
        forces = residual[: self._equilibrium.size]
        return float(np.sqrt(np.einsum("n,n->", forces, forces)))

    def balanced(self) -> NDArray:
        """Unknowns (n,) in equilibrium at the trial phase field."""
        discretisation = self.discretisation
        tensile_energy = discretisation.solve_displacement(self._load, self._case.staggered.residual_tolerance)
        self.history_field = updated_history(self._case, self._committed, tensile_energy)
        displacement = discretisation.go_to(self._load)
        self.reached = np.concatenate([displacement, self.phase_field(self.reached)])
        return self.reached

    def factorise(self) -> None:
        """Make the factors those of the trial state."""
        discretisation = self.discretisation
        self._equilibrium.solver.factorise(discretisation.tangent())
        with discretisation.costs.timed("phase_field"):
            self._fracture.assemble(self.history_field, discretisation.nodal_phase_field)
        self._equation.solver.factorise(self._equation.matrix())

    def solve(self, residual: NDArray) -> NDArray:
        """Unknowns (n,) that the factors, of each equation by itself, give for a residual (n,)."""
        displacement = self._equilibrium.solver.solve_again(residual[: self._equilibrium.size])
        return np.concatenate([displacement, self._equation.solver.solve_again(self.phase_field(residual))])

    def sweep(self, times: int) -> list[float]:
        """Go on from the trial state, displacement and phase field in turn by its factors; the latter's changes."""
        self.factorise()
        changes, size = [], self._equilibrium.size
        for _ in range(times):
            residual = self.residual(self.reached)[0][:size]
            step, moved = -self._equilibrium.solver.solve_again(residual), self.reached.copy()
            moved[:size] = search(self.discretisation, moved[:size], residual, step)[0]
            residual = self.residual(moved)[0][size:]
            step = self._equation.solver.solve_again(residual)
            self.reached = np.concatenate([moved[:size], moved[size:] - step])
            changes.append(float(np.abs(step).max()))
        self.residual(self.reached)
        return changes


def _minimised(
    equations: CoupledEquations,
    case: Case,
    give_up: Callable[[int], str],
    runs_away: Callable[[], bool],
    cautious: bool,
) -> StepOutcome | None:
    """The outcome of the iteration, None where it does not converge; raises NewtonError where it leaves all bounds."""
    settings, moves = case.staggered, deque[Move](maxlen=MEMORY)
    balance = max(10.0 * settings.residual_tolerance, EQUILIBRIUM_SHARE * settings.tolerance)
    unknowns, change, asked_again = equations.start, np.inf, 0
    residual, scale = equations.residual(unknowns)
    for iteration in range(1, min(LARGEST_ITERATIONS, settings.largest_iterations) + 1):
        equations.discretisation.costs.begin_iteration()
        if iteration % LARGEST_USES == 1:
            equations.factorise()
        step = -_inverse(equations, moves, residual)
        slope = float(np.einsum("n,n->", step, residual))
        before, change = change, float(np.abs(equations.phase_field(step)).max())
        if equations.imbalance(residual) <= balance * scale and remaining_distance(change, before) <= settings.tolerance:
            return StepOutcome("converged", equations.history_field, iteration)
        if iteration % ITERATIONS_BETWEEN == 0:
            if cautious and runs_away():
                return StepOutcome("interrupted", equations.history_field, iteration, RUNS_AWAY)
            if iteration >= asked_again and give_up(iteration):
                # forces out of balance may vanish where nothing is broken
                unknowns, asked_again = equations.balanced(), 2 * iteration
                reason = give_up(iteration)
                if reason:
                    return StepOutcome("interrupted", equations.history_field, iteration, reason)
                residual, scale = equations.residual(unknowns)
                moves.clear()
                continue
        if not slope < 0.0:
            return None
        start, old = unknowns, residual
        unknowns, residual, scale = search(equations, start, old, step * min(1.0, LONGEST_STEP / change))
        equations.discretisation.costs.count["quasi_newton_iterations"] += 1
        move = Move(unknowns - start, residual - old, float(np.einsum("n,n->", unknowns - start, residual - old)))
        if move.product > -SMALLEST_CURVATURE * slope:
            moves.append(move)
    return None


def _inverse(equations: CoupledEquations, moves: deque[Move], residual: NDArray) -> NDArray:
    """The inverse Jacobian's product with a residual (n,): the factors', corrected by the moves (Nocedal 1980)."""
    rest, shares = residual.copy(), []
    for move in reversed(moves):
        share = float(np.einsum("n,n->", move.step, rest)) / move.product
        rest -= share * move.change
        shares.append(share)
    product = equations.solve(rest)
    for move, share in zip(moves, reversed(shares), strict=True):
        product += (share - float(np.einsum("n,n->", move.change, product)) / move.product) * move.step
    return product
