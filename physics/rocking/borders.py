"""Where the verdict on a block changes with the amplitude of a pulse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from physics.rocking.motion import Verdict


@dataclass(frozen=True)
class Border:
    """A change of the verdict at an ``amplitude``, with the verdicts ``below`` and ``above`` it."""

    amplitude: float
    below: Verdict
    above: Verdict


def borders(verdict_at: Callable[[float], Verdict], amplitudes: ArrayLike, tolerance: float = 1e-4) -> list[Border]:
    """All changes of the verdict between neighbouring amplitudes (n,), each bisected to a relative tolerance.

    A band narrower than the distance of the amplitudes can be missed.
    """
    levels = np.asarray(amplitudes, dtype=float)
    verdicts = [verdict_at(level) for level in levels]
    found = []
    for low, high, below, above in zip(levels, levels[1:], verdicts, verdicts[1:], strict=False):
        while below is not above:
            border = _bisected(verdict_at, low, high, below, above, tolerance)
            found.append(border)
            # behind it there may be another verdict than at the next amplitude
            low, below = border.amplitude * (1.0 + tolerance), border.above
    return found


def _bisected(
    verdict_at: Callable[[float], Verdict], low: float, high: float, below: Verdict, above: Verdict, tolerance: float
) -> Border:
    while high - low > tolerance * high:
        middle = 0.5 * (low + high)
        verdict = verdict_at(middle)
        if verdict is below:
            low = middle
        else:
            high, above = middle, verdict
    return Border(0.5 * (low + high), below, above)
