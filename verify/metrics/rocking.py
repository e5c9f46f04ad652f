"""Metrics of a body that rocks: its angle, peaks, impacts and what becomes of it, from its history."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from physics.rocking.motion import OVERTURNED, Verdict, impacts_of, settled_verdict
from verify.metrics.metric import MetricError, history_column, metric, run_name
from verify.metrics.motion import at_time

if TYPE_CHECKING:
    from cases import Case
    from verify.metrics.metric import RunData

#: numbers of the verdicts, in the order of falling safety
VERDICTS = (Verdict.SAFE, Verdict.AFTER_IMPACTS, Verdict.NO_IMPACT)
#: time between two records, in units of 1/p, above which a block comes down and goes up again unseen
COARSEST = 0.25


class Rocking(NamedTuple):
    """Time, angle, counter-clockwise, and its rate (n,) of the body that rocks [time], [rad], [rad/time]."""

    time: NDArray[np.float64]
    angle: NDArray[np.float64]
    rate: NDArray[np.float64]


def rocking_body(case: Case) -> str:
    """Name of the body that rocks; MetricError for a case without."""
    if case.rocking is None:
        raise MetricError(f"{case.name}: no body rocks; add the table rocking")
    return case.rocking.body


def rocking_of(run: RunData) -> Rocking:
    """The motion of the body that rocks, as the run recorded it."""
    body = rocking_body(run.case)
    angle = np.unwrap(history_column(run, f"{body}_angle"))
    return Rocking(history_column(run, "time"), angle, history_column(run, f"{body}_spin"))


def _with_impacts(run: RunData) -> Rocking:
    """The same; MetricError where the records are so far apart that they pass over impacts."""
    motion = rocking_of(run)
    from physics.rocking.of_case import block_of  # compiled: on use

    dynamics, records = run.case.dynamics, run.case.output.records
    assert dynamics is not None
    whole, frequency = dynamics.end_time - dynamics.start_time, block_of(run.case).frequency
    if whole * frequency > COARSEST * records:
        every = f"is recorded every {whole / records:.3g} {run.case.units.time}, in which its block may meet the ground"
        remedy = f"set output.records to {math.ceil(whole * frequency / COARSEST)} or more"
        raise MetricError(f"{run_name(run)}: {every}; {remedy}")
    return motion


def verdict_on(run: RunData) -> Verdict:
    """What becomes of the body; MetricError where the run ends before it is known.

    A block that has come to rest, or moves with less energy than the barrier where its centre stands over the corner,
    is safe as well.
    """
    time, angle, rate = _with_impacts(run)
    from physics.rocking.of_case import block_of, ground_motion  # compiled: on use

    case, block = run.case, block_of(run.case)
    ground_end = ground_motion(case).end
    verdict = settled_verdict(block, ground_end, time, angle, rate[-1])
    if verdict is not None:
        return verdict
    barrier = block.frequency**2 * (1.0 - math.cos(block.slenderness - abs(angle[-1])))
    if time[-1] >= ground_end and abs(angle[-1]) < block.slenderness and 0.5 * rate[-1] ** 2 < barrier:
        return Verdict.SAFE
    raise MetricError(f"{run_name(run)}: whether the body falls is open at its end, t = {time[-1]:g}; run it longer")


@metric("number", "what becomes of the body that rocks: 0 safe, 1 overturned after impacts, 2 without impact")
def verdict(run: RunData) -> float:
    """Number of the verdict (thesis Fig. 7.7)."""
    return float(VERDICTS.index(verdict_on(run)))


@metric("number", "impacts of the body that rocks")
def impacts(run: RunData) -> float:
    """Changes of the angle's sign that go on beyond a tenth of a degree."""
    return float(len(impacts_of(*_with_impacts(run)[:2])))


def _first_peak(run: RunData) -> int:
    """Row of the largest angle before the first impact, at which the body turns back."""
    time, angle, _ = _with_impacts(run)
    first = next(iter(impacts_of(time, angle)), math.inf)
    row = int(np.abs(angle[time <= first]).argmax())
    if row == len(angle) - 1 or abs(angle[row]) >= math.radians(OVERTURNED) * (1.0 - 1e-9):
        raise MetricError(f"{run_name(run)}: the angle has no peak; it grows until the end")
    return row


@metric("time", "first peak of the angle")
def first_peak_time(run: RunData) -> float:
    """Time of the largest angle before the first impact."""
    return float(_with_impacts(run).time[_first_peak(run)])


@metric("degree", "size of the first peak of the angle")
def first_peak_angle(run: RunData) -> float:
    """Largest angle before the first impact."""
    return abs(math.degrees(_with_impacts(run).angle[_first_peak(run)]))


@metric("time", "first impact")
def first_impact_time(run: RunData) -> float:
    """Time of the first change of the angle's sign that goes on beyond a tenth of a degree."""
    found = impacts_of(*_with_impacts(run)[:2])
    if not found:
        raise MetricError(f"{run_name(run)}: the body meets no impact")
    return found[0]


@metric("number", "energy at the second peak of free rocking over that at the first")
def energy_kept(run: RunData) -> float:
    """What an impact leaves, as a rigid block's potential energy at the largest angles before and after it."""
    time, angle, _ = _with_impacts(run)
    from physics.rocking.of_case import block_of, ground_motion  # compiled: on use

    block, start = block_of(run.case), ground_motion(run.case).end
    ends = np.searchsorted(time, [*impacts_of(time, angle), math.inf])
    size, peaks = np.abs(angle), []
    for first, last in pairwise(ends):
        row = int(first) + int(size[first:last].argmax())
        if time[row] > start and first < row < last - 1:
            peaks.append(math.cos(block.slenderness - size[row]) - math.cos(block.slenderness))
    if len(peaks) < 2:
        raise MetricError(f"{run_name(run)}: has no two peaks of free rocking with an impact between; run it longer")
    return peaks[1] / peaks[0]


@metric("time", "when the body lies")
def overturning_time(run: RunData) -> float:
    """First time at which the angle is that from which on a body counts as overturned."""
    time, angle, _ = rocking_of(run)
    beyond = np.flatnonzero(np.abs(angle) >= math.radians(OVERTURNED) * (1.0 - 1e-9))
    if not len(beyond):
        raise MetricError(f"{run_name(run)}: the angle stays below {OVERTURNED:g} degrees; run it longer")
    return float(time[beyond[0]])


@metric("degree", "largest angle")
def tilt(run: RunData, *, start: float, end: float, of: str = "") -> float:
    """Largest size of the angle between two times, of a region of the case or of the body that rocks."""
    return float(np.abs(_degrees_between(run, start, end, of)).max())


@metric("degree", "angle about which the body swings")
def mean_tilt(run: RunData, *, start: float, end: float) -> float:
    """Size of the mean angle between two times, of whole periods if the body swings on an elastic ground."""
    return abs(float(_degrees_between(run, start, end).mean()))


def _degrees_between(run: RunData, start: float, end: float, of: str = "") -> NDArray[np.float64]:
    """The angles recorded between two times [degrees]."""
    time = history_column(run, "time")
    angle = np.unwrap(history_column(run, f"{of or rocking_body(run.case)}_angle"))
    inside = (time >= start - 1e-12) & (time <= end + 1e-12)
    if not inside.any():
        raise MetricError(f"{run_name(run)}: records nothing from t = {start:g} to {end:g}")
    return np.degrees(angle[inside])


@metric("number", "relative error of the force that carries the body's weight")
def support_error(run: RunData, *, start: float, end: float) -> float:
    """Mean vertical force of contact between two times, less the change of momentum, against the weight."""
    from physics.rocking.of_case import block_of  # compiled: on use

    case, body, block = run.case, rocking_body(run.case), block_of(run.case)
    columns = [f"{body}_{name}_y" for name in ("impulse", "momentum")]
    impulse, momentum = (at_time(run, name, end) - at_time(run, name, start) for name in columns)
    weight = block.mass * case.plane.thickness * block.gravity
    return abs((impulse - momentum) / (end - start) / weight - 1.0)


@metric("length", "how far beyond the block's edge the corner lies about which it rocks freely")
def base_offset(run: RunData) -> float:
    """Size of that distance, from the balance of energy between the first two impacts behind the ground's motion.

    Free on a corner at a distance b beside the centre, the rate r and the angle a keep
    (I/m + h² + b²) r²/2 + g (h cos a + b sin |a|), h half of the height: b is fitted where the angle is beyond half of
    its peak.
    """
    time, angle, rate = _with_impacts(run)
    from physics.rocking.of_case import block_of, ground_motion  # compiled: on use

    block, end = block_of(run.case), ground_motion(run.case).end
    found = [impact for impact in impacts_of(time, angle) if impact > end]
    if not found:
        raise MetricError(f"{run_name(run)}: no impact follows the ground's motion; run it longer")
    free = (time > found[0]) & (time < (found[1] if len(found) > 1 else math.inf))
    size = np.abs(angle)
    chosen = free & (size > 0.5 * size[free].max())
    half_width, half_height = 0.5 * block.width, 0.5 * block.height
    turning = block.inertia / block.mass + half_height**2 + half_width**2
    kept = 0.5 * turning * rate[chosen] ** 2 + block.gravity * half_height * np.cos(angle[chosen])
    terms = np.column_stack([-block.gravity * np.sin(size[chosen]), np.ones(int(chosen.sum()))])
    return abs(float(np.linalg.lstsq(terms, kept, rcond=None)[0][0]) - half_width)


@metric("length", "how far beside the block's corner the force passes that holds it while it rocks freely")
def force_offset(run: RunData) -> float:
    """Size of that distance between the first two impacts behind the ground's motion, where the angle is beyond half of
    its peak: the moment of the impulses about the corner over the upright one, from the changes of momentum and spin.

    A block that trembles on its corner, or whose corner sinks, has its place by this and not by its energy.
    """
    time, angle, rate = _with_impacts(run)
    from physics.rocking.of_case import block_of, ground_motion  # compiled: on use

    case, block, body = run.case, block_of(run.case), rocking_body(run.case)
    found = [impact for impact in impacts_of(time, angle) if impact > ground_motion(case).end]
    if not found:
        raise MetricError(f"{run_name(run)}: no impact follows the ground's motion; run it longer")
    free = (time > found[0]) & (time < (found[1] if len(found) > 1 else math.inf))
    beyond = np.flatnonzero(free & (np.abs(angle) > 0.5 * np.abs(angle[free]).max()))
    rows = slice(beyond[0], beyond[-1] + 1)
    momentum_x, momentum_y = (history_column(run, f"{body}_momentum_{axis}")[rows] for axis in "xy")
    mass = block.mass * case.plane.thickness
    push_x, push_y = np.diff(momentum_x), np.diff(momentum_y) + mass * block.gravity * np.diff(time[rows])
    side, middle = -np.sign(angle[beyond[0]]), 0.5 * (angle[rows][1:] + angle[rows][:-1])
    # from the centre of mass to the corner
    to_x = 0.5 * (side * block.width * np.cos(middle) + block.height * np.sin(middle))
    to_y = 0.5 * (side * block.width * np.sin(middle) - block.height * np.cos(middle))
    turned = block.inertia * case.plane.thickness * float(rate[rows][-1] - rate[rows][0])
    return abs((turned - float(to_x @ push_y - to_y @ push_x)) / float(push_y.sum()))
