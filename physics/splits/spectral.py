"""Split by the signs of the principal strains."""

import math

from numba import njit

from physics.point_response import PointResponse


@njit(cache=True, error_model="numpy")
def response(g, exx, eyy, gxy, lam, mu):
    """Principal extensions drive fracture (Eqs. 2.74-2.80).

    In 2D the projections on the principal directions follow from the double angle; ``turning`` is the
    coefficient of their rotation, which tends to the common degradation when the eigenvalues coincide.
    Nothing is branched on and no division can fail, so that a loop may take several points at once.
    """
    mean, half_difference, half_shear = 0.5 * (exx + eyy), 0.5 * (exx - eyy), 0.5 * gxy
    radius = math.sqrt(half_difference * half_difference + half_shear * half_shear)
    e1, e2 = mean + radius, mean - radius
    trace = exx + eyy
    # equal eigenvalues: any direction is principal
    apart = radius > max(1e-14 * (abs(mean) + radius), 1e-150)
    over, between = (radius, e1 - e2) if apart else (1.0, 1.0)
    cosine, sine = half_difference / over, half_shear / over
    cosine, sine = (cosine, sine) if apart else (1.0, 0.0)
    g1 = g if e1 > 0.0 else 1.0
    g2 = g if e2 > 0.0 else 1.0
    gt = g if trace > 0.0 else 1.0
    turning = (g1 * e1 - g2 * e2) / between
    turning = turning if apart else g1

    p1x, p1y, p1s = 0.5 * (1.0 + cosine), 0.5 * (1.0 - cosine), 0.5 * sine
    p2x, p2y, p2s = p1y, p1x, -p1s
    qx, qy, qs = 0.5 * sine, -0.5 * sine, -0.5 * cosine
    a1, a2, at = 2.0 * mu * g1, 2.0 * mu * g2, 4.0 * mu * turning
    dt = lam * gt
    plus1, plus2 = max(e1, 0.0), max(e2, 0.0)
    minus1, minus2 = min(e1, 0.0), min(e2, 0.0)
    tplus, tminus = max(trace, 0.0), min(trace, 0.0)
    return PointResponse(
        0.5 * lam * tplus * tplus + mu * (plus1 * plus1 + plus2 * plus2),
        0.5 * lam * tminus * tminus + mu * (minus1 * minus1 + minus2 * minus2),
        dt * trace + a1 * e1 * p1x + a2 * e2 * p2x,
        dt * trace + a1 * e1 * p1y + a2 * e2 * p2y,
        a1 * e1 * p1s + a2 * e2 * p2s,
        dt + a1 * p1x * p1x + a2 * p2x * p2x + at * qx * qx,
        dt + a1 * p1x * p1y + a2 * p2x * p2y + at * qx * qy,
        a1 * p1x * p1s + a2 * p2x * p2s + at * qx * qs,
        dt + a1 * p1y * p1y + a2 * p2y * p2y + at * qy * qy,
        a1 * p1y * p1s + a2 * p2y * p2s + at * qy * qs,
        a1 * p1s * p1s + a2 * p2s * p2s + at * qs * qs,
    )
