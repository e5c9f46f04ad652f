"""All cases at once: what accuracy costs, on one picture, and where methods fail, in one table."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from cases import Case, list_cases, load_case
from cases.loader import LIBRARY
from cases.solvers import SOLVERS
from verify.studies.records import Kind, Made, made_of

from . import kept, style
from .charts import costs_of
from .maps import label_of, read_borders
from .results import READING_ERRORS, CaseResults, method_of
from .words import listed, number

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

TARGETS = (0.05, 0.01, 0.002)
FRONT_COLUMNS = ("case", "title", "solver", "chart", "ladder", "level", "seconds", "error")
PANELS = 4
FAINT = "#cfd3d8"


def studied_cases(summary: Mapping[str, Any], out: Path) -> list[Case]:
    """The cases of a report, and those of the library that have something on record."""
    judged = {entry["case"]: CaseResults(entry, out).case for entry in summary["cases"]}
    kept = [name for name in list_cases() if any((LIBRARY / name / kind).is_dir() for kind in ("charts", "maps"))]
    others = {name: load_case(name) for name in kept if name not in judged}
    return [case for _, case in sorted((judged | others).items()) if case is not None]


def all_made(cases: Sequence[Case], kind: Kind, out: Path) -> list[Made]:
    """The charts or maps of all cases that have been made."""
    return [made for case in cases for made in made_of(case, kind, out)]


# ------------------------------------------------------------------------------------ accuracy over seconds


def fronts(charts: Sequence[Made]) -> pd.DataFrame:
    """The levels of each case and solver that no other of them beats in seconds and error, the cheapest first.

    The error of a level is the largest of all quantities of its chart; those without an error at any level are left out.
    """
    levels = pd.concat([_levels(made) for made in charts], ignore_index=True)
    parts = [_front(part) for _, part in levels.groupby(["case", "solver"], sort=False)]
    return pd.concat(parts, ignore_index=True)[list(FRONT_COLUMNS)]


def _levels(made: Made) -> pd.DataFrame:
    table = pd.read_csv(made.file)
    known = table[table.groupby("quantity")["error"].transform("count") > 0]
    worst = known.groupby(["solver", "ladder", "level"], sort=False).agg(
        seconds=("seconds", "first"), error=("error", lambda errors: errors.max(skipna=False))
    )
    return worst.reset_index().assign(case=made.case.name, title=made.case.title, chart=made.name).dropna(
        subset=["seconds", "error"]
    )


def _front(levels: pd.DataFrame) -> pd.DataFrame:
    ordered = levels.sort_values(["seconds", "error"])
    return ordered[ordered["error"] < ordered["error"].cummin().shift(fill_value=np.inf)]


def draw_fronts(table: pd.DataFrame, charts: Sequence[Made], folder: Path) -> style.Drawing:
    """Draw a panel for each case on the same axes: its fronts, those of all others pale behind them."""
    names = list(table["case"].unique())
    rows = -(-len(names) // PANELS)
    figure, axes = style.panels(rows, PANELS, 11.5, 0.7 + 2.3 * rows, grid=True, sharex=True, sharey=True)
    colours = style.colours_of(solvers_of(table))
    for axis, name in zip(axes.flat, names, strict=False):
        _draw_case(axis, table, name, colours)
    for axis in list(axes.flat)[len(names) :]:
        axis.set_axis_off()
    for place, axis in enumerate(list(axes.flat)[: len(names)]):
        axis.tick_params(labelbottom=place + PANELS >= len(names))
    for axis in axes[:, 0]:
        axis.set_ylabel("relative error [%]")
    figure.supxlabel(costs_of(charts[0].case)["seconds"], fontsize=9)
    style.legend_above(figure, [axes.flat[0]])
    said = (
        "Each point is the cheapest run with that error, the largest of all quantities that the case charts; below and "
        "to the left is better. Seconds of different processors and of cases of different tiers are not to be compared."
    )
    return style.drawing(figure, folder, "fronts", "What accuracy costs", said, table)


def _fronts_drawn(table: pd.DataFrame, charts: Sequence[Made], folder: Path) -> style.Drawing | style.Film:
    """The picture of all fronts, drawn only if they are others than in the last report."""
    key = kept.key_of([table.to_csv(), costs_of(charts[0].case)])
    if groups := kept.read(folder, key):
        return groups[0][0]
    with style.drawing_style():
        drawn = draw_fronts(table, charts, folder)
    kept.write(folder, key, [[drawn]])
    return drawn


def solvers_of(table: pd.DataFrame) -> list[str]:
    """The solvers of a table in the order in which they are shown."""
    return [solver for solver in SOLVERS if solver in set(table["solver"])]


def _draw_case(axis: Any, table: pd.DataFrame, name: str, colours: dict[str, str]) -> None:
    mine, others = table[table["case"] == name], table[table["case"] != name]
    for solver, colour in colours.items():
        part, method = mine[mine["solver"] == solver], method_of(solver)
        axis.plot(
            part["seconds"], part["error"], linestyle=method.line, marker="o", markersize=4, color=colour,
            label=method.title,
        )
    for count, (_, other) in enumerate(others.groupby(["case", "solver"], sort=False)):
        label = "" if count else "the other cases"
        axis.plot(other["seconds"], other["error"], "-", color=FAINT, linewidth=1.0, zorder=1, label=label)
    axis.set(xscale="log", yscale="log")
    style.plain_numbers(axis.yaxis, 100.0)
    style.plain_numbers(axis.xaxis)
    axis.minorticks_off()
    axis.set_title(textwrap.fill(str(mine["title"].iloc[0]), 34), fontsize=8.5, loc="left")


def cost_rows(table: pd.DataFrame, charts: Sequence[Made]) -> list[dict[str, Any]]:
    """What of each case is charted, where it comes from, and each solver's least seconds for each target."""
    rows = []
    for name, part in table.groupby("case", sort=False):
        made = [one for one in charts if one.case.name == name]
        quantities = dict.fromkeys(one.metric.replace("_", " ") for each in made for one in each.study.quantities)
        seconds = {solver: [_least(levels, target) for target in TARGETS] for solver, levels in part.groupby("solver")}
        notes = listed(dict.fromkeys(filter(None, (one.note() for one in made))))
        rows.append({"case": made[0].case, "quantities": listed(quantities), "seconds": seconds, "note": notes})
    return rows


def _least(levels: pd.DataFrame, target: float) -> str:
    within = levels.loc[levels["error"] <= target, "seconds"]
    return number(within.min(), 2) if len(within) else "–"


# ------------------------------------------------------------------------------------------ where it fails


def border_groups(maps: Sequence[Made]) -> list[dict[str, Any]]:
    """For each map its case, title, axes, where it comes from, and its borders; those with a theory first."""
    return [
        {
            "case": made.case, "title": made.study.title or made.name, "note": made.note(), "rows": list(_borders(made)),
            "x": label_of(made.study.x, made.case), "y": label_of(made.study.y, made.case),
        }
        for made in sorted(maps, key=lambda made: not made.study.borders)
    ]  # fmt: skip


def _borders(made: Made) -> Iterator[dict[str, str]]:
    for _, row in read_borders(made).iterrows():
        known = np.isfinite(row["theory"])
        theory = str(row["border"]).replace("_", " ") if known else ""
        yield {
            "y": number(row["y"]) if isinstance(row["y"], int | float) else str(row["y"]),
            "change": f"{row['verdict_below']} → {row['verdict_above']}",
            "measured": number(row["measured"]),
            "theory": f"{number(row['theory'])} ({theory})" if known else "–",
            "ratio": number(row["measured"] / row["theory"], 3) if known else "–",
        }


# ------------------------------------------------------------------------------------------------- the page


def contents(summary: Mapping[str, Any], out: Path) -> dict[str, Any]:
    """What the page of all studies shows; ``drawing`` is None without charts, ``problem`` says what is amiss."""
    shown: dict[str, Any] = {"drawing": None, "costs": [], "borders": [], "targets": TARGETS, "problem": ""}
    try:
        cases = studied_cases(summary, out)
        charts = all_made(cases, "charts", out)
        if charts:
            table = fronts(charts)
            shown["drawing"] = _fronts_drawn(table, charts, out / "figures" / "studies")
            shown |= {"costs": cost_rows(table, charts), "solvers": solvers_of(table)}
        shown["borders"] = border_groups(all_made(cases, "maps", out))
    except READING_ERRORS as problem:
        shown["problem"] = f"{type(problem).__name__}: {problem}"
    return shown
