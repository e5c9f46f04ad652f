"""What every elastic law answers at one point."""

from typing import NamedTuple


class PointResponse(NamedTuple):
    """Energies, stress (xx, yy, xy) and upper half of the tangent."""

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
