"""Metrics of moving bodies: how cracks start, run and branch, and what they leave."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

import numpy as np

from physics.broken import BROKEN
from physics.waves import rayleigh_speed
from verify.metrics import crack_front
from verify.metrics.crack_front import Branch
from verify.metrics.crack_path import TORN_WIDTH_OF_HISTORY, path_angle, reach_of_history
from verify.metrics.curves import Array
from verify.metrics.metric import DIRECTION, MetricError, metric, require_stored, run_name

if TYPE_CHECKING:
    from cases import Case
    from verify.metrics.metric import RunData

AXES = {"x": 0, "y": 1}
#: phase field below which something is at least damaged
WHOLE = 1.0 - 1e-6
#: side of the smallest square, in length scales, that counts as a piece between cracks and not as a gap in one
ENCLOSED = 4.0


def _points(run: RunData, at: float | None = None) -> Any:
    """Point data of the snapshot of a time, of the last one without; MetricError where there is none of that time."""
    if at is not None:
        require_stored(run, run.nearest(at), at)
    return run.points(at).point_data


def _plane(data: Any) -> Array:
    return np.asarray(data["reference"])[:, :2]


def _broken_at(run: RunData) -> tuple[Any, Array]:
    data = _points(run)
    if "broken_at" not in data:
        raise MetricError(f"{run_name(run)}: does not tell when its points broke; ask this of dynamic cases")
    return data, np.asarray(data["broken_at"])


@functools.lru_cache(maxsize=8)
def branches_of(run: RunData, until: float = np.inf) -> list[Branch]:
    """Branches of the crack that ran during a dynamic run, the longest first; none where nothing broke.

    until : leave out what broke later.
    """
    data, broken_at = _broken_at(run)
    start, notch = _notch(run.case)
    there = broken_at <= until
    phase_field = np.where(there | np.isinf(until), data["phase_field"], 1.0)
    when = np.where(there, broken_at, np.nan)
    reach = None if notch is None else reach_of_history(run.case, notch, TORN_WIDTH_OF_HISTORY)
    return crack_front.branches(_plane(data), phase_field, when, run.case.mesh.h, start, notch, BROKEN, reach)


def _notch(case: Case) -> tuple[Array | None, Array | None]:
    """End of the only notch, and the whole of it where it is part of the phase field."""
    if len(case.all_notches) != 1:
        return None, None
    only = case.all_notches[0]
    whole = np.array([only.start, only.end], dtype=float)
    return whole[1], whole if only.kind == "history" else None


def _of_branches(run: RunData) -> list[Branch]:
    found = branches_of(run)
    if not found:
        raise MetricError(f"{run_name(run)}: has no running crack, nothing broke; load it longer")
    return found


@metric("time", "when the crack set out")
@functools.lru_cache(maxsize=8)
def initiation_time(run: RunData) -> float:
    """Time at which a point broke that is a length scale or more away from what was broken at the start."""
    data, broken_at = _broken_at(run)
    points = _plane(data)
    late = broken_at > 0.0
    if (broken_at == 0.0).any():
        from scipy.spatial import cKDTree

        distance, _ = cKDTree(points[broken_at == 0.0]).query(points)
        late &= distance >= _length_scale(run.case)
    if not late.any():
        raise MetricError(f"{run_name(run)}: has no running crack, nothing broke; load it longer")
    return float(broken_at[late].min())


def _length_scale(case: Case) -> float:
    return min(m.fracture.length_scale for m in case.materials.values() if m.fracture is not None)


@metric("energy", "elastic energy when the crack set out")
def stored_energy_at_initiation(run: RunData) -> float:
    """Elastic energy when the crack set out."""
    history = run.history
    return float(np.interp(initiation_time(run), history["time"], history["E_el"]))


@metric("time", "when the tip first divided")
def branching_time(run: RunData) -> float:
    """Time at which the tip first divided."""
    time = crack_front.branching_time(_of_branches(run))
    if not np.isfinite(time):
        raise MetricError(f"{run_name(run)}: its crack does not branch; load it longer or higher")
    return time


@metric("degree", "angle between the two longest branches")
def branching_angle(run: RunData, *, length: float) -> float:
    """Angle between the two longest branches over a length behind their parting."""
    return crack_front.branching_angle(_of_branches(run), length, run.case.mesh.h)


@metric("degree", "direction of the longest branch", period=DIRECTION)
def branch_angle(run: RunData) -> float:
    """Direction of the longest branch in degrees from the x axis, -180 to 180."""
    return path_angle(_of_branches(run)[0].points)


@metric("degree", "direction from the notch to the crack's tip", period=DIRECTION)
def crack_direction(run: RunData, *, until: float = np.inf) -> float:
    """Direction in degrees from the x axis, -180 to 180, from the notch's end to the tip of the crack there at a time.

    The tip is the point farthest from the notch's end of those beyond it that broke in the run.
    """
    if len(run.case.all_notches) != 1:
        notches = f"has {len(run.case.all_notches)} notches, not one to run from"
        raise MetricError(f"{run_name(run)}: {notches}; ask for branch_angle")
    (notch,) = run.case.all_notches
    data, broken_at = _broken_at(run)
    away = _plane(data)[(broken_at > 0.0) & (broken_at <= until)] - np.asarray(notch.end)
    away = away[away @ np.subtract(notch.end, notch.start) > 0.0]
    if not len(away):
        raise MetricError(f"{run_name(run)}: nothing broke beyond its notch; load it longer")
    x, y = away[np.argmax(np.hypot(*away.T))]
    return float(np.degrees(np.arctan2(y, x)))


@metric("number", "tips that the crack came to have")
def branch_count(run: RunData, *, until: float = np.inf) -> float:
    """Number of tips that the crack came to have by a time."""
    return float(len(branches_of(run, until)))


@metric("number", "pieces that branches enclose by running into cracks")
def enclosed_pieces(run: RunData, *, until: float = np.inf) -> float:
    """Number of pieces that cracks enclose by a time: meetings of a branch with another one's crack."""
    data, broken_at = _broken_at(run)
    least = (ENCLOSED * _length_scale(run.case)) ** 2
    return float(crack_front.enclosed(_plane(data), broken_at <= until, run.case.mesh.h, least))


@metric("velocity", "largest speed of a crack tip")
def tip_speed(run: RunData, *, interval: float, count: float = 5, over_rayleigh: float = 0) -> float:
    """Largest speed of a tip: lines fitted to `count` positions in a row, `interval` apart in time (Borden et al. 2012).

    over_rayleigh : 1 for the speed in units of that of Rayleigh waves.
    """
    speeds = [branch.speed(interval, int(count))[1] for branch in _of_branches(run)]
    largest = max((float(speed.max()) for speed in speeds if len(speed)), default=float("nan"))
    return largest / rayleigh_speed_of(run.case) if over_rayleigh else largest


def rayleigh_speed_of(case: Case) -> float:
    """Rayleigh speed of the material that breaks, of the slowest one where there are several."""
    breakable = [m for m in case.materials.values() if m.fracture is not None and m.density is not None]
    if not breakable:
        raise MetricError(f"case {case.name}: has no material that moves and breaks")
    return min(map(rayleigh_speed, breakable))


@metric("number", "connected pieces of unbroken material")
def fragments(run: RunData, *, least_share: float = 1e-3) -> float:
    """Number of connected pieces of unbroken points, those below a share of their body's volume left out."""
    data = _points(run)
    return float(
        crack_front.fragments(
            _plane(data), np.asarray(data["volume"]), run.case.plane.thickness, np.asarray(data["body"]),
            np.asarray(data["phase_field"]) < BROKEN, least_share,
        )
    )  # fmt: skip


#: width of a band of broken material, in length scales, above which it holds more than one crack
CONE = 8.0


@metric("number", "1 where a cone formed under an impact, else 0")
def cone_index(run: RunData, *, level: float, middle: float, within: float) -> float:
    """1 where a cone has formed under an impact along y at x = middle, 0 where there is a median crack or none.

    A cone's flanks leave broken points on both sides of the middle at a height y = level, further apart than one crack
    is wide. within : distance from the middle [length] beyond which cracks are others, such as those of bending.
    """
    data, h = _points(run), run.case.mesh.h
    away = _plane(data) - (middle, level)
    near = (np.asarray(data["phase_field"]) < BROKEN) & (np.abs(away) < (within, h)).all(axis=1)
    lengths = [m.fracture.length_scale for m in run.case.materials.values() if m.fracture]
    return float(near.any() and float(np.ptp(away[near, 0])) > CONE * max(lengths))


@metric("number", "largest difference from the mirror image")
def asymmetry(run: RunData, *, direction: str, middle: float, at: float | None = None) -> float:
    """Largest difference of the phase field at points and their mirror images, at a time or at the end.

    direction : "x" or "y", the coordinate that is mirrored about `middle`.
    """
    if direction not in AXES:
        raise MetricError(f"metric asymmetry: direction = {direction!r} is not known; give 'x' or 'y'")
    _require_mirrored_bodies(run.case, AXES[direction], middle)
    data = _points(run, at)
    phase_field = np.asarray(data["phase_field"])
    if not phase_field.min() < WHOLE:
        raise MetricError(f"{run_name(run)}: has no crack that could be asymmetric; load it longer")
    return crack_front.asymmetry(_plane(data), phase_field, AXES[direction], middle)


def _require_mirrored_bodies(case: Case, axis: int, middle: float) -> None:
    """MetricError where the bodies that break do not lie on both sides of a line alike."""
    bounds = [body.bounds() for body in case.bodies.values() if case.materials[body.material].fracture]
    if not bounds:
        raise MetricError(f"case {case.name}: no body can break, so that nothing is asymmetric")
    places = [corner[axis] for pair in bounds for corner in pair]
    there = 0.5 * (min(places) + max(places))
    if abs(there - middle) > case.mesh.h:
        said = f"its bodies have their middle at {'xy'[axis]} = {there:g}, not at {middle:g}"
        raise MetricError(f"case {case.name}: {said}; give middle = {there:g}")


@metric("number", "share of time that the phase field took")
def phase_field_share(run: RunData) -> float:
    """Share of the stepping time that the phase field took."""
    if not run.case.fracture_enabled:
        raise MetricError(f"{run_name(run)}: has no phase field, since nothing can break")
    seconds = run.info.get("seconds", {})
    parts = {name: seconds.get(name, 0.0) for name in ("phase_field", "increments")}
    if not parts["increments"]:
        raise MetricError(f"{run_name(run)}: tells no seconds of its steps; run it again")
    return parts["phase_field"] / parts["increments"]
