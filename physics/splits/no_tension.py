"""Split into what a material without tension would carry, and the rest (Freddi and Royer-Carfagni 2010).

psi_minus is the energy of the masonry-like solid of in-plane strains, whose cracks open as they must for no stress to be
tensile (doi 10.1016/j.jmps.2010.02.010): nothing where both principal strains are extensions, a bar along the second
one where the first stress would be tension, and everything where neither would.
"""

import math

from numba import njit

from physics.point_response import PointResponse


@njit(cache=True)
def response(g, exx, eyy, gxy, lam, mu):
    """What opens drives fracture; a broken point carries pressure across and along its crack, and no shear on it."""
    mean, half_difference, half_shear = 0.5 * (exx + eyy), 0.5 * (exx - eyy), 0.5 * gxy
    radius = math.sqrt(half_difference * half_difference + half_shear * half_shear)
    # equal eigenvalues: any direction is principal
    if radius > 1e-14 * (abs(mean) + radius) and radius > 1e-150:
        cosine, sine = half_difference / radius, half_shear / radius
    else:
        cosine, sine, radius = 1.0, 0.0, 0.0
    e1, e2 = mean + radius, mean - radius
    side = lam + 2.0 * mu
    whole = 0.5 * lam * (e1 + e2) * (e1 + e2) + mu * (e1 * e1 + e2 * e2)
    # what is carried in the principal directions without tension: modulus of each, and of both together
    if e2 > 0.0:
        m11, m12, m22 = 0.0, 0.0, 0.0
    elif side * e1 + lam * e2 > 0.0:
        m11, m12, m22 = 0.0, 0.0, side - lam * lam / side
    else:
        m11, m12, m22 = side, lam, side
    psi_minus = 0.5 * (m11 * e1 * e1 + m22 * e2 * e2) + m12 * e1 * e2
    k11, k12, k22 = g * side + (1.0 - g) * m11, g * lam + (1.0 - g) * m12, g * side + (1.0 - g) * m22
    s1, s2 = k11 * e1 + k12 * e2, k12 * e1 + k22 * e2
    # (s1 - s2) / (e1 - e2), with the round-off of the moduli alone
    turning = 0.5 * (k11 + k22) - k12 + (0.5 * (k11 - k22) * mean / radius if k11 != k22 else 0.0)

    p1x, p1y, ps = 0.5 * (1.0 + cosine), 0.5 * (1.0 - cosine), 0.5 * sine
    qx, qs, at = 0.5 * sine, -0.5 * cosine, 2.0 * turning
    return PointResponse(
        whole - psi_minus, psi_minus, s1 * p1x + s2 * p1y, s1 * p1y + s2 * p1x, (s1 - s2) * ps,
        k11 * p1x * p1x + 2.0 * k12 * p1x * p1y + k22 * p1y * p1y + at * qx * qx,
        (k11 + k22) * p1x * p1y + k12 * (p1x * p1x + p1y * p1y) - at * qx * qx,
        ps * (k11 * p1x - k22 * p1y + k12 * (p1y - p1x)) + at * qx * qs,
        k11 * p1y * p1y + 2.0 * k12 * p1x * p1y + k22 * p1x * p1x + at * qx * qx,
        ps * (k11 * p1y - k22 * p1x + k12 * (p1x - p1y)) - at * qx * qs,
        (k11 + k22 - 2.0 * k12) * ps * ps + at * qs * qs,
    )  # fmt: skip
