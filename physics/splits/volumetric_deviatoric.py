"""Split into change of volume and change of shape."""

from numba import njit

from physics.volume_and_shape import parted


@njit(cache=True)
def response(g, exx, eyy, gxy, lam, mu):
    """Expansion and shear drive fracture, compression does not (Eqs. 2.66-2.73)."""
    return parted(0.0, g, exx, eyy, gxy, lam, mu)
