"""Star-convex split: change of volume and shape, with a pressure that holds cracks back (Vicentini et al. 2024).

The law of `physics.volume_and_shape` (doi 10.1007/s10704-024-00763-w), which is the volumetric split at gamma = 0.
psi_plus is negative under pressure alone.
"""

from numba import njit

from physics.splits import GAMMA
from physics.volume_and_shape import parted


@njit(cache=True)
def response(g, exx, eyy, gxy, lam, mu):
    """Expansion and shear drive fracture, compression counts against them."""
    return parted(GAMMA, g, exx, eyy, gxy, lam, mu)
