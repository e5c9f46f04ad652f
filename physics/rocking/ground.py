"""Accelerations of the ground: pulses by their formulas, and records given as tables."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

#: shapes of a pulse: a cycle of "sine" and "cosine" is a whole period, of "half_sine" half of one; "ricker" is the
#: wavelet about the middle of one period, cut where it has fallen below 4e-3 of its height
PULSES = ("sine", "half_sine", "cosine", "ricker")
RECORD = len(PULSES)


class GroundMotion(NamedTuple):
    """Horizontal acceleration of the ground over time, as compiled loops take it.

    Attributes
    ----------
    kind : number of the shape in `PULSES`, or `RECORD`.
    amplitude : of a pulse [m/s²]. end : the ground rests afterwards [s]. cycles : of a pulse until then.
    times, accelerations : (n,) samples of a record [s], [m/s²], linear between them; (0,) of a pulse.
    """

    kind: int
    amplitude: float
    end: float
    cycles: float
    times: NDArray[np.float64]
    accelerations: NDArray[np.float64]

    def breaks(self) -> NDArray[np.float64]:
        """Times (m,) at which the acceleration is not smooth [s]."""
        return self.times if self.kind == RECORD else np.array([0.0, self.end])

    def acceleration(self, times: ArrayLike) -> NDArray[np.float64]:
        """Acceleration (n,) [m/s²] at times (n,) [s]."""
        return _accelerations(self, np.atleast_1d(np.asarray(times, dtype=float)))


def pulse(shape: str, amplitude: float, circular_frequency: float, cycles: int = 1) -> GroundMotion:
    """A pulse of largest acceleration ``amplitude`` [m/s²] and the circular frequency of its period [rad/s]."""
    end = cycles * (1.0 if shape == "half_sine" else 2.0) * math.pi / circular_frequency
    return GroundMotion(PULSES.index(shape), amplitude, end, float(cycles), np.zeros(0), np.zeros(0))


def record(times: ArrayLike, accelerations: ArrayLike) -> GroundMotion:
    """A measured motion: accelerations (n,) [m/s²] at increasing times (n,) [s], counted from the first of them."""
    samples = np.asarray(times, dtype=float)
    samples = samples - samples[0]
    return GroundMotion(RECORD, 1.0, float(samples[-1]), 1.0, samples, np.asarray(accelerations, dtype=float))


def cut(motion: GroundMotion, start: float, end: float | None = None) -> GroundMotion:
    """The part of a record between two times [s], counted from the first of them."""
    last = motion.end if end is None else min(end, motion.end)
    inside = (motion.times > start) & (motion.times < last)
    times = np.concatenate([[start], motion.times[inside], [last]])
    return record(times, np.interp(times, motion.times, motion.accelerations))


@njit(cache=True)
def acceleration(ground, time):
    """Acceleration [m/s²] at one time [s]; zero before 0, after the end and of a ground that never moves."""
    if time < 0.0 or time > ground.end or ground.end == 0.0:
        return 0.0
    phase = time / ground.end
    if ground.kind == 0:
        return ground.amplitude * math.sin(2.0 * math.pi * ground.cycles * phase)
    if ground.kind == 1:
        return ground.amplitude * math.sin(math.pi * ground.cycles * phase)
    if ground.kind == 2:
        return ground.amplitude * math.cos(2.0 * math.pi * ground.cycles * phase)
    if ground.kind == 3:
        square = (2.0 * math.pi * (phase - 0.5)) ** 2
        return ground.amplitude * (1.0 - square) * math.exp(-0.5 * square)
    # np.interp takes two seconds longer to compile
    behind = max(1, np.searchsorted(ground.times, time))
    start, first, last = ground.times[behind - 1], ground.accelerations[behind - 1], ground.accelerations[behind]
    return first + (time - start) * (last - first) / (ground.times[behind] - start)


@njit(cache=True)
def _accelerations(ground, times):
    found = np.empty(len(times))
    for number, time in enumerate(times):
        found[number] = acceleration(ground, time)
    return found


def response_spectrum(
    ground: GroundMotion, periods: ArrayLike, damping: float = 0.05, step: float = 0.005
) -> NDArray[np.float64]:
    """Pseudo-acceleration (n,) [m/s²] of linear oscillators of the periods (n,) [s] with a share of critical damping.

    Exact for an acceleration that is linear over every ``step`` [s] (Nigam and Jennings 1969); the free motion after the
    ground has come to rest is followed for two periods.
    """
    largest = []
    for period in np.atleast_1d(np.asarray(periods, dtype=float)):
        samples = ground.acceleration(np.arange(0.0, ground.end + 2.0 * period, step))
        largest.append(_largest_response(samples, step, 2.0 * np.pi / period, damping))
    return np.array(largest)


def _largest_response(samples: NDArray, step: float, omega: float, damping: float) -> float:
    """x'' + 2 zeta omega x' + omega² x = -a, discretised exactly for an a that is linear within a step."""
    from scipy.signal import lfilter  # a second to import, and only spectra need it

    system = np.zeros((4, 4))
    system[:2, :2] = [[0.0, 1.0], [-(omega**2), -2.0 * damping * omega]]
    system[1, 2], system[2, 3] = -1.0, 1.0
    whole = expm(system * step)
    free, after = whole[:2, :2], whole[:2, 3] / step
    before = whole[:2, 2] - after
    numerator = [
        after[0],
        before[0] - free[1, 1] * after[0] + free[0, 1] * after[1],
        free[0, 1] * before[1] - free[1, 1] * before[0],
    ]
    displacement = lfilter(numerator, [1.0, -np.trace(free), np.linalg.det(free)], samples)
    return float(omega**2 * np.abs(displacement).max())
