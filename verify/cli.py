"""The command line: list, validate, plan, surface, run, compare, report, accept, schema.

Exit codes: 0 within tolerance, 1 out of tolerance, 2 a run failed, 3 bad input, 4 nothing was checked.
"""

import json
import multiprocessing
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from cases import Case, CaseError, case_schema, list_cases, load_case
from verify.atomic import WriteError
from verify.curves import CurveError
from verify.judge import JudgeError, accept, checks_of, find_runs
from verify.progress import progress_view
from verify.provenance import code_version
from verify.run_folder import RunFolder, RunFolderError, run_path
from verify.running import DEFAULT_OUT, DEFAULT_THREADS, InterruptedRunError, case_for_run, run, up_to_date
from verify.summary import (
    check_name,
    check_sentence,
    counts,
    exit_code,
    failed_runs,
    summarise,
    write_summary,
)

OUT_OF_TOLERANCE, RUN_FAILED, BAD_INPUT, NOTHING_CHECKED = 1, 2, 3, 4
USER_ERRORS = (CaseError, CurveError, JudgeError, RunFolderError)
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
def plan(case: CaseArgument, tier: TierOption = "standard", run_names: RunOption = None) -> None:
    """Print what will be modelled and what it will cost, without running it.

    Examples: `verify plan sen_tension --tier paper` · `verify plan sen_shear --run mpm`
    """
    from verify.plan import RULE
    from verify.plan import plan as make_plan

    base = load_case(case, tier)
    console = _console()
    for name in _selected_runs(base, run_names):
        console.print(_plan_table(make_plan(load_case(case, tier, name), name)))
    console.print(f"Seconds are a rough estimate: {RULE}.", highlight=False)


def _plan_table(planned: Any) -> Table:
    table = Table(
        "what", "value", title=f"{planned.case} · {planned.tier} · {planned.run}", title_justify="left"
    )
    increments = f"{planned.increments}" + (" or more, adaptive" if planned.adaptive else ", constant")
    rows = {
        "solver": f"{planned.solver}: {planned.basis}",
        "notch": planned.notches,
        "cells": f"{planned.cells}",
        "points": f"{planned.points}",
        "unknowns": f"{planned.unknowns_displacement} of u, {planned.unknowns_phase_field} of c",
        "increments": f"{increments}, about {planned.iterations} staggered iterations each",
        "memory": f"about {planned.memory_mb:.0f} MB",
        "time": f"about {planned.seconds:.0f} s",
    }
    for what, value in rows.items():
        table.add_row(what, value)
    for saving in planned.savings:
        table.add_row(saving.name, f"{'on' if saving.used else 'off'}: {saving.effect}")
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
    typer.echo(json.dumps(case_schema(), indent=2))


# ------------------------------------------------------------------------------------------------- compute


@dataclass(frozen=True)
class _Job:
    """One run to do; plain data, so that another process can take it."""

    source: Path
    name: str
    run: str
    tier: str
    out: Path
    threads: int
    force: bool
    resume: bool

    @property
    def title(self) -> str:
        return f"{self.name} {self.tier} {self.run}"


@dataclass(frozen=True)
class _Outcome:
    title: str
    line: str
    failed: bool


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
        int, typer.Option("--threads", min=1, help="threads of all jobs together")
    ] = DEFAULT_THREADS,
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="runs at the same time")] = 1,
) -> None:
    """Compute the runs of a case, or of all cases, that are not up to date. Judges nothing.

    Examples: `verify run sen_tension` · `verify run sen_shear --run mpm --tier quick` · `verify run --jobs 2` ·
    `verify run l_panel --tier paper --resume`
    """
    todo = [
        _Job(*named, tier=tier, out=out, threads=max(1, threads // jobs), force=force, resume=resume)
        for named in _named_runs(case, tier, run_names)
    ]
    for job in todo:
        case_for_run(job.source, job.run, job.tier)  # a mistake in the last case is told before the first run
    console, failed = _console(), False
    for outcome in _outcomes(todo, jobs):
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


def _outcomes(todo: list[_Job], jobs: int) -> Iterator[_Outcome]:
    if jobs == 1 or len(todo) < 2:
        yield from map(_do, todo)
        return
    # a fresh process for each run: the thread count of a used one is fixed, and its memory not its own
    with ProcessPoolExecutor(jobs, mp_context=_fresh_processes(), max_tasks_per_child=1) as pool:
        for future in as_completed([pool.submit(_do, job) for job in todo]):
            yield future.result()


def _fresh_processes() -> multiprocessing.context.BaseContext:
    """Where the platform can, copies of one process that has imported the solvers and computed nothing."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["verify.cli", "verify.ready"])
    return context


def _do(job: _Job) -> _Outcome:
    """One run from start to end; a failure to write is a failed run, not the end of the others."""
    folder = run_path(job.out, job.name, job.tier, job.run)
    finished = None if job.force else up_to_date(case_for_run(job.source, job.run, job.tier), folder)
    try:
        with _progress(job, finished) as listener:
            done = finished or run(
                job.source, job.run, job.tier, job.out, listener,
                threads=job.threads, force=job.force, resume=job.resume,
            )  # fmt: skip
    except WriteError as error:
        return _Outcome(job.title, str(error), True)
    return _outcome(job, done, finished is not None)


@contextmanager
def _progress(job: _Job, finished: RunFolder | None) -> Iterator[Any]:
    if finished:
        yield None
        return
    with progress_view(job.title, _console()) as view:
        yield view


def _outcome(job: _Job, done: RunFolder, was_up_to_date: bool) -> _Outcome:
    info = done.info
    state = "up to date" if was_up_to_date else f"{info['seconds'].get('total', 0.0):.1f} s"
    if not was_up_to_date and info.get("resumed_after_step") is not None:
        state += f", resumed after step {info['resumed_after_step']}"
    line = f"{info['status'].replace('_', ' ')} ({state}), {done.folder}"
    if done.good:
        return _Outcome(job.title, line, False)
    kept = "the last good state is saved there" if info["increments"] else "there is no good state"
    return _Outcome(job.title, f"{line}; {info['reason']}; {kept}", True)


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
    return any(state.status != "missing" for state in find_runs(case, out).values())


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
def report(out: OutOption = DEFAULT_OUT) -> None:
    """Write the HTML report of what `compare` judged last, and print its path. Computes nothing.

    Example: `verify report --out reports/out`
    """
    if not (out / "summary.json").is_file():
        raise RunFolderError(
            f"{out / 'summary.json'}: there is nothing to report; judge with `verify compare` first."
        )
    from reports import write_report

    typer.echo(f"Report: {write_report(out)}")


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
    table = Table("run", "metric", "value", "unit", title=f"accepted for {loaded.name}, tier {tier}")
    for row in rows:
        table.add_row(row.run, row.metric, f"{row.value:.8g}", row.unit)
    _console().print(table)


# ---------------------------------------------------------------------------------------------------- main


def main(arguments: list[str] | None = None) -> None:
    """Entry point of the command ``verify``; a user's mistake gets one sentence on stderr, no traceback."""
    sys.exit(_exit_code(arguments))


def _exit_code(arguments: list[str] | None) -> int:
    try:
        return app(args=arguments, standalone_mode=False) or 0
    except USER_ERRORS as error:
        return _say(str(error), BAD_INPUT)
    except WriteError as error:
        return _say(str(error), RUN_FAILED)
    except InterruptedRunError as stopped:
        return _say(str(stopped), RUN_FAILED)
    except typer.Abort:
        return _say("Stopped.", RUN_FAILED)
    except typer.TyperException as error:
        return _say(error.format_message(), BAD_INPUT)


def _say(sentence: str, code: int) -> int:
    print(sentence, file=sys.stderr)
    return code


if __name__ == "__main__":
    main()
