"""Change of volume and change of shape apart, the law that several splits share."""

from numba import njit

from physics.point_response import PointResponse


@njit(cache=True)
def parted(gamma, g, exx, eyy, gxy, lam, mu):
    """psi_plus = mu |dev|^2 + K (<tr>+^2 - gamma <tr>-^2) / 2, psi_minus = (1 + gamma) K <tr>-^2 / 2."""
    bulk = lam + mu
    trace = exx + eyy
    half_difference = 0.5 * (exx - eyy)
    deviatoric = mu * (2.0 * half_difference * half_difference + 0.5 * gxy * gxy)
    volumetric = 0.5 * bulk * trace * trace
    if trace > 0.0:
        psi_plus, psi_minus, factor = volumetric + deviatoric, 0.0, g
    else:
        psi_plus, psi_minus = deviatoric - gamma * volumetric, (1.0 + gamma) * volumetric
        factor = 1.0 + gamma * (1.0 - g)
    pressure = factor * bulk * trace
    shear = 2.0 * g * mu * half_difference
    normal, coupling = factor * bulk + g * mu, factor * bulk - g * mu
    return PointResponse(
        psi_plus, psi_minus, pressure + shear, pressure - shear, g * mu * gxy,
        normal, coupling, 0.0, normal, 0.0, g * mu,
    )  # fmt: skip
