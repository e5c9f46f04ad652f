"""Quasi-static loading in increments that adapt: grown while nothing breaks, undone and cut when too much does."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from cases import Case

from .conjugates import (
    AT_START,
    MarchState,
    Target,
    carried_force,
    conjugate_force,
    gentler_start,
    gives_way,
    has_lost_its_force,
    noted,
    path_targets,
    step_work,
    turns_aside,
    way,
    why_it_ends,
)
from .costs import OutOfTimeError
from .linear_solvers import LinearSolverError
from .path_following import longest_dissipation_step
from .quasi_newton import CoupledDiscretisation, quasi_newton_step
from .refinement import FollowingDiscretisation
from .staggered import (
    NewtonError,
    QuasiStaticDiscretisation,
    StepOutcome,
    energy_across,
    energy_of_advance,
    staggered_step,
)
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
#: why the iterations of an increment end that is accepted nevertheless
BROKEN_THROUGH = "broken through"
#: why an increment of forces alone is undone: the body gives way under them and finds no rest
GIVES_WAY = "the body breaks through and no state is in equilibrium with the load"
#: share of the way through the narrowest piece that a crack goes in one increment whose fracture energy leads: energies
#: of a bar that snaps back by a third then balance within 6 %
SHARE_OF_WIDTH = 0.25
#: below this phase field material counts as broken
BROKEN_PHASE_FIELD = 0.1


@dataclass(frozen=True)
class Increment:
    """One accepted increment: the discretisation holds its state while the increment is being listened to.

    ``u`` is the load parameter, ``F`` the force conjugate to it: of the constraints that follow it, or else the work per
    load factor of what acts on the bodies, linear in u like the force of an elastic body. ``share`` is the part of the
    load path done, ``reason`` says why there is no new state.
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
    march: MarchState = AT_START

    @property
    def is_last(self) -> bool:
        """Nothing comes after it, whatever is left of the path."""
        return self.status != RunStatus.COMPLETE

    @property
    def is_good(self) -> bool:
        """It does not repeat the last good state."""
        return not self.reason

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
    discretisation: QuasiStaticDiscretisation, case: Case, after: Increment | None = None
) -> Iterator[Increment]:
    """Follow the load path of the case; yields the first state, then each accepted increment.

    The last increment's status tells how it ended: complete (path done), broken through, or no convergence (the state
    is the last good one, ``reason`` says why). ``after`` goes on behind an increment
    whose state the discretisation has been restored to.
    """
    return _LoadPath(discretisation, case, after).follow()


@dataclass(frozen=True)
class _Limits:
    """What an increment of a case may do.

    Attributes
    ----------
    length : of the load path
    digits : decimals of a load: enough for the smallest increments, too few for the sums' round-off
    adaptive : increments are grown and cut
    energy : fracture energy of the largest advance of the crack allowed in one increment
    """

    length: float
    digits: int
    adaptive: bool
    energy: float

    @classmethod
    def of(cls, case: Case) -> _Limits:
        """The limits that a case sets."""
        length = float(np.abs(np.diff(case.load.path)).sum()) or 1.0
        energy = case.load.largest_advance * energy_of_advance(case)
        if case.load.control == "dissipation":
            energy = min(energy, SHARE_OF_WIDTH * energy_across(case))
        return cls(
            length=length,
            digits=12 - int(np.ceil(np.log10(length))),
            adaptive=case.load.adaptive and case.staggered.scheme != "passes",
            energy=energy,
        )


def _first_advance(discretisation: QuasiStaticDiscretisation, outcome: StepOutcome) -> float:
    """Fracture energy of the first state beyond that of the notches."""
    if np.array_equal(outcome.history_field, discretisation.history_field):
        return 0.0
    reached, nodal = discretisation.energies()[1], discretisation.nodal_phase_field
    discretisation.solve_phase_field(discretisation.history_field)
    of_notches = discretisation.energies()[1]
    discretisation.set_phase_field(nodal)
    return reached - of_notches


def _first_size(turn: Sequence[Target], size: float, adaptive: bool) -> float:
    """First increment on the way from one target to the next, the two of ``turn``; ``size`` is that in use before."""
    if len(turn) < 2 or turn[0].increment == turn[1].increment:
        return size
    return min(size, turn[1].increment) if adaptive else turn[1].increment


def _end_of_prologue(case: Case, start: float, target: float) -> float:
    """Load at the end of the stretch that is taken at once, no farther than the first state that is to be stored."""
    wanted = [(u - start) / (target - start) for u in case.snapshots]
    share = min((s for s in wanted if s > 0.0), default=1.0)
    return start + min(case.load.prologue, share) * (target - start)


class _LoadPath:
    """The march along the load path."""

    def __init__(self, discretisation: QuasiStaticDiscretisation, case: Case, after: Increment | None) -> None:
        self.discretisation, self.case, self.last = discretisation, case, after
        self.limits = _Limits.of(case)
        self.dissipative = self.limits.adaptive and case.load.control == "dissipation"
        self.march = after.march if after else MarchState(next_size=case.load.increment)
        self.done = after.share * self.limits.length if after else 0.0
        self.started = time.perf_counter() - (after.seconds if after else 0.0)
        self.newton_before = discretisation.costs.count["newton"]
        self.targets = path_targets(case)

    @property
    def load(self) -> float:
        """Load parameter of the last accepted increment, or the path's first."""
        return self.last.u if self.last else self.case.load.path[0]

    @property
    def step(self) -> int:
        """Number of the increment to come."""
        return self.last.step + 1 if self.last else 0

    def follow(self) -> Iterator[Increment]:
        """The first state, then each accepted increment."""
        if self.last is None:
            yield self._first_state()
        while self.march.leg < len(self.targets):
            target = self.targets[self.march.leg].load
            if self.load == target:
                leg = self.march.leg + 1
                if turns_aside(self.case, self.targets[: leg + 1]):
                    self.march = replace(self.march, peak=0.0, peak_at=0.0)
                size = _first_size(self.targets[leg - 1 : leg + 1], self.march.next_size, self.limits.adaptive)
                self.march = replace(self.march, leg=leg, next_size=size)
                continue
            assert self.last is not None
            if self.last.is_last:
                return
            try:
                yield self._advance(target)
            except OutOfTimeError:
                self.discretisation.undo()
                yield self._report_end(RunStatus.TIMED_OUT, f"out of time in the increment after u = {self.load:g}")
                return

    def _first_state(self) -> Increment:
        """The state at the path's first load, or the report that there is none."""
        outcome, problem = self._try(self.case, self.load, cautious=False)
        if not problem and self.limits.adaptive and _first_advance(self.discretisation, outcome) > self.limits.energy:
            problem = TOO_FAR
        if not problem:
            return self._first_state() if self._refine() else self._accept(self.load, outcome)
        self.discretisation.undo()
        self.last = Increment(
            step=0, u=self.load, F=0.0, elastic_energy=0.0, fracture_energy=0.0, external_work=0.0,
            c_min=float(self.discretisation.phase_field.min()), staggered=outcome.iterations,
            newton=self.discretisation.costs.count["newton"] - self.newton_before,
            seconds=time.perf_counter() - self.started, status=RunStatus.NO_CONVERGENCE, share=0.0,
            reason=f"{problem} in the first state, u = {self.load:g}; {gentler_start(self.case)}",
        )  # fmt: skip
        return self.last

    def _advance(self, target: float) -> Increment:
        """One accepted increment towards the target, or the report that there is none."""
        if self.march.controlled:
            return self._advance_by_dissipation(target)
        at_once = self._prologue(target) if self.step == 1 and self.case.load.prologue else None
        return at_once or self._advance_by_load(target)

    def _prologue(self, target: float) -> Increment | None:
        """The stretch on which nothing breaks, in one increment; None, and back to its start, where something does.

        It ends at the first state that is to be stored.
        """
        load = round(_end_of_prologue(self.case, self.load, target), self.limits.digits)
        converged = {"staggered": self.case.staggered.model_copy(update={"scheme": "converged"})}
        outcome, problem = self._try(self.case.model_copy(update=converged), load, cautious=True)
        if problem:
            self._undo()
            return None
        if self._refine():
            return self._prologue(target)
        self.done += abs(load - self.load)
        return self._accept(load, outcome)

    def _advance_by_load(self, target: float) -> Increment:
        """An increment of the load, cut until it can be accepted."""
        way, smallest_size = target - self.load, self.case.load.smallest
        while True:
            size = min(self.march.next_size, abs(way))
            # do not leave a sliver before the target
            ends = abs(way) - size < 1e-9 * self.limits.length
            load = target if ends else round(self.load + np.sign(way) * size, self.limits.digits)
            smallest = size <= smallest_size * 1.001
            outcome, problem = self._try(self.case, load, self.limits.adaptive and (self.dissipative or not smallest))
            if not problem:
                if self._refine():
                    continue
                return self._grow_and_accept(load, outcome)
            if self.dissipative and smallest and problem in (TOO_FAR, GIVES_WAY):
                self.discretisation.undo()
                return self._advance_by_dissipation(target)
            if smallest or not self.case.load.adaptive:
                self.discretisation.undo()
                return self._report_failure(problem)
            self._undo()
            self.march = replace(self.march, next_size=max(SHRINKING * size, smallest_size))

    def _advance_by_dissipation(self, target: float) -> Increment:
        """An increment of the fracture energy, whatever the load does; the load leads again once it rises freely."""
        start = self.load
        outcome, load = longest_dissipation_step(
            self.discretisation, self.case, start, self.limits.energy, lambda u: GIVES_WAY if self._gives_way(u) else ""
        )
        if not outcome.reason and self._refine():
            return self._advance_by_dissipation(target)
        rise = (load - start) * np.sign(target - start)
        self.march = replace(self.march, controlled=bool(rise < self.march.next_size))
        if outcome.reason:
            return self._report_failure(outcome.reason)
        if rise > abs(target - start):
            # the path ends before the advance is paid: the load leads to its end
            self.discretisation.undo()
            self.dissipative, self.march = False, replace(self.march, controlled=False)
            return self._advance(target)
        self.done = max(self.done, abs(load - self.case.load.path[0]))
        return self._accept(load, outcome)

    def _refine(self) -> bool:
        """Whether the crack has left the fine cells: then there are more, and the last good state is on them."""
        return isinstance(self.discretisation, FollowingDiscretisation) and self.discretisation.refine()

    def _undo(self) -> None:
        self.discretisation.undo()
        self.discretisation.costs.count["undone_increments"] += 1

    def _try(self, case: Case, load: float, cautious: bool) -> tuple[StepOutcome, str]:
        """Outcome of a staggered step and what speaks against accepting it; ``cautious`` judges the crack's advance."""

        def give_up(iteration: int) -> str:
            too_far = cautious and self._runs_away()
            if too_far and self.dissipative:
                return TOO_FAR
            if self._gives_way(load):
                return GIVES_WAY
            if self._broken(self._force(load), load):
                return BROKEN_THROUGH
            return TOO_FAR if too_far else ""

        try:
            if case.staggered.scheme == "bfgs":
                coupled = cast(CoupledDiscretisation, self.discretisation)
                outcome = quasi_newton_step(coupled, case, load, give_up, self._runs_away, cautious)
            else:
                outcome = staggered_step(self.discretisation, case, load, give_up)
        except (NewtonError, LinearSolverError) as error:
            problem = GIVES_WAY if self._gives_way(load) else str(error)
            return StepOutcome("stalled", self.discretisation.history_field, 0), problem
        if cautious and self._runs_away():
            return outcome, TOO_FAR
        if self._gives_way(load):
            return outcome, GIVES_WAY
        return outcome, "" if outcome.reason == BROKEN_THROUGH else outcome.reason

    def _beyond(self, load: float) -> float:
        """The load that is on the way to come from one that is reached; itself at the end."""
        coming = (target.load for target in self.targets[self.march.leg :] if target.load != load)
        return next(coming, load)

    def _towards(self, load: float) -> float:
        """The load on the way to or from which F of the trial state at a load is told."""
        return self._beyond(load) if load == self.load else self.load

    def _force(self, load: float) -> float:
        """F of the trial state at a load."""
        return conjugate_force(self.discretisation, self.case, self.march, self._towards(load))

    def _gives_way(self, load: float) -> bool:
        return gives_way(self.discretisation, self.case, self.march, load, self._force(load))

    def _advance_energy(self) -> float:
        before = self.last.fracture_energy if self.last else 0.0
        return self.discretisation.energies()[1] - before

    def _runs_away(self) -> bool:
        return self._advance_energy() > self.limits.energy

    def _broken(self, force: float, load: float) -> bool:
        """Whether the force is gone at a load because the specimen is, not because it is unloaded."""
        gone = has_lost_its_force(self.case, self.march, load, carried_force(self.case, force, load, self._towards(load)))
        return gone and bool(self.discretisation.phase_field.min() < BROKEN_PHASE_FIELD)

    def _grow_and_accept(self, load: float, outcome: StepOutcome) -> Increment:
        quiet = self._advance_energy() < QUIET_SHARE * self.limits.energy
        self.done += abs(load - self.load)
        before, size = self.last.c_min if self.last else 1.0, self.march.next_size
        accepted = self._accept(load, outcome)
        fall = before - accepted.c_min if accepted.c_min > BROKEN_PHASE_FIELD else 0.0
        if self.limits.adaptive and fall > LARGEST_FALL:
            size = max(0.5 * size, self.case.load.smallest)
        elif self.limits.adaptive and quiet and GROWTH * fall <= LARGEST_FALL:
            size = min(GROWTH * size, self.targets[self.march.leg].increment)
        self.march = replace(self.march, next_size=size)
        self.last = replace(accepted, march=self.march)
        return self.last

    def _accept(self, load: float, outcome: StepOutcome) -> Increment:
        discretisation, before = self.discretisation, self.last
        force = self._force(load)
        external_work = before.external_work + step_work(discretisation, self.march, before.u, load) if before else 0.0
        elastic, fracture = discretisation.energies()
        broken = before is not None and self._broken(force, load)
        carried = carried_force(self.case, force, load, self._towards(load))
        if self.march.peak < carried < np.inf:
            self.march = replace(self.march, peak=carried, peak_at=way(self.case, load))
        self.march = noted(discretisation, self.case, self.march, load, self._beyond(load), force)
        newton = discretisation.costs.count["newton"]
        discretisation.commit(outcome.history_field)
        self.last = Increment(
            step=self.step,
            u=load,
            F=force,
            elastic_energy=elastic,
            fracture_energy=fracture,
            external_work=external_work,
            c_min=float(discretisation.phase_field.min()),
            staggered=outcome.iterations,
            newton=newton - self.newton_before,
            seconds=time.perf_counter() - self.started,
            status=RunStatus.BROKEN_THROUGH if broken else RunStatus.COMPLETE,
            share=min(1.0, self.done / self.limits.length),
            march=self.march,
        )
        self.newton_before = newton
        discretisation.costs.count["increments"] += 1
        discretisation.costs.count["staggered_iterations"] += outcome.iterations
        return self.last

    def _report_failure(self, problem: str) -> Increment:
        assert self.last is not None
        reason = why_it_ends(self.case, self.march, problem, self.load)
        return self._report_end(RunStatus.BROKEN_THROUGH if problem == GIVES_WAY else RunStatus.NO_CONVERGENCE, reason)

    def _report_end(self, status: RunStatus, reason: str) -> Increment:
        """The last good state again, with the reason why there is no new one."""
        assert self.last is not None
        self.last = replace(self.last, status=status, reason=reason)
        return self.last
