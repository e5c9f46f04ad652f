"""The metrics that a check may ask for: scalars of one run, of two runs, and of the runs of a sweep.

>>> METRICS["peak_force"](run)                                      # doctest: +SKIP
>>> PAIR_METRICS["curve_l2_whole"](run, reference_run_or_curve)     # doctest: +SKIP
>>> SWEEP_METRICS["convergence_order"](runs, measure="l2_error_displacement")  # doctest: +SKIP
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from physics.surface_energy import SurfaceEnergy
from verify.metrics import crack_path as paths
from verify.metrics import curves, running_cracks
from verify.metrics import motion as dynamics
from verify.metrics.curves import Array, Curve, CurveComparison
from verify.metrics.energy_release import energy_release_rate
from verify.metrics.metric import Metric, MetricError, RunData

if TYPE_CHECKING:
    from cases import Case


# --- one run: curve and energies ------------------------------------------------------------------


def curve_of(source: RunData | Curve) -> Curve:
    """The load-displacement curve of a run; a curve is its own."""
    if isinstance(source, Curve):
        return source
    return Curve.from_history(source.history, f"run {source.info.get('run', '')}".strip())


def _of_curve(function: Callable[[Curve], float]) -> Callable[[RunData], float]:
    def value(run: RunData) -> float:
        return function(curve_of(run))

    return value


def dissipated_work(run: RunData) -> float:
    """External work of the history less the energy F u / 2 that unloading would give back."""
    return _last(run, "W_ext") - curves.recoverable_energy(curve_of(run))


def fracture_energy(run: RunData) -> float:
    """Fracture energy of the last state."""
    return _last(run, "E_frac")


def energy_balance(run: RunData, *, at: str = "peak") -> float:
    """What the balance of energies misses at the "peak" force or at the "end", over the work or the starting energy.

    Of the two the larger one is taken; bodies that fly freely have no work. All are gains since the first row, whose
    fracture energy (a notch of broken material) the load did not put in.
    """
    if at not in ("peak", "end"):
        raise MetricError(f"metric energy_balance: at = {at!r} is not known; give 'peak' or 'end'")
    row = curves.peak_index(curve_of(run)) if at == "peak" else -1
    work = _column(run, "W_ext")
    scale = max(abs(work[row] - work[0]), _column(run, "E_el")[0] + _column(run, "E_kin")[0])
    return abs(dynamics.missing_energy(run.history)[row]) / scale if scale else float("nan")


def fracture_energy_rate(run: RunData, *, share: float = 0.5) -> float:
    """Slope dE_frac/du over the last share of the travel of u, over the thickness.

    This is the toughness where u is the position of the crack tip.
    """
    u, energy = _column(run, "u"), _column(run, "E_frac")
    last = np.abs(u - u[-1]) <= share * abs(u[-1] - u[0])
    if np.ptp(u[last]) == 0:
        raise MetricError("metric fracture_energy_rate: one increment is no slope; refine the load")
    return float(np.polyfit(u[last], energy[last], 1)[0]) / run.case.plane.thickness


def _column(run: RunData, name: str) -> Array:
    if name not in run.history or len(run.history) == 0:
        raise MetricError(f"run {run.info.get('run', '')}: its history has no values of {name}; run it again")
    return run.history[name].to_numpy(dtype=float)


def _last(run: RunData, name: str) -> float:
    return float(_column(run, name)[-1])


# --- one run: crack and fields --------------------------------------------------------------------


def _crack(run: RunData) -> Array:
    path = np.asarray(run.crack_path, dtype=float)
    if len(path) < 2:
        raise MetricError(f"run {run.info.get('run', '')}: has no crack path, nothing broke; load it further")
    return path


def _of_crack(function: Callable[[Array], float]) -> Callable[[RunData], float]:
    def value(run: RunData) -> float:
        return function(_crack(run))

    return value


def crack_angle_in_layer(run: RunData, *, lower: float, upper: float) -> float:
    """Direction of the part of the crack between two heights y [length]: degrees from the x axis, 0 to 180."""
    path = _crack(run)
    even = paths.resample(path, paths.path_length(path) / 400)
    part = even[(even[:, 1] >= lower) & (even[:, 1] <= upper)]
    if len(part) < 3:
        raise MetricError(f"run {run.info.get('run', '')}: no crack between y = {lower:g} and {upper:g}; load it further")
    return paths.path_angle(part) % 180.0


def crack_length(run: RunData) -> float:
    """Length of the crack path, 0 where nothing broke."""
    return paths.path_length(np.asarray(run.crack_path, dtype=float).reshape(-1, 2))


def mean_energy_release_rate(
    run: RunData, *, inner: float, outer: float, tip: Sequence[float] | None = None, share: float = 1 / 3
) -> float:
    """Mean of J over the last share of the snapshots, around the crack's tip in each of them.

    inner, outer : half sizes of the boxes of ``verify.metrics.energy_release``. tip : where the crack does not grow;
    otherwise the tip is traced, and where nothing broke it is the end of the only notch.
    """
    snapshots = list(run.snapshots())
    if not snapshots:
        raise MetricError(f"run {run.info.get('run', '')}: has no snapshots; name some in output.snapshots")
    last = snapshots[-math.ceil(share * len(snapshots)) :]
    return float(np.mean([_release_rate(points, run.case, inner, outer, tip) for _, _, points in last]))


def _release_rate(points: Any, case: Case, inner: float, outer: float, tip: Sequence[float] | None) -> float:
    data = points.point_data
    reference = np.asarray(data["reference"])[:, :2]
    where = np.asarray(tip) if tip is not None else _tip(reference, np.asarray(data["phase_field"]), case)
    return energy_release_rate(
        reference,
        np.asarray(data["volume"]),
        case.plane.thickness,
        np.asarray(data["stress"]),
        np.asarray(data["gradient"]),
        np.asarray(data["energy_density"]),
        where,
        inner,
        outer,
    )


def _tip(reference: Array, phase_field: Array, case: Case) -> Array:
    path = paths.trace_case_crack(reference, phase_field, case).points
    if len(path):
        return paths.tip_position(path)
    if len(case.notches) != 1:
        raise MetricError("metric energy_release_rate: no crack and not one notch; give the parameter tip")
    return np.asarray(case.notches[0].end, dtype=float)


def _surface_energy(run: RunData, material: str) -> SurfaceEnergy:
    """Of the material that is named, or of the first one."""
    name = material or next(iter(run.case.materials))
    described = run.case.materials.get(name)
    if described is None or described.fracture is None:
        known = ", ".join(run.case.materials)
        raise MetricError(f"metric surface_energy: material {name!r} cannot break; choose one of {known}")
    return SurfaceEnergy.of(described.fracture)


def _surface_energy_extreme(which: int) -> Callable[..., float]:
    def value(run: RunData, *, material: str = "") -> float:
        return _surface_energy(run, material).extremes()[which][0]

    return value


def angle_off_weak_direction(run: RunData, *, material: str = "") -> float:
    """Degrees, 0 to 90, from the crack path to the nearest direction of the material's least surface energy."""
    energy = _surface_energy(run, material)
    (least, _), (largest, _) = energy.extremes()
    if math.isclose(least, largest, rel_tol=1e-6):
        raise MetricError(f"run {run.info.get('run', '')}: its material has no weak direction; judge the crack_angle")
    off = paths.path_angle(_crack(run)) - np.degrees(energy.weak_directions())
    return float(np.abs((off + 90.0) % 180.0 - 90.0).min())


def measure(run: RunData, *, name: str) -> float:
    """A scalar that the solver itself measured (``measures`` of run.json)."""
    value = run.info.get("measures", {}).get(name)
    if value is None:
        known = ", ".join(run.info.get("measures", {})) or "none"
        raise MetricError(f"run {run.info.get('run', '')}: has no measure {name}; it has {known}")
    return float(value)


# --- two runs -------------------------------------------------------------------------------------


def _of_comparison(value_of: Callable[[CurveComparison], float]) -> Callable[..., float]:
    def value(run: RunData, reference: RunData | Curve) -> float:
        return value_of(curves.compare_curves(curve_of(reference), curve_of(run)))

    return value


def curve_max_error_until(run: RunData, reference: RunData | Curve, *, u_max: float) -> float:
    """Largest difference of force up to u_max over the reference's peak force."""
    return curves.max_error_until(curve_of(reference), curve_of(run), u_max)


def _of_paths(function: Callable[[Array, Array], float], over_h: bool = False) -> Callable[..., float]:
    """Of the main cracks, or of those that begin at ``start`` [length], where a body has several."""

    def value(run: RunData, reference: RunData, *, start: Sequence[float] | None = None) -> float:
        one, two = (_crack(r) if start is None else _crack_from(r, start) for r in (run, reference))
        return function(one, two) / (run.case.mesh.h if over_h else 1.0)

    return value


def _crack_from(run: RunData, start: Sequence[float]) -> Array:
    """Path of the crack that begins at a place (within four cells), in the last state."""
    data = run.points().point_data
    reference = np.asarray(data["reference"])[:, :2]
    path = paths.trace_crack(reference, np.asarray(data["phase_field"]), run.case.mesh.h, start=start).points
    if len(path) < 2 or not np.allclose(path[0], start):
        raise MetricError(f"run {run.info.get('run', '')}: has no crack that begins at {list(start)}; load it further")
    return path


def crack_turn(run: RunData, reference: RunData, *, by: float) -> float:
    """Angle between the cracks of two runs less the angle that it should be, both in degrees, counter-clockwise."""
    angle = paths.path_angle(_crack(run)) - paths.path_angle(_crack(reference)) - by
    return (angle + 180.0) % 360.0 - 180.0


# --- sweeps ---------------------------------------------------------------------------------------


def fitted_order(h: ArrayLike, error: ArrayLike) -> float:
    """Order of convergence: slope of the least-squares line of log(error) over log(h)."""
    h, error = np.asarray(h, dtype=float), np.asarray(error, dtype=float)
    usable = len(h) == len(error) >= 2 and np.ptp(h) > 0 and np.all(h > 0) and np.all(error > 0)
    if not (usable and np.all(np.isfinite(error))):
        raise MetricError(
            "an order of convergence needs two or more different sizes with positive errors, "
            f"got h = {h.tolist()} and errors {error.tolist()}; widen the sweep"
        )
    return float(np.polyfit(np.log(h), np.log(error), 1)[0])


def convergence_order(
    runs: Sequence[RunData], *, measure: str = "l2_error_displacement", over: str = "mesh.h"
) -> float:
    """Fitted order of a metric or measure over a number of the case (dotted key), of the runs of a sweep."""
    metric = find_metric(measure if measure in METRICS else f"{MEASURE_PREFIX}{measure}")
    return fitted_order([_number(run.case, over) for run in runs], [metric(run) for run in runs])


def _number(case: Case, dotted: str) -> float:
    value: Any = case
    for key in dotted.split("."):
        value = getattr(value, key, None)
    if not isinstance(value, int | float):
        raise MetricError(f"metric convergence_order: {dotted} is no number of the case; try 'mesh.h'")
    return float(value)


# --- registry -------------------------------------------------------------------------------------

MEASURE_PREFIX = "measure:"


def _measured(name: str, meaning: str, unit: str = "number") -> Metric:
    def value(run: RunData) -> float:
        return measure(run, name=name)

    return Metric(name, unit, meaning, value)


def _registry(*metrics: Metric) -> dict[str, Metric]:
    return {metric.name: metric for metric in metrics}


METRICS = _registry(
    Metric("peak_force", "force", "largest reaction force", _of_curve(curves.peak_force)),
    Metric(
        "displacement_at_peak",
        "displacement",
        "displacement at the largest reaction force",
        _of_curve(curves.displacement_at_peak),
    ),
    Metric(
        "end_displacement",
        "displacement",
        "displacement of the last increment",
        _of_curve(lambda curve: float(curve.u[-1])),
    ),
    Metric(
        "initial_stiffness",
        "toughness",
        "slope of the load-displacement curve at its start",
        _of_curve(curves.initial_stiffness),
    ),
    Metric(
        "closed_stiffness_ratio",
        "number",
        "slope of the curve on the other side of u = 0, where cracks are closed, over the initial one",
        _of_curve(lambda curve: curves.closed_stiffness(curve) / curves.initial_stiffness(curve)),
    ),
    Metric("dissipated_work", "energy", "external work that unloading does not give back", dissipated_work),
    Metric("fracture_energy", "energy", "fracture energy at the end", fracture_energy),
    Metric("energy_balance", "number", "energy missing, over the work or the starting energy", energy_balance),
    Metric(
        "fracture_energy_rate",
        "toughness",
        "growth of the fracture energy with u, over the thickness",
        fracture_energy_rate,
    ),
    Metric("energy_release_rate", "toughness", "J-integral around the tip", mean_energy_release_rate),
    Metric("crack_length", "length", "length of the crack path", crack_length),
    Metric("crack_angle", "degree", "overall direction of the crack path", _of_crack(paths.path_angle)),
    Metric("crack_angle_in_layer", "degree", "direction of the crack in a layer", crack_angle_in_layer),
    Metric(
        "angle_off_weak_direction", "degree", "crack path from the nearest weak direction", angle_off_weak_direction
    ),
    Metric("tip_x", "length", "x of the crack tip", _of_crack(lambda path: paths.tip_position(path)[0])),
    Metric("tip_y", "length", "y of the crack tip", _of_crack(lambda path: paths.tip_position(path)[1])),
    Metric("initiation_time", "time", "when the crack set out", running_cracks.initiation_time),
    Metric(
        "stored_energy_at_initiation",
        "energy",
        "elastic energy when the crack set out",
        running_cracks.stored_energy_at_initiation,
    ),
    Metric("branching_time", "time", "when the tip first divided", running_cracks.branching_time),
    Metric("branching_angle", "degree", "angle between the two longest branches", running_cracks.branching_angle),
    Metric("crack_direction", "degree", "direction from the notch to the crack's tip", running_cracks.crack_direction),
    Metric("branch_angle", "degree", "direction of the longest branch", running_cracks.branch_angle),
    Metric("branch_count", "number", "tips that the crack came to have", running_cracks.branch_count),
    Metric(
        "enclosed_pieces", "number", "pieces that branches enclose by running into cracks", running_cracks.enclosed_pieces
    ),
    Metric("tip_speed", "velocity", "largest speed of a crack tip", running_cracks.tip_speed),
    Metric("fragments", "number", "connected pieces of unbroken material", running_cracks.fragments),
    Metric("cone_index", "number", "1 where a cone formed under an impact, else 0", running_cracks.cone_index),
    Metric("asymmetry", "number", "largest difference from the mirror image", running_cracks.asymmetry),
    Metric("fracture_energy_gain", "energy", "fracture energy since a time", running_cracks.fracture_energy_gain),
    Metric("phase_field_share", "number", "share of time that the phase field took", running_cracks.phase_field_share),
    Metric(
        "least_surface_energy", "toughness", "least energy of a crack over its directions", _surface_energy_extreme(0)
    ),
    Metric(
        "largest_surface_energy", "toughness", "largest energy of a crack over its directions", _surface_energy_extreme(1)
    ),
    Metric("measure", "number", "a scalar that the solver measured, by its name", measure),
    Metric("period", "time", "mean period of an oscillation", dynamics.period),
    Metric("period_error", "number", "relative error of the vibrating bar's period", dynamics.period_error),
    Metric("half_width_error", "number", "relative error of the half-width on a floor", dynamics.half_width_error),
    Metric("energy_drift", "number", "trend of the energy while a wave crosses a length", dynamics.energy_drift),
    Metric("energy_left", "number", "energy at the end over that at the start", dynamics.energy_left),
    Metric("contact_impulse", "momentum", "impulse of contact on a body", dynamics.contact_impulse),
    Metric("momentum_drift", "number", "largest change of the whole momentum", dynamics.momentum_drift),
    Metric("travel", "length", "way of a body's centre of mass", dynamics.travel),
    Metric("angular_velocity", "rate", "angular velocity of a body", dynamics.angular_velocity),
    Metric("contact_start", "time", "when two bodies begin to push", dynamics.contact_start),
    Metric("contact_violations", "number", "nodes at which contact conditions failed", dynamics.contact_violations),
    _measured("constraint_error", "largest violation of a constraint"),
    _measured("element_quality", "least scaled Jacobian of the moved elements"),
    _measured("profile_error", "error of the phase-field profile"),
    _measured("l2_error_displacement", "relative L2 error of the displacement"),
    _measured("contact_half_width", "half-width of the pressure on a floor", "length"),
    _measured("peak_pressure", "largest pressure on a floor under the bodies' weight", "stress"),
    _measured("l2_error_stress", "relative L2 error of the stress"),
    _measured("l2_error_phase_field", "relative L2 error of the phase field"),
)

PAIR_METRICS = _registry(
    Metric(
        "curve_l2_before_peak",
        "number",
        "L2 norm of the relative error of the force (Eq. 4.19) up to the earlier peak",
        _of_comparison(lambda comparison: comparison.l2_percent_before_peak / 100.0),
    ),
    Metric(
        "curve_l2_whole",
        "number",
        "L2 norm of the relative error of the force (Eq. 4.19)",
        _of_comparison(lambda comparison: comparison.l2_percent_whole / 100.0),
    ),
    Metric(
        "curve_l2_peak_normalised",
        "number",
        "L2 norm of the difference of force over the peak force",
        _of_comparison(lambda comparison: comparison.l2_peak_percent_whole / 100.0),
    ),
    Metric(
        "curve_max_error_until",
        "number",
        "largest difference of force up to a displacement, over the peak force",
        curve_max_error_until,
    ),
    Metric(
        "history_difference",
        "number",
        "largest difference of a column of the history, over its largest value",
        running_cracks.history_difference,
    ),
    Metric("crack_turn", "degree", "angle between two cracks less the one that it should be", crack_turn),
    Metric("path_hausdorff", "length", "largest distance of the crack paths", _of_paths(paths.hausdorff)),
    Metric("path_mean_distance", "length", "mean distance of crack paths", _of_paths(paths.mean_distance)),
    Metric(
        "path_hausdorff_over_h",
        "number",
        "largest distance of the crack paths in cells",
        _of_paths(paths.hausdorff, over_h=True),
    ),
    Metric(
        "path_mean_distance_over_h",
        "number",
        "mean distance of the crack paths in cells",
        _of_paths(paths.mean_distance, over_h=True),
    ),
)

SWEEP_METRICS = _registry(
    Metric("convergence_order", "number", "fitted order of convergence of an error", convergence_order)
)


def find_metric(name: str) -> Metric:
    """The metric of that name, of any kind; 'measure:NAME' reads the solver's measure NAME.

    Raises MetricError for a name that is not known.
    """
    if name.startswith(MEASURE_PREFIX):
        key = name.removeprefix(MEASURE_PREFIX)
        return replace(_measured(key, f"the solver's own {key}"), name=name)
    for registry in (METRICS, PAIR_METRICS, SWEEP_METRICS):
        if name in registry:
            return registry[name]
    known = ", ".join([*METRICS, *PAIR_METRICS, *SWEEP_METRICS])
    raise MetricError(f"metric {name}: is not known; choose one of {known}, or measure:NAME")


def metric_unit(name: str, case: Case) -> str:
    """Text of a metric's unit in the units of a case, such as "kN"; "1" for pure numbers."""
    kind = find_metric(name).unit
    return "°" if kind == "degree" else case.units.label(kind)
