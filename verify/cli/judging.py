"""Commands that judge results, keep them and pass them on."""

import shlex
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from cases import load_case
from cases.loader import reading_once
from numerics.status import RunStatus
from verify.cli.shared import (
    COLOURS,
    CaseArgument,
    OptionalCases,
    OutOption,
    TierOption,
    app,
    as_folder,
    as_share,
    new_console,
    new_table,
    selected_cases,
)
from verify.judging.acceptance import accept
from verify.judging.judge import find_runs
from verify.judging.summary import exit_code, summarise, write_summary
from verify.judging.views import check_name, check_sentence, counts, failed_runs, needed_records, suspect_runs
from verify.runs.atomic import write_table
from verify.runs.run_folder import RunFolderError
from verify.runs.running import DEFAULT_OUT


@app.command()
def compare(
    names: OptionalCases = None,
    tier: TierOption = "standard",
    out: OutOption = DEFAULT_OUT,
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="cases judged at the same time")] = 1,
) -> None:
    """Judge finished runs and write summary.json, junit.xml, summary.csv and summary.md. Computes nothing.

    Without a case, all cases of the library that have been run in this tier are judged. `verify report` draws one report
    of all that were judged together.

    Examples: `verify compare` · `verify compare sen_tension --tier paper` · `verify compare mine.toml other.toml`
    """
    cases = selected_cases(names, tier)
    with reading_once():
        states = [{s.status for s in find_runs(loaded, out).values()} - {RunStatus.MISSING} for loaded in cases]
    found = [loaded for loaded, there in zip(cases, states, strict=True) if there]
    if not any(there - {RunStatus.NEEDS_RECORD} for there in states):
        command = shlex.join(["verify", "run", *(names or []), "--tier", tier, "--out", str(out)])
        raise RunFolderError(f"{out / 'runs'}: nothing has been run in tier {tier!r}; do it with `{command}`.")
    summary = summarise(found, tier, out, jobs)
    write_summary(summary, out)
    console = new_console()
    _print_problems(console, summary)
    console.print(_verdict_table(summary))
    left_out = [loaded.name for loaded in cases if loaded not in found]
    if left_out:
        console.print(f"Not run in this tier and not judged: {', '.join(left_out)}")
    raise typer.Exit(exit_code(summary))


def _print_problems(console: Console, summary: dict[str, Any]) -> None:
    for case in summary["cases"]:
        for sentence in (*failed_runs(case), *suspect_runs(case)):
            console.print(f"{case['case']}: run {sentence}")
        for sentence in needed_records(case):
            console.print(sentence)
        for check in case["checks"]:
            untold = case["verdict"] == "NOT_CHECKED" and check["error"] is None
            if untold or check["verdict"] in ("FAIL", "MISSING"):
                line = f"{case['case']}: {check['verdict']}: {check_name(check)}: {check_sentence(check)}"
                console.print(line)


def _verdict_table(summary: dict[str, Any]) -> Table:
    table = new_table("case", "verdict", "checks passed", "most of a limit", title=f"tier {summary['tier']}")
    for case in summary["cases"]:
        passed, gated, margin = counts(case)
        share = "" if margin is None else f"{100 * margin:.0f} %"
        table.add_row(case["case"], Text(case["verdict"], COLOURS[case["verdict"]]), f"{passed} of {gated}", share)
    return table


@app.command()
def judge(
    case: CaseArgument,
    history: Annotated[Path, typer.Option("--history", metavar="FILE", help="CSV file of force over displacement")],
    columns: Annotated[str, typer.Option("--map", help="columns, units and signs: 'u = U2, F = -2 * RF2 [N]'")] = "",
    crack_path: Annotated[
        Path | None, typer.Option("--crack-path", metavar="FILE", help="CSV file x,y from the crack's start to its tip")
    ] = None,
    fields: Annotated[
        Path | None, typer.Option("--fields", metavar="FILE", help="VTU, PVD, VTK, XDMF or Exodus file, for its crack")
    ] = None,
    arrays: Annotated[str, typer.Option("--arrays", help="what its arrays are: 'damage = d, displacement = U'")] = "",
    tier: TierOption = "standard",
    name: Annotated[str, typer.Option("--name", help="what the result is called; its file's name without")] = "",
    within: Annotated[
        float | None,
        typer.Option(
            "--within", parser=as_share, metavar="SHARE", help="replaces the case's relative limits, such as 5%"
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", parser=as_folder, metavar="FOLDER", help="reports/out/judged/CASE without")
    ] = None,
) -> None:
    """Judge a result from elsewhere against the kept results of both solvers, published and exact ones. Solves nothing.

    Columns named u and F are found by themselves, with their units in names such as F_kN. A word in the map says what the
    forces are of: `half model`, `per thickness`; `damage`, or a column d, stands for c = 1 - d.

    Examples: `verify judge sen_shear --history mine.csv` ·
    `verify judge l_panel --history abaqus.csv --map "u = U2, F = -2 * RF2 [N]" --within 5%`
    """
    from reports import judge as judge_and_draw

    judged = judge_and_draw(
        case, history, columns, crack_path, fields=fields, arrays=arrays, tier=tier, name=name, within=within, out=out
    )
    console, summary = new_console(), {"tier": tier, "cases": [judged.entry]}
    _print_problems(console, summary)
    for sentence in judged.remarks:
        console.print(sentence)
    console.print(_verdict_table(summary))
    console.print(f"Page: {judged.page}")
    raise typer.Exit(exit_code(summary))


@app.command()
def report(
    out: OutOption = DEFAULT_OUT,
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="pages made at the same time")] = 1,
) -> None:
    """Write the HTML report of what `compare` judged last, and print its path. Computes nothing.

    Example: `verify report --out reports/out`
    """
    if not (out / "summary.json").is_file():
        raise RunFolderError(f"{out / 'summary.json'}: there is nothing to report; judge with `verify compare` first.")
    from reports import write_report

    typer.echo(f"Report: {write_report(out, jobs)}")


@app.command("coverage")
def coverage_command(
    cases: OptionalCases = None,
    source: Annotated[str, typer.Option("--source", help="only sources with this in their name: Kakouris")] = "",
    out: OutOption = DEFAULT_OUT,
    to: Annotated[Path | None, typer.Option("--to", metavar="FILE", help="write the table as CSV")] = None,
) -> None:
    """Put every printed number beside ours, of the finest tier that has one, run or baseline. Computes nothing.

    Examples: `verify coverage --source Kakouris` · `verify coverage l_panel --to l_panel.csv`
    """
    from verify.judging.coverage import coverage, coverage_sentence, coverage_table

    rows = [row for row in coverage(selected_cases(cases, "standard"), out) if source.lower() in row.source.lower()]
    if not rows:
        said = f"of a source with {source!r} in its name; leave --source out to see all" if source else "in these cases"
        raise typer.BadParameter(f"there is no printed number {said}")
    shown = new_table("case", "quantity", "run", "tier", "printed", "ours", "off", "limit")
    for row in rows:
        off = "" if row.share is None else f"{100 * row.share:.2g} %"
        ours = "" if row.ours is None else f"{row.ours:.6g}"
        limit = f"{row.limit:g}" if row.gated else "shown"
        shown.add_row(row.case, row.quantity, row.run, row.tier, f"{row.printed:.6g} {row.unit}", ours, off, limit)
    console = new_console()
    console.print(shown)
    console.print(coverage_sentence(rows))
    if to:
        write_table(to, coverage_table(rows))
        console.print(f"Table: {to}")


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
    table = new_table("run", "metric", "parameters", "value", "unit", title=f"accepted for {loaded.name}, tier {tier}")
    for row in rows:
        table.add_row(row.run, row.metric, row.parameters, f"{row.value:.8g}", row.unit)
    console = new_console()
    console.print(table)
    if absent := [name for name, state in find_runs(loaded, out).items() if state.run is None]:
        console.print(f"Not run, and so left as they are recorded: {', '.join(absent)}", markup=False)


@app.command()
def archive(
    case: CaseArgument,
    tier: TierOption = "standard",
    out: OutOption = DEFAULT_OUT,
    to: Annotated[Path | None, typer.Option("--to", metavar="FILE", help="zip file; CASE-TIER.zip without")] = None,
    fields: Annotated[bool, typer.Option("--fields", help="with the fields of all runs")] = False,
    licence: Annotated[str, typer.Option("--licence", help="SPDX name of its licence, such as CC-BY-4.0")] = "",
) -> None:
    """Put a case, its finished runs and their verdict into one zip file, ready for a repository with DOIs.

    Fields are left out where no check needs them. `verify import` reads it back on another machine.

    Examples: `verify archive sen_tension` · `verify archive my_case.toml --fields --licence CC-BY-4.0`
    """
    from verify.judging.archive import write_archive

    loaded = load_case(case, tier)
    file = to or Path(f"{loaded.name}-{tier}.zip")
    with_fields = write_archive(loaded, out, file, fields, licence)
    console = new_console()
    if with_fields:
        console.print(f"With the fields of {', '.join(with_fields)}")
    console.print(f"Archive: {file} ({file.stat().st_size / 1e6:.1f} MB)")


@app.command("import")
def import_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="zip file that `verify archive` wrote")],
    out: OutOption = DEFAULT_OUT,
) -> None:
    """Read an archive back and judge it here. Computes nothing.

    Example: `verify import sen_tension-standard.zip --out elsewhere`
    """
    from verify.judging.archive import read_archive

    found, console = read_archive(file, out), new_console()
    (entry,) = found.summary["cases"]
    _print_problems(console, found.summary)
    console.print(_verdict_table(found.summary))
    if entry["verdict"] != found.verdict:
        console.print(f"It was archived with the verdict {found.verdict} by version {found.summary['version']}.")
    console.print(f"Case: {out / 'cases' / entry['case']}; `verify report --out {out}` draws its page")
    raise typer.Exit(exit_code(found.summary))
