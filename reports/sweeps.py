"""Figures of sweeps: critical values over what was swept, beside the published ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cases.solvers import SOLVERS

from . import style
from .results import CaseResults
from .words import listed, number

CRITICAL = ("peak_force", "displacement_at_peak")
TITLES = {"peak_force": "peak force", "displacement_at_peak": "displacement at peak"}
UNITS = {"peak_force": "force", "displacement_at_peak": "displacement"}
SAID = ("metric", "unit", "value", "target")
LENGTH_SCALE, SPACING = "length_scale", "h"


def critical_table(results: CaseResults) -> pd.DataFrame:
    """Return what the checks say of sweeps over two numbers.

    Columns family, first, second (names of what was swept), line, x (their values), metric, value, published.
    """
    specs = results.case.run_specs() if results.case else {}
    rows = []
    for check in results.entry.get("checks", []):
        spec = specs.get(check["run"])
        if spec is None or check["metric"] not in CRITICAL or not str(check["against"]).startswith("reference:"):
            continue
        swept = {key.rpartition(".")[2]: value for key, value in spec.sweep_values.items()}
        numbers = all(isinstance(value, int | float) for value in swept.values())
        if len(swept) == 2 and numbers and check["value"] is not None:
            (first, line), (second, x) = swept.items()
            rows.append((spec.family, first, second, line, x, check["metric"], check["value"], check["target"]))
    return pd.DataFrame(rows, columns=["family", "first", "second", "line", "x", "metric", "value", "published"])


def critical_values(results: CaseResults, folder: Path) -> list[style.Drawing]:
    """Draw peak force and its displacement over the last number swept, a line for each value of the first."""
    return [_critical(str(family), part, results, folder) for family, part in critical_table(results).groupby("family")]


def _critical(family: str, table: pd.DataFrame, results: CaseResults, folder: Path) -> style.Drawing:
    first, second = table["first"].iloc[0], table["second"].iloc[0]
    figure, axes = style.panels(1, len(CRITICAL), 8.4, 3.8)
    colours = style.colours_of([f"{line:g}" for line in sorted(table["line"].unique())])
    for axis, metric in zip(axes.flat, CRITICAL, strict=True):
        part = table[table["metric"] == metric]
        for line, row in part.groupby("line"):
            _draw_line(axis, row.sort_values("x"), colours[f"{float(str(line)):g}"], f"{first} = {float(str(line)):g}")
        axis.set(xlabel=_with_unit(second, results), xscale="log")
        axis.set_ylabel(f"{TITLES[metric]} [{results.unit(UNITS[metric])}]")
        ticks = sorted(part["x"].unique())
        axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks], minor=False)
        axis.minorticks_off()
        axis.grid(True)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    chosen = dict(zip(labels, handles, strict=True))
    chosen["published"] = chosen.pop("published")
    figure.legend(chosen.values(), chosen.keys(), loc="outside lower center", ncols=min(len(chosen), 5))
    name = f"critical-{style.slug(family)}"
    return style.drawing(
        figure, folder, name, f"Critical values: {family}",
        f"Lines: computed. Black crosses: published. {_largest_miss(table)} {_resolution(table)}",
        table,
    )


def single_table(results: CaseResults) -> pd.DataFrame:
    """Return what the checks against references say of sweeps over one number.

    Columns family, solver, swept (name), x (its value), metric, unit, value, target.
    """
    specs = results.case.run_specs() if results.case else {}
    rows = []
    for check in results.entry.get("checks", []):
        spec = specs.get(check["run"])
        published = str(check["against"]).startswith("reference:") and check["value"] is not None
        if spec is None or len(spec.sweep_values) != 1 or not published:
            continue
        ((key, x),) = spec.sweep_values.items()
        if isinstance(x, int | float) and not isinstance(x, bool):
            rows.append((spec.family, spec.solver, key, x, *(check[name] for name in SAID)))
    return pd.DataFrame(rows, columns=["family", "solver", "swept", "x", *SAID])


def values_over_sweep(results: CaseResults, folder: Path) -> list[style.Drawing]:
    """Draw each metric that a reference speaks of over the number swept, where there are at least three of them."""
    drawings = []
    for (family, metric), part in single_table(results).groupby(["family", "metric"]):
        row = part.sort_values("x").drop_duplicates("x")
        if len(row) < 3:
            continue
        figure = style.Figure(figsize=(6.4, 3.8))
        said = f"{str(metric).replace('_', ' ')}" + ("" if row["unit"].iloc[0] == "1" else f" [{row['unit'].iloc[0]}]")
        axes = style.curve_axes(figure, str(row["swept"].iloc[0]), said)
        line = SOLVERS[str(row["solver"].iloc[0])].line
        axes.plot(row["x"], row["value"], line, marker="o", markersize=4, label="computed")
        axes.plot(row["x"], row["target"], "x", color="black", markersize=6, label="published", zorder=4)
        axes.legend()
        name, title = f"{style.slug(str(metric))}-{style.slug(str(family))}", f"{said} over {row['swept'].iloc[0]}"
        drawings.append(style.drawing(figure, folder, name, title, "The number swept is in the case's units.", row))
    return drawings


def _with_unit(name: str, results: CaseResults) -> str:
    return f"{name} [{results.unit('length')}]" if name in (LENGTH_SCALE, SPACING) else name.replace("_", " ")


def _draw_line(axes: Any, row: pd.DataFrame, colour: str, label: str) -> None:
    axes.plot(row["x"], row["value"], "--o", color=colour, markersize=4, label=label)
    axes.plot(row["x"], row["published"], "x", color="black", markersize=6, label="published", zorder=4)


def _largest_miss(table: pd.DataFrame) -> str:
    said = []
    for metric, part in table.groupby("metric", sort=False):
        miss = np.abs(part["value"].to_numpy(float) / part["published"].to_numpy(float) - 1.0)
        worst = part.iloc[int(np.argmax(miss))]
        where = f"{worst['first']} = {worst['line']:g}, {worst['second']} = {worst['x']:g}"
        shares = f"{number(100 * float(miss.max()), 2)} % ({where}), median {number(100 * float(np.median(miss)), 2)} %"
        said.append(f"{TITLES[str(metric)]} {shares}")
    return f"Largest difference from print: {listed(said)}."


def _resolution(table: pd.DataFrame) -> str:
    """Say how much the peak still changes with the cells, where they resolve the length scale and where not."""
    if table["first"].iloc[0] != LENGTH_SCALE or table["second"].iloc[0] != SPACING:
        return ""
    spreads: dict[bool, list[float]] = {True: [], False: []}
    for line, row in table[table["metric"] == "peak_force"].groupby("line"):
        steps = row.sort_values("x")
        spacing, force = steps["x"].to_numpy(float), steps["value"].to_numpy(float)
        for h, change in zip(spacing[1:], np.abs(force[1:] / force[:-1] - 1.0), strict=True):
            spreads[bool(h <= float(str(line)))].append(float(change))
    if not spreads[True] or not spreads[False]:
        return ""
    return (
        f"From one spacing to the next finer one the peak force changes by at most {100 * np.max(spreads[True]):.1f} % "
        f"where h ≤ l0, and by up to {100 * np.max(spreads[False]):.1f} % where h > l0."
    )
