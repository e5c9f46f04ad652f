"""Acceleration of alternate minimisation: over-relaxed while the crack runs, Anderson's method once it settles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: a larger change of the phase field tells that the crack is running: the past says nothing of what comes
RUNNING = 0.1
#: over-relaxation of a running crack
OVER_RELAXATION = 1.7
#: longest accelerated step, as a change of the phase field: a crack must not be carried past a state of rest
LONGEST_STEP = 0.2
#: directions of the past below this share of the strongest one are left out
SMALLEST_SHARE = 1e-10


class Acceleration:
    """Next iterate of a fixed-point iteration x -> G(x) from the last few (Walker and Ni, 2011).

    Slow iterations have few slow directions, which a short memory finds. ``memory`` is the number of past differences
    used; 0 over-relaxes throughout. G(x) - x points downhill in energy, so that a step against it, which would seek a
    state of unstable equilibrium, is refused.
    """

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

    def _over_relaxed(self, start: NDArray, residual: NDArray) -> NDArray:
        self._starts, self._residuals = [], []
        return start + OVER_RELAXATION * residual
