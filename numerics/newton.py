"""Newton's method with a line search, for equilibrium at a given phase field."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .staggered import NewtonError

LARGEST_ITERATIONS = 60
LARGEST_HALVINGS = 6


class Equilibrium(Protocol):
    """Equations R(x) = 0 of the free displacement unknowns x."""

    def residual(self, unknowns: NDArray) -> tuple[NDArray, float]:
        """Residual (n,) and the force scale that it is judged against."""

    def correction(self, unknowns: NDArray, residual: NDArray) -> NDArray:
        """Solution d (n,) of K(x) d = -R."""


def newton(system: Equilibrium, unknowns: NDArray, tolerance: float) -> tuple[NDArray, int]:
    """Unknowns with |R| <= tolerance * force scale, and the number of corrections.

    The energies of the three splits are convex, so that a Newton step, shortened while the residual does
    not fall, converges; ``NewtonError`` says when it did not.
    """
    residual, scale = system.residual(unknowns)
    norm = np.linalg.norm(residual)
    for iteration in range(LARGEST_ITERATIONS):
        if norm <= tolerance * scale:
            return unknowns, iteration
        step = system.correction(unknowns, residual)
        for _ in range(LARGEST_HALVINGS):
            trial = unknowns + step
            residual, scale = system.residual(trial)
            trial_norm = np.linalg.norm(residual)
            # the first step carries the load in: its residual starts from a jump at the boundary
            if trial_norm < norm or trial_norm <= tolerance * scale or iteration == 0:
                break
            step *= 0.5
        unknowns, norm = trial, trial_norm
        if not np.isfinite(norm):
            raise NewtonError("equilibrium iteration met a value that is not finite")
    raise NewtonError(f"no equilibrium in {LARGEST_ITERATIONS} iterations, residual {norm / scale:.1e} of the forces")
