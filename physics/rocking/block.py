"""The rigid rectangular block that rocks about its corners (Housner 1963)."""

from __future__ import annotations

import math
from dataclasses import dataclass

GRAVITY = 9.81


@dataclass(frozen=True)
class Block:
    """A homogeneous block of ``width`` and ``height`` [m] under ``gravity`` [m/s²].

    ``density`` [kg/m³] is that of a slice one metre thick; the pendulum does not depend on it.
    """

    width: float
    height: float
    density: float = 1.0
    gravity: float = GRAVITY

    @property
    def half_diagonal(self) -> float:
        """R, from a corner to the centre [m]."""
        return 0.5 * math.hypot(self.width, self.height)

    @property
    def slenderness(self) -> float:
        """Angle alpha between a side and the diagonal [rad]."""
        return math.atan2(self.width, self.height)

    @property
    def frequency(self) -> float:
        """p = sqrt(3 g / (4 R)) [1/s]."""
        return math.sqrt(0.75 * self.gravity / self.half_diagonal)

    @property
    def uplift_acceleration(self) -> float:
        """Acceleration of the ground at which the block begins to rock, g tan alpha [m/s²]."""
        return self.gravity * math.tan(self.slenderness)

    @property
    def housner_restitution(self) -> float:
        """eta = theta'+ / theta'- of an impact that conserves the moment of momentum about the new corner."""
        return 1.0 - 1.5 * math.sin(self.slenderness) ** 2

    @property
    def mass(self) -> float:
        """Mass of the slice [kg]."""
        return self.density * self.width * self.height

    @property
    def inertia(self) -> float:
        """Moment of inertia of the slice about its centre [kg m²]."""
        return self.mass * (self.width**2 + self.height**2) / 12.0
