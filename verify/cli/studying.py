"""Commands that study accuracy, failure and cost."""

import math
from collections.abc import Callable
from typing import Annotated

import pandas as pd
import typer
from rich.table import Table

from cases import Case, load_case
from verify.cli.shared import (
    CaseArgument,
    ClusterOption,
    JobsOption,
    OptionalCases,
    OutOption,
    RecordOption,
    RunOption,
    ThreadsOption,
    TierOption,
    app,
    new_console,
    new_table,
    selected_cases,
)
from verify.runs.run_folder import RunFolderError
from verify.runs.running import DEFAULT_OUT


def _teller() -> Callable[[str], None]:
    """What prints a line while a study goes on."""
    console = new_console()
    return lambda line: console.print(line)


def _studied(names: list[str] | None, tier: str, key: str) -> list[Case]:
    """The cases that are named, or all of the library that have charts or maps (``key``) at the tier."""
    return [case for case in selected_cases(names, tier) if names or getattr(case, key)]


@app.command()
def chart(
    cases: OptionalCases = None,
    tier: TierOption = "standard",
    out: OutOption = DEFAULT_OUT,
    names: Annotated[list[str] | None, typer.Option("--chart", help="only this chart; may be repeated")] = None,
    repeats: Annotated[int, typer.Option("--repeats", min=1, help="runs of each level; the least time counts")] = 1,
    record: RecordOption = False,
    jobs: JobsOption = 1,
    threads: ThreadsOption = 1,
    cluster: ClusterOption = None,
) -> None:
    """Chart accuracy against cost: run the ladders of a case's charts, tabulate and draw error over time and work.

    Finished runs are used again, stopped ones are gone on with. Tables and figures go to OUT/charts. Without a case, all
    of the library that have charts are charted.

    Examples: `verify chart sen_tension --tier quick` · `verify chart surfing --chart spacing --repeats 3` ·
    `verify chart --tier quick --record`
    """
    from reports import draw_chart, drawing_style
    from verify.studies.charts import choice_sentence, make_charts
    from verify.studies.records import Made
    from verify.studies.study import Options

    tell, options = _teller(), Options(out, jobs, threads, cluster)
    for loaded in _studied(cases, tier, "charts"):
        for file in make_charts(loaded, options, names or [], repeats, tell, record):
            with drawing_style():
                drawing = draw_chart(Made("charts", file.stem, file, loaded), file.parent)
            for _, choice in pd.read_csv(file.with_name(f"{file.stem}-choices.csv")).iterrows():
                tell(choice_sentence(choice))
            tell(f"Chart: {file}, {file.parent / drawing.file}")


@app.command()
def stability(
    cases: OptionalCases = None,
    tier: TierOption = "standard",
    out: OutOption = DEFAULT_OUT,
    names: Annotated[list[str] | None, typer.Option("--map", help="only this map; may be repeated")] = None,
    record: RecordOption = False,
    jobs: JobsOption = 1,
    threads: ThreadsOption = 1,
    cluster: ClusterOption = None,
) -> None:
    """Map where a method fails: a verdict for every pair of two levels, the border between them bisected.

    Finished runs are used again, failed ones too. Tables and figures go to OUT/maps. Without a case, all of the library
    that have maps are mapped.

    Examples: `verify stability sen_tension --tier quick` · `verify stability surfing --map toughness --jobs 2` ·
    `verify stability --tier quick --record`
    """
    from reports import draw_map, drawing_style
    from verify.studies.maps import make_maps
    from verify.studies.records import Made
    from verify.studies.study import Options

    tell, options = _teller(), Options(out, jobs, threads, cluster)
    for loaded in _studied(cases, tier, "maps"):
        for file in make_maps(loaded, options, names or [], tell, record):
            with drawing_style():
                drawing = draw_map(Made("maps", file.stem, file, loaded), file.parent)
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
    jobs: JobsOption = 1,
    threads: ThreadsOption = 1,
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

    tell, loaded = _teller(), load_case(case, tier)

    file = price(loaded, Options(out, jobs, threads, cluster), run_names or [], tell, record, only or [])
    new_console().print(_price_table(pd.read_csv(file)))
    tell(f"Prices: {file}")


def _price_table(prices: pd.DataFrame) -> Table:
    ratios = {"time": "seconds", "work": "work", "unknowns": "unknowns"}
    times = (f"times the {name}" for name in ratios)
    table = new_table("run", "without", *times, "quantity", "with", "without it", "change")
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
    write: Annotated[bool, typer.Option("--write", help="keep the constants and the runs that they come from")] = False,
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
    shown = new_table(
        "predicted over measured", "median", "least", "most", "within a factor of 2", "with its case left out"
    )
    for name, row in calibration.judged(table, fitted).iterrows():
        values = (f"{row[key]:.2f}" for key in ("median", "least", "most"))
        shown.add_row(str(name), *values, *(f"{100 * row[key]:.0f} %" for key in ("within", "left_out")))
    console = new_console()
    console.print(shown)
    console.print(f"{len(table)} runs of {table['case'].nunique()} cases")
    if write:
        calibration.write_constants(fitted, table)
        console.print(f"Written: {calibration.COSTS_FILE}, {calibration.RUNS_FILE}")
