"""Figures of accuracy against cost, from the tables that ``verify chart`` leaves."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib.ticker import NullFormatter

from numerics.status import RunStatus
from verify.studies.charts import choice_sentence
from verify.studies.records import made_of

from . import style
from .results import method_of
from .words import listed, metric_in_words, number

if TYPE_CHECKING:
    from cases import Case
    from verify.studies.records import Made

    from .results import CaseResults

FAILED = [status for status in RunStatus if status.failed]


def accuracy_against_cost(results: CaseResults, folder: Path) -> list[style.Drawing]:
    """Draw every chart of the case that has been made, here or for the record."""
    if results.case is None:
        return []
    return [draw_chart(made, folder) for made in made_of(results.case, "charts", results.out)]


def draw_chart(made: Made, folder: Path) -> style.Drawing:
    """Draw one chart from its table, with the slopes and choices beside it; the caption says where it comes from.

    A row of axes for each quantity: its error over processor time and over counted work.
    """
    table = pd.read_csv(made.file)
    quantities, costs = list(table["quantity"].unique()), costs_of(made.case)
    figure, axes = style.panels(
        len(quantities), len(costs), 9.4, 0.8 + 2.7 * len(quantities), grid=True, sharey="row", sharex="col"
    )
    colours = style.colours_of(list(table["ladder"].unique()))
    for row, quantity in zip(axes, quantities, strict=True):
        part = table[table["quantity"] == quantity]
        for axis, cost in zip(row, costs, strict=True):
            _draw_quantity(axis, part, cost, colours)
        for axis in row:
            _draw_uncertainty(axis, part)
        words = metric_in_words(str(quantity))
        row[0].set_ylabel(f"{words} [%]" if "error" in words else f"relative error of\n{words.lower()} [%]")
        style.plain_numbers(row[0].yaxis, 100.0)
    for axis, words in zip(axes[-1], costs.values(), strict=True):
        axis.set_xlabel(words)
    style.plain_numbers(axes[-1, 0].xaxis)
    axes[-1, 1].xaxis.set_minor_formatter(NullFormatter())
    style.legend_above(figure, axes[:, 0])
    name = f"chart-{style.slug(made.name)}"
    title = f"Accuracy against cost: {made.study.title or made.name}"
    return style.drawing(figure, folder, name, title, _caption(made, table), table)


def costs_of(case: Case) -> dict[str, str]:
    """Columns of costs, and what they are called on an axis."""
    work = "material points × time steps" if case.dynamics else "unknowns × iterations"
    return {"seconds": "processor time, start-up left out [s]", "work": f"counted work: {work}"}


def _draw_quantity(axis: Any, part: pd.DataFrame, cost: str, colours: dict[str, str]) -> None:
    axis.set(xscale="log", yscale="log")
    for marker, (ladder, levels) in zip(cycle(style.MARKERS), part.groupby("ladder", sort=False), strict=False):
        line = method_of(str(levels["solver"].iloc[0])).line
        axis.plot(
            levels[cost], levels["error"], line, marker=marker, markersize=4,
            color=colours[str(ladder)], label=str(ladder).replace("_", " "),
        )  # fmt: skip
    front = part[part["on_front"].astype(bool)]
    axis.plot(
        front[cost], front["error"], "o", markersize=9, markerfacecolor="none", color=style.INK,
        markeredgewidth=0.8, label="front of best choices in time",
    )  # fmt: skip


def _draw_uncertainty(axis: Any, part: pd.DataFrame) -> None:
    """Shade the errors that are below what is known of the reference; the axis stays as it is."""
    unsure, limits = float(part["uncertainty"].max()), axis.get_ylim()
    if np.isfinite(unsure) and unsure > limits[0]:
        axis.axhspan(limits[0], unsure, color=style.PALE, zorder=0, label="uncertainty of the reference")
        axis.set_ylim(limits)


def _caption(made: Made, table: pd.DataFrame) -> str:
    choices = pd.read_csv(made.file.with_name(f"{made.name}-choices.csv"))
    slopes = pd.read_csv(made.file.with_name(f"{made.name}-slopes.csv"))
    together = choices[choices["quantity"] == "all quantities"]
    chosen = together if len(together) else choices
    parts = [made.note(), *(choice_sentence(choice) for _, choice in chosen.iterrows())]
    parts += [_own_targets(table), _orders(slopes), _failures(table)]
    repeats = table["repeats"].dropna()
    parts.append(f"Least processor time of {repeats.min():.0f} or more runs, start-up apart." if len(repeats) else "")
    return " ".join(part for part in parts if part)


def _own_targets(table: pd.DataFrame) -> str:
    """Quantities whose exact value is another one at every level, such as the toughness that a mesh sees."""
    said = []
    for quantity, values in table.dropna(subset=["reference"]).groupby("quantity", sort=False)["reference"]:
        if values.nunique() > 1:
            spread = f"{number(values.min(), 3)} to {number(values.max(), 3)}"
            said.append(f"Each level's {str(quantity).replace('_', ' ')} is held against its own exact value, {spread}.")
    return " ".join(said)


def _orders(slopes: pd.DataFrame) -> str:
    fitted = slopes[np.isfinite(slopes["order"])]
    said = []
    for quantity, part in fitted.groupby("quantity", sort=False):
        each = [f"{row['ladder']} {number(row['order'], 2)}" for _, row in part.iterrows()]
        said.append(f"{str(quantity).replace('_', ' ')}: {', '.join(each)}")
    return f"Fitted orders of the error in the level's size: {'; '.join(said)}." if said else ""


def _failures(table: pd.DataFrame) -> str:
    failed = table[table["status"].isin(FAILED)].drop_duplicates(["ladder", "level"])
    said = [f"{row['ladder']} at {row['level']}" for _, row in failed.iterrows()]
    return f"Without result: {listed(said)}." if said else ""
