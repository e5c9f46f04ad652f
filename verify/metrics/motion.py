"""Metrics of runs that move: periods, energies over time, momentum, motion of bodies, contact."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.exact_motion import bar_period, contact_half_width, pressure_wave_speed
from verify.metrics.metric import MetricError


def column(run: Any, name: str) -> NDArray:
    """A column of the run's history (n,)."""
    if name not in run.history or len(run.history) == 0:
        known = ", ".join(run.history.columns)
        raise MetricError(f"run {run.info.get('run', '')}: its history has no column {name}; it has {known}")
    return run.history[name].to_numpy(dtype=float)


def at_time(run: Any, name: str, time: float) -> float:
    """A column at a time, between the recorded ones by a parabola through the three nearest."""
    times, values = column(run, "time"), column(run, name)
    if not times[0] <= time <= times[-1] * (1.0 + 1e-9):
        raise MetricError(f"run {run.info.get('run', '')}: ends at t = {times[-1]:g}, before {time:g}")
    first = int(np.clip(np.searchsorted(times, time) - 1, 0, max(len(times) - 3, 0)))
    near = slice(first, first + 3)
    weights = np.polyfit(times[near] - time, values[near], len(times[near]) - 1)
    return float(weights[-1])


def period(run: Any, *, of: str = "momentum_x") -> float:
    """Mean time between the zeros of a column, twice."""
    times, values = column(run, "time"), column(run, of)
    before = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0)
    if len(before) < 2:
        raise MetricError(f"run {run.info.get('run', '')}: {of} has fewer than two zeros; run it longer")
    zeros = times[before] - values[before] * (times[before + 1] - times[before]) / (values[before + 1] - values[before])
    return float(2.0 * (zeros[-1] - zeros[0]) / (len(zeros) - 1))


def period_error(run: Any) -> float:
    """Relative error of the vibrating bar's period."""
    return abs(period(run) / bar_period(run.case) - 1.0)


def energy(run: Any) -> NDArray:
    """Strain, fracture and kinetic energy less the external work and that of friction (n,)."""
    held = sum(column(run, name) for name in ("E_el", "E_frac", "E_kin"))
    return held - column(run, "W_ext") - column(run, "W_contact")  # type: ignore[no-any-return]


def half_width_error(run: Any) -> float:
    """Relative error of the half-width of the pressure on a floor, against Hertz's."""
    measured = run.info.get("measures", {}).get("contact_half_width")
    if measured is None:
        raise MetricError(f"run {run.info.get('run', '')}: nothing rests on a floor; run it longer")
    return abs(measured / contact_half_width(run.case) - 1.0)


def missing_energy(history: Any) -> NDArray:
    """Energy held since the first row beyond what external forces and friction gave (n,)."""
    held = history["E_el"] + history["E_frac"] + history["E_kin"]
    less = held - history["W_ext"] - history.get("W_contact", 0.0)
    return (less - less.iloc[0]).to_numpy(dtype=float)  # type: ignore[no-any-return]


def energy_drift(run: Any, *, length: float) -> float:
    """Trend of the energy while a wave crosses `length`, over the energy at the start."""
    times, total = column(run, "time"), energy(run)
    slope = np.polyfit(times, total, 1)[0]
    return float(abs(slope) * length / pressure_wave_speed(run.case) / total[0])


def energy_left(run: Any) -> float:
    """Energy at the end over that at the start."""
    total = energy(run)
    return float(total[-1] / total[0])


def momentum_drift(run: Any) -> float:
    """Largest change of the whole momentum, over the sum of the bodies' own at the start."""
    bodies = [name for name, body in run.case.bodies.items() if not body.rigid]
    own = sum(np.hypot(column(run, f"{b}_momentum_x")[0], column(run, f"{b}_momentum_y")[0]) for b in bodies)
    x, y = column(run, "momentum_x"), column(run, "momentum_y")
    return float(np.hypot(x - x[0], y - y[0]).max() / own)


def travel(run: Any, *, body: str, time: float, direction: str = "x") -> float:
    """How far the centre of mass of a body has gone at a time."""
    name = f"{body}_{direction}"
    return at_time(run, name, time) - float(column(run, name)[0])


def angular_velocity(run: Any, *, body: str, time: float) -> float:
    """Of a body as a whole at a time, counter-clockwise positive."""
    return at_time(run, f"{body}_spin", time)


def contact_start(run: Any, *, body: str) -> float:
    """First recorded time at which contact has given the body a thousandth of all its impulse."""
    impulse = np.hypot(column(run, f"{body}_impulse_x"), column(run, f"{body}_impulse_y"))
    if not impulse.max() > 0.0:
        raise MetricError(f"run {run.info.get('run', '')}: {body} touches nothing; run it longer")
    return float(column(run, "time")[np.flatnonzero(impulse > 1e-3 * impulse.max())[0]])


def contact_impulse(run: Any, *, body: str) -> float:
    """Size of the impulse that contact has given the body by the end."""
    x, y = (column(run, f"{body}_impulse_{direction}")[-1] for direction in "xy")
    return float(np.hypot(x, y))


def contact_violations(run: Any) -> float:
    """Share of the nodes in contact at which one of the conditions C.2 to C.4 of Algorithm 3 did not hold."""
    counters = run.info.get("counters", {})
    broken = sum(counters.get(f"contact_C{number}", 0) for number in (2, 3, 4))
    return broken / max(1, counters.get("contact_nodes", 0))
