"""Acceleration of alternate minimisation: Anderson's method where the phase field settles, momentum where it runs."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cases.discretisation import Staggered

from .costs import Costs

#: a larger change of the phase field tells that the crack is running: the past says nothing of what comes
RUNNING = 0.1
#: over-relaxation of a running crack
OVER_RELAXATION = 1.7
#: longest accelerated step, as a change of the phase field: a crack must not be carried past a state of rest
LONGEST_STEP = 0.2
#: directions of the past below this share of the strongest one are left out
SMALLEST_SHARE = 1e-10
#: iterations over which the change of the phase field falls unless the crack runs
ITERATIONS_OF_A_FALL = 3
#: the crack has come to rest when the change falls below this share of its largest
RESTING_SHARE = 0.5
#: largest share of the last move that momentum keeps
LARGEST_MOMENTUM = 0.9
#: momentum that went uphill so often in an increment is given up for the rest of it
LARGEST_REFUSALS = 3


class Acceleration(Protocol):
    """Next iterate of a fixed-point iteration x -> G(x)."""

    @property
    def crack_runs(self) -> bool:
        """Whether the next iterate is one of many on the way of a running crack, none of which need be exact."""

    def next(self, start: NDArray, image: NDArray) -> NDArray:
        """Next iterate (n,), ``start`` (n,) having been mapped to ``image`` (n,)."""


def acceleration_of(settings: Staggered, costs: Costs) -> Acceleration:
    """The acceleration that a case names."""
    if settings.acceleration == "none":
        return Plain()
    anderson = Anderson(settings.memory)
    return anderson if settings.acceleration == "anderson" else Momentum(anderson, costs)


class Plain:
    """No acceleration."""

    crack_runs = False

    def next(self, _start: NDArray, image: NDArray) -> NDArray:
        """The image (n,)."""
        return image


class Anderson:
    """Next iterate of a fixed-point iteration x -> G(x) from the last few (Walker and Ni, 2011).

    Slow iterations have few slow directions, which a short memory finds. ``memory`` is the number of past differences
    used; 0 over-relaxes throughout. G(x) - x points downhill in energy, so that a step against it, which would seek a
    state of unstable equilibrium, is refused.
    """

    crack_runs = False

    def __init__(self, memory: int) -> None:
        self._memory = memory
        self._starts: list[NDArray] = []
        self._residuals: list[NDArray] = []

    def next(self, start: NDArray, image: NDArray) -> NDArray:
        """Next iterate (n,), ``start`` (n,) having been mapped to ``image`` (n,)."""
        residual = image - start
        # what is not finite is left to equilibrium to report
        if not np.abs(residual).max() <= RUNNING or not self._memory:
            return self._over_relaxed(start, residual)
        self._starts = [*self._starts[-self._memory :], start]
        self._residuals = [*self._residuals[-self._memory :], residual]
        if len(self._residuals) == 1:
            return image
        moves, falls = np.diff(self._starts, axis=0), np.diff(self._residuals, axis=0)
        # einsum sums in one fixed order, whatever the number of threads
        products = np.einsum("in,jn->ij", falls, falls)
        weights = np.linalg.lstsq(products, np.einsum("in,n->i", falls, residual), rcond=SMALLEST_SHARE)[0]
        step = residual - np.einsum("i,in->n", weights, moves + falls)
        if np.einsum("n,n->", step, residual) <= 0.0:
            return self._over_relaxed(start, residual)
        return start + step * min(1.0, LONGEST_STEP / np.abs(step).max())

    def forget(self) -> None:
        """Begin anew."""
        self._starts, self._residuals = [], []

    def _over_relaxed(self, start: NDArray, residual: NDArray) -> NDArray:
        self.forget()
        return start + OVER_RELAXATION * residual


class Momentum:
    """Anderson's method, but a crack that runs keeps its momentum (Nesterov 1983; O'Donoghue and Candès 2015).

    The changes of a crack that runs do not fall: each iteration carries it on by the same little, and nothing of the
    past tells where it will rest. Momentum adds a growing share of the last move, until the changes fall or it would go
    uphill; what the iteration contracts at once it leaves stable, unlike a larger over-relaxation. ``costs`` counts
    its iterations, its refusals uphill, and the increments in which it was given up for these.
    """

    def __init__(self, anderson: Anderson, costs: Costs) -> None:
        self._anderson, self._costs = anderson, costs
        self._changes: list[float] = []
        self._image: NDArray | None = None
        self._age = self._refusals = 0

    @property
    def crack_runs(self) -> bool:
        """Whether the last iterate was given momentum."""
        return self._age > 0

    def next(self, start: NDArray, image: NDArray) -> NDArray:
        """Next iterate (n,), ``start`` (n,) having been mapped to ``image`` (n,)."""
        residual = image - start
        moved, self._image = image - (start if self._image is None else self._image), image
        self._changes.append(float(np.abs(residual).max()))
        uphill = not np.einsum("n,n->", residual, moved) > 0.0
        if not (self._runs_on(uphill) if self._age else self._begins_to_run(uphill)):
            return self._anderson.next(start, image)
        self._age += 1
        self._costs.count["momentum_iterations"] += 1
        step = residual + min(LARGEST_MOMENTUM, (self._age - 1) / (self._age + 2)) * moved
        return start + step * min(1.0, max(LONGEST_STEP, self._changes[-1]) / np.abs(step).max())

    def _begins_to_run(self, uphill: bool) -> bool:
        """Whether the changes have not fallen for a while; Anderson's method then begins anew behind."""
        if uphill or self._refusals == LARGEST_REFUSALS or len(self._changes) <= ITERATIONS_OF_A_FALL:
            return False
        if not self._changes[-1] >= self._changes[-1 - ITERATIONS_OF_A_FALL]:
            return False
        self._anderson.forget()
        self._changes, self._age = self._changes[-1:], 1
        return True

    def _runs_on(self, uphill: bool) -> bool:
        """Whether momentum goes on; it rests where the changes fall or it would go uphill, which is counted."""
        if self._changes[-1] >= RESTING_SHARE * max(self._changes) and not uphill:
            return True
        self._changes, self._age = self._changes[-1:], 0
        if uphill:
            self._refusals += 1
            self._costs.count["momentum_refused"] += 1
            self._costs.count["momentum_given_up"] += self._refusals == LARGEST_REFUSALS
        return False
