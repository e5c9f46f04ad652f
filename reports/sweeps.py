"""Figures of sweeps: critical values over what was swept, beside the published ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from . import style
from .results import method_of
from .words import listed, number

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from .results import CaseResults

CRITICAL = ("peak_force", "displacement_at_peak")
TITLES = {"peak_force": "peak force", "displacement_at_peak": "displacement at peak"}
UNITS = {"peak_force": "force", "displacement_at_peak": "displacement"}
SAID = ("metric", "unit", "value", "target")
LENGTH_SCALE, SPACING = "length_scale", "h"


def _swept(results: CaseResults) -> Iterator[tuple[Any, dict[str, Any], dict[str, Any]]]:
    """Yield what the checks against references say of sweeps over numbers: the run's spec, what was swept, the check."""
    specs = results.case.run_specs() if results.case else {}
    for check in results.checks:
        spec, published = specs.get(check["run"]), str(check["against"]).startswith("reference:")
        values = spec.sweep_values if spec else {}
        numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values.values())
        if values and numbers and published and check["value"] is not None:
            yield spec, values, check


def critical_table(results: CaseResults) -> pd.DataFrame:
    """Return what the checks say of sweeps over two numbers.

    Columns family, first, second (names of what was swept), line, x (their values), metric, value, published.
    """
    rows = []
    for spec, values, check in _swept(results):
        if len(values) == 2 and check["metric"] in CRITICAL:
            first, second = (key.rpartition(".")[2] for key in values)
            rows.append((spec.family, first, second, *values.values(), check["metric"], check["value"], check["target"]))
    return pd.DataFrame(rows, columns=["family", "first", "second", "line", "x", "metric", "value", "published"])


def critical_values(results: CaseResults, folder: Path) -> list[style.Drawing]:
    """Draw peak force and its displacement over the last number swept, a line for each value of the first."""
    return [_critical(str(family), part, results, folder) for family, part in critical_table(results).groupby("family")]


def _critical(family: str, table: pd.DataFrame, results: CaseResults, folder: Path) -> style.Drawing:
    first, second = table["first"].iloc[0], table["second"].iloc[0]
    figure, axes = style.panels(1, len(CRITICAL), 8.4, 3.8, grid=True)
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
    style.legend_below(figure, [axes.flat[0]], columns=5, last="published")
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
    rows = [
        (spec.family, spec.solver, *next(iter(values.items())), *(check[name] for name in SAID))
        for spec, values, check in _swept(results) if len(values) == 1
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=["family", "solver", "swept", "x", *SAID])


def values_over_sweep(results: CaseResults, folder: Path) -> list[style.Drawing]:
    """Draw each metric that a reference speaks of over the number swept, where there are at least three of them."""
    drawings = []
    for (family, metric), part in single_table(results).groupby(["family", "metric"]):
        row = part.sort_values("x").drop_duplicates("x")
        if len(row) < 3:
            continue
        said = f"{str(metric).replace('_', ' ')}" + ("" if row["unit"].iloc[0] == "1" else f" [{row['unit'].iloc[0]}]")
        figure, axes = style.curve_axes(6.4, 3.8, str(row["swept"].iloc[0]), said)
        line = method_of(str(row["solver"].iloc[0])).line
        axes.plot(row["x"], row["value"], linestyle=line, marker="o", markersize=4, label="computed")
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
