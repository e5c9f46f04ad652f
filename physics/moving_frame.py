"""What acts on every body of a dynamic case alike: gravity, the motion of its frame, damping."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cases import Case
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
        self._gravity = np.array(dynamics.gravity, float)
        self._damping, self._settling = dynamics.damping, dynamics.settling
        self._ground = ground_motion(case) if dynamics.ground else None
        self._direction = np.eye(2)["xy".index(dynamics.ground.direction)] if dynamics.ground else np.zeros(2)
        self.at_rest = not self._gravity.any() and self._ground is None

    def acceleration(self, now: float) -> NDArray[np.float64]:
        """Of all free bodies (2,) [length/time²]."""
        return self.accelerations(np.array([now]))[0]  # type: ignore[no-any-return]

    def accelerations(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of all free bodies (n, 2) at times (n,): gravity, ramped in the settling, less the ground's (D'Alembert)
        [length/time²]."""
        value = np.tile(self._gravity, (len(times), 1))
        if self._settling and self._settling.ramp > 0.0:
            value *= np.clip((times + self._settling.duration) / self._settling.ramp, 0.0, 1.0)[:, None]
        if self._ground is not None:
            value -= self._ground.acceleration(times)[:, None] * self._direction
        return value

    def damping(self, now: float) -> float:
        """Rate at which all velocities fall [1/time]."""
        return float(self.dampings(np.array([now]))[0])

    def dampings(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """The same (n,) at times (n,)."""
        if self._settling is None:
            return np.full(len(times), self._damping)
        return np.where(times < 0.0, self._settling.damping, self._damping)
