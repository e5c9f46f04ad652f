"""What becomes of a rocking body: its angle over time, impacts and the verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from physics.rocking.block import Block

#: angle from which on a body counts as overturned [degrees] (thesis 7.3.2.1)
OVERTURNED = 85.0
#: an impact is a change of the angle's sign that goes on beyond this [degrees]
IMPACT_ANGLE = 0.1
#: impacts of the free motion after which a block that still stands is safe (thesis 7.3.2.1)
SAFE_IMPACTS = 2
#: energy over the barrier with which the fall of a block that deforms is settled, as a share of the barrier
MARGIN = 0.05
#: energy below the barrier with which a block that swings back is safe, as a share of the barrier: what it stands on may
#: be a tenth narrower than its base
SAFE_MARGIN = 0.2
#: and the angle, over that at which the centre stands over the corner
NO_RETURN = 1.5


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
    """Motion of a block.

    Attributes
    ----------
    time : (n,) [s]; angle : (n,) [rad], positive towards +x; rate : (n,) [rad/s].
    verdict : how it ends; ``settled`` is the time from which on nothing could change it [s].
    impacts : times of impacts [s].
    place : (n, 2) of the centre from the middle of the base, in the frame of the ground [m]; velocity : (n, 2) [m/s].
    """

    time: NDArray[np.float64]
    angle: NDArray[np.float64]
    rate: NDArray[np.float64]
    verdict: Verdict
    settled: float
    impacts: list[float]
    place: NDArray[np.float64]
    velocity: NDArray[np.float64]


def verdict_of(overturned: bool, impacts: int) -> Verdict:
    """The verdict on a motion."""
    if not overturned:
        return Verdict.SAFE
    return Verdict.AFTER_IMPACTS if impacts else Verdict.NO_IMPACT


def impacts_of(time: ArrayLike, angle: ArrayLike) -> list[float]:
    """Times at which an angle over time (n,) [rad] changes its sign and goes on beyond `IMPACT_ANGLE`."""
    times, angles = np.asarray(time, dtype=float), np.asarray(angle, dtype=float)
    beyond = np.flatnonzero(np.abs(angles) > math.radians(IMPACT_ANGLE))
    changes = np.flatnonzero(angles[beyond[:-1]] * angles[beyond[1:]] < 0.0)
    found = []
    for before, after in zip(beyond[changes], beyond[changes + 1], strict=True):
        # the last zero on the way
        last = before + np.flatnonzero(angles[before:after] * angles[after] <= 0.0)[-1]
        share = angles[last] / (angles[last] - angles[last + 1])
        found.append(float(times[last] + share * (times[last + 1] - times[last])))
    return found


def settled_verdict(block: Block, ground_end: float, time: ArrayLike, angle: ArrayLike, rate: float) -> Verdict | None:
    """The verdict on a motion so far, None where it is still open.

    It is settled where the block has fallen; or the ground rests, and the block has met it `SAFE_IMPACTS` times since
    then, or swings back with less energy than the barrier where its centre stands over the corner, by `SAFE_MARGIN`, or
    moves outward beyond `NO_RETURN` or with more energy than the barrier, by `MARGIN`: the base of a block that deforms
    is not quite its width.

    Parameters
    ----------
    time, angle : (n,) of the motion so far [s], [rad]; rate : at its end [rad/s].
    ground_end : time from which on the ground rests [s].
    """
    impacts, last = impacts_of(time, angle), float(np.asarray(angle)[-1])
    if abs(last) >= math.radians(OVERTURNED) * (1.0 - 1e-9):
        return verdict_of(True, len(impacts))
    if float(np.asarray(time)[-1]) < ground_end:
        return None
    if sum(impact > ground_end for impact in impacts) >= SAFE_IMPACTS:
        return Verdict.SAFE
    alpha, square = block.slenderness, block.frequency**2
    energy, barrier = 0.5 * rate**2 - square * (1.0 - math.cos(alpha - abs(last))), square * (1.0 - math.cos(alpha))
    if abs(last) <= math.radians(IMPACT_ANGLE):
        return None
    if last * rate > 0.0:
        beyond = abs(last) > NO_RETURN * alpha or energy > MARGIN * barrier
        return verdict_of(True, len(impacts)) if beyond else None
    return Verdict.SAFE if energy < -SAFE_MARGIN * barrier and abs(last) < alpha else None
