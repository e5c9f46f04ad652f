"""Figures of curves: load-displacement, relative error, energies, convergence."""

from __future__ import annotations

from dataclasses import replace
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib.ticker import NullFormatter, NullLocator, StrMethodFormatter

from cases import CaseError, load_case
from verify.metrics.curves import BROKEN_FRACTION, Curve, CurveError, peak_index

from . import interactive, style
from .results import READING_ERRORS, method_of, tells
from .words import listed, metric_in_words, number

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from .results import CaseResults, RunResults

LARGEST_ENERGY_PANELS = 6
#: more runs than this have their legend below the curves
MANY_RUNS = 6
#: a relative error beyond this is told as such: of a force that has vanished there is no share
LARGEST_PERCENT = 100.0


def published_curves(results: CaseResults) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield the name and the points (columns u, F) of each reference that brings a curve."""
    for name, reference in results.case.references.items() if results.case else ():
        points = results.case.reference_curve(name) if results.case and reference.curve else ()
        if len(points):
            yield name, pd.DataFrame(points, columns=["u", "F"])


def peak_row(history: pd.DataFrame) -> pd.Series:
    """Return the increment at the peak, the one that the checks speak of."""
    try:
        return history.iloc[peak_index(Curve.from_history(history))]
    except CurveError:  # too short or not a number: still worth a picture
        return history.iloc[int(np.argmax(np.nan_to_num(np.abs(history["F"].to_numpy(float)))))]


_OVER_LOAD = {
    "reaction force": "Reaction force over displacement",
    "work per load factor": "Work of the loads over their factor",
    "force that does work on u,": "Force that does work on u, each reaction times the scale of its constraint, over u,",
}


def load_displacement(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Draw F over u of all runs over the published points, peaks marked."""
    runs = results.shown_runs()
    if not runs:
        return None
    force, displacement = results.unit("force"), results.unit("displacement")
    many = len(runs) > MANY_RUNS
    height = 4.2 + 0.09 * len(runs) * many
    figure, axes = style.curve_axes(7.2, height, results.load_label, f"{results.force_name} F [{force}]")
    published = list(published_curves(results))
    _draw_published(axes, published)
    colours = style.colours_of([run.name for run in runs])
    for run in runs:
        _draw_history(axes, run, colours[run.name], force, displacement)
    axes.axhline(0.0, color=style.GREY, linewidth=0.6)
    if many:
        figure.legend(loc="outside lower center", ncols=2, fontsize="x-small")
    else:
        axes.legend(loc="best")
    tables = [run.history[["u", "F"]].assign(run=run.name) for run in runs]
    tables += [points.assign(run=f"published: {name}") for name, points in published]
    drawn = style.drawing(
        figure, folder, "load-displacement", "Load and displacement",
        f"{_OVER_LOAD[results.force_name]} of {listed(run.label for run in runs)}; "
        "a ring marks the peak of each run. " + _published_caption(results, published),
        pd.concat(tables)[["run", "u", "F"]],
    )
    lines = [interactive.points(f"published: {name}", points["u"], points["F"]) for name, points in published]
    for run in runs:
        lines.append(interactive.line(run.label, colours[run.name], run.method.line, run.history["u"], run.history["F"]))
    return replace(drawn, curves=interactive.Curves(drawn.title, f"u [{displacement}]", f"F [{force}]", lines))


def _published_caption(results: CaseResults, published: list[tuple[str, pd.DataFrame]]) -> str:
    if not published or results.case is None:
        return "No published curve belongs to this case."
    sources = (f"{name}: {results.case.references[name].source}" for name, _ in published)
    return f"Black markers are published points ({'; '.join(sources)})."


def _draw_published(axes: Any, published: list[tuple[str, pd.DataFrame]]) -> None:
    for (name, points), marker in zip(published, cycle(style.MARKERS), strict=False):
        every = max(len(points) // 40, 1)  # a digitised curve of hundreds of points would hide the runs
        axes.plot(
            points["u"][::every], points["F"][::every], linestyle="none", marker=marker, markersize=3.6,
            color="black", markerfacecolor="white", markeredgewidth=0.8, zorder=2.5,
            label=f"published: {name}",
        )  # fmt: skip


def _draw_history(axes: Any, run: RunResults, colour: str, force: str, displacement: str) -> None:
    history, peak = run.history, peak_row(run.history)
    said = f"{run.label}, peak {number(peak['F'])} {force} at {number(peak['u'])} {displacement}"
    axes.plot(history["u"], history["F"], linestyle=run.method.line, color=colour, label=said, zorder=3)
    ring = {"markersize": 7, "markerfacecolor": "none", "markeredgewidth": 1.2}
    axes.plot(peak["u"], peak["F"], "o", color=colour, zorder=4, **ring)


# ---------------------------------------------------------------- relative error


def relative_errors(results: CaseResults, folder: Path) -> list[style.Drawing]:
    """Draw Eq. 4.19 over displacement, one figure for each reference (a run or a published curve)."""
    compared: dict[str, list[dict[str, Any]]] = {}
    for curve in results.entry.get("curves") or []:
        if curve.get("file") and (results.out / curve["file"]).is_file():
            compared.setdefault(curve["reference"], []).append(curve)
    return [_relative_error(results, reference, curves, folder) for reference, curves in compared.items()]


def _relative_error(
    results: CaseResults, reference: str, curves: list[dict[str, Any]], folder: Path
) -> style.Drawing:
    figure, axes = style.curve_axes(7.2, 3.2, results.load_label, "relative error, Eq. 4.19 [%]")
    colours = style.colours_of([run.name for run in results.shown_runs()])
    tables = [pd.read_csv(results.out / curve["file"]).assign(run=curve["run"]) for curve in curves]
    carried = tables[0].iloc[int(np.nanargmax(tables[0]["F_reference"].abs()))]
    for curve, table in zip(curves, tables, strict=True):
        run, name = results.runs.get(curve["run"]), curve["run"]
        error = table["relative_error_percent"].where(_is_loaded(table, carried["F_reference"]))
        axes.plot(
            table["u"], error, linestyle=run.method.line if run else "-", color=colours.get(name, style.INK), label=name
        )
    axes.axhline(0.0, color=style.GREY, linewidth=0.8)
    axes.axvline(carried["u"], color=style.GREY, linewidth=0.9, linestyle=":", label=f"peak of {reference}")
    together = pd.concat(tables, ignore_index=True)
    shown = together[_is_loaded(together, carried["F_reference"])]
    scaled = _calm_error_axis(axes, shown, float(carried["u"]))
    axes.legend(loc="upper left")
    unloaded = (
        f" Not drawn where {reference} carries less than {100 * BROKEN_FRACTION:g} % of its peak."
        if len(shown) < len(together) else ""
    )  # fmt: skip
    caption = (
        f"Relative error of the force against {reference}, Eq. 4.19. Its L2 norm: "
        f"{'; '.join(_norms_in_words(curve) for curve in curves)}.{unloaded}{scaled}"
    )
    name = f"relative-error-{style.slug(reference)}"
    return style.drawing(figure, folder, name, f"Relative error against {reference}", caption, together)


def _is_loaded(table: pd.DataFrame, peak: float) -> pd.Series:
    return table["F_reference"].abs() >= BROKEN_FRACTION * abs(peak)


def _norms_in_words(curve: Mapping[str, Any]) -> str:
    parts = (("before_peak", "up to the peak"), ("after_peak", "after it"), ("whole", "whole curve"))
    norms = ((curve.get(f"l2_percent_{key}"), words) for key, words in parts)
    said = (
        f"{number(norm, 3)} % {words}" if norm <= LARGEST_PERCENT else f"above {LARGEST_PERCENT:g} % {words}"
        for norm, words in norms if norm is not None
    )  # fmt: skip
    return f"{curve['run']} {', '.join(said)}"


def _calm_error_axis(axes: Any, table: pd.DataFrame, peak_u: float) -> str:
    """Keep the errors before the peak readable where those after it are far larger; say so."""
    error = table["relative_error_percent"].abs()
    before = error[(table["u"].abs() > 0.05 * abs(peak_u)) & (table["u"].abs() <= 0.9 * abs(peak_u))].max()
    if not before > 0 or not error.max() > 20 * before:
        return ""
    linear = 2 * style.nice_number(before)
    axes.set_yscale("symlog", linthresh=linear)
    axes.axhspan(-linear, linear, color=style.PALE, zorder=0)
    axes.yaxis.set_minor_locator(NullLocator())  # each tick, and each formula as its label, costs time to draw
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    return f" The axis is linear within ±{number(linear)} % (shaded) and logarithmic beyond."


# ---------------------------------------------------------------- energies


def energies(results: CaseResults, folder: Path) -> style.Drawing | None:
    """Draw elastic, fracture, kinetic energy, their sum and the external work of each run that tells them."""
    runs = [run for run in results.shown_runs() if tells(run, "E_el", "E_frac")]
    many = len(runs) > LARGEST_ENERGY_PANELS
    shown = [run for run in results.main_runs(LARGEST_ENERGY_PANELS) if run in runs] if many else runs
    if not shown:
        return None
    columns = min(len(shown), 3)
    rows = -(-len(shown) // columns)
    figure, grid = style.panels(
        rows, columns, 7.2 if columns > 1 else 4.8, 2.9 * rows, grid=True, sharey=True, sharex=True
    )
    for axes in grid.flat[len(shown) :]:
        axes.set_visible(False)
    for axes, run in zip(grid.flat, shown, strict=False):
        _draw_energies(axes, run)
        axes.set(title=run.label, xlabel=results.load_label)
    for axes in grid[:, 0]:
        axes.set_ylabel(f"energy [{results.unit('energy')}]")
    style.legend_below(figure, [grid.flat[0]], columns=5)
    left_out = f" {len(runs) - len(shown)} further runs are in the CSV." if len(shown) < len(runs) else ""
    return style.drawing(
        figure, folder, "energies", "Energies",
        f"Energies over displacement. {_balance_caption(shown)}{left_out}",
        style.table_of(runs, ("u", "E_el", "E_frac", "E_kin", "W_ext")),
    )


def _energy_sum(history: pd.DataFrame) -> pd.Series:
    kinetic = history["E_kin"].fillna(0.0) if "E_kin" in history else 0.0
    return history["E_el"] + history["E_frac"] + kinetic


def _draw_energies(axes: Any, run: RunResults) -> None:
    history, look = run.history, {"linestyle": run.method.line, "marker": ""}
    axes.plot(
        history["u"], history["W_ext"], color=style.GREY, linewidth=3.4, alpha=0.55, label="external work"
    )
    told = history.dropna(subset=["E_el", "E_frac"])
    if len(told) < len(history):  # integrated from the fields of some states
        history, look = told, {"linestyle": "", "marker": "o"}
    axes.plot(history["u"], _energy_sum(history), "-", color="black", linewidth=0.9, label="sum of energies")
    axes.plot(history["u"], history["E_el"], color=style.OKABE_ITO[0], label="elastic", **look)
    axes.plot(history["u"], history["E_frac"], color=style.OKABE_ITO[1], label="fracture", **look)
    if "E_kin" in history and history["E_kin"].abs().max() > 0:
        axes.plot(history["u"], history["E_kin"], color=style.OKABE_ITO[2], label="kinetic", **look)


def _balance_caption(runs: list[RunResults]) -> str:
    largest = {run.name: run.history["W_ext"].abs().max() for run in runs}
    gaps = {run.name: (_energy_sum(run.history) - run.history["W_ext"]).abs().max() for run in runs}
    parts = [f"{100 * gaps[name] / work:.2g} % ({name})" for name, work in largest.items() if work > 0]
    said = "Largest gap between the sum and the external work, over the largest work"
    return f"{said}: {listed(parts)}." if parts else ""


# ---------------------------------------------------------------- convergence


def sweep_table(results: CaseResults) -> pd.DataFrame:
    """Return the errors of all sweeps over the spacing h.

    Columns base, solver, h, measure, error, theory; empty when no run of a sweep over h has an ``l2_error``.
    """
    rows = []
    specs = results.case.run_specs() if results.case else {}
    for run in results.runs.values():
        spec = specs.get(run.name)
        if spec is None or "mesh.h" not in spec.sweep_values:
            continue
        others = [f"{key}={value}" for key, value in spec.sweep_values.items() if key != "mesh.h"]
        family = ", ".join([spec.family, *others])
        for measure, error in (run.entry.get("measures") or {}).items():
            if measure.startswith("l2_error") and error is not None and error > 0:
                h = float(spec.sweep_values["mesh.h"])
                rows.append((family, run.method.name, h, measure, error, _theory(results, run, spec.family, measure)))
    table = pd.DataFrame(rows, columns=["base", "solver", "h", "measure", "error", "theory"])
    return table.sort_values(["measure", "base", "h"], ignore_index=True)


def _theory(results: CaseResults, run: RunResults, family: str, measure: str) -> float:
    """Return the order that a check asks for, else that of a smooth field: 2 for linear elements, p + 1 for splines."""
    orders = (check for check in results.checks if check["metric"] == "convergence_order" and check["run"] == family)
    asked = [check["target"] for check in orders if measure in (check.get("parameters") or {}).values()]
    if asked and asked[0] is not None:
        return float(asked[0])
    if not run.method.by_points:
        return 2.0
    try:
        case = load_case(results.source, tier=results.tier or None, run=run.name)
        return float(case.mpm.order) + 1.0
    except (CaseError, *READING_ERRORS):
        return float("nan")


def convergence(results: CaseResults, folder: Path) -> list[style.Drawing]:
    """Draw error over h in logarithmic axes with fitted slopes, one figure per measure."""
    table = sweep_table(results)
    return [_convergence(str(measure), part, results, folder) for measure, part in table.groupby("measure")]


def _convergence(measure: str, table: pd.DataFrame, results: CaseResults, folder: Path) -> style.Drawing:
    words = metric_in_words(measure)
    figure, axes = style.curve_axes(5.6, 4.4, f"spacing h [{results.unit('length')}]", words)
    axes.set(xscale="log", yscale="log")
    colours = style.colours_of(list(table["base"].unique()))
    said = []
    for base, part in table.groupby("base", sort=False):
        slope = _draw_sweep(axes, str(base), part, colours[str(base)])
        expected = f" (theory {part['theory'].iloc[0]:g})" if np.isfinite(part["theory"].iloc[0]) else ""
        said.append(f"{base}: {number(slope, 3)}{expected}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    ticks = np.sort(table["h"].unique())
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.legend(loc="best")
    return style.drawing(
        figure, folder, f"convergence-{style.slug(measure)}", f"Convergence: {words}",
        f"Error over spacing; slopes fitted by least squares to all levels: {'; '.join(said)}. "
        "Grey triangles show the slope that theory predicts.",
        table,
    )


def _draw_sweep(axes: Any, base: str, part: pd.DataFrame, colour: str) -> float:
    h, error = part["h"].to_numpy(float), part["error"].to_numpy(float)
    slope = float(np.polyfit(np.log(h), np.log(error), 1)[0]) if len(h) > 1 else float("nan")
    line, said = method_of(str(part["solver"].iloc[0])).line, f"{base}: slope {number(slope, 3)}"
    axes.plot(h, error, linestyle=line, marker="o", markersize=4, color=colour, label=said)
    theory = float(part["theory"].iloc[0])
    if len(h) > 1 and np.isfinite(theory):
        _draw_slope_triangle(axes, h, error, theory)
    return slope


def _draw_slope_triangle(axes: Any, h: np.ndarray, error: np.ndarray, order: float) -> None:
    """Draw a triangle of slope ``order`` under the two finest levels."""
    left, right = np.sort(h)[:2]
    base = 0.55 * error[np.argmin(h)]
    top = base * (right / left) ** order
    axes.plot([left, right, right, left], [base, base, top, base], color=style.GREY, linewidth=0.8)
    axes.annotate(
        f"{order:g}", (right, np.sqrt(base * top)), xytext=(3, 0), textcoords="offset points",
        va="center", color="#5c6168", fontsize=8,
    )  # fmt: skip
