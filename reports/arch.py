"""Figures of vaults: how far they are broken along their span, and the hinges of limit analysis."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from verify.metrics.hinges import arch_of, exact_hinges, hinges_of, vault_of
from verify.metrics.metric import MetricError

from . import style
from .words import listed, number

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from verify.metrics.hinges import Hinge

    from .results import CaseResults, RunResults


def hinges(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Draw the least phase field over the angle from the crown in the last state of all runs."""
    if results.case is None:
        return None
    try:
        _, arch = arch_of(results.case)
    except MetricError:
        return None
    runs = results.main_runs()
    figure, axes = style.curve_axes(7.6, 3.6, "angle from the crown [°]", "least phase field c")
    colours, tables = style.colours_of([run.name for run in runs]), []
    for run in runs:
        table = _least_over_angle(run)
        axes.plot(table["angle"], table["c"], linestyle=run.method.line, color=colours[run.name], label=run.label)
        tables.append(table.assign(run=run.name))
    factor, exact = exact_hinges(arch)
    for number_of_line, place in enumerate(exact):
        label = {} if number_of_line else {"label": "hinges of limit analysis without tension"}
        axes.axvline(place, color=style.INK, linewidth=0.9, linestyle=":", **label)
    axes.set_ylim(-0.05, 1.05)
    style.legend_below(figure, [axes])
    said = listed(f"{run.name}: {_hinges_in_words(run, results.unit('time'))}" for run in runs)
    return style.drawing(
        figure, folder, "hinges", "Hinges",
        f"The vault stands without tension up to a horizontal load of {number(factor, 2)} of its weight. {said}.",
        pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(),
    )


def hinges_with_places(results: CaseResults, run: RunResults) -> list[tuple[Hinge, NDArray]]:
    """The hinges of a run and where they lay at its start (2,); none without a vault."""
    if results.case is None:
        return []
    try:
        _, arch = arch_of(results.case)
    except MetricError:
        return []
    found = hinges_of(run.folder)
    return list(zip(found, arch.middle([hinge.angle for hinge in found]), strict=True))


def _least_over_angle(run: RunResults) -> pd.DataFrame:
    angle, _, data = vault_of(run.folder)
    width = np.degrees(run.folder.case.mesh.h / arch_of(run.folder.case)[1].radius)
    sector = np.round(angle / width).astype(int)
    numbers = np.unique(sector)
    least = [float(data["phase_field"][sector == number].min()) for number in numbers]
    return pd.DataFrame({"angle": numbers * width, "c": least})


def _hinges_in_words(run: RunResults, unit: str) -> str:
    found = hinges_of(run.folder)
    told = listed(f"{number(hinge.angle, 3)}° at {number(hinge.time, 4)} {unit}" for hinge in found)
    return f"hinges at {told}" if found else "no hinge"
