"""Metrics of the history of one run or two: load-displacement curve, energies, columns over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from verify.metrics import curves
from verify.metrics.curves import Array, Curve
from verify.metrics.metric import MetricError, NotGivenError, history_column, metric, run_name, whole_column

if TYPE_CHECKING:
    from verify.metrics.metric import RunData


def curve_of(source: RunData | Curve) -> Curve:
    """The load-displacement curve of a run; a curve is its own. MetricError for a run that moves in time."""
    if isinstance(source, Curve):
        return source
    if source.case.dynamics is not None:
        said = "moves in time, and its F is the power of what acts on it"
        raise MetricError(f"{run_name(source)}: {said}; ask for energies, momentum or columns of its history")
    return _over_u(source)


def _over_u(run: RunData) -> Curve:
    return Curve.from_history(run.history, run_name(run))


# --- load-displacement curve ----------------------------------------------------------------------


@metric("force", "largest force, that which does work on u")
def peak_force(run: RunData) -> float:
    """Largest force with its sign, as `curves.peak_force`."""
    return curves.peak_force(curve_of(run))


@metric("displacement", "displacement at the largest force")
def displacement_at_peak(run: RunData) -> float:
    """As `curves.displacement_at_peak`."""
    return curves.displacement_at_peak(curve_of(run))


@metric("displacement", "displacement of the last increment")
def end_displacement(run: RunData) -> float:
    """Last value of u."""
    return float(curve_of(run).u[-1])


@metric("stiffness", "slope of the load-displacement curve at its start")
def initial_stiffness(run: RunData) -> float:
    """As `curves.initial_stiffness`."""
    return curves.initial_stiffness(curve_of(run))


@metric("number", "slope of the curve on the other side of u = 0, where cracks are closed, over the initial one")
def closed_stiffness_ratio(run: RunData) -> float:
    """Of `curves.closed_stiffness` and `curves.initial_stiffness`."""
    curve = curve_of(run)
    return curves.closed_stiffness(curve) / curves.initial_stiffness(curve)


# --- energies -------------------------------------------------------------------------------------


@metric("energy", "external work that unloading does not give back")
def dissipated_work(run: RunData) -> float:
    """External work of the history less the energy F u / 2 that unloading would give back, from a start without force."""
    if curves.preloaded(curve_of(run)):
        said = "begins under a force, and what unloading would give back is not known"
        raise MetricError(f"{run_name(run)}: {said}; ask for fracture_energy")
    return _last(run, "W_ext") - curves.recoverable_energy(curve_of(run))


@metric("energy", "fracture energy at the end")
def fracture_energy(run: RunData) -> float:
    """Fracture energy of the last state."""
    return _last(run, "E_frac")


@metric("energy", "fracture energy since a time")
def fracture_energy_gain(run: RunData, *, after: float = 0.0, until: float = np.inf) -> float:
    """Fracture energy that came between two times, without that of notches of broken material."""
    time, energy = history_column(run, "time"), whole_column(run, "E_frac")
    if not after < min(until, time[-1]):
        said = f"has nothing between t = {after:g} and {min(until, time[-1]):g}"
        raise MetricError(f"{run_name(run)}: {said}; run it longer")
    first, last = np.interp([after, min(until, time[-1])], time, energy)
    return float(last - first)


@metric("number", "energy missing, over the work or the starting energy")
def energy_balance(run: RunData, *, at: str = "peak") -> float:
    """What the balance of energies misses at the "peak" force or at the "end", over the work or the starting energy.

    Of the two the larger one is taken; bodies that fly freely have no work. All are gains since the first row, whose
    fracture energy (a notch of broken material) the load did not put in.
    """
    if at not in ("peak", "end"):
        raise MetricError(f"metric energy_balance: at = {at!r} is not known; give 'peak' or 'end'")
    row = curves.peak_index(_over_u(run)) if at == "peak" else -1
    work, elastic, kinetic, _ = (whole_column(run, name) for name in ("W_ext", "E_el", "E_kin", "E_frac"))
    scale = max(abs(work[row] - work[0]), elastic[0] + kinetic[0])
    return abs(missing_energy(run.history)[row]) / scale if scale else float("nan")


def missing_energy(history: Any) -> NDArray:
    """Energy held since the first row beyond what external forces and contact gave (n,)."""
    held = history["E_el"] + history["E_frac"] + history["E_kin"]
    less = held - history["W_ext"] - history.get("W_contact", 0.0)
    return (less - less.iloc[0]).to_numpy(dtype=float)  # type: ignore[no-any-return]


def largest_energy(history: Any) -> float:
    """The largest that the bodies hold or external forces give [energy], without that of notches of broken material."""
    held = (history["E_el"] + history["E_frac"] + history["E_kin"]).to_numpy(float)
    return float(max(np.ptp(history["W_ext"].to_numpy(float)), np.max(held - history["E_frac"].iloc[0])))


@metric("number", "least phase field of the whole run")
def least_phase_field(run: RunData) -> float:
    """Smallest value that any point had in any row."""
    return float(np.nanmin(history_column(run, "c_min")))


@metric("toughness", "growth of the fracture energy with u, over the thickness")
def fracture_energy_rate(run: RunData, *, share: float = 0.5) -> float:
    """Slope dE_frac/du over the last share of the travel of u, over the thickness.

    This is the toughness where u is the position of the crack tip.
    """
    u, energy = history_column(run, "u"), whole_column(run, "E_frac")
    last = np.abs(u - u[-1]) <= share * abs(u[-1] - u[0])
    if np.ptp(u[last]) == 0:
        raise MetricError("metric fracture_energy_rate: one increment is no slope; refine the load")
    return float(np.polyfit(u[last], energy[last], 1)[0]) / run.case.plane.thickness


def _last(run: RunData, name: str) -> float:
    value = float(history_column(run, name)[-1])
    if np.isnan(value):
        raise NotGivenError(f"{run_name(run)}: its history has no {name} in its last row")
    return value


# --- two runs -------------------------------------------------------------------------------------


@metric("number", "L2 norm of the relative error of the force (Eq. 4.19) up to the earlier peak", of="pair")
def curve_l2_before_peak(run: RunData, reference: RunData | Curve) -> float:
    """As a fraction."""
    return curves.compare_curves(curve_of(reference), curve_of(run)).l2_percent_before_peak / 100.0


@metric("number", "L2 norm of the relative error of the force (Eq. 4.19)", of="pair")
def curve_l2_whole(run: RunData, reference: RunData | Curve) -> float:
    """As a fraction."""
    return curves.compare_curves(curve_of(reference), curve_of(run)).l2_percent_whole / 100.0


@metric("number", "L2 norm of the difference of force over the peak force", of="pair")
def curve_l2_peak_normalised(run: RunData, reference: RunData | Curve) -> float:
    """As a fraction."""
    return curves.compare_curves(curve_of(reference), curve_of(run)).l2_peak_percent_whole / 100.0


@metric("number", "largest difference of force up to a displacement, over the peak force", of="pair")
def curve_max_error_until(run: RunData, reference: RunData | Curve, *, u_max: float) -> float:
    """Largest difference of force up to u_max over the reference's peak force."""
    return curves.max_error_until(curve_of(reference), curve_of(run), u_max)


@metric("number", "largest difference of a column of the history, over its largest value", of="pair")
def history_difference(
    run: RunData, reference: RunData, *, column: str, after: float = 0.0, until: float = np.inf, since_start: float = 0
) -> float:
    """Largest difference of a column of the history between two times, over the largest value of the reference.

    since_start : 1 for the change of the column since the first row.
    """
    time = history_column(run, "time")
    time = time[(time >= after) & (time <= until)]
    if not len(time):
        raise MetricError(f"{run_name(run)}: records nothing from t = {after:g} to {until:g}; run it longer")
    value, target = (_at_times(source, column, time, bool(since_start)) for source in (run, reference))
    if not target.any():
        said = f"its {column} is zero throughout, against which no difference has a size"
        raise MetricError(f"{run_name(reference)}: {said}; name another column, or run it longer")
    return float(np.abs(value - target).max() / np.abs(target).max())


def _at_times(run: RunData, column: str, times: Array, since_start: bool) -> Array:
    values = history_column(run, column)
    return np.interp(times, history_column(run, "time"), values - values[0] * since_start)
