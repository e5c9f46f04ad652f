"""Explicit integration in time: the outer loop of thesis Algorithm 3, once for both solvers."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cases import Case

from .costs import Costs
from .fields import Fields
from .status import RunStatus
from .time_steps import beyond_stable, step_size


class BlewUpError(RuntimeError):
    """A step left the range in which the integration is stable; the message says what was seen."""


@dataclass(frozen=True)
class Balance:
    """Energies [energy] and momentum (2,) [force time] of a moving discretisation.

    ``external_work`` is that of tractions, gravity, the moving frame, damping and prescribed motions since the start;
    ``external_power`` is its present rate. ``contact_work`` is that of contact between the bodies, ``friction_work`` the
    part of friction in it. ``transfer_work`` is what kinetic energy loses where velocities go from points to nodes and
    back; None where there are no points, and where strains follow velocities that are mapped once more, whose work is not
    that of the nodes' forces.
    """

    elastic: float
    fracture: float
    kinetic: float
    external_work: float
    external_power: float
    contact_work: float
    momentum: tuple[float, float]
    friction_work: float = 0.0
    transfer_work: float | None = None

    @property
    def total(self) -> float:
        """Energy held now."""
        return self.elastic + self.fracture + self.kinetic


class DynamicDiscretisation(Protocol):
    """What a solver offers to the explicit driver."""

    costs: Costs

    def stable_step(self) -> float:
        """Largest time step by the case's rule, before the case's share [time]."""

    def steps(self, times: NDArray, size: float) -> int:
        """Take some of the steps that begin at `times` (n,), at least one, and tell how many; raises BlewUpError of the
        first one alone."""

    def balance(self) -> Balance:
        """Energies and momentum now; sums of the linear algebra's library would depend on its number of threads."""

    def least_phase_field(self) -> float:
        """Smallest phase field."""

    def monitored(self) -> dict[str, float]:
        """Further columns of the history, the same ones at every record."""

    def fields(self) -> Fields:
        """Everything to be seen now."""

    def measures(self) -> dict[str, float]:
        """Scalars that only the solver can tell at the end."""

    def checkpoint(self) -> dict[str, NDArray]:
        """Arrays from which `restore` makes the state again."""

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to the state of a checkpoint of the same case."""


#: growth of the energy over what was there and was put in that counts as instability
LARGEST_GAIN = 2.0


@dataclass(frozen=True)
class Instant:
    """State of the run at one time.

    ``energy_at_start`` is what the bodies held at time 0 [energy], ``steps_per_second`` the pace since then; each step
    takes the ``passes``; ``columns`` are those of the discretisation.
    """

    step: int
    time: float
    balance: Balance
    energy_at_start: float
    c_min: float
    passes: int
    steps_per_second: float
    seconds: float
    status: RunStatus
    share: float
    reason: str = ""
    columns: dict[str, float] = field(default_factory=dict)

    @property
    def u(self) -> float:
        """In dynamics the load parameter is the time."""
        return self.time

    @property
    def is_last(self) -> bool:
        """Nothing comes after it."""
        return self.status == RunStatus.BLEW_UP

    @property
    def is_good(self) -> bool:
        """It holds a new state of the history."""
        return self.status != RunStatus.BLEW_UP

    def row(self) -> dict[str, float]:
        """Columns of the history; F, conjugate to the time, is the power of the external forces."""
        balance = self.balance
        return {
            "step": self.step,
            "time": self.time,
            "u": self.time,
            "F": balance.external_power,
            "E_el": balance.elastic,
            "E_frac": balance.fracture,
            "E_kin": balance.kinetic,
            "W_ext": balance.external_work,
            "c_min": self.c_min,
            "staggered": self.passes,
            "newton": 0,
            "seconds": round(self.seconds, 6),
            "W_contact": balance.contact_work,
            "W_friction": balance.friction_work,
            **({} if balance.transfer_work is None else {"W_transfer": balance.transfer_work}),
            "momentum_x": balance.momentum[0],
            "momentum_y": balance.momentum[1],
            **self.columns,
        }

    def text(self) -> str:
        """Time, pace and energies for the progress display."""
        energy = self.balance
        return (
            f"step {self.step} t={self.time:.5g} {self.steps_per_second:.0f} steps/s E_kin={energy.kinetic:.4g}"
            f" E_el={energy.elastic:.4g} E_frac={energy.fracture:.4g} c_min={self.c_min:.2f}"
        )


def instants(discretisation: DynamicDiscretisation, case: Case, after: Instant | None = None) -> Iterator[Instant]:
    """Integrate the case in time, the settling first; yields the state at the start, then every so many steps.

    The last one's status tells whether the end was reached or the run blew up. ``after`` goes on behind an instant
    whose state the discretisation has been restored to.
    """
    return _TimeMarch(discretisation, case, after).follow()


def number_of_steps(case: Case, stable: float) -> int:
    """Equal steps to the end of a dynamic case where `stable` is the step by its rule [time]."""
    assert case.dynamics is not None
    length = case.dynamics.end_time - case.dynamics.start_time
    return int(np.ceil(length / step_size(case, stable) * (1.0 - 1e-12)))


class _TimeMarch:
    """Steps of equal size from the start to the end of the run."""

    def __init__(self, discretisation: DynamicDiscretisation, case: Case, after: Instant | None) -> None:
        assert case.dynamics is not None
        self.discretisation, self.case, self.after = discretisation, case, after
        self.passes = case.staggered.passes
        self.start, self.end = case.dynamics.start_time, case.dynamics.end_time
        self.n_steps = number_of_steps(case, discretisation.stable_step())
        self.size = (self.end - self.start) / self.n_steps
        evenly = np.linspace(0, self.n_steps, min(case.output.records, self.n_steps) + 1)
        times = [t for t in (*case.snapshots, *case.frame_times) if t <= self.end]
        reached = (int(np.ceil((t - self.start) / self.size * (1.0 - 1e-12))) for t in times)
        #: steps after which the state is told, snapshots and frames at the first step that reaches their time
        self.told = {*map(int, np.round(evenly)), *reached}
        self.started = time.perf_counter() - (after.seconds if after else 0.0)
        self.energy_at_start = after.energy_at_start if after else discretisation.balance().total

    def follow(self) -> Iterator[Instant]:
        """The first state, then each one that is told."""
        if self.after is None:
            yield self._instant(0)
        elif self.after.is_last:
            return
        step = self.after.step if self.after else 0
        for told in sorted(told for told in self.told if told > step):
            times = np.array([self._time(number) for number in range(step, told)])
            while step < told:
                try:
                    done = self.discretisation.steps(times[len(times) - (told - step) :], self.size)
                except BlewUpError as error:
                    yield self._instant(step + 1, f"step {step + 1} at t = {self._time(step + 1):.6g}: {error}")
                    return
                self.discretisation.costs.count["steps"] += done
                step += done
            instant = self._instant(step)
            yield instant
            if instant.is_last:
                return

    def _time(self, step: int) -> float:
        return self.start + step * self.size

    def _instant(self, step: int, problem: str = "") -> Instant:
        balance, seconds = self.discretisation.balance(), time.perf_counter() - self.started
        problem = problem or self._growth(step, balance)
        if problem and (beyond := beyond_stable(self.case, self.discretisation.stable_step())):
            problem += f"; {beyond}"
        return Instant(
            step=step,
            time=self._time(step),
            balance=balance,
            energy_at_start=self.energy_at_start,
            c_min=self.discretisation.least_phase_field(),
            passes=self.passes,
            steps_per_second=step / seconds if seconds else 0.0,
            seconds=seconds,
            status=RunStatus.BLEW_UP if problem else RunStatus.COMPLETE,
            share=step / self.n_steps,
            reason=problem,
            columns=self.discretisation.monitored(),
        )

    def _growth(self, step: int, balance: Balance) -> str:
        """What speaks for instability: energy that nobody put in."""
        if not np.isfinite(balance.total):
            return f"step {step}: the energy is not finite"
        given = self.energy_at_start + abs(balance.external_work)
        if balance.kinetic + balance.elastic > LARGEST_GAIN * given and given > 0.0:
            return (
                f"step {step}: the energy has grown to {balance.total:.4g} of {given:.4g} given to the bodies; the time"
                f" step {self.size:.4g} may be above the stability limit, shorten it"
            )
        return ""
