"""Figures of bodies that rock: the angle over time, the motion of the ground and its response spectrum."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from physics.rocking.motion import OVERTURNED
from verify.metrics.rocking import rocking_of, verdict_on

from . import style
from .results import READING_ERRORS, tells
from .words import listed, number

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from cases import Case
    from physics.rocking.ground import GroundMotion

    from .results import CaseResults, RunResults

#: share of critical damping of the response spectrum, and number of its periods
DAMPING, PERIODS = 0.05, 80


def angles(results: CaseResults, folder: Path) -> list[style.Drawing]:
    """Draw the angle of the body that rocks over time, all runs together, and that of each region."""
    case = results.case
    if case is None:
        return []
    drawn = [_angles_of_block(results, case, folder)] if case.rocking else []
    drawn += [_angles_of_region(results, name, folder) for name in case.output.regions]
    return [drawing for drawing in drawn if drawing is not None]


def _angles_of_region(results: CaseResults, name: str, folder: Path) -> style.Drawing | None:
    runs = [run for run in results.shown_runs() if tells(run, f"{name}_angle")]
    if not runs:
        return None
    figure, axes = style.curve_axes(7.6, 4.0, f"time t [{results.unit('time')}]", "angle θ, counter-clockwise [°]")
    colours, tables = style.colours_of([run.name for run in runs]), []
    for run in runs:
        table = pd.DataFrame({"run": run.name, "time": run.history["time"]})
        table["angle"] = np.degrees(np.unwrap(run.history[f"{name}_angle"]))
        axes.plot(table["time"], table["angle"], linestyle=run.method.line, color=colours[run.name], label=run.label)
        tables.append(table)
    style.legend_below(figure, [axes])
    said = listed(f"{t['run'].iloc[0]} {number(float(t['angle'].abs().max()), 3)}°" for t in tables)
    return style.drawing(
        figure, folder, f"angle-{style.slug(name)}", f"Angle of {name.replace('_', ' ')} over time",
        f"Turn of its points about their centre of mass; at most {said}.", pd.concat(tables, ignore_index=True),
    )


def _angles_of_block(results: CaseResults, case: Case, folder: Path) -> style.Drawing | None:
    assert case.rocking is not None
    runs = [run for run in results.shown_runs() if f"{case.rocking.body}_angle" in run.history]
    if not runs:
        return None
    label = "angle θ, counter-clockwise [°]"
    figure, axes = style.curve_axes(7.6, 4.0, f"time t [{results.unit('time')}]", label)
    colours = style.colours_of([run.name for run in runs])
    tables = []
    for run in runs:
        time, angle, _ = rocking_of(run.folder)
        axes.plot(time, np.degrees(angle), linestyle=run.method.line, color=colours[run.name], label=run.label)
        tables.append(pd.DataFrame({"run": run.name, "time": time, "angle": np.degrees(angle)}))
    from physics.rocking.of_case import block_of  # compiled: on use

    _mark_no_return(axes, math.degrees(block_of(case).slenderness), pd.concat(tables)["angle"])
    style.legend_below(figure, [axes], columns=2)
    said = listed(f"{run.name} {_verdict(run)}" for run in runs)
    return style.drawing(
        figure, folder, "angles", f"Angle of {case.rocking.body} over time",
        f"Time 0 is the start of the ground's motion. A body counts as overturned at {OVERTURNED:g}°. {said}.",
        pd.concat(tables, ignore_index=True),
    )


def _mark_no_return(axes: Any, alpha: float, angle: pd.Series) -> None:
    """Lines at ±alpha [degrees] where they are reached; falls leave the picture at twice of it."""
    low, high = float(angle.min()), float(angle.max())
    axes.set_ylim(max(1.1 * low, -2.0 * alpha) - 0.2, min(1.1 * high, 2.0 * alpha) + 0.2)
    for number_of_line, place in enumerate(place for place in (-alpha, alpha) if low < place < high):
        label = {} if number_of_line else {"label": "±α: the centre stands over a corner"}
        axes.axhline(place, color=style.GREY, linewidth=0.9, linestyle=":", **label)


def _verdict(run: RunResults) -> str:
    try:
        return f"({verdict_on(run.folder)})"
    except READING_ERRORS:
        return "(open)"


def _distinct(motions: Mapping[str, GroundMotion]) -> dict[str, GroundMotion]:
    """The motions that differ, each under the first name that has it."""
    found: dict[tuple[Any, ...], str] = {}
    for name, motion in motions.items():
        samples = motion.times.tobytes(), motion.accelerations.tobytes()
        found.setdefault((motion.kind, motion.amplitude, motion.end, motion.cycles, *samples), name)
    return {name: motions[name] for name in found.values()}


def ground(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Draw the acceleration of the ground over time and its response spectrum; of runs that differ, each one's."""
    case, runs = results.case, results.shown_runs()
    if case is None or case.dynamics is None or case.dynamics.ground is None or not runs:
        return None
    figure, grid = style.panels(1, 2, 8.2, 3.2, grid=True)
    from physics.rocking.ground import response_spectrum
    from physics.rocking.of_case import ground_motion  # compiled: on use

    motions = {run.name: ground_motion(run.folder.case) for run in runs}
    distinct = list(_distinct(motions).items())
    colours = style.colours_of([name for name, _ in distinct])
    unit, tables = results.unit("acceleration"), []
    for name, motion in distinct:
        times = np.linspace(0.0, 1.05 * motion.end, 2000)
        # of a pulse about its length; of a record from a few of its samples on
        shortest, longest = (4.0 / len(motion.times), 0.25) if len(motion.times) else (0.02, 5.0)
        periods = motion.end * np.geomspace(shortest, longest, PERIODS)
        spectrum = response_spectrum(motion, periods, DAMPING, step=min(0.1 * periods[0], motion.end / 4000))
        grid[0, 0].plot(times, motion.acceleration(times), color=colours[name], label=name)
        grid[0, 1].plot(periods, spectrum, color=colours[name])
        tables.append(pd.DataFrame({"run": name, "period": periods, "spectral_acceleration": spectrum}))
    time = results.unit("time")
    grid[0, 0].set(title="ground", xlabel=f"time t [{time}]", ylabel=f"acceleration [{unit}]")
    grid[0, 1].set(title="response spectrum, 5 % damping", xlabel=f"period [{time}]", xscale="log",
                   ylabel=f"pseudo-acceleration [{unit}]")  # fmt: skip
    style.legend_below(figure, [grid[0, 0]])
    largest = max(table["spectral_acceleration"].max() for table in tables)
    return style.drawing(
        figure, folder, "ground", "Motion of the ground",
        f"Acceleration along {case.dynamics.ground.direction}, and the largest response of linear oscillators over their"
        f" period; at most {number(largest, 3)} {unit}. Runs with the same ground stand under one name.",
        pd.concat(tables, ignore_index=True),
    )
