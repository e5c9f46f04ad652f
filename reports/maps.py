"""Figures of maps of failure, from the tables that ``verify stability`` leaves."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from verify.studies.records import made_of

from . import style
from .words import level_in_words, listed, number, plural

if TYPE_CHECKING:
    from cases import Case
    from verify.studies.records import Made

    from .results import CaseResults

# colour and mark of a verdict; those of accuracy take shades of blue, from the closest limit to the widest
FAILURES = {
    "energy drift": ("#E69F00", "E"),
    "blew up": ("#D55E00", "×"),
    "no convergence": ("#CC79A7", "–"),
    "numerical fracture": ("#7B3294", "/"),
    "timeout": ("#8a8f98", "T"),
    "not possible": ("#eceef1", ""),
    "slides": ("#F0E442", ""),
    "overturned after impacts": ("#E69F00", ""),
    "overturned without impact": ("#D55E00", ""),
}
GOOD = ("stable", "holds", "safe")
#: a power that is no surer than this is not told
SURE = 0.25
ACCURATE = ("#0072B2", "#56B4E9", "#A6D3F0", "#D6EAF8")


def where_it_fails(results: CaseResults, folder: Path) -> list[style.Drawing]:
    """Draw every map of the case that has been made, here or for the record."""
    if results.case is None:
        return []
    return [draw_map(made, folder) for made in made_of(results.case, "maps", results.out)]


def draw_map(made: Made, folder: Path) -> style.Drawing:
    """Draw one map from its table: a field for each cell, dots for bisected ones, the theory's border as a line.

    The caption says where it comes from.
    """
    table, borders = pd.read_csv(made.file), read_borders(made)
    columns, rows = (list(dict.fromkeys(table.loc[~table["bisected"], axis])) for axis in ("x", "y"))
    colours = _colours(table)
    figure, axes = style.panels(1, 1, 1.8 + 0.62 * max(len(columns), 6), 1.7 + 0.42 * max(len(rows), 3))
    axis = axes[0][0]
    for _, cell in table[~table["bisected"]].iterrows():
        _draw_cell(axis, cell, columns.index(cell["x"]), rows.index(cell["y"]), colours)
    if pd.api.types.is_numeric_dtype(table["x"]):
        _draw_borders(axis, table, borders, columns, rows, colours)
    axis.set_xticks(range(len(columns)), [_short(value) for value in columns])
    axis.set_yticks(range(len(rows)), [_short(value) for value in rows])
    axis.set(xlim=(-0.5, len(columns) - 0.5), ylim=(-0.5, len(rows) - 0.5))
    axis.set(xlabel=label_of(made.study.x, made.case), ylabel=label_of(made.study.y, made.case))
    for verdict, colour in colours.items():
        axis.fill_between([], [], color=colour, label=verdict)
    style.legend_above(figure, [axis])
    name = f"map-{style.slug(made.name)}"
    title = f"Where it fails: {made.study.title or made.name}"
    caption = " ".join(filter(None, (made.note(), _caption(table, borders), _powers(made))))
    return style.drawing(figure, folder, name, title, caption, table)


def read_borders(made: Made) -> pd.DataFrame:
    """Where the verdict of a map changes, and where theory has it."""
    return pd.read_csv(made.file.with_name(f"{made.name}-borders.csv"))


def label_of(levels: dict[str, tuple[Any, ...]], case: Case) -> str:
    """What differs from level to level, in words with units."""
    varied = [key for key, values in levels.items() if any(value != values[0] for value in values)]
    return ", ".join(level_in_words(key, case) for key in varied or list(levels)[:1])


def _colours(table: pd.DataFrame) -> dict[str, str]:
    found = list(dict.fromkeys(table["verdict"]))
    accurate = sorted((v for v in found if v.startswith("within")), key=lambda verdict: float(verdict.split()[1]))
    good = dict(zip([*(v for v in found if v in GOOD), *accurate], ACCURATE, strict=False))
    beyond = {verdict: "#F6D7C3" for verdict in found if verdict.startswith("beyond")}
    bad = {verdict: FAILURES.get(verdict, ("#D55E00", "?"))[0] for verdict in found if verdict not in good | beyond}
    return good | beyond | bad


def _draw_cell(axis: Any, cell: pd.Series, column: int, row: int, colours: dict[str, str]) -> None:
    colour = colours[cell["verdict"]]
    axis.fill_between([column - 0.48, column + 0.48], row - 0.48, row + 0.48, color=colour, linewidth=0)
    mark = FAILURES.get(cell["verdict"], ("", ""))[1]
    iterations = f"{cell['iterations']}" if cell["iterations"] and not mark else mark
    said = f"{number(100 * cell['error'], 2)} %" if np.isfinite(cell["error"]) else iterations
    dark = colour in ACCURATE[:1]
    axis.text(column, row, said, ha="center", va="center", fontsize=7, color="white" if dark else style.INK)


def _draw_borders(
    axis: Any, table: pd.DataFrame, borders: pd.DataFrame, columns: list[Any], rows: list[Any], colours: dict[str, str]
) -> None:
    """Bisected cells as dots between the columns, and the theory's border as a black line through the rows."""
    for _, cell in table[table["bisected"]].iterrows():
        axis.plot(
            _place(cell["x"], columns), rows.index(cell["y"]) - 0.3, "o", markersize=4,
            color=colours[cell["verdict"]], markeredgecolor=style.INK, markeredgewidth=0.5,
        )  # fmt: skip
    label: str | None = "border of the theory"
    for _, border in borders.dropna(subset=["theory"]).drop_duplicates(["y", "border"]).iterrows():
        x, row = _place(border["theory"], columns), rows.index(border["y"])
        axis.plot([x, x], [row - 0.48, row + 0.48], "-", color="black", linewidth=2, label=label)
        label = None


def _place(x: float, columns: list[Any]) -> float:
    """Where x lies between the columns, by logarithms where all are positive."""
    values, at = np.sort(np.asarray(columns, dtype=float)), np.argsort(columns).astype(float)
    if values[0] > 0 and x > 0:
        values, x = np.log(values), float(np.log(x))
    return float(np.interp(x, values, at, left=at[0] - 0.5, right=at[-1] + 0.5))


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _caption(table: pd.DataFrame, borders: pd.DataFrame) -> str:
    counts = table["verdict"].value_counts()
    parts = [f"{plural(len(table), 'cell')}: {listed(f'{count} {verdict}' for verdict, count in counts.items())}."]
    for border, known in borders.dropna(subset=["theory"]).groupby("border"):
        ratios = known["measured"] / known["theory"]
        spread = f"{number(float(ratios.min()), 3)} to {number(float(ratios.max()), 3)}"
        parts.append(f"Measured over theoretical border ({str(border).replace('_', ' ')}, black lines): {spread}.")
    failed = table[table["verdict"].isin(list(FAILURES)) & table["reason"].notna()].drop_duplicates(["verdict", "reason"])
    parts += [f"{row['verdict'].capitalize()}: {row['reason']}." for _, row in failed.head(4).iterrows()]
    if table["bisected"].any():
        parts.append("Dots: cells added by bisection.")
    return " ".join(parts)


def _powers(made: Made) -> str:
    """The errors of each row as a power of x."""
    file = made.file.with_name(f"{made.name}-powers.csv")
    table = pd.read_csv(file) if file.is_file() else pd.DataFrame()
    said = []
    for _, row in table.iterrows():
        errors = f"{_short(row['y'])}: {number(100 * row['least'], 2)} % to {number(100 * row['largest'], 2)} %"
        power = f", power {row['power']:.2f} ± {row['uncertainty']:.2f}" if row["uncertainty"] < SURE else ""
        said.append(errors + power)
    x, y = (label_of(levels, made.case) for levels in (made.study.x, made.study.y))
    return f"Errors over {x} for each {y}: {'; '.join(said)}." if said else ""
