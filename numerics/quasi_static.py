"""Quasi-static loading in increments that adapt: grown while nothing breaks, undone and cut when too much does."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from cases import Case

from .linear_solvers import LinearSolverError
from .path_following import dissipation_step
from .refinement import FollowingDiscretisation
from .staggered import Discretisation, NewtonError, StepOutcome, staggered_step
from .status import RunStatus

#: an increment is quiet, and the next one may grow, when the crack advances by less than this share of the limit
QUIET_SHARE = 0.25
#: growth of the increment after a quiet one
GROWTH = 1.5
#: shortening of an increment that was undone
SHRINKING = 0.25
#: while nothing is broken, the phase field falls ever faster towards a limit load: an increment in which it fell by
#: more than this halves the next one
LARGEST_FALL = 0.05
#: why an increment is undone although it was solved
TOO_FAR = "crack advances too far"
#: below this phase field material counts as broken
BROKEN_PHASE_FIELD = 0.1


@dataclass(frozen=True)
class Increment:
    """One accepted increment: the discretisation holds its state while the increment is being listened to.

    ``u`` is the load parameter, ``F`` the force conjugate to it; ``share`` is the part of the load path done.
    ``leg``, ``next_size``, ``peak`` and ``controlled`` are what the march needs to go on from here: the number of the
    path's target, the size of the next increment, the largest force so far, whether the fracture energy leads.
    """

    step: int
    u: float
    F: float
    elastic_energy: float
    fracture_energy: float
    external_work: float
    c_min: float
    staggered: int
    newton: int
    seconds: float
    status: RunStatus
    share: float
    reason: str = ""
    leg: int = 0
    next_size: float = 0.0
    peak: float = 0.0
    controlled: bool = False

    @property
    def is_last(self) -> bool:
        """Nothing comes after it, whatever is left of the path."""
        return self.status != RunStatus.COMPLETE

    @property
    def is_good(self) -> bool:
        """It does not repeat the last good state."""
        return self.status != RunStatus.NO_CONVERGENCE

    def row(self) -> dict[str, float]:
        """Columns of the history; the share of the load path stands for the time, and nothing moves."""
        return {
            "step": self.step,
            "time": float(self.share),
            "u": float(self.u),
            "F": float(self.F),
            "E_el": float(self.elastic_energy),
            "E_frac": float(self.fracture_energy),
            "E_kin": 0.0,
            "W_ext": float(self.external_work),
            "c_min": float(self.c_min),
            "staggered": self.staggered,
            "newton": self.newton,
            "seconds": round(float(self.seconds), 6),
        }

    def text(self) -> str:
        """A few words for the progress display."""
        return f"step {self.step} u={self.u:.5g} F={self.F:.5g} c_min={self.c_min:.2f}"


def increments(
    discretisation: Discretisation, case: Case, after: Increment | None = None
) -> Iterator[Increment]:
    """Follow the load path of the case; yields the unloaded state first, then each accepted increment.

    The last increment's status tells how it ended: complete (path done), broken through, or no convergence (the state
    is the last good one, ``reason`` says why). ``after`` goes on behind an increment
    whose state the discretisation has been restored to.
    """
    return _LoadPath(discretisation, case, after).follow()


class _LoadPath:
    """State of the march along the load path."""

    def __init__(self, discretisation: Discretisation, case: Case, after: Increment | None) -> None:
        self.discretisation, self.case = discretisation, case
        self.load = case.load.path[0]
        self.increment = case.load.increment
        self.length = float(np.abs(np.diff(case.load.path)).sum()) or 1.0
        #: decimals of a load: enough for the smallest increments, too few for the sums' round-off
        self.digits = 12 - int(np.ceil(np.log10(self.length)))
        self.done = 0.0
        self.step = 0
        self.work = 0.0
        self.peak = 0.0
        self.last: Increment | None = None
        self.started = time.perf_counter()
        self.newton_before = 0
        materials = [case.materials[body.material].fracture for body in case.bodies.values()]
        advances = [f.toughness * f.length_scale for f in materials if f is not None]
        #: fracture energy of the largest advance allowed in one increment
        self.energy_limit = case.load.largest_advance * case.plane.thickness * min(advances, default=np.inf)
        self.adaptive = case.load.adaptive and case.staggered.scheme == "converged"
        self.dissipative = self.adaptive and case.load.control == "dissipation"
        #: the fracture energy leads, not the load
        self.controlled = False
        self.leg = 0
        if after is not None:
            self._go_on(after)

    def _go_on(self, after: Increment) -> None:
        self.last, self.load, self.increment, self.leg = after, after.u, after.next_size, after.leg
        self.done, self.step = after.share * self.length, after.step + 1
        self.work, self.peak, self.controlled = after.external_work, after.peak, after.controlled
        self.started -= after.seconds
        self.newton_before = self.discretisation.costs.count["newton"]

    def follow(self) -> Iterator[Increment]:
        """The unloaded state, then each accepted increment."""
        if self.last is None:
            yield self._first_state()
        targets = self.case.load.path[1:]
        while self.leg < len(targets):
            if self.load == targets[self.leg]:
                self.leg += 1
                continue
            assert self.last is not None
            if self.last.is_last:
                return
            yield self._advance(targets[self.leg])

    def _first_state(self) -> Increment:
        outcome = staggered_step(self.discretisation, self.case, self.load)
        return self._accept(self.load, outcome)

    def _advance(self, target: float) -> Increment:
        """One accepted increment towards the target, or the report that there is none."""
        if self.controlled:
            return self._advance_by_dissipation(target)
        direction = np.sign(target - self.load)
        if self.step == 1 and self.case.load.prologue:
            return self._prologue(target)
        while True:
            size = min(self.increment, abs(target - self.load))
            # do not leave a sliver before the target
            left = abs(target - self.load) - size
            load = target if left < 1e-9 * self.length else round(self.load + direction * size, self.digits)
            smallest = size <= self.case.load.smallest * 1.001
            outcome, problem = self._try(load, smallest)
            if not problem and self._refine():
                continue
            if not problem:
                return self._grow_and_accept(load, outcome)
            self.discretisation.undo()
            if self.dissipative and problem == TOO_FAR:
                return self._advance_by_dissipation(target)
            if smallest or not self.case.load.adaptive:
                return self._report_failure(problem)
            self.increment = max(SHRINKING * size, self.case.load.smallest)
            self.discretisation.costs.count["undone_increments"] += 1

    def _advance_by_dissipation(self, target: float) -> Increment:
        """An increment of the fracture energy, whatever the load does; the load leads again once it rises freely."""
        start = self.load
        try:
            outcome, load = dissipation_step(self.discretisation, self.case, start, self.energy_limit)
        except (NewtonError, LinearSolverError) as error:
            outcome, load = StepOutcome("stalled", self.discretisation.history_field, 0, str(error)), start
        self.discretisation.costs.count["dissipation_increments"] += 1
        if not outcome.reason and self._refine():
            return self._advance_by_dissipation(target)
        rise = (load - start) * np.sign(target - start)
        self.controlled = rise < self.increment
        if outcome.reason:
            self.discretisation.undo()
            return self._report_failure(outcome.reason)
        if rise > abs(target - start):
            # the path ends before the advance is paid: the load leads to its end
            self.discretisation.undo()
            self.dissipative = self.controlled = False
            return self._advance(target)
        self.done = max(self.done, abs(load - self.case.load.path[0]))
        broken = self._broken(self.discretisation.reaction_force())
        return self._accept(load, outcome, RunStatus.BROKEN_THROUGH if broken else RunStatus.COMPLETE)

    def _refine(self) -> bool:
        """Whether the crack has left the fine cells: then there are more, and the last good state is on them."""
        return isinstance(self.discretisation, FollowingDiscretisation) and self.discretisation.refine()

    def _prologue(self, target: float) -> Increment:
        """The stretch on which nothing breaks, in one increment."""
        load = round(self.load + self.case.load.prologue * (target - self.load), self.digits)
        converged = {"staggered": self.case.staggered.model_copy(update={"scheme": "converged"})}
        outcome = staggered_step(self.discretisation, self.case.model_copy(update=converged), load)
        self.done += abs(load - self.load)
        return self._accept(load, outcome)

    def _try(self, load: float, smallest: bool) -> tuple[StepOutcome, str]:
        """Outcome of a staggered step and what speaks against accepting it."""
        cautious = self.adaptive and (self.dissipative or not smallest)

        def give_up(iteration: int) -> str:
            too_far = cautious and self._advance_energy() > self.energy_limit
            if too_far and self.dissipative:
                return TOO_FAR
            if self._broken(self.discretisation.reaction_force()):
                return "broken through"
            return TOO_FAR if too_far else ""

        try:
            outcome = staggered_step(self.discretisation, self.case, load, give_up)
        except (NewtonError, LinearSolverError) as error:
            return StepOutcome("stalled", self.discretisation.history_field, 0), str(error)
        if cautious and self._advance_energy() > self.energy_limit:
            return outcome, TOO_FAR
        if outcome.verdict == "interrupted" and outcome.reason == "broken through":
            return outcome, ""
        return outcome, outcome.reason

    def _advance_energy(self) -> float:
        before = self.last.fracture_energy if self.last else 0.0
        return self.discretisation.energies()[1] - before

    def _broken(self, force: float) -> bool:
        load = self.case.load
        if not load.stop_when_broken or abs(force) >= load.broken_fraction * self.peak:
            return False
        # a force near zero on unloading is no break
        return bool(self.discretisation.phase_field.min() < BROKEN_PHASE_FIELD)

    def _grow_and_accept(self, load: float, outcome: StepOutcome) -> Increment:
        quiet = self._advance_energy() < QUIET_SHARE * self.energy_limit
        self.done += abs(load - self.load)
        broken = self._broken(self.discretisation.reaction_force())
        before = self.last.c_min if self.last else 1.0
        accepted = self._accept(load, outcome, RunStatus.BROKEN_THROUGH if broken else RunStatus.COMPLETE)
        fall = before - accepted.c_min if accepted.c_min > BROKEN_PHASE_FIELD else 0.0
        if self.adaptive and fall > LARGEST_FALL:
            self.increment = max(0.5 * self.increment, self.case.load.smallest)
        elif self.adaptive and quiet and GROWTH * fall <= LARGEST_FALL:
            self.increment = min(GROWTH * self.increment, self.case.load.increment)
        self.last = replace(accepted, next_size=self.increment)
        return self.last

    def _accept(self, load: float, outcome: StepOutcome, status: RunStatus = RunStatus.COMPLETE) -> Increment:
        discretisation = self.discretisation
        force = discretisation.reaction_force()
        elastic, fracture = discretisation.energies()
        if self.last is not None:
            self.work += 0.5 * (force + self.last.F) * (load - self.load)
        self.peak = max(self.peak, abs(force))
        newton = discretisation.costs.count["newton"]
        discretisation.commit(outcome.history_field)
        self.last = Increment(
            step=self.step,
            u=load,
            F=force,
            elastic_energy=elastic,
            fracture_energy=fracture,
            external_work=self.work,
            c_min=float(discretisation.phase_field.min()),
            staggered=outcome.iterations,
            newton=newton - self.newton_before,
            seconds=time.perf_counter() - self.started,
            status=status,
            share=min(1.0, self.done / self.length),
            leg=self.leg,
            next_size=self.increment,
            peak=self.peak,
            controlled=self.controlled,
        )
        self.load, self.newton_before = load, newton
        self.step += 1
        discretisation.costs.count["increments"] += 1
        discretisation.costs.count["staggered_iterations"] += outcome.iterations
        return self.last

    def _report_failure(self, problem: str) -> Increment:
        assert self.last is not None
        reason = f"{problem}; the smallest increment {self.case.load.smallest:g} after u = {self.load:g} failed"
        self.last = replace(self.last, status=RunStatus.NO_CONVERGENCE, reason=reason)
        return self.last
