"""The command line: cases before anything is run, runs and their judgement, studies of accuracy, failure and cost.

Exit codes: 0 within tolerance, 1 out of tolerance, 2 a run failed, 3 bad input, 4 nothing was checked, 5 internal error.
"""

import io
import math
import shlex
import sys
import tempfile
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import typer
from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from cases import Case, CaseError, UserError, list_cases, load_case, schema_text
from cases.errors import BrokenRuleError
from cases.judging import TIERS
from cases.loader import LIBRARY, reading_once
from cases.solvers import SOLVERS, installed, register
from numerics.status import RunStatus
from verify.extras import missing_extra
from verify.judging.acceptance import accept
from verify.judging.judge import checks_of, find_runs
from verify.judging.summary import exit_code, summarise, write_summary
from verify.judging.views import check_name, check_sentence, counts, failed_runs, needed_records, suspect_runs
from verify.runs.atomic import NO_ROOM, write_table
from verify.runs.jobs import Job, Outcome, outcomes
from verify.runs.provenance import code_version
from verify.runs.refusals import refusals
from verify.runs.run_folder import RunFolderError
from verify.runs.running import DEFAULT_OUT, DEFAULT_THREADS
from verify.runs.selection import named_runs, selected_runs

RUN_FAILED, BAD_INPUT, INTERNAL_ERROR = 2, 3, 5
COLOURS = {"PASS": "green"} | dict.fromkeys(("FAIL", "RUN_FAILED", "SUSPECT"), "red")
COLOURS |= dict.fromkeys(("MISSING", "NEEDS_RECORD", "NOT_CHECKED"), "yellow")
EXIT_CODE_HELP = (
    "Exit codes: 0 within tolerance, 1 out of tolerance or suspect, 2 a run failed, 3 bad input, 4 nothing was checked,"
    " 5 internal error."
)
DEBUG = "--debug"
#: letters in a line of what no terminal shows
WIDEST = 10_000

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
CasesArgument = Annotated[
    list[str], typer.Argument(metavar="CASE...", help="names in the library, folders with a case.toml, or .toml files")
]
OptionalCases = Annotated[
    list[str] | None,
    typer.Argument(metavar="[CASE]...", help="names, folders or .toml files; all of the library without any"),
]
TierOption = Annotated[str, typer.Option("--tier", help="resolution: quick, standard or paper")]


def _folder(given: str | Path) -> Path:
    """The folder of an option, which may be to come."""
    if not str(given).strip():
        raise typer.BadParameter("is empty; give a folder")
    if Path(given).exists() and not Path(given).is_dir():
        raise typer.BadParameter(f"{str(given)!r} is a file; give a folder")
    return Path(given)


def _share(text: str) -> float:
    """0.01 for "1%" and for "0.01"."""
    try:
        value = float(text.strip().removesuffix("%")) / (100.0 if text.strip().endswith("%") else 1.0)
    except ValueError:
        value = math.nan
    if not 0.0 < value < 1.0:
        raise typer.BadParameter(f"{text!r} is no share; give for instance 1% or 0.01")
    return value


OutOption = Annotated[Path, typer.Option("--out", parser=_folder, metavar="FOLDER", help="folder of all results")]
AccuracyOption = Annotated[
    float | None,
    typer.Option("--accuracy", parser=_share, metavar="SHARE", help="error allowed in each checked quantity, such as 1%"),
]
ClusterOption = Annotated[
    str | None,
    typer.Option("--cluster", help="do the runs on this Dask cluster, one on each worker: tcp://host:8786"),
]
RunOption = Annotated[list[str] | None, typer.Option("--run", help="only this run; may be repeated")]
RecordOption = Annotated[bool, typer.Option("--record", help="keep them beside the case, for every report to show")]
JobsOption = Annotated[int, typer.Option("--jobs", min=1, help="runs at the same time")]
ThreadsOption = Annotated[int, typer.Option("--threads", min=1, help="threads of each run")]


def _console() -> Console:
    """Made anew for each command, because tests and callers may have replaced sys.stdout; brackets are no markup.

    Files and other programs get each row of a table in one line, whatever its width.
    """
    seen = sys.stdout.isatty()
    width = None if seen else WIDEST
    return Console(file=sys.stdout, width=width, soft_wrap=not seen, markup=False, highlight=False, emoji=False)


def _table(*headers: str, **options: Any) -> Table:
    """A table that breaks what a narrow terminal has no room for, and cuts nothing off."""
    return Table(*(Column(header, overflow="fold") for header in headers), **options)


def _selected(names: Sequence[str] | None, tier: str) -> list[Case]:
    """The cases that are asked for, all of the library without.

    Raises CaseError where two files are called the same, so that the results of one would replace those of the other.
    """
    found: dict[str, Case] = {}
    for name in names or list_cases():
        case = load_case(name, tier)
        other = found.setdefault(case.name, case)
        if other.source != case.source:
            raise CaseError(
                f"{case.source}: is called {case.name!r} as {other.source} is, so that their results would replace each"
                " other; rename one of the two."
            )
    return list(found.values())


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
    debug: Annotated[bool, typer.Option(DEBUG, help="show where in the program an internal error happened")] = False,
) -> None:
    """Options of the program itself."""


@app.command("list")
def list_command(
    solvers: Annotated[bool, typer.Option("--solvers", help="the solvers that runs can name")] = False,
) -> None:
    """List the cases of the library with their runs, or the solvers.

    Examples: `verify list` · `verify list --solvers`
    """
    console, table = _console(), _table("case", "section", "title", "runs")
    if solvers:
        console.print(_solver_table())
        return
    for name in list_cases():
        case = load_case(name)
        table.add_row(name, case.section, case.title, ", ".join(case.runs))
    console.print(table)


def _solver_table() -> Table:
    table = _table("solver", "title", "from", "gives")
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
    wrong, console = False, _console()
    for case in _selected(cases, TIERS[0]):
        for tier in TIERS:
            checks_of(load_case(case.source, tier))
        named = ((tier, run) for tier in TIERS for run in load_case(case.source, tier).expanded_runs())
        runs = [load_case(case.source, tier, run) for tier, run in named]
        found, remarks = refusals(runs), dict.fromkeys(said for each in [case, *runs] for said in each.remarks)
        for sentence in (found.sentences or [f"{case.name}: valid{found.note}", *remarks]) + found.needs:
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

    console, bases = _console(), _selected(cases, tier)
    named = named_runs(bases, run_names)
    _refuse([load_case(source, tier, name) for source, _, name in named])
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
    table = _table("what", "value", title=planned.title, title_justify="left")
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
    table = _table("material", "order", f"least [{unit}]", "at [°]", f"largest [{unit}]", "at [°]", "forbidden [°]")
    for row in write_surface(loaded, out).to_dict("records"):
        least = (f"{row['least']:.5g}", f"{row['theta_least']:.1f}")
        largest = (f"{row['largest']:.5g}", f"{row['theta_largest']:.1f}")
        table.add_row(row["material"], str(row["order"]), *least, *largest, row["forbidden"])
    console = _console()
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
    console = _console()
    console.print(table.to_string(index=False) if rows else "No run of a rigid block changes its verdict.")
    console.print(f"Written to {file}")


@app.command()
def schema() -> None:
    """Print the JSON Schema of case files, for editors.

    Example: `verify schema > case.schema.json`
    """
    typer.echo(schema_text(), nl=False)


# ------------------------------------------------------------------------------------------------- compute


@app.command("run")
def run_command(
    cases: OptionalCases = None,
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
    jobs: JobsOption = 1,
    timeout: Annotated[
        float | None, typer.Option("--timeout", min=0.0, help="seconds after which a run is given up; it can be resumed")
    ] = None,
    accuracy: AccuracyOption = None,
    cluster: ClusterOption = None,
) -> None:
    """Compute the runs of a case, or of all cases, that are not up to date. Judges nothing.

    Examples: `verify run sen_tension` · `verify run sen_shear --run mpm --tier quick` · `verify run --jobs 2` ·
    `verify run l_panel --tier paper --resume` · `verify run sen_tension --accuracy 1%` ·
    `verify run --cluster tcp://127.0.0.1:8786 --threads 1`
    """
    from verify.planning.plan import longest_first, planned_job

    each, console = threads if cluster else max(1, threads // jobs), _console()
    with reading_once():
        wanted = [
            Job(*named, tier=tier, out=out, threads=each, force=force, resume=resume, timeout=timeout)
            for named in named_runs(_selected(cases, tier), run_names)
        ]
        # a mistake in the last case is told before the first run; those of the library have none
        _refuse([job.case() for job in wanted if not job.source.is_relative_to(LIBRARY)])
        planned = [planned_job(job, accuracy) for job in wanted]
        todo = [job for job, _ in planned]
        todo = longest_first(todo) if cluster or 1 < jobs < len(todo) else todo
    for job, sentences in planned:
        for sentence in sentences:
            console.print(f"{job.title}: {sentence}")
    ended = list[Outcome]()
    for outcome in outcomes(todo, jobs, cluster):
        # a record that several runs need is told once
        if not (outcome.needs_record and any(other.line == outcome.line for other in ended)):
            console.print(f"{outcome.title}: {outcome.line}")
        ended.append(outcome)
    if any(outcome.refused for outcome in ended) or all(outcome.needs_record for outcome in ended):
        raise typer.Exit(BAD_INPUT)
    if any(outcome.failed for outcome in ended):
        raise typer.Exit(RUN_FAILED)


def _refuse(cases: list[Case]) -> None:
    """Raise CaseError with all that the solvers of these runs object to, if they do."""
    found = refusals(cases)
    if sentences := found.sentences + found.needs:
        raise CaseError("\n".join(sentences))


# --------------------------------------------------------------------------------------------------- judge


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
    cases = _selected(names, tier)
    with reading_once():
        states = [{s.status for s in find_runs(loaded, out).values()} - {RunStatus.MISSING} for loaded in cases]
    found = [loaded for loaded, there in zip(cases, states, strict=True) if there]
    if not any(there - {RunStatus.NEEDS_RECORD} for there in states):
        command = shlex.join(["verify", "run", *(names or []), "--tier", tier, "--out", str(out)])
        raise RunFolderError(
            f"{out / 'runs'}: nothing has been run in tier {tier!r}; do it with `{command}`."
        )
    summary = summarise(found, tier, out, jobs)
    write_summary(summary, out)
    console = _console()
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
    table = _table("case", "verdict", "checks passed", "most of a limit", title=f"tier {summary['tier']}")
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
        typer.Option("--within", parser=_share, metavar="SHARE", help="replaces the case's relative limits, such as 5%"),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", parser=_folder, metavar="FOLDER", help="reports/out/judged/CASE without")
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
    console, summary = _console(), {"tier": tier, "cases": [judged.entry]}
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
        raise RunFolderError(
            f"{out / 'summary.json'}: there is nothing to report; judge with `verify compare` first."
        )
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

    rows = [row for row in coverage(_selected(cases, "standard"), out) if source.lower() in row.source.lower()]
    if not rows:
        said = f"of a source with {source!r} in its name; leave --source out to see all" if source else "in these cases"
        raise typer.BadParameter(f"there is no printed number {said}")
    shown = _table("case", "quantity", "run", "tier", "printed", "ours", "off", "limit")
    for row in rows:
        off = "" if row.share is None else f"{100 * row.share:.2g} %"
        ours = "" if row.ours is None else f"{row.ours:.6g}"
        limit = f"{row.limit:g}" if row.gated else "shown"
        shown.add_row(row.case, row.quantity, row.run, row.tier, f"{row.printed:.6g} {row.unit}", ours, off, limit)
    console = _console()
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
    table = _table("run", "metric", "parameters", "value", "unit", title=f"accepted for {loaded.name}, tier {tier}")
    for row in rows:
        table.add_row(row.run, row.metric, row.parameters, f"{row.value:.8g}", row.unit)
    console = _console()
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
    console = _console()
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

    found, console = read_archive(file, out), _console()
    (entry,) = found.summary["cases"]
    _print_problems(console, found.summary)
    console.print(_verdict_table(found.summary))
    if entry["verdict"] != found.verdict:
        console.print(f"It was archived with the verdict {found.verdict} by version {found.summary['version']}.")
    console.print(f"Case: {out / 'cases' / entry['case']}; `verify report --out {out}` draws its page")
    raise typer.Exit(exit_code(found.summary))


# -------------------------------------------------------------------------------------------------- studies


def _teller() -> Callable[[str], None]:
    """What prints a line while a study goes on."""
    console = _console()
    return lambda line: console.print(line)


def _studied(names: list[str] | None, tier: str, key: str) -> list[Case]:
    """The cases that are named, or all of the library that have charts or maps (``key``) at the tier."""
    return [case for case in _selected(names, tier) if names or getattr(case, key)]


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
    _console().print(_price_table(pd.read_csv(file)))
    tell(f"Prices: {file}")


def _price_table(prices: pd.DataFrame) -> Table:
    ratios = {"time": "seconds", "work": "work", "unknowns": "unknowns"}
    times = (f"times the {name}" for name in ratios)
    table = _table("run", "without", *times, "quantity", "with", "without it", "change")
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
    shown = _table("predicted over measured", "median", "least", "most", "within a factor of 2", "with its case left out")
    for name, row in calibration.judged(table, fitted).iterrows():
        values = (f"{row[key]:.2f}" for key in ("median", "least", "most"))
        shown.add_row(str(name), *values, *(f"{100 * row[key]:.0f} %" for key in ("within", "left_out")))
    console = _console()
    console.print(shown)
    console.print(f"{len(table)} runs of {table['case'].nunique()} cases")
    if write:
        calibration.write_constants(fitted, table)
        console.print(f"Written: {calibration.COSTS_FILE}, {calibration.RUNS_FILE}")


# ---------------------------------------------------------------------------------------------------- main


#: what typer makes of Ctrl-C
INTERRUPTED = 130
STOPPED = "Stopped: what is finished is kept; the same command does the rest, `verify run --resume` behind checkpoints."


def main(arguments: list[str] | None = None) -> None:
    """Entry point of the command ``verify``; a user's mistake gets one sentence on stderr, no traceback."""
    for stream in (sys.stdout, sys.stderr):  # a letter that a terminal or pipe has no place for is none of the program's
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    sys.exit(_exit_code(arguments))


def _exit_code(arguments: list[str] | None) -> int:
    try:
        code = app(args=arguments, standalone_mode=False) or 0
        return _say(STOPPED, code) if code == INTERRUPTED else code
    except UserError as error:
        return _say(str(error), error.exit_code)
    except typer.Abort:
        return _say("Stopped.", RUN_FAILED)
    except typer.TyperException as error:
        return _say(error.format_message(), BAD_INPUT)
    except ModuleNotFoundError as error:
        missing = missing_extra(error)
        return _say(str(missing), BAD_INPUT) if missing else _internal(error, arguments)
    except BrokenPipeError:  # whoever reads the output has had enough
        sys.stderr.close()
        return 0
    except OSError as error:
        if error.errno in NO_ROOM:  # in the middle of a file it names none
            where = error.filename or "The disk"
            return _say(f"{where}: {_reason(error)}; make room, or name another folder.", RUN_FAILED)
        return _internal(error, arguments) if error.filename is None else _say(_refused(error), BAD_INPUT)
    except Exception as error:
        return _internal(error, arguments)


def _refused(error: OSError) -> str:
    """A file or folder that the system does not let us read or write."""
    return f"{error.filename}: {_reason(error)}; make it readable and writable, or name another."


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()


def _internal(error: Exception, arguments: list[str] | None) -> int:
    """A mistake of the program, which is no verdict: one sentence, and the traceback for whoever mends it."""
    what = " ".join(f"{type(error).__name__}: {error}".split())
    if DEBUG not in (sys.argv[1:] if arguments is None else arguments):
        with suppress(OSError):  # a disk that takes nothing has it shown here
            with tempfile.NamedTemporaryFile("w", prefix="verify-", suffix=".txt", delete=False, encoding="utf8") as file:
                traceback.print_exception(error, file=file)
            remedy = f"please report it where you have the program from, with {file.name}"
            return _say(f"Internal error: {what}; {remedy} (`verify {DEBUG} ...` shows it here).", INTERNAL_ERROR)
    traceback.print_exception(error)
    return _say(f"Internal error: {what}; please report it with the traceback above.", INTERNAL_ERROR)


def _say(sentence: str, code: int) -> int:
    print(sentence, file=sys.stderr)
    return code


if __name__ == "__main__":
    main()
