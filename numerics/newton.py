"""Newton's method with a line search, for equilibrium at a given phase field."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cases import Case

from .costs import Costs
from .staggered import NewtonError

LARGEST_ITERATIONS = 40
LARGEST_CUTS = 5
#: after so many corrections a looser tolerance will do: torn points that open and close can trade forces of a size
#: that is nothing to the body, without end
PATIENCE = 6
LOOSE_TOLERANCE = 1e-4
#: share of the forces that would stretch a body by as much as it is moved, below which forces say nothing: those of a
#: body that is moved as a whole are the rounding of its strain
LEAST_FORCES = 1e-7
#: stiffness of torn material in the tangent, as a share of the whole one's: a lower one flings it to and fro
TORN_STIFFNESS = 1e-4
#: a step is long enough when the slope of the energy along it has fallen to this share
SLOPE_SHARE = 0.5
#: largest ratio of loads by which a displacement is scaled to begin with
LARGEST_SCALING = 2.0


def load_ratio(load: float, before: float) -> float:
    """Factor on the last displacement that a new load begins with; 1 where the load starts, jumps or changes its sign.

    Exact while the phase field rests and all that is prescribed grows with the load on a geometry that stays, since all
    three splits are homogeneous of degree one.
    """
    ratio = load / before if before else 1.0
    return ratio if 0.0 < ratio <= LARGEST_SCALING else 1.0


def least_forces(case: Case, stiffness: NDArray) -> float:
    """Scale of forces over the largest displacement, below which none are judged [force/length].

    stiffness : (n_bodies, 3, 3) [stress]
    """
    return LEAST_FORCES * float(stiffness.max()) * case.plane.thickness


class Residual(Protocol):
    """Equations R(x) = 0."""

    def residual(self, unknowns: NDArray) -> tuple[NDArray, float]:
        """Residual (n,) and the force scale that it is judged against."""


class Equilibrium(Residual, Protocol):
    """Equations R(x) = 0 of the free displacement unknowns x."""

    def correction(self, unknowns: NDArray, residual: NDArray) -> NDArray:
        """Solution d (n,) of K(x) d = -R."""


def newton(system: Equilibrium, unknowns: NDArray, tolerance: float, finest: float, costs: Costs) -> NDArray:
    """Unknowns (n,) with |R| <= tolerance * force scale; counts corrections and equilibria that stayed loose.

    What is not in equilibrium to the tolerance ``finest`` is corrected once at least: near the tip of a crack a
    change that is nothing to the whole body's forces is much.

    R is the gradient of an energy that is convex for all three splits, so that a Newton step, cut back to where the
    energy is near its lowest along it, converges; ``NewtonError`` says when it did not.
    """
    residual, scale = system.residual(unknowns)
    for iteration in range(LARGEST_ITERATIONS):
        norm = np.linalg.norm(residual)
        if not np.isfinite(norm):
            raise NewtonError("equilibrium iteration met a value that is not finite")
        if norm <= (tolerance if iteration else finest) * scale:
            return unknowns
        if iteration >= PATIENCE and norm <= LOOSE_TOLERANCE * scale:
            costs.count["loose_equilibria"] += 1
            return unknowns
        costs.count["newton"] += 1
        step = system.correction(unknowns, residual)
        unknowns, residual, scale = search(system, unknowns, residual, step)
    raise NewtonError(f"no equilibrium in {LARGEST_ITERATIONS} iterations, residual {norm / scale:.1e} of the forces")


def search(
    system: Residual, unknowns: NDArray, residual: NDArray, step: NDArray
) -> tuple[NDArray, NDArray, float]:
    """Go along the step until the energy's slope has fallen enough (regula falsi on step . R).

    Returns unknowns, residual and force scale there; sums run in one order on any number of threads.
    """
    low, low_slope, high = 0.0, float(np.einsum("n,n->", step, residual)), np.inf
    length, enough = 1.0, SLOPE_SHARE * abs(low_slope)
    for _ in range(LARGEST_CUTS):
        tried = length
        trial, scale = system.residual(unknowns + tried * step)
        slope = float(np.einsum("n,n->", step, trial))
        if abs(slope) <= enough or (slope < 0.0 and tried == 1.0):
            break
        if slope < 0.0:
            low, low_slope, length = tried, slope, 0.5 * (tried + high)
        else:
            high = tried
            length = low + (high - low) * max(0.1, low_slope / (low_slope - slope))
    return unknowns + tried * step, trial, scale
