"""Compiled laws of points that move: strains that turn with the material, and stresses.

Loops run over strips of points: what a parallel loop writes by its own index to arrays out of a tuple, numba takes for
unused and leaves out.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

from numba import njit, prange

from physics.energy_splits import inlined_response
from physics.phase_field import degradation


class BodyLaw(NamedTuple):
    """In-plane Lamé constants of a body [stress] and its residual stiffness k_f."""

    lam: float
    mu: float
    residual_stiffness: float


@njit(forceinline=True)
def turned_strain(exx, eyy, gxy, l00, l01, l10, l11, corotational):
    """Strain after a step with the displacement gradients l of the step.

    Additive: the symmetric part is summed in fixed axes (Eq. 6.41). Corotational: the gradient is taken on the middle
    of the step, l (1 + l/2)^-1, whose symmetric part a rigid turn leaves zero; the strain so far turns with the
    material (Hughes and Winget 1980).
    """
    if not corotational:
        return exx + l00, eyy + l11, gxy + l01 + l10
    a, b, c, d = 1.0 + 0.5 * l00, 0.5 * l01, 0.5 * l10, 1.0 + 0.5 * l11
    over = 1.0 / (a * d - b * c)
    m00, m01 = (l00 * d - l01 * c) * over, (l01 * a - l00 * b) * over
    m10, m11 = (l10 * d - l11 * c) * over, (l11 * a - l10 * b) * over
    half = 0.25 * (m10 - m01)  # half of the angle
    # cosine and sine of twice the angle, as the deviator turns, by Cayley's formula: half is the tangent of a quarter
    even, odd = 1.0 - half * half, 2.0 * half
    over = 1.0 / ((1.0 + half * half) * (1.0 + half * half))
    cosine, sine = (even * even - odd * odd) * over, 2.0 * even * odd * over
    mean, difference, shear = 0.5 * (exx + eyy), 0.5 * (exx - eyy), 0.5 * gxy
    turned, sheared = cosine * difference - sine * shear, sine * difference + cosine * shear
    return mean + turned + m00, mean - turned + m11, 2.0 * sheared + m01 + m10


# without liberties, which it would else take over from the loop that compiles it first: the same strain, the same bits
@njit(fastmath=False)
def elastic_stress(exx, eyy, gxy, lam, mu):
    """Stress of a point that cannot break."""
    pressure = lam * (exx + eyy)
    return pressure + 2.0 * mu * exx, pressure + 2.0 * mu * eyy, mu * gxy


@njit(cache=True, parallel=True)
def elastic_stresses(strips, law, elastic):
    """Stresses of a body that cannot break."""
    lam, mu = law.lam, law.mu
    exx, eyy, gxy, sxx, syy, sxy = elastic
    for strip in prange(len(strips) - 1):
        for p in range(strips[strip], strips[strip + 1]):
            sxx[p], syy[p], sxy[p] = elastic_stress(exx[p], eyy[p], gxy[p], lam, mu)


@cache
def degraded_stresses(split: int) -> Callable[..., None]:
    """The loop over a body that can break by the split of this code.

    Each has a loop of its own: with the law known, the compiler takes several points at once.
    """

    @njit(cache=True, parallel=True, error_model="numpy")
    def stresses(strips, law, elastic, crack):
        """Degradation, stresses (Eq. 2.50) and both parts of the energy density."""
        lam, mu, residual_stiffness = law.lam, law.mu, law.residual_stiffness
        exx, eyy, gxy, sxx, syy, sxy = elastic
        c, g, psi_plus, psi_minus = crack.c, crack.g, crack.psi_plus, crack.psi_minus
        for strip in prange(len(strips) - 1):
            for p in range(strips[strip], strips[strip + 1]):
                g[p] = degradation(c[p], residual_stiffness)
                r = inlined_response(split, g[p], exx[p], eyy[p], gxy[p], lam, mu)
                sxx[p], syy[p], sxy[p] = r.sxx, r.syy, r.sxy
                psi_plus[p], psi_minus[p] = r.psi_plus, r.psi_minus

    return stresses
