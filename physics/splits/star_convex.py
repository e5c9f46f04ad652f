"""Star-convex split: change of volume and shape, with a pressure that holds cracks back (Vicentini et al. 2024).

psi_plus = mu |dev|^2 + K (<tr>+^2 - gamma <tr>-^2) / 2, psi_minus = (1 + gamma) K <tr>-^2 / 2
(doi 10.1007/s10704-024-00763-w), which is the volumetric split at gamma = 0. psi_plus is negative under pressure alone.
"""

from numba import njit

from physics.point_response import PointResponse

#: gamma: the larger, the stronger under pressure
GAMMA = 5.0


@njit(cache=True)
def response(g, exx, eyy, gxy, lam, mu):
    """Expansion and shear drive fracture, compression counts against them."""
    bulk = lam + mu
    trace = exx + eyy
    half_difference = 0.5 * (exx - eyy)
    deviatoric = mu * (2.0 * half_difference * half_difference + 0.5 * gxy * gxy)
    volumetric = 0.5 * bulk * trace * trace
    if trace > 0.0:
        psi_plus, psi_minus, factor = volumetric + deviatoric, 0.0, g
    else:
        psi_plus, psi_minus = deviatoric - GAMMA * volumetric, (1.0 + GAMMA) * volumetric
        factor = 1.0 + GAMMA * (1.0 - g)
    pressure = factor * bulk * trace
    shear = 2.0 * g * mu * half_difference
    normal, coupling = factor * bulk + g * mu, factor * bulk - g * mu
    return PointResponse(
        psi_plus, psi_minus, pressure + shear, pressure - shear, g * mu * gxy,
        normal, coupling, 0.0, normal, 0.0, g * mu,
    )  # fmt: skip
