"""Figures of moving bodies over time: energies, speed of crack tips, momentum."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from verify.metrics.histories import missing_energy
from verify.metrics.running_cracks import branches_of, rayleigh_speed_of

from . import style
from .results import tells
from .words import listed, number

if TYPE_CHECKING:
    from pathlib import Path

    from .results import CaseResults, RunResults

#: column of the history -> what it is called
ENERGIES = {
    "E_el": "elastic",
    "E_frac": "fracture",
    "E_kin": "kinetic",
    "W_ext": "work of external forces",
    "W_contact": "work of contact",
    "W_transfer": "lost from points to nodes and back",
}
#: share of the Rayleigh speed that cracks rarely exceed (Ravi-Chandar and Knauss 1984)
EXPERIMENTAL_SHARE = 0.6
#: positions of the tip over the run, and how many of them a speed is fitted to
TIP_POSITIONS, FITTED = 80, 5
MOST_BRANCHES = 4


def _time_label(results: CaseResults) -> str:
    return f"time t [{results.unit('time')}]"


def energies(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Draw each kind of energy over time, all runs together, and what the balance misses."""
    runs = results.shown_runs()
    kinds = [column for column in ENERGIES if any(_acts(run, column) for run in runs)]
    if not runs or not kinds:
        return None
    columns = 2
    rows = -(-(len(kinds) + 1) // columns)
    figure, grid = style.panels(rows, columns, 8.2, 2.5 * rows + 0.4, grid=True, sharex=True)
    colours = style.colours_of([run.name for run in runs])
    for axes, kind in zip(grid.flat, kinds, strict=False):
        _draw_over_time(axes, runs, colours, {run.name: run.history[kind] for run in runs if kind in run.history})
        axes.set(title=ENERGIES[kind], ylabel=f"[{results.unit('energy')}]")
    balanced = [run for run in runs if tells(run, "E_el", "E_frac", "E_kin", "W_ext")]
    missing = {run.name: 100.0 * _missing_energy(run.history) for run in balanced}
    balance = grid.flat[len(kinds)]
    _draw_over_time(balance, runs, colours, missing)
    balance.axhline(0.0, color=style.GREY, linewidth=0.8)
    balance.set(title="missing from the balance", ylabel="[% of all energy given]")
    for axes in grid.flat[len(kinds) + 1 :]:
        axes.set_visible(False)
    for axes in grid.flat[max(0, len(kinds) + 1 - columns) : len(kinds) + 1]:
        axes.set_xlabel(_time_label(results))
        axes.tick_params(labelbottom=True)
    style.legend_below(figure, [grid.flat[0]])
    said = listed(f"{number(np.abs(missing[run.name]).max(), 2)} % ({run.name})" for run in balanced)
    return style.drawing(
        figure, folder, "energies", "Energies over time",
        "Energies of the whole body or of all bodies. The balance is elastic + fracture + kinetic energy, less what "
        f"there was at the start and what external forces and contact did; at most {said} of the energy given. What "
        "material points lose where velocities go to the nodes and back is part of what is missing.",
        style.table_of(runs, ("time", *ENERGIES)),
    )


def _acts(run: RunResults, column: str) -> bool:
    return column in run.history and bool(run.history[column].abs().max() > 0)


def _draw_over_time(axes: Any, runs: list[RunResults], colours: dict[str, str], values: dict[str, Any]) -> None:
    for run in runs:
        if run.name in values:
            look = {"color": colours[run.name], "label": run.label}
            axes.plot(run.history["time"], values[run.name], linestyle=run.method.line, **look)


def _missing_energy(history: pd.DataFrame) -> np.ndarray:
    """What is held beyond what was given, over the largest energy given until the end."""
    scale = history["E_el"].iloc[0] + history["E_kin"].iloc[0] + history["W_ext"].abs().max()
    return missing_energy(history) / (float(scale) or 1.0)


# ---------------------------------------------------------------- crack tips


def tip_speed(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Draw the speed of each crack tip over time below the Rayleigh speed."""
    if results.case is None or not results.case.fracture_enabled or results.case.dynamics is None:
        return None
    interval = results.case.dynamics.end_time / TIP_POSITIONS
    runs = results.main_runs()
    found = {run.name: branches_of(run.folder) for run in runs}
    tables = [
        pd.DataFrame(dict(zip(("time", "speed"), branch.speed(interval, FITTED), strict=True))).assign(run=name, branch=i)
        for name, branches in found.items()
        for i, branch in enumerate(branches[:MOST_BRANCHES], 1)
    ]
    table = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()
    if table.empty:
        return None
    speed = f"speed of the crack tip [{results.unit('velocity')}]"
    figure, axes = style.curve_axes(7.2, 3.6, _time_label(results), speed)
    colours = style.colours_of([run.name for run in runs])
    for run in runs:
        _draw_speeds(axes, run, table[table["run"] == run.name], colours[run.name])
    limit = rayleigh_speed_of(results.case)
    for share, line in ((1.0, "-"), (EXPERIMENTAL_SHARE, ":")):
        label = "Rayleigh speed" if share == 1.0 else f"{100 * share:g} % of the Rayleigh speed"
        axes.axhline(share * limit, color=style.INK, linewidth=0.9, linestyle=line, label=label)
    axes.set_ylim(bottom=0.0)
    style.legend_below(figure, [axes], columns=2)
    return style.drawing(
        figure, folder, "tip-speed", "Speed of the crack tips",
        f"Lines fitted to {FITTED} positions of a tip, {number(interval)} {results.unit('time')} apart, along each "
        f"branch from its start (Borden et al. 2012). {_branching_in_words(results, found)}",
        table[["run", "branch", "time", "speed"]],
    )


def _draw_speeds(axes: Any, run: RunResults, table: pd.DataFrame, colour: str) -> None:
    for number_of_branch, part in table.groupby("branch"):
        first = number_of_branch == table["branch"].min()
        label = run.label if first else None
        look = {"linestyle": run.method.line, "linewidth": 1.5 if first else 0.9}
        axes.plot(part["time"], part["speed"], color=colour, label=label, **look)


def _branching_in_words(results: CaseResults, found: dict[str, Any]) -> str:
    said = []
    for name, branches in found.items():
        times = [branch.arrival[fork] for branch in branches for fork in branch.forks]
        if times:
            said.append(f"{name} at {number(min(times), 3)} {results.unit('time')} into {len(branches)} tips in the end")
    return f"The crack branches: {'; '.join(said)}." if said else "The crack does not branch."


# ---------------------------------------------------------------- momentum


def momentum(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Draw the momentum of each body and of all, in x and y, for cases of several bodies."""
    runs = [run for run in results.main_runs() if tells(run, "momentum_x", "momentum_y")]
    if results.case is None or len(results.case.bodies) < 2 or not runs:
        return None
    names = list(results.case.bodies)
    figure, grid = style.panels(len(runs), 2, 8.2, 2.7 * len(runs) + 0.4, grid=True, sharex=True)
    colours = style.colours_of(names)
    for row, run in zip(grid, runs, strict=True):
        for axes, direction in zip(row, "xy", strict=True):
            _draw_momentum(axes, run, names, colours, direction)
            axes.set(title=f"{run.label}, {direction}", ylabel=f"[{results.unit('force')}·{results.unit('time')}]")
    for axes in grid[-1]:
        axes.set_xlabel(_time_label(results))
    style.legend_below(figure, [grid[0, 0]], columns=len(names) + 1)
    columns = [str(c) for c in runs[0].history if "momentum" in str(c) or "impulse" in str(c)]
    return style.drawing(
        figure, folder, "momentum", "Momentum",
        "Momentum of each body and of all bodies together; what one body loses in contact another gains.",
        style.table_of(runs, ("time", *columns)),
    )


def _draw_momentum(axes: Any, run: RunResults, names: list[str], colours: dict[str, str], direction: str) -> None:
    time = run.history["time"]
    for name in names:
        if f"{name}_momentum_{direction}" in run.history:
            axes.plot(time, run.history[f"{name}_momentum_{direction}"], "--", color=colours[name], label=name)
    axes.plot(time, run.history[f"momentum_{direction}"], "-", color=style.INK, linewidth=1.0, label="all")
