"""Speeds of waves in an isotropic elastic material."""

from __future__ import annotations

import numpy as np

from cases.material import Material
from physics.roots import root


def shear_speed(material: Material) -> float:
    """Speed of shear waves, sqrt(mu / density) [length/time]."""
    assert material.density is not None
    return float(np.sqrt(material.mu / material.density))


def pressure_speed(material: Material) -> float:
    """Speed of pressure waves in plane strain, sqrt((lambda + 2 mu) / density) [length/time], the root of Eq. 6.49."""
    assert material.density is not None
    return float(np.sqrt((material.lam + 2.0 * material.mu) / material.density))


def rayleigh_speed(material: Material) -> float:
    """Speed of surface waves in plane strain, which a crack in mode I cannot exceed [length/time].

    Root of Rayleigh's equation (2 - s)² = 4 sqrt(1 - s) sqrt(1 - k s) with s = (c / c_s)², k = (c_s / c_p)²
    (Freund 1998, eq. 2.5.4).
    """
    ratio = material.mu / (material.lam + 2.0 * material.mu)

    def out_of_balance(s: float) -> float:
        return (2.0 - s) ** 2 - 4.0 * np.sqrt(1.0 - s) * np.sqrt(1.0 - ratio * s)

    # s = 0 is a root that means nothing
    return shear_speed(material) * float(np.sqrt(root(out_of_balance, 1e-3, 1.0)))
