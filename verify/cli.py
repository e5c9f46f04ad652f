"""The command line: cases before anything is run, runs and their judgement, studies of accuracy, failure and cost.

Exit codes: 0 within tolerance, 1 out of tolerance, 2 a run failed, 3 bad input, 4 nothing was checked.
"""

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import typer
from rich.console import Console
from rich.table import Table

from cases import Case, CaseError, UserError, list_cases, load_case, schema_text
from numerics.status import RunStatus
from verify.judging.acceptance import accept
from verify.judging.judge import checks_of, find_runs
from verify.judging.summary import exit_code, summarise, write_summary
from verify.judging.views import check_name, check_sentence, counts, failed_runs
from verify.runs.jobs import Job, outcomes
from verify.runs.provenance import code_version
from verify.runs.run_folder import RunFolderError
from verify.runs.running import DEFAULT_OUT, DEFAULT_THREADS

OUT_OF_TOLERANCE, RUN_FAILED, BAD_INPUT, NOTHING_CHECKED = 1, 2, 3, 4
COLOURS = {"PASS": "green", "FAIL": "red", "RUN_FAILED": "red", "MISSING": "yellow", "NOT_CHECKED": "yellow"}
EXIT_CODE_HELP = (
    "Exit codes: 0 within tolerance, 1 out of tolerance, 2 a run failed, 3 bad input, 4 nothing was checked."
)

app = typer.Typer(
    name="verify",
    help=f"Verify phase-field fracture by two independent solvers. {EXIT_CODE_HELP}",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)

CaseArgument = Annotated[
    str, typer.Argument(help="name in the library, folder with a case.toml, or .toml file")
]
OptionalCase = Annotated[
    str | None,
    typer.Argument(metavar="[CASE]", help="name, folder or .toml file; all of the library without it"),
]
TierOption = Annotated[str, typer.Option("--tier", help="resolution: quick, standard or paper")]
OutOption = Annotated[Path, typer.Option("--out", help="folder of all results")]
AccuracyOption = Annotated[
    str | None, typer.Option("--accuracy", help="error allowed in each checked quantity, such as 1%")
]
ClusterOption = Annotated[
    str | None,
    typer.Option("--cluster", help="do the runs on this Dask cluster, one on each worker: tcp://host:8786"),
]
RunOption = Annotated[list[str] | None, typer.Option("--run", help="only this run; may be repeated")]


def _console() -> Console:
    """Made anew for each command, because tests and callers may have replaced sys.stdout."""
    return Console(file=sys.stdout, soft_wrap=not sys.stdout.isatty())


def _selected(case: str | None, tier: str) -> list[Case]:
    return [load_case(name, tier) for name in ([case] if case else list_cases())]


def _selected_runs(case: Case, wanted: list[str] | None) -> list[str]:
    """Names of the runs to do; the name of a sweep stands for all its members."""
    if not wanted:
        return case.expanded_runs()
    names: list[str] = []
    for run_name in wanted:
        members = [name for name in case.expanded_runs() if case.run_spec(name).family == run_name]
        names += members or [run_name]
    return list(dict.fromkeys(names))


# ----------------------------------------------------------------------------------------- look, not compute


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(code_version())
        raise typer.Exit


@app.callback()
def main_options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="show the version and end")
    ] = False,
) -> None:
    """Options of the program itself."""


@app.command("list")
def list_command() -> None:
    """List the cases of the library with their runs.

    Example: `verify list`
    """
    console, table = _console(), Table("case", "section", "title", "runs")
    for name in list_cases():
        case = load_case(name)
        table.add_row(name, case.section, case.title, ", ".join(case.runs))
    console.print(table)


@app.command()
def validate(case: OptionalCase = None) -> None:
    """Check case files in all tiers and runs, without running them.

    Examples: `verify validate` · `verify validate sen_tension` · `verify validate my_case.toml`
    """
    for name in [case] if case else list_cases():
        for tier in ("quick", "standard", "paper"):
            loaded = load_case(name, tier)
            checks_of(loaded)
            for run_name in loaded.expanded_runs():
                load_case(name, tier, run_name)
        _console().print(f"{name}: valid", highlight=False)


@app.command()
def plan(
    case: CaseArgument,
    tier: TierOption = "standard",
    run_names: RunOption = None,
    accuracy: AccuracyOption = None,
    out: OutOption = DEFAULT_OUT,
) -> None:
    """Print what will be modelled and what it will cost, without running it.

    With an accuracy, the savings with the highest recorded prices are switched off until the rest keeps within it, as
    `verify run --accuracy` does; what the case's charts say of it is repeated.

    Examples: `verify plan sen_tension --tier paper` · `verify plan sen_tension --tier quick --accuracy 1%`
    """
    from verify.planning.plan import RULE
    from verify.planning.plan import plan as make_plan
    from verify.studies.charts import recorded_choices

    base, share = load_case(case, tier), _share(accuracy)
    console = _console()
    for name in _selected_runs(base, run_names):
        console.print(_plan_table(make_plan(load_case(case, tier, name), name, share)))
    console.print(f"Seconds are a rough estimate: {RULE}.", highlight=False)
    for sentence in recorded_choices(base, out, share) if share else ():
        console.print(f"Measured by `verify chart`: {sentence}", highlight=False)


def _share(accuracy: str | None) -> float | None:
    """0.01 for "1%" and for "0.01"."""
    if accuracy is None:
        return None
    text = accuracy.strip()
    try:
        value = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        value = math.nan
    if not 0.0 < value < 1.0:
        raise typer.BadParameter(f"{accuracy!r} is no share; give for instance 1% or 0.01", param_hint="--accuracy")
    return value


def _plan_table(planned: Any) -> Table:
    table = Table(
        "what", "value", title=f"{planned.case} · {planned.tier} · {planned.run}", title_justify="left"
    )
    adapts = " or more, adaptive" if planned.adaptive else ", constant"
    increments = f"{planned.increments}{adapts}, about {planned.iterations} staggered iterations in all"
    rows = {
        "regime": planned.regime,
        "bodies": planned.bodies,
        "solver": f"{planned.solver}: {planned.basis}",
        "notch": planned.notches,
        "cells": f"{planned.cells}",
        "points": f"{planned.points}",
        "unknowns": f"{planned.unknowns_displacement} of u, {planned.unknowns_phase_field} of c",
        "increments": f"{planned.increments} equal steps in time"
        if planned.explicit
        else f"{increments}, about as many Newton iterations",
        "memory": f"about {planned.memory_mb:.0f} MB",
        "time": f"about {planned.seconds:.0f} s",
    }
    for what, value in rows.items():
        table.add_row(what, value)
    for saving in planned.savings:
        table.add_row(saving.name, f"{'on' if saving.used else 'off'}: {saving.reason}")
    for note in (*planned.notes, planned.unpriced):
        if note:
            table.add_row("note", note)
    return table


@app.command()
def surface(case: CaseArgument, tier: TierOption = "standard", out: OutOption = DEFAULT_OUT) -> None:
    """Draw the surface energy of a case's materials over direction, without running the case.

    Writes polar plots, surface stiffness and profiles as SVG with the CSV behind them.

    Example: `verify surface square_plate_anisotropic`
    """
    from reports import write_surface

    loaded = load_case(case, tier)
    if not loaded.fracture_enabled:
        raise CaseError(f"{loaded.source}: no material has a table 'fracture', so there is no surface energy; add one.")
    unit = loaded.units.label("toughness")
    table = Table("material", "order", f"least [{unit}]", "at [°]", f"largest [{unit}]", "at [°]", "forbidden [°]")
    for row in write_surface(loaded, out).to_dict("records"):
        least = (f"{row['least']:.5g}", f"{row['theta_least']:.1f}")
        largest = (f"{row['largest']:.5g}", f"{row['theta_largest']:.1f}")
        table.add_row(row["material"], str(row["order"]), *least, *largest, row["forbidden"])
    console = _console()
    console.print(table)
    console.print(f"Figures and data: {out / 'surface' / loaded.name}", highlight=False)


@app.command()
def schema() -> None:
    """Print the JSON Schema of case files, for editors.

    Example: `verify schema > case.schema.json`
    """
    typer.echo(schema_text(), nl=False)


# ------------------------------------------------------------------------------------------------- compute


@app.command("run")
def run_command(
    case: OptionalCase = None,
    tier: TierOption = "standard",
    out: OutOption = DEFAULT_OUT,
    run_names: RunOption = None,
    force: Annotated[bool, typer.Option("--force", help="run even what is up to date")] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="go on with runs that were stopped, from their last checkpoint")
    ] = False,
    threads: Annotated[
        int, typer.Option("--threads", min=1, help="threads of all jobs together; on a cluster, of each")
    ] = DEFAULT_THREADS,
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="runs at the same time")] = 1,
    accuracy: AccuracyOption = None,
    cluster: ClusterOption = None,
) -> None:
    """Compute the runs of a case, or of all cases, that are not up to date. Judges nothing.

    Examples: `verify run sen_tension` · `verify run sen_shear --run mpm --tier quick` · `verify run --jobs 2` ·
    `verify run l_panel --tier paper --resume` · `verify run sen_tension --accuracy 1%` ·
    `verify run --cluster tcp://127.0.0.1:8786 --threads 1`
    """
    from verify.planning.plan import plan as make_plan

    each = threads if cluster else max(1, threads // jobs)
    todo = [
        Job(*named, tier=tier, out=out, threads=each, force=force, resume=resume)
        for named in _named_runs(case, tier, run_names)
    ]
    for job in todo:
        job.case()  # a mistake in the last case is told before the first run
    console, failed = _console(), False
    if accuracy is not None:
        plans = [make_plan(job.case(), job.run, _share(accuracy)) for job in todo]
        todo = [replace(job, change=planned.change) for job, planned in zip(todo, plans, strict=True)]
        for job, planned in zip(todo, plans, strict=True):
            off = [f"{name} off: it {why}" for name, why in planned.too_dear.items()]
            for said in (*off, planned.unpriced):
                console.print(f"{job.title}: {said}", markup=False, highlight=False) if said else None
    for outcome in outcomes(todo, jobs, cluster):
        console.print(f"{outcome.title}: {outcome.line}", markup=False, highlight=False)
        failed |= outcome.failed
    if failed:
        raise typer.Exit(RUN_FAILED)


def _named_runs(case: str | None, tier: str, run_names: list[str] | None) -> list[tuple[Path, str, str]]:
    """Source, case and run of what is asked for. Over the whole library, a case without the named run is passed over."""
    todo = []
    for loaded in _selected(case, tier):
        for name in _selected_runs(loaded, run_names):
            if case or name in loaded.expanded_runs():
                todo.append((loaded.source, loaded.name, name))
    if not todo:
        raise typer.BadParameter(f"no case has a run called {', '.join(run_names or [])}", param_hint="--run")
    return todo


# --------------------------------------------------------------------------------------------------- judge


@app.command()
def compare(case: OptionalCase = None, tier: TierOption = "standard", out: OutOption = DEFAULT_OUT) -> None:
    """Judge finished runs and write summary.json, junit.xml, summary.csv and summary.md. Computes nothing.

    Without a case, all cases of the library that have been run in this tier are judged.

    Examples: `verify compare` · `verify compare sen_tension --tier paper`
    """
    cases = _selected(case, tier)
    found = [loaded for loaded in cases if _has_runs(loaded, out)]
    if not found:
        command = " ".join(["verify run", *([case] if case else []), "--tier", tier, "--out", str(out)])
        raise RunFolderError(
            f"{out / 'runs'}: nothing has been run in tier {tier!r}; do it with `{command}`."
        )
    summary = summarise(found, tier, out)
    write_summary(summary, out)
    console = _console()
    _print_problems(console, summary)
    console.print(_verdict_table(summary))
    left_out = [loaded.name for loaded in cases if loaded not in found]
    if left_out:
        console.print(f"Not run in this tier and not judged: {', '.join(left_out)}", highlight=False)
    raise typer.Exit(exit_code(summary))


def _has_runs(case: Case, out: Path) -> bool:
    return any(state.status != RunStatus.MISSING for state in find_runs(case, out).values())


def _print_problems(console: Console, summary: dict[str, Any]) -> None:
    for case in summary["cases"]:
        for sentence in failed_runs(case):
            console.print(f"{case['case']}: run {sentence}", markup=False, highlight=False)
        for check in case["checks"]:
            if check["verdict"] in ("FAIL", "MISSING"):
                line = f"{case['case']}: {check['verdict']}: {check_name(check)}: {check_sentence(check)}"
                console.print(line, markup=False, highlight=False)


def _verdict_table(summary: dict[str, Any]) -> Table:
    table = Table("case", "verdict", "checks passed", "most of a limit", title=f"tier {summary['tier']}")
    for case in summary["cases"]:
        passed, gated, margin = counts(case)
        share = "" if margin is None else f"{100 * margin:.0f} %"
        colour = COLOURS[case["verdict"]]
        table.add_row(case["case"], f"[{colour}]{case['verdict']}[/]", f"{passed} of {gated}", share)
    return table


@app.command()
def report(
    out: OutOption = DEFAULT_OUT,
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="pages made at the same time")] = 1,
) -> None:
    """Write the HTML report of what `compare` judged last, and print its path. Computes nothing.

    Example: `verify report --out reports/out`
    """
    if not (out / "summary.json").is_file():
        raise RunFolderError(
            f"{out / 'summary.json'}: there is nothing to report; judge with `verify compare` first."
        )
    from reports import write_report

    typer.echo(f"Report: {write_report(out, jobs)}")


@app.command("accept")
def accept_command(
    case: CaseArgument,
    reason: Annotated[str, typer.Option("--reason", help="why the new values are right; kept beside them")],
    tier: TierOption = "standard",
    out: OutOption = DEFAULT_OUT,
) -> None:
    """Make the values of the finished runs the baseline of a case and tier.

    Example: `verify accept sen_tension --tier quick --reason "finer staggered tolerance, see README"`
    """
    loaded = load_case(case, tier)
    rows = accept(loaded, reason, out)
    table = Table("run", "metric", "parameters", "value", "unit", title=f"accepted for {loaded.name}, tier {tier}")
    for row in rows:
        table.add_row(row.run, row.metric, row.parameters, f"{row.value:.8g}", row.unit)
    _console().print(table)


# -------------------------------------------------------------------------------------------------- studies


@app.command()
def chart(
    case: CaseArgument,
    tier: TierOption = "standard",
    out: OutOption = DEFAULT_OUT,
    names: Annotated[list[str] | None, typer.Option("--chart", help="only this chart; may be repeated")] = None,
    repeats: Annotated[int, typer.Option("--repeats", min=1, help="runs of each level; the least time counts")] = 1,
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="runs at the same time")] = 1,
    threads: Annotated[int, typer.Option("--threads", min=1, help="threads of each run")] = 1,
    cluster: ClusterOption = None,
) -> None:
    """Chart accuracy against cost: run the ladders of a case's charts, tabulate and draw error over time and work.

    Finished runs are used again, stopped ones are gone on with. Tables and figures go to OUT/charts.

    Examples: `verify chart sen_tension --tier quick` · `verify chart surfing --chart spacing --repeats 3`
    """
    from reports import draw_chart, drawing_style
    from verify.studies.charts import choice_sentence, make_charts
    from verify.studies.study import Options

    console, loaded = _console(), load_case(case, tier)

    def tell(line: str) -> None:
        console.print(line, markup=False, highlight=False)

    for file in make_charts(loaded, Options(out, jobs, threads, cluster), names or [], repeats, tell):
        with drawing_style():
            drawing = draw_chart(file, file.parent, loaded.charts[file.stem].title)
        for _, choice in pd.read_csv(file.with_name(f"{file.stem}-choices.csv")).iterrows():
            tell(choice_sentence(choice))
        tell(f"Chart: {file}, {file.parent / drawing.file}")


@app.command()
def stability(
    case: CaseArgument,
    tier: TierOption = "standard",
    out: OutOption = DEFAULT_OUT,
    names: Annotated[list[str] | None, typer.Option("--map", help="only this map; may be repeated")] = None,
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="runs at the same time")] = 1,
    threads: Annotated[int, typer.Option("--threads", min=1, help="threads of each run")] = 1,
    cluster: ClusterOption = None,
) -> None:
    """Map where a method fails: a verdict for every pair of two levels, the border between them bisected.

    Finished runs are used again, failed ones too. Tables and figures go to OUT/maps.

    Examples: `verify stability sen_tension --tier quick` · `verify stability surfing --map toughness --jobs 2`
    """
    from reports import draw_map, drawing_style
    from verify.studies.maps import make_maps
    from verify.studies.study import Options

    console, loaded = _console(), load_case(case, tier)

    def tell(line: str) -> None:
        console.print(line, markup=False, highlight=False)

    for file in make_maps(loaded, Options(out, jobs, threads, cluster), names or [], tell):
        with drawing_style():
            drawing = draw_map(file, file.parent, loaded.maps[file.stem])
        tell(drawing.caption)
        tell(f"Map: {file}, {file.parent / drawing.file}")


@app.command("price")
def price_command(
    case: CaseArgument,
    tier: TierOption = "standard",
    out: OutOption = DEFAULT_OUT,
    run_names: RunOption = None,
    only: Annotated[list[str] | None, typer.Option("--saving", help="only this saving; may be repeated")] = None,
    record: Annotated[bool, typer.Option("--record", help="keep the prices beside the case's baseline")] = False,
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="runs at the same time")] = 1,
    threads: Annotated[int, typer.Option("--threads", min=1, help="threads of each run")] = 1,
    cluster: ClusterOption = None,
) -> None:
    """Price every saving: run a case with each of them off in turn and with all off.

    Tabulates processor time spared against the change in each checked quantity. Recorded prices are read by
    `verify plan` and `verify run` with `--accuracy`.

    Examples: `verify price sen_tension --tier quick` · `verify price sen_tension --run fem --record`
    · `verify price l_panel --saving "graded grid"`
    """
    from verify.studies.prices import price
    from verify.studies.study import Options

    console, loaded = _console(), load_case(case, tier)

    def tell(line: str) -> None:
        console.print(line, markup=False, highlight=False)

    file = price(loaded, Options(out, jobs, threads, cluster), run_names or [], tell, record, only or [])
    console.print(_price_table(pd.read_csv(file)))
    tell(f"Prices: {file}")


def _price_table(prices: pd.DataFrame) -> Table:
    ratios = {"time": "seconds", "work": "work", "unknowns": "unknowns"}
    table = Table("run", "without", *(f"times the {name}" for name in ratios), "quantity", "with", "without it", "change")
    for _, row in prices.iterrows():
        cost = [f"{row[f'{key}_without'] / row[f'{key}_with']:.3g}" for key in ratios.values()]
        change = "" if math.isnan(row["change"]) else f"{100 * row['change']:.2g} %"
        values = (row["quantity"], f"{row['with']:.6g}", f"{row['without']:.6g}", change)
        shown = values if isinstance(row["quantity"], str) else ("", "", "", str(row["status"]))
        table.add_row(row["run"], row["saving"], *cost, *shown)
    return table


@app.command()
def calibrate(
    out: OutOption = DEFAULT_OUT,
    write: Annotated[bool, typer.Option("--write", help="keep constants and runs in verify/planning/costs.*")] = False,
) -> None:
    """Fit the constants of predicted costs to all finished runs of a folder, and tell how far predictions are off.

    Run on an idle machine for seconds that hold elsewhere; processor time is what is fitted.

    Examples: `verify calibrate` · `verify calibrate --out reports/out --write`
    """
    from verify.planning import calibration

    table = calibration.measured_runs(out)
    if table["case"].nunique() < 2:
        raise RunFolderError(f"{out / 'runs'}: holds no finished runs of two cases or more; do them with `verify run`.")
    fitted = calibration.fit(table)
    judged = {"fitted": calibration.predicted(table, fitted), "left out": calibration.left_out(table)}
    shown = Table("predicted over measured", "median", "least", "most", "within a factor of 2", "with its case left out")
    for name in calibration.QUANTITIES:
        ratios = judged["fitted"][name]
        shares = [f"{100 * calibration.within_factor(part[name]):.0f} %" for part in judged.values()]
        shown.add_row(name, *(f"{value:.2f}" for value in (ratios.median(), ratios.min(), ratios.max())), *shares)
    console = _console()
    console.print(shown)
    console.print(f"{len(table)} runs of {table['case'].nunique()} cases", highlight=False)
    if write:
        calibration.write_constants(fitted, table)
        console.print(f"Written: {calibration.COSTS_FILE}, {calibration.RUNS_FILE}", highlight=False)


# ---------------------------------------------------------------------------------------------------- main


def main(arguments: list[str] | None = None) -> None:
    """Entry point of the command ``verify``; a user's mistake gets one sentence on stderr, no traceback."""
    sys.exit(_exit_code(arguments))


def _exit_code(arguments: list[str] | None) -> int:
    try:
        return app(args=arguments, standalone_mode=False) or 0
    except UserError as error:
        return _say(str(error), error.exit_code)
    except typer.Abort:
        return _say("Stopped.", RUN_FAILED)
    except typer.TyperException as error:
        return _say(error.format_message(), BAD_INPUT)


def _say(sentence: str, code: int) -> int:
    print(sentence, file=sys.stderr)
    return code


if __name__ == "__main__":
    main()
