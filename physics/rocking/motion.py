"""What becomes of a rocking body: its angle over time, impacts and the verdict."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

#: angle from which on a body counts as overturned [degrees] (thesis 7.3.2.1)
OVERTURNED = 85.0


class Verdict(StrEnum):
    """How the motion ends (thesis Fig. 7.7)."""

    SAFE = "safe"
    AFTER_IMPACTS = "overturned after impacts"
    NO_IMPACT = "overturned without impact"

    @property
    def overturned(self) -> bool:
        """Whether the body falls."""
        return self is not Verdict.SAFE


@dataclass(frozen=True)
class RockingMotion:
    """Angle of a body over time.

    Attributes
    ----------
    time : (n,) [s]; angle : (n,) [rad], positive towards +x; rate : (n,) [rad/s].
    impacts : times of impacts [s].
    verdict : how it ends; ``settled`` is the time from which on nothing could change it [s].
    """

    time: NDArray[np.float64]
    angle: NDArray[np.float64]
    rate: NDArray[np.float64]
    verdict: Verdict
    settled: float
    impacts: list[float] = field(default_factory=list)


def verdict_of(overturned: bool, impacts: int) -> Verdict:
    """The verdict on a motion."""
    if not overturned:
        return Verdict.SAFE
    return Verdict.AFTER_IMPACTS if impacts else Verdict.NO_IMPACT
