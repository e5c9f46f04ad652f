"""Split into change of volume and change of shape."""

from numba import njit

from physics.point_response import PointResponse


@njit(cache=True)
def response(g, exx, eyy, gxy, lam, mu):
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
