"""Metrics of crack paths of one run or two, of the J-integral at the tip, and of the energy of a crack's surface."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cases.geometry import SAME_LINE
from cases.solvers import IMPORTED
from physics.broken import BROKEN
from physics.surface_energy import SurfaceEnergy
from verify.metrics import crack_path as paths
from verify.metrics.curves import Array
from verify.metrics.metric import LINE, MetricError, NotGivenError, metric, run_name
from verify.metrics.release import release_rate

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cases import Case
    from verify.metrics.metric import RunData


def _crack(run: RunData) -> Array:
    path = np.asarray(run.crack_path, dtype=float)
    _require_path_given(run)
    if len(path) < 2:
        raise MetricError(f"{run_name(run)}: has no crack path, {_why_none(run)}")
    return path


def _why_none(run: RunData) -> str:
    """Nothing broke, or what broke is no line: a tracer sees none that is not longer than twice its width."""
    if "c_min" in run.history and float(run.history["c_min"].iloc[-1]) < BROKEN:
        return "what broke beside notches is no longer than it is wide; load it further, or make the length scale smaller"
    return "nothing broke; load it further"


def _require_path_given(run: RunData) -> None:
    """No path means that nothing broke, but of a result from elsewhere that none came with it."""
    if run.info.get("solver") == IMPORTED and not len(run.crack_path):
        raise NotGivenError(f"{run_name(run)}: came without a crack path; give one as a CSV file with the columns x,y")


# --- shape ----------------------------------------------------------------------------------------


@metric("length", "length of the crack path")
def crack_length(run: RunData) -> float:
    """Length of the crack path, 0 where nothing broke or what broke is no longer than it is wide.

    Notches are no part of it; a line on which a constraint holds the phase field broken is.
    """
    _require_path_given(run)
    return paths.path_length(np.asarray(run.crack_path, dtype=float).reshape(-1, 2))


@metric("degree", "overall direction of the crack path", period=LINE)
def crack_angle(run: RunData) -> float:
    """Degrees from the x axis, -180 to 180, from start to tip; compared as a line, which has no sense.

    Notches are no part of it; a line on which a constraint holds the phase field broken is.
    """
    return paths.path_angle(_crack(run))


@metric("degree", "direction of the crack in a layer", period=LINE)
def crack_angle_in_layer(run: RunData, *, lower: float, upper: float) -> float:
    """Direction of the part of the crack between two heights y [length]: degrees from the x axis, 0 to 180."""
    path = _crack(run)
    even = paths.resample(path, paths.path_length(path) / 400)
    part = even[(even[:, 1] >= lower) & (even[:, 1] <= upper)]
    if len(part) < 3:
        raise MetricError(f"{run_name(run)}: no crack between y = {lower:g} and {upper:g}; load it further")
    return paths.path_angle(part) % 180.0


@metric("degree", "crack path from the nearest weak direction")
def angle_off_weak_direction(run: RunData, *, material: str = "") -> float:
    """Degrees, 0 to 90, from the crack path to the nearest direction of the material's least surface energy."""
    energy = _surface_energy(run, material)
    (least, _), (largest, _) = energy.extremes()
    if math.isclose(least, largest, rel_tol=1e-6):
        raise MetricError(f"{run_name(run)}: its material has no weak direction; judge the crack_angle")
    off = paths.path_angle(_crack(run)) - np.degrees(energy.weak_directions())
    return float(np.abs((off + 90.0) % 180.0 - 90.0).min())


@metric("length", "x of the crack tip")
def tip_x(run: RunData) -> float:
    """Of the last vertex of the crack path."""
    return float(paths.tip_position(_crack(run))[0])


@metric("length", "y of the crack tip")
def tip_y(run: RunData) -> float:
    """Of the last vertex of the crack path."""
    return float(paths.tip_position(_crack(run))[1])


# --- energy of a surface, and its release ---------------------------------------------------------


@metric("toughness", "J-integral around the tip")
def energy_release_rate(
    run: RunData, *, inner: float, outer: float, tip: Sequence[float] | None = None,
    direction: Sequence[float] | None = None, share: float = 1 / 3,
) -> float:  # fmt: skip
    """Mean of J over the last share of the snapshots, around the crack's tip in each of them, of bodies at rest.

    Pressure on faces and body forces count.

    inner, outer : half sizes of the boxes of ``verify.metrics.energy_release``. tip : where the crack does not grow;
    otherwise the tip is traced, and where nothing broke it is the end of the only notch. direction : in which the crack
    grows; otherwise that of its last part, as long as `outer`, and where nothing broke that of the only notch.
    """
    snapshots = list(run.snapshots())
    if not snapshots:
        raise NotGivenError(f"{run_name(run)}: has no snapshots; name some in output.snapshots")
    last = snapshots[-math.ceil(share * len(snapshots)) :]
    _require_rest(run, [step for _, step, _ in last])
    return float(np.mean([_release_rate(u, points, run.case, inner, outer, tip, direction) for u, _, points in last]))


#: kinetic energy over the elastic one from which on inertia has a part in a release rate
_MOVING = 0.01


def _require_rest(run: RunData, steps: Sequence[int]) -> None:
    if not run.case.dynamics:
        return
    rows = run.history[run.history["step"].isin(steps)]
    moving = float((rows["E_kin"] / rows["E_el"]).max())
    if moving > _MOVING:
        said = f"the kinetic energy is {moving:.2g} of the elastic one, and inertia has no part in the integral"
        raise MetricError(f"{run_name(run)}: {said}; ask for energies, or for a body that has come to rest")


def _release_rate(
    load: float, points: Any, case: Case, inner: float, outer: float,
    tip: Sequence[float] | None, direction: Sequence[float] | None,
) -> float:  # fmt: skip
    data = points.point_data
    reference = np.asarray(data["reference"])[:, :2]
    at, along = (None if given is None else np.asarray(given, dtype=float) for given in (tip, direction))
    if at is None or along is None:
        start, end = _last_part(reference, np.asarray(data["phase_field"]), case, outer)
        at, along = end if at is None else at, end - start if along is None else along
    return release_rate(data, case, load, at, along, inner, outer)


def _last_part(reference: Array, phase_field: Array, case: Case, length: float) -> tuple[Array, Array]:
    """Start and tip of the last part of a length of the crack, its notch included where there is one only."""
    path = paths.trace_case_crack(reference, phase_field, case).points
    if len(case.all_notches) == 1:
        notch = np.array([case.all_notches[0].start, case.all_notches[0].end], dtype=float)
        goes_on = len(path) > 0 and _same_place(path[0], notch[1], case)
        path = np.vstack([notch[:1], path]) if goes_on else path if len(path) else notch
    if not len(path):
        raise MetricError("metric energy_release_rate: no crack and not one notch; give the parameters tip and direction")
    tip = paths.tip_position(path)
    even = paths.resample(path, 0.5 * case.mesh.h)
    return even[int((np.linalg.norm(even - tip, axis=1) <= length).argmax())], tip


def _same_place(one: ArrayLike, other: ArrayLike, case: Case) -> bool:
    return bool(np.abs(np.subtract(one, other)).max() < SAME_LINE * case.mesh.h)


def _surface_energy(run: RunData, material: str) -> SurfaceEnergy:
    """Of the material that is named, or of the first one."""
    name = material or next(iter(run.case.materials))
    described = run.case.materials.get(name)
    if described is None or described.fracture is None:
        known = ", ".join(run.case.materials)
        raise MetricError(f"metric surface_energy: material {name!r} cannot break; choose one of {known}")
    return SurfaceEnergy.of(described.fracture)


@metric("toughness", "least energy of a crack over its directions")
def least_surface_energy(run: RunData, *, material: str = "") -> float:
    """Of the material that is named, or of the first one."""
    return _surface_energy(run, material).extremes()[0][0]


@metric("toughness", "largest energy of a crack over its directions")
def largest_surface_energy(run: RunData, *, material: str = "") -> float:
    """Of the material that is named, or of the first one."""
    return _surface_energy(run, material).extremes()[1][0]


# --- two runs -------------------------------------------------------------------------------------


@metric("length", "largest distance of the crack paths", of="pair")
def path_hausdorff(run: RunData, reference: RunData, *, start: Sequence[float] | None = None) -> float:
    """Of the main cracks, or of those that begin at ``start`` [length], where a body has several."""
    return paths.hausdorff(*_two_cracks(run, reference, start))


@metric("length", "mean distance of crack paths", of="pair")
def path_mean_distance(run: RunData, reference: RunData, *, start: Sequence[float] | None = None) -> float:
    """Of the main cracks, or of those that begin at ``start`` [length], where a body has several."""
    return paths.mean_distance(*_two_cracks(run, reference, start))


@metric("number", "largest distance of the crack paths in cells", of="pair")
def path_hausdorff_over_h(run: RunData, reference: RunData, *, start: Sequence[float] | None = None) -> float:
    """`path_hausdorff` over the run's spacing."""
    return path_hausdorff(run, reference, start=start) / run.case.mesh.h


@metric("number", "mean distance of the crack paths in cells", of="pair")
def path_mean_distance_over_h(run: RunData, reference: RunData, *, start: Sequence[float] | None = None) -> float:
    """`path_mean_distance` over the run's spacing."""
    return path_mean_distance(run, reference, start=start) / run.case.mesh.h


def _two_cracks(run: RunData, reference: RunData, start: Sequence[float] | None) -> tuple[Array, Array]:
    one, two = (_crack(source) if start is None else _crack_from(source, start) for source in (run, reference))
    return one, two


def _crack_from(run: RunData, start: Sequence[float]) -> Array:
    """Path of the crack that begins at a place (within four cells), in the last state."""
    data = run.points().point_data
    reference = np.asarray(data["reference"])[:, :2]
    path = paths.trace_crack(reference, np.asarray(data["phase_field"]), run.case.mesh.h, start=start).points
    if len(path) < 2 or not _same_place(path[0], start, run.case):
        raise MetricError(f"{run_name(run)}: has no crack that begins at {list(start)}; load it further")
    return path


@metric("degree", "angle between two cracks less the one that it should be", of="pair")
def crack_turn(run: RunData, reference: RunData, *, by: float) -> float:
    """Angle between the cracks of two runs less the angle that it should be, both in degrees, counter-clockwise."""
    angle = paths.path_angle(_crack(run)) - paths.path_angle(_crack(reference)) - by
    return (angle + 180.0) % 360.0 - 180.0
