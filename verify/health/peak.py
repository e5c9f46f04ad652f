"""What increments and moving points cost the force of a run at rest: a peak between two, a crack that lags, crossings."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from verify.metrics.histories import missing_energy

#: a force that falls below this share of what it was has no course that could be carried back
_FALLEN = 0.5
#: rows of a history by which a course is carried on: a parabola, so that a smooth peak keeps its height
_ROWS = 3
#: places between two increments at which both courses are compared
_PLACES = 50


def missed_peak(history: pd.DataFrame) -> float:
    """Share by which the largest force may be larger between two increments; 0 where nothing breaks behind it.

    The force's courses before and behind are carried on until they meet, or up to the next increment where it falls.
    """
    force, load = np.abs(history["F"].to_numpy(float)), history["u"].to_numpy(float)
    peak, whole = int(force.argmax()), history["c_min"].to_numpy(float)
    if peak + 1 >= len(force) or not force[peak] > 0.0 or not whole[peak + 1] < whole[peak]:
        return 0.0
    between = [_highest_between(load, force, row) for row in (peak - 1, peak) if row > 0]
    return max([0.0, *(highest / force[peak] - 1.0 for highest in between)])


def _highest_between(load: NDArray, force: NDArray, row: int) -> float:
    """Largest force that is likely between a row and the next one; 0 where the load turns there."""
    before, behind = slice(max(0, row + 1 - _ROWS), row + 1), slice(row + 1, row + 1 + _ROWS)
    if not _one_way(load[before.start : row + 2]):
        return 0.0
    places = np.linspace(load[row], load[row + 1], _PLACES)
    courses = [_carried_on(load[before], force[before], places)]
    if force[row + 1] > _FALLEN * force[row] and len(load[behind]) > 1 and _one_way(load[row:][: 1 + _ROWS]):
        courses.append(_carried_on(load[behind], force[behind], places))
    return float(np.min(courses, axis=0).max())


def _one_way(load: NDArray) -> bool:
    steps = np.diff(load)
    return bool(np.all(steps > 0.0) or np.all(steps < 0.0))


def _carried_on(load: NDArray, force: NDArray, places: NDArray) -> NDArray:
    """The polynomial through some rows, at other places."""
    middle, scale = load.mean(), np.ptp(load)
    coefficients = np.polyfit((load - middle) / scale, force, len(load) - 1)
    return np.polyval(coefficients, (places - middle) / scale)


def lagging_crack(history: pd.DataFrame) -> float:
    """Share by which the largest force is too large because the crack lags behind a load that goes on before it rests.

    What of the work done by then no state holds has driven the crack beside the toughness, and the force grows with the
    root of both.
    """
    peak = int(np.abs(history["F"].to_numpy(float)).argmax())
    lost = max(0.0, -float(missing_energy(history)[peak]))
    torn = float(history["E_frac"].iloc[peak] - history["E_frac"].iloc[0])
    return float(np.sqrt(1.0 + lost / torn) - 1.0) if torn > 0.0 else 0.0


def lost_at_crossings(history: pd.DataFrame, energy: float) -> float:
    """Energy that is lost while nothing breaks, over another one: what points leave behind in their old cells.

    Only increments count whose force falls behind its course: there a trapezoid tells less work than was done.
    """
    load, force = (np.diff(history[name].to_numpy(float)) for name in ("u", "F"))
    slope = np.divide(force, load, out=np.zeros(len(load)), where=load != 0.0)
    falls = (load[1:] * load[:-1] > 0.0) & (slope[1:] < slope[:-1])
    lost = np.maximum(-np.diff(missing_energy(history))[1:], 0.0)
    return float(lost[falls].sum() / energy) if energy > 0.0 else 0.0
