"""Split of the elastic energy into a part that drives fracture and one that does not (thesis 2.6.3).

All functions are compiled, work on one point, and return stress and consistent tangent in closed form:
psi = g psi_plus + psi_minus, stress = d psi / d strain (Eq. 2.50), tangent = d stress / d strain (Eq. 2.51).
Strains are exx, eyy and the engineering shear gxy; ``lam`` is the in-plane first Lamé constant, so that the
split acts on in-plane strains (d = 2 in Eq. 2.63).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .elasticity import ROOTED, Law


class PointResponse(NamedTuple):
    """Answer of the law at one point: energies, stress (xx, yy, xy) and upper half of the tangent."""

    psi_plus: float
    psi_minus: float
    sxx: float
    syy: float
    sxy: float
    d00: float
    d01: float
    d02: float
    d11: float
    d12: float
    d22: float


@njit(cache=True, inline="always")
def _no_split(g, exx, eyy, gxy, lam, mu):
    """Whole energy is degraded (Eq. 2.61)."""
    trace = exx + eyy
    psi = 0.5 * lam * trace * trace + mu * (exx * exx + eyy * eyy + 0.5 * gxy * gxy)
    normal = g * (lam + 2.0 * mu)
    return PointResponse(
        psi, 0.0,
        g * (lam * trace + 2.0 * mu * exx), g * (lam * trace + 2.0 * mu * eyy), g * mu * gxy,
        normal, g * lam, 0.0, normal, 0.0, g * mu,
    )  # fmt: skip


@njit(cache=True, inline="always")
def _volumetric_deviatoric(g, exx, eyy, gxy, lam, mu):
    """Expansion and shear drive fracture, compression does not (Eqs. 2.66-2.73)."""
    bulk = lam + mu
    trace = exx + eyy
    half_difference = 0.5 * (exx - eyy)
    deviatoric = mu * (2.0 * half_difference * half_difference + 0.5 * gxy * gxy)
    volumetric = 0.5 * bulk * trace * trace
    if trace > 0.0:
        psi_plus, psi_minus, factor = volumetric + deviatoric, 0.0, g
    else:
        psi_plus, psi_minus, factor = deviatoric, volumetric, 1.0
    pressure = factor * bulk * trace
    shear = 2.0 * g * mu * half_difference
    normal, coupling = factor * bulk + g * mu, factor * bulk - g * mu
    return PointResponse(
        psi_plus, psi_minus, pressure + shear, pressure - shear, g * mu * gxy,
        normal, coupling, 0.0, normal, 0.0, g * mu,
    )  # fmt: skip


@njit(cache=True, inline="always")
def _spectral(g, exx, eyy, gxy, lam, mu):
    """Principal extensions drive fracture (Eqs. 2.74-2.80).

    In 2D the projections on the principal directions follow from the double angle; ``turning`` is the
    coefficient of their rotation, which tends to the common degradation when the eigenvalues coincide.
    """
    mean, half_difference, half_shear = 0.5 * (exx + eyy), 0.5 * (exx - eyy), 0.5 * gxy
    radius = math.sqrt(half_difference * half_difference + half_shear * half_shear)
    e1, e2 = mean + radius, mean - radius
    trace = exx + eyy
    # equal eigenvalues: any direction is principal
    if radius > 1e-14 * (abs(mean) + radius) and radius > 1e-150:
        cosine, sine = half_difference / radius, half_shear / radius
    else:
        cosine, sine, radius = 1.0, 0.0, 0.0
    g1 = g if e1 > 0.0 else 1.0
    g2 = g if e2 > 0.0 else 1.0
    gt = g if trace > 0.0 else 1.0
    turning = (g1 * e1 - g2 * e2) / (e1 - e2) if radius > 0.0 else g1

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


@njit(cache=True, inline="always")
def point_response(split, g, exx, eyy, gxy, lam, mu):
    """Energies, stress and consistent tangent at one point.

    Parameters
    ----------
    split : code from ``SPLIT_CODES``.
    g : degradation, Eq. 2.48.
    exx, eyy, gxy : strains, engineering shear.
    lam, mu : in-plane Lamé constants [stress].
    """
    if split == 2:
        return _spectral(g, exx, eyy, gxy, lam, mu)
    if split == 1:
        return _volumetric_deviatoric(g, exx, eyy, gxy, lam, mu)
    return _no_split(g, exx, eyy, gxy, lam, mu)


@njit(cache=True, inline="always")
def _tangent_times(r, x, y, s):
    """Product (xx, yy, xy) of the tangent with a strain."""
    return r.d00 * x + r.d01 * y + r.d02 * s, r.d01 * x + r.d11 * y + r.d12 * s, r.d02 * x + r.d12 * y + r.d22 * s


@njit(cache=True)
def _rooted_response(split, g, exx, eyy, gxy, root):
    """The law of lambda = 0, mu = 1/2 between strain~ = R strain and stress~, stress = R^T stress~ (He and Shao 2019)."""
    a0, a1, a2 = root[0, 0], root[0, 1], root[0, 2]
    b0, b1, b2 = root[1, 0], root[1, 1], root[1, 2]
    c0, c1, c2 = root[2, 0], root[2, 1], root[2, 2]
    x, y, s = a0 * exx + a1 * eyy + a2 * gxy, b0 * exx + b1 * eyy + b2 * gxy, c0 * exx + c1 * eyy + c2 * gxy
    r = point_response(split, g, x, y, s, 0.0, 0.5)
    x0, y0, s0 = _tangent_times(r, a0, b0, c0)
    x1, y1, s1 = _tangent_times(r, a1, b1, c1)
    x2, y2, s2 = _tangent_times(r, a2, b2, c2)
    return PointResponse(
        r.psi_plus, r.psi_minus,
        a0 * r.sxx + b0 * r.syy + c0 * r.sxy, a1 * r.sxx + b1 * r.syy + c1 * r.sxy, a2 * r.sxx + b2 * r.syy + c2 * r.sxy,
        a0 * x0 + b0 * y0 + c0 * s0, a0 * x1 + b0 * y1 + c0 * s1, a0 * x2 + b0 * y2 + c0 * s2,
        a1 * x1 + b1 * y1 + c1 * s1, a1 * x2 + b1 * y2 + c1 * s2, a2 * x2 + b2 * y2 + c2 * s2,
    )  # fmt: skip


@njit(cache=True, inline="always")
def body_response(law, body, g, exx, eyy, gxy):
    """The same as ``point_response`` by the law (``Law``) of a body of any stiffness.

    ``body`` is its number, best unsigned: numba asks a signed one whether it counts from the end.
    """
    split = law.split[body]
    if split >= ROOTED:
        return _rooted_response(split - ROOTED, g, exx, eyy, gxy, law.root[body])
    return point_response(split, g, exx, eyy, gxy, law.lam[body], law.mu[body])


@njit(cache=True)
def _responses(law, g, strain, energies, stress, tangent):
    for p in range(strain.shape[0]):
        r = body_response(law, 0, g[p], strain[p, 0], strain[p, 1], strain[p, 2])
        energies[p, 0], energies[p, 1] = r.psi_plus, r.psi_minus
        stress[p, 0], stress[p, 1], stress[p, 2] = r.sxx, r.syy, r.sxy
        tangent[p, 0, 0], tangent[p, 1, 1], tangent[p, 2, 2] = r.d00, r.d11, r.d22
        tangent[p, 0, 1] = tangent[p, 1, 0] = r.d01
        tangent[p, 0, 2] = tangent[p, 2, 0] = r.d02
        tangent[p, 1, 2] = tangent[p, 2, 1] = r.d12


def responses(law: Law, degradation: NDArray, strain: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """The law of one body over many points.

    Parameters
    ----------
    law : of which the first body counts.
    degradation : (n,) values of g.
    strain : (n, 3) Voigt xx, yy, engineering xy.

    Returns
    -------
    energies (n, 2): psi_plus, psi_minus; stress (n, 3); tangent (n, 3, 3).
    """
    n = len(strain)
    energies, stress, tangent = np.empty((n, 2)), np.empty((n, 3)), np.empty((n, 3, 3))
    _responses(law, degradation, strain, energies, stress, tangent)
    return energies, stress, tangent
