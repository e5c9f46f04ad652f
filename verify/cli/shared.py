"""The program, its options and how it tells things."""

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Column, Table

from cases import Case, CaseError, list_cases, load_case
from verify.runs.provenance import code_version
from verify.runs.refusals import refusals

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
CaseArgument = Annotated[str, typer.Argument(help="name in the library, folder with a case.toml, or .toml file")]
CasesArgument = Annotated[
    list[str], typer.Argument(metavar="CASE...", help="names in the library, folders with a case.toml, or .toml files")
]
OptionalCases = Annotated[
    list[str] | None,
    typer.Argument(metavar="[CASE]...", help="names, folders or .toml files; all of the library without any"),
]
TierOption = Annotated[str, typer.Option("--tier", help="resolution: quick, standard or paper")]


def as_folder(given: str | Path) -> Path:
    """The folder of an option, which may be to come."""
    if not str(given).strip():
        raise typer.BadParameter("is empty; give a folder")
    if Path(given).exists() and not Path(given).is_dir():
        raise typer.BadParameter(f"{str(given)!r} is a file; give a folder")
    return Path(given)


def as_share(text: str) -> float:
    """0.01 for "1%" and for "0.01"."""
    try:
        value = float(text.strip().removesuffix("%")) / (100.0 if text.strip().endswith("%") else 1.0)
    except ValueError:
        value = math.nan
    if not 0.0 < value < 1.0:
        raise typer.BadParameter(f"{text!r} is no share; give for instance 1% or 0.01")
    return value


OutOption = Annotated[Path, typer.Option("--out", parser=as_folder, metavar="FOLDER", help="folder of all results")]
AccuracyOption = Annotated[
    float | None,
    typer.Option(
        "--accuracy", parser=as_share, metavar="SHARE", help="error allowed in each checked quantity, such as 1%"
    ),
]
ClusterOption = Annotated[
    str | None,
    typer.Option("--cluster", help="do the runs on this Dask cluster, one on each worker: tcp://host:8786"),
]
RunOption = Annotated[list[str] | None, typer.Option("--run", help="only this run; may be repeated")]
RecordOption = Annotated[bool, typer.Option("--record", help="keep them beside the case, for every report to show")]
JobsOption = Annotated[int, typer.Option("--jobs", min=1, help="runs at the same time")]
ThreadsOption = Annotated[int, typer.Option("--threads", min=1, help="threads of each run")]


def new_console() -> Console:
    """Made anew for each command, because tests and callers may have replaced sys.stdout; brackets are no markup.

    Files and other programs get each row of a table in one line, whatever its width.
    """
    seen = sys.stdout.isatty()
    width = None if seen else WIDEST
    return Console(file=sys.stdout, width=width, soft_wrap=not seen, markup=False, highlight=False, emoji=False)


def new_table(*headers: str, **options: Any) -> Table:
    """A table that breaks what a narrow terminal has no room for, and cuts nothing off."""
    return Table(*(Column(header, overflow="fold") for header in headers), **options)


def selected_cases(names: Sequence[str] | None, tier: str) -> list[Case]:
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


def refuse_what_cannot_run(cases: list[Case]) -> None:
    """Raise CaseError with all that the solvers of these runs object to, if they do."""
    found = refusals(cases)
    if sentences := found.sentences + found.needs:
        raise CaseError("\n".join(sentences))
