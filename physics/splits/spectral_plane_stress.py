"""Split by the signs of all three principal strains, of which the third is free: plane stress only."""

from numba import njit

from physics.point_response import PointResponse
from physics.splits.spectral import response as in_plane


@njit(cache=True)
def response(g, exx, eyy, gxy, lam, mu):
    """Principal extensions drive fracture (Eqs. 2.74-2.80), the third where stress across the plane is nought.

    With the degradation g3 of the third strain and gt of the volume, gt lambda tr + 2 mu g3 e3 = 0 leaves
    e3 = -gt lambda t / (gt lambda + 2 mu g3) of the in-plane trace t, and of the volumetric term
    gt lambda tr = 2 mu g3 gt lambda t / (gt lambda + 2 mu g3). The third strain shrinks where the plane grows. ``lam`` is
    lambda* = 2 lambda mu / (lambda + 2 mu), as of all splits.
    """
    full = 2.0 * mu * lam / (2.0 * mu - lam)
    trace = exx + eyy
    gt, g3 = (g, 1.0) if trace > 0.0 else (1.0, g)
    both = gt * full + 2.0 * mu * g3
    across = gt * full / both if both > 0.0 else 0.0
    third, volume = -across * trace, (1.0 - across) * trace
    # of the plane alone, without its volumetric term
    r = in_plane(g, exx, eyy, gxy, 0.0, mu)
    volumetric, sideways = 0.5 * full * volume * volume, mu * third * third
    plus, minus = (volumetric, sideways) if trace > 0.0 else (sideways, volumetric)
    dt = 2.0 * mu * g3 * across
    return PointResponse(
        r.psi_plus + plus, r.psi_minus + minus,
        r.sxx + dt * trace, r.syy + dt * trace, r.sxy,
        r.d00 + dt, r.d01 + dt, r.d02, r.d11 + dt, r.d12, r.d22,
    )  # fmt: skip
