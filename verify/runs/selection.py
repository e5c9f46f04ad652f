"""Which runs are asked for."""

from collections.abc import Sequence
from pathlib import Path

from cases import Case, UserError


def selected_runs(case: Case, wanted: Sequence[str] | None) -> list[str]:
    """Names of the runs of a case that are asked for, all of them without; a sweep's name stands for all its members."""
    if not wanted:
        return case.expanded_runs()
    members = {run: [name for name in case.expanded_runs() if case.run_spec(name).family == run] for run in wanted}
    return list(dict.fromkeys(name for run in wanted for name in members[run] or [run]))


def named_runs(cases: Sequence[Case], wanted: Sequence[str] | None) -> list[tuple[Path, str, str]]:
    """Source, case and run of what is asked for; of several cases, those without the run are passed over.

    Raises
    ------
    UserError : no case has such a run.
    """
    todo = [
        (case.source, case.name, name)
        for case in cases
        for name in selected_runs(case, wanted)
        if len(cases) == 1 or name in case.expanded_runs()
    ]
    if todo:
        return todo
    if wanted:
        raise UserError(f"--run: no case has a run called {', '.join(wanted)}; `verify list` names them.")
    raise UserError(f"{cases[0].source}: 'runs' names no run; add a table [runs.NAME].")
