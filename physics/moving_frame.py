"""What acts on every body of a dynamic case alike: gravity, the motion of its frame, damping."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cases import Case
from physics.rocking.ground import acceleration
from physics.rocking.of_case import ground_motion


class MovingFrame:
    """Accelerations in the frame of the ground over time.

    Attributes
    ----------
    at_rest : nothing accelerates the bodies at any time.
    """

    def __init__(self, case: Case) -> None:
        assert case.dynamics is not None
        dynamics = case.dynamics
        self._gravity, self._damping, self._settling = np.array(dynamics.gravity), dynamics.damping, dynamics.settling
        self._ground = ground_motion(case) if dynamics.ground else None
        self._direction = np.eye(2)["xy".index(dynamics.ground.direction)] if dynamics.ground else np.zeros(2)
        self.at_rest = not self._gravity.any() and self._ground is None

    def acceleration(self, now: float) -> NDArray[np.float64]:
        """Of all free bodies (2,): gravity, ramped in the settling, less the ground's (D'Alembert) [length/time²]."""
        value = self._gravity
        if self._settling and self._settling.ramp > 0.0:
            value = value * min(1.0, max(0.0, (now + self._settling.duration) / self._settling.ramp))
        if self._ground is not None:
            value = value - acceleration(self._ground, now) * self._direction
        return value

    def damping(self, now: float) -> float:
        """Rate at which all velocities fall [1/time]."""
        return self._settling.damping if self._settling and now < 0.0 else self._damping
