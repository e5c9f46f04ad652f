"""Commands that look at cases before anything is run."""

from typing import Annotated

import pandas as pd
import typer
from rich.console import Console
from rich.table import Table

from cases import Case, CaseError, list_cases, load_case, schema_text
from cases.errors import BrokenRuleError
from cases.judging import TIERS
from cases.solvers import SOLVERS, installed, register
from numerics.description import remarks
from verify.cli.shared import (
    BAD_INPUT,
    AccuracyOption,
    CaseArgument,
    CasesArgument,
    OptionalCases,
    OutOption,
    RunOption,
    TierOption,
    app,
    new_console,
    new_table,
    refuse_what_cannot_run,
    selected_cases,
)
from verify.judging.judge import checks_of
from verify.runs.atomic import write_table
from verify.runs.refusals import refusals
from verify.runs.running import DEFAULT_OUT
from verify.runs.selection import named_runs, selected_runs


@app.command("list")
def list_command(
    solvers: Annotated[bool, typer.Option("--solvers", help="the solvers that runs can name")] = False,
    indicators: Annotated[
        bool, typer.Option("--indicators", help="what the health record of a run holds, with limits and remedies")
    ] = False,
) -> None:
    """List the cases of the library with their runs, the solvers, or the indicators of the health record.

    Examples: `verify list` · `verify list --solvers` · `verify list --indicators`
    """
    tables = {_solver_table: solvers, _indicator_table: indicators}
    asked = [table for table, is_asked in tables.items() if is_asked] or [_case_table]
    for table in asked:
        new_console().print(table())


def _case_table() -> Table:
    table = new_table("case", "section", "title", "runs")
    for name in list_cases():
        case = load_case(name)
        table.add_row(name, case.section, case.title, ", ".join(case.runs))
    return table


def _indicator_table() -> Table:
    from verify.health import INDICATORS

    table = new_table("indicator", "what", "limit", "beyond")
    for name, indicator in INDICATORS.items():
        table.add_row(name, indicator.meaning, f"{indicator.limit:g}", indicator.remedy)
    return table


def _solver_table() -> Table:
    table = new_table("solver", "title", "from", "gives")
    for name in installed():
        try:
            register(name)
        except BrokenRuleError as error:
            table.add_row(name, error.text, "", error.remedy)
    for name, solver in SOLVERS.items():
        home = (solver.table or solver.quasi_static or solver.dynamic).partition(":")[0]
        table.add_row(name, solver.title, home, "a table" if solver.table else "fields")
    return table


@app.command()
def validate(cases: OptionalCases = None) -> None:
    """Check case files in all tiers and runs, without running them: what they say, and whether their solvers take them.

    Examples: `verify validate` · `verify validate sen_tension` · `verify validate mine.toml other.toml`
    """
    wrong, console = False, new_console()
    for case in selected_cases(cases, TIERS[0]):
        for tier in TIERS:
            checks_of(load_case(case.source, tier))
        named = ((tier, run) for tier in TIERS for run in load_case(case.source, tier).expanded_runs())
        runs = [load_case(case.source, tier, run) for tier, run in named]
        found = refusals(runs)
        told = dict.fromkeys(said for each in [case, *runs] for said in [*each.mesh_remarks, *remarks(each)])
        for sentence in (found.sentences or [f"{case.name}: valid{found.note}", *told]) + found.needs:
            console.print(sentence)
        wrong |= bool(found.sentences)
    if wrong:
        raise typer.Exit(BAD_INPUT)


@app.command()
def plan(
    cases: CasesArgument,
    tier: TierOption = "standard",
    run_names: RunOption = None,
    accuracy: AccuracyOption = None,
    out: OutOption = DEFAULT_OUT,
) -> None:
    """Print what will be modelled and what it will cost, without running it.

    With an accuracy, the savings with the highest recorded prices are switched off until the rest keeps within it, as
    `verify run --accuracy` does; what the case's charts say of it is repeated.

    Examples: `verify plan sen_tension --tier paper` · `verify plan mine.toml other.toml` ·
    `verify plan sen_tension --tier quick --accuracy 1%`
    """
    from verify.planning.plan import RULE
    from verify.studies.charts import recorded_choices

    console, bases = new_console(), selected_cases(cases, tier)
    named = named_runs(bases, run_names)
    refuse_what_cannot_run([load_case(source, tier, name) for source, _, name in named])
    for source, _, name in named:
        _print_plan(console, load_case(source, tier, name), name, accuracy)
    console.print(f"Seconds are a rough estimate: {RULE}.")
    if accuracy is None:
        return
    for base in bases:
        for sentence in recorded_choices(base, out, accuracy):
            console.print(f"{base.name}, measured by `verify chart`: {sentence}")


def _print_plan(console: Console, case: Case, run: str, accuracy: float | None) -> None:
    from verify.planning.plan import plan as make_plan

    if SOLVERS[case.run_spec(run).solver].table:
        console.print(f"{case.name}, run {run}: comes as a table, so that there is nothing to plan")
        return
    planned = make_plan(case, run, accuracy)
    table = new_table("what", "value", title=planned.title, title_justify="left")
    for row in planned.rows():
        table.add_row(*row)
    console.print(table)


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
    table = new_table("material", "order", f"least [{unit}]", "at [°]", f"largest [{unit}]", "at [°]", "forbidden [°]")
    for row in write_surface(loaded, out).to_dict("records"):
        least = (f"{row['least']:.5g}", f"{row['theta_least']:.1f}")
        largest = (f"{row['largest']:.5g}", f"{row['theta_largest']:.1f}")
        table.add_row(row["material"], str(row["order"]), *least, *largest, row["forbidden"])
    console = new_console()
    console.print(table)
    console.print(f"Figures and data: {out / 'surface' / loaded.name}")


@app.command()
def borders(
    case: CaseArgument,
    tier: TierOption = "standard",
    run_names: RunOption = None,
    ratios: Annotated[
        list[float] | None, typer.Option("--ratio", min=0.1, help="frequency of the pulse over p; may be repeated")
    ] = None,
    out: OutOption = DEFAULT_OUT,
) -> None:
    """Tell where a pendulum or Winkler run's verdict changes with the amplitude of its pulse.

    Amplitudes are over that which lifts the block. Writes them as CSV too.

    Examples: `verify borders rocking_pendulum --run pendulum --ratio 3 --ratio 5` · `verify borders rocking_winkler`
    """
    from rigid_block.verdicts import borders_of, model_of

    base, rows = load_case(case, tier), []
    asked: list[float | None] = [*ratios] if ratios else [None]
    solvers = {name: base.run_spec(name).solver for name in selected_runs(base, run_names)}
    of_blocks = {name: solver for name, solver in solvers.items() if SOLVERS[solver].of_rigid_block}
    if not of_blocks:
        known = ", ".join(name for name, solver in SOLVERS.items() if solver.of_rigid_block)
        raise CaseError(f"{base.source}: no run has a solver of a rigid block; give one the solver {known}.")
    for name, solver in of_blocks.items():
        for ratio in asked:
            change = {"rocking": {"borders": []}, "dynamics": {"ground": {"frequency_ratio": ratio}}} if ratio else {}
            loaded = load_case(case, tier, name, change)
            found = borders_of(loaded, model_of(loaded, solver))
            rows += [(name, solver, ratio, border.amplitude, str(border.below), str(border.above)) for border in found]
    table = pd.DataFrame(rows, columns=["run", "solver", "frequency_ratio", "uplift_ratio", "below", "above"])
    file = out / "borders" / f"{base.name}.csv"
    write_table(file, table)
    console = new_console()
    console.print(table.to_string(index=False) if rows else "No run of a rigid block changes its verdict.")
    console.print(f"Written to {file}")


@app.command()
def schema() -> None:
    """Print the JSON Schema of case files, for editors.

    Example: `verify schema > case.schema.json`
    """
    typer.echo(schema_text(), nl=False)
