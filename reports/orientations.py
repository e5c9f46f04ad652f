"""Figure of sweeps over the material's orientation: critical load over orientation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from cases import load_case

from . import style
from .curves import peak_row
from .results import method_of
from .words import listed, number

if TYPE_CHECKING:
    from pathlib import Path

    from cases import Case

    from .results import CaseResults

KEY = "orientation"


def critical_load_table(results: CaseResults) -> pd.DataFrame:
    """Peak force of each run of a sweep over an orientation: columns family, solver, orientation, peak_force.

    Families with the same solver and materials go on under the name of the first one.
    """
    specs = results.case.run_specs() if results.case else {}
    rows = []
    names: dict[tuple[str, str], str] = {}
    for run in results.shown_runs():
        spec = specs.get(run.name)
        swept = {key.rpartition(".")[2]: value for key, value in (spec.sweep_values if spec else {}).items()}
        if results.case and spec and list(swept) == [KEY]:
            name = names.setdefault((run.method.name, _materials(results.case, run.name)), spec.family)
            rows.append((name, run.method.name, float(swept[KEY]), float(peak_row(run.history)["F"])))
    return pd.DataFrame(rows, columns=["family", "solver", KEY, "peak_force"])


def _materials(case: Case, run: str) -> str:
    """The materials of a run but for their orientation."""
    materials = load_case(case.source, case.tier, run).materials
    return "".join(f"{name}{material.model_dump(exclude={'fracture': {KEY}})}" for name, material in materials.items())


def critical_load(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Draw the peak force over the material's orientation, a line for each family; None without two orientations."""
    table = critical_load_table(results)
    if table[KEY].nunique() < 2:
        return None
    figure, axes = style.curve_axes(6.4, 3.8, "material orientation [°]", f"critical load [{results.unit('force')}]")
    colours = style.colours_of(list(dict.fromkeys(table["family"])))
    for family, part in table.groupby("family", sort=False):
        row = part.sort_values(KEY)
        line = method_of(str(row["solver"].iloc[0])).line
        look = {"linestyle": line, "marker": "o", "markersize": 4, "color": colours[str(family)]}
        axes.plot(row[KEY], row["peak_force"], label=family, **look)
    axes.legend()
    return style.drawing(
        figure, folder, "critical-load-over-orientation", "Critical load over material orientation",
        _symmetry_in_words(table), table,
    )  # fmt: skip


def _symmetry_in_words(table: pd.DataFrame) -> str:
    """How far the critical loads at an orientation and at the opposite one differ."""
    said = []
    for family, part in table.groupby("family", sort=False):
        loads = part.set_index(KEY)["peak_force"]
        pairs = [angle for angle in loads.index if angle > 0 and -angle in loads.index]
        if pairs:
            miss = max(abs(loads[angle] / loads[-angle] - 1.0) for angle in pairs)
            said.append(f"{number(100 * float(np.round(miss, 6)), 2)} % ({family})")
    symmetry = f" Largest difference between an orientation and its opposite: {listed(said)}." if said else ""
    return "Largest reaction force over the orientation of the material's axis 1, counter-clockwise." + symmetry
