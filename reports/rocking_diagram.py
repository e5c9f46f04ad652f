"""The diagram of failure and safety of a rocking block: verdicts and borders over the frequency and size of a pulse."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import pandas as pd

from cases.solvers import SOLVERS
from physics.rocking.motion import Verdict
from verify.metrics.rocking import verdict_on
from verify.studies.records import made_of

from . import style
from .results import READING_ERRORS
from .words import listed, plural

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from .results import CaseResults, RunResults

#: marks of the verdicts
MARKS = {
    Verdict.SAFE: ("o", "#56B4E9"), Verdict.AFTER_IMPACTS: ("s", "#E69F00"), Verdict.NO_IMPACT: ("^", "#D55E00"),
}  # fmt: skip
#: measured border of a rigid model -> width of its line; above it the block falls
BORDERS = {"border_after_impacts": 1.0, "border_without_impact": 2.0}
FREQUENCY, AMPLITUDE = "dynamics.ground.frequency_ratio", "dynamics.ground.uplift_ratio"


class Place(NamedTuple):
    """Frequency of the pulse over p, its amplitude over that of uplift, and what is there."""

    frequency: float
    amplitude: float
    what: str
    solver: str


def diagram(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Draw where the block falls over ω/p and α/α_g: points of the material points, borders of the rigid models."""
    if results.case is None or results.case.rocking is None:
        return None
    borders = [place for run in results.shown_runs() for place in _borders_of(run)]
    points = [*_points_of_runs(results), *_points_of_maps(results)]
    if len({place.frequency for place in borders}) < 2:
        return None
    figure, axes = style.curve_axes(6.4, 5.2, r"$\omega\,/\,p$", r"$\alpha\,/\,\alpha_g$")
    solvers = list(dict.fromkeys(place.solver for place in borders))
    colours = style.colours_of(solvers)
    for solver in solvers:
        for border, width in BORDERS.items():
            line = sorted(place for place in borders if (place.what, place.solver) == (border, solver))
            axes.plot(
                [place.frequency for place in line], [place.amplitude for place in line], linewidth=width,
                linestyle=SOLVERS[solver].line, color=colours[solver],
                label=f"{SOLVERS[solver].title}, {border.removeprefix('border_').replace('_', ' ')}",
            )  # fmt: skip
    for verdict, (mark, colour) in MARKS.items():
        there = [place for place in points if place.what == verdict]
        if not there:
            continue
        axes.plot(
            [place.frequency for place in there], [place.amplitude for place in there], mark, color=colour,
            markeredgecolor=style.INK, markeredgewidth=0.5, label=f"material points: {verdict}",
        )  # fmt: skip
    axes.set_ylim(bottom=0.0)
    style.legend_below(figure, [axes], columns=2)
    return style.drawing(
        figure, folder, "diagram", "Failure and safety",
        "Frequency of the pulse over p and its amplitude over that which lifts the block. Lines: amplitudes from which on"
        f" {listed(SOLVERS[s].title for s in solvers)} fall after impacts, thin, and without impact, thick."
        f" Marks: {plural(len(points), 'run')} of material points, those of the maps below among them, whose figures tell"
        " what they stand for and when they were made.",
        pd.DataFrame([*borders, *points]),
    )


def _borders_of(run: RunResults) -> Iterator[Place]:
    case, measures = run.folder.case, run.record.get("measures", {})
    ground = case.dynamics.ground if case.dynamics else None
    for name in BORDERS if ground and ground.frequency_ratio else ():
        if (value := measures.get(name)) is not None and math.isfinite(value):
            yield Place(float(ground.frequency_ratio), float(value), name, run.method.name)  # type: ignore[union-attr, arg-type]


def _points_of_runs(results: CaseResults) -> Iterator[Place]:
    for run in results.shown_runs():
        ground = run.folder.case.dynamics.ground  # type: ignore[union-attr]
        if not run.method.by_points or ground is None or None in (ground.frequency_ratio, ground.uplift_ratio):
            continue
        try:
            yield Place(ground.frequency_ratio, ground.uplift_ratio, str(verdict_on(run.folder)), run.method.name)  # type: ignore[arg-type]
        except READING_ERRORS:
            continue


def _points_of_maps(results: CaseResults) -> Iterator[Place]:
    """Cells of the maps of material points over the two, made here or for the record."""
    assert results.case is not None
    for made in made_of(results.case, "maps", results.out):
        chosen = made.study
        solver = made.case.run_spec(str(chosen.run)).solver if chosen.run else ""
        if (list(chosen.x), list(chosen.y)) == ([AMPLITUDE], [FREQUENCY]) and SOLVERS[solver].by_points:
            cells: Any = pd.read_csv(made.file).itertuples()
            yield from (Place(float(cell.y), float(cell.x), str(cell.verdict), solver) for cell in cells)
