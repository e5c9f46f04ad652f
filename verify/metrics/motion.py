"""Metrics of runs that move: periods, energies over time, momentum, motion of bodies, contact."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cases import Case
from physics.exact_motion import bar_period, contact_half_width, pressure_wave_speed
from physics.exact_rules import otherwise_than
from verify.metrics.histories import largest_energy, missing_energy
from verify.metrics.metric import MetricError, NotGivenError, history_column, metric, run_name, whole_column

if TYPE_CHECKING:
    from verify.metrics.metric import RunData


def at_time(run: RunData, name: str, time: float) -> float:
    """A column at a time, between the recorded ones by a parabola through the three nearest."""
    times, values = history_column(run, "time"), history_column(run, name)
    if not times[0] <= time <= times[-1] * (1.0 + 1e-9):
        said = f"has no t = {time:g}, it goes from {times[0]:g} to {times[-1]:g}"
        raise MetricError(f"{run_name(run)}: {said}; run it longer, or ask for another time")
    first = int(np.clip(np.searchsorted(times, time) - 1, 0, max(len(times) - 3, 0)))
    near = slice(first, first + 3)
    weights = np.polyfit(times[near] - time, values[near], len(times[near]) - 1)
    return float(weights[-1])


@metric("time", "mean period of an oscillation")
def period(run: RunData, *, of: str = "momentum_x") -> float:
    """Mean time between the zeros of a column, twice."""
    times, values = history_column(run, "time"), history_column(run, of)
    before = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0)
    if len(before) < 2:
        raise MetricError(f"{run_name(run)}: {of} has fewer than two zeros; run it longer")
    zeros = times[before] - values[before] * (times[before + 1] - times[before]) / (values[before + 1] - values[before])
    return float(2.0 * (zeros[-1] - zeros[0]) / (len(zeros) - 1))


def _require_exact(run: RunData, solution: str) -> None:
    """Raise MetricError for a run that is no case of the exact solution from which its error is measured."""
    if otherwise := otherwise_than(run.case, solution):
        raise MetricError(f"{run_name(run)}: the exact solution {solution!r} {otherwise}")


@metric("number", "relative error of the vibrating bar's period")
def period_error(run: RunData) -> float:
    """Relative error of the vibrating bar's period."""
    _require_exact(run, "vibrating_bar")
    return abs(period(run) / bar_period(run.case) - 1.0)


def energy(run: RunData) -> NDArray:
    """Strain, fracture and kinetic energy less the external work and that of friction (n,)."""
    held = sum(whole_column(run, name) for name in ("E_el", "E_frac", "E_kin"))
    return held - history_column(run, "W_ext") - history_column(run, "W_friction")  # type: ignore[no-any-return]


@metric("number", "relative error of the half-width on a floor")
def half_width_error(run: RunData) -> float:
    """Relative error of the half-width of the pressure on a floor, against Hertz's."""
    measured = run.info.get("measures", {}).get("contact_half_width")
    if measured is None:
        raise MetricError(f"{run_name(run)}: nothing rests on a floor; run it longer")
    _require_exact(run, "line_contact")
    return abs(measured / contact_half_width(run.case) - 1.0)


@metric("number", "trend of the energy while a wave crosses a length")
def energy_drift(run: RunData, *, length: float) -> float:
    """Trend of the energy while a wave crosses `length`, over the energy at the start."""
    times, total = history_column(run, "time"), energy(run)
    if not total[0]:
        raise MetricError(f"{run_name(run)}: begins without energy, whose trend has no size; give a body a velocity")
    slope = np.polyfit(times, total, 1)[0]
    return float(abs(slope) * length / pressure_wave_speed(run.case) / total[0])


@metric("number", "energy at the end over that at the start")
def energy_left(run: RunData) -> float:
    """Energy at the end over that at the start."""
    total = energy(run)
    if not total[0]:
        raise MetricError(f"{run_name(run)}: begins without energy, of which none can be left; give a body a velocity")
    return float(total[-1] / total[0])


@metric("number", "energy that transfer takes, over the largest that there is")
def transfer_loss(run: RunData) -> float:
    """What kinetic energy has lost by the end where velocities go from points to nodes and back."""
    lost = history_column(run, "W_transfer")
    return float((lost[0] - lost[-1]) / largest_energy(run.history))


@metric("number", "energy missing beyond what transfer takes, over the largest that there is")
def unaccounted_energy(run: RunData) -> float:
    """Largest size: with forces, contact and transfer, what is left is the integration in time."""
    lost = history_column(run, "W_transfer")
    return float(np.abs(missing_energy(run.history) - lost + lost[0]).max() / largest_energy(run.history))


#: a momentum below this share of the largest that an energy allows is none
_ROUND_OFF = 1e-9


def _mass(case: Case) -> float:
    """Of the bodies that move freely [force time² / length]."""
    parts = zip(case.bodies.values(), case.outlines(), strict=True)
    areas = (case.materials[body.material].density * part.area for body, part in parts if not body.keeps_velocity)
    return float(sum(areas) * case.plane.thickness)


@metric("number", "largest change of the whole momentum")
def momentum_drift(run: RunData) -> float:
    """Largest change of the whole momentum, over the sum of the bodies' own at the start.

    Where that is round-off of the largest that their energy allows, as of bodies that only turn, it is over this one.
    """
    bodies = [name for name, body in run.case.bodies.items() if not body.keeps_velocity]
    starts = ([history_column(run, f"{name}_momentum_{axis}")[0] for axis in "xy"] for name in bodies)
    own = sum(np.hypot(*start) for start in starts)
    most = np.sqrt(2.0 * _mass(run.case) * history_column(run, "E_kin")[0])
    own = own if own > _ROUND_OFF * most else most
    if not own:
        raise MetricError(f"{run_name(run)}: its bodies begin at rest, with no momentum to keep; give one a velocity")
    x, y = history_column(run, "momentum_x"), history_column(run, "momentum_y")
    return float(np.hypot(x - x[0], y - y[0]).max() / own)


@metric("length", "way of a body's centre of mass")
def travel(run: RunData, *, body: str, time: float, direction: str) -> float:
    """How far the centre of mass of a body has gone along "x" or "y" at a time."""
    if direction not in ("x", "y"):
        raise MetricError(f"metric travel: direction = {direction!r} is not known; give 'x' or 'y'")
    name = f"{body}_{direction}"
    return at_time(run, name, time) - float(history_column(run, name)[0])


@metric("rate", "angular velocity of a body")
def angular_velocity(run: RunData, *, body: str, time: float) -> float:
    """Of a body as a whole at a time, counter-clockwise positive."""
    return at_time(run, f"{body}_spin", time)


@metric("time", "when two bodies begin to push")
def contact_start(run: RunData, *, body: str) -> float:
    """First recorded time at which contact has given the body a thousandth of all its impulse."""
    impulse = np.hypot(history_column(run, f"{body}_impulse_x"), history_column(run, f"{body}_impulse_y"))
    if not impulse.max() > 0.0:
        raise MetricError(f"{run_name(run)}: {body} touches nothing; run it longer")
    return float(history_column(run, "time")[np.flatnonzero(impulse > 1e-3 * impulse.max())[0]])


@metric("momentum", "impulse of contact on a body")
def contact_impulse(run: RunData, *, body: str) -> float:
    """Size of the impulse that contact has given the body by the end."""
    x, y = (history_column(run, f"{body}_impulse_{direction}")[-1] for direction in "xy")
    return float(np.hypot(x, y))


@metric("number", "nodes at which contact conditions failed")
def contact_violations(run: RunData) -> float:
    """Share of the nodes in contact at which one of the conditions C.2 to C.4 of Algorithm 3 did not hold."""
    counters = run.info.get("counters", {})
    if "contact_nodes" not in counters:
        raise NotGivenError(f"{run_name(run)}: does not tell at how many nodes contact acted")
    if not counters["contact_nodes"]:
        raise MetricError(f"{run_name(run)}: no body touches another; run it longer")
    broken = sum(counters.get(f"contact_C{number}", 0) for number in (2, 3, 4))
    return float(broken / counters["contact_nodes"])
