"""The split that is none: all energy drives fracture."""

from numba import njit

from physics.point_response import PointResponse


@njit(cache=True)
def response(g, exx, eyy, gxy, lam, mu):
    """Whole energy is degraded (Eq. 2.61)."""
    trace = exx + eyy
    psi = 0.5 * lam * trace * trace + mu * (exx * exx + eyy * eyy + 0.5 * gxy * gxy)
    normal = g * (lam + 2.0 * mu)
    return PointResponse(
        psi, 0.0,
        g * (lam * trace + 2.0 * mu * exx), g * (lam * trace + 2.0 * mu * eyy), g * mu * gxy,
        normal, g * lam, 0.0, normal, 0.0, g * mu,
    )  # fmt: skip
