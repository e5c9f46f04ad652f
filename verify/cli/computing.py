"""Commands that compute."""

from typing import Annotated

import typer

from cases.loader import LIBRARY, reading_once
from verify.cli.shared import (
    BAD_INPUT,
    RUN_FAILED,
    AccuracyOption,
    ClusterOption,
    JobsOption,
    OptionalCases,
    OutOption,
    RunOption,
    TierOption,
    app,
    new_console,
    refuse_what_cannot_run,
    selected_cases,
)
from verify.runs.jobs import Job, Outcome, outcomes
from verify.runs.running import DEFAULT_OUT, DEFAULT_THREADS
from verify.runs.selection import named_runs


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

    each, console = threads if cluster else max(1, threads // jobs), new_console()
    with reading_once():
        wanted = [
            Job(*named, tier=tier, out=out, threads=each, force=force, resume=resume, timeout=timeout)
            for named in named_runs(selected_cases(cases, tier), run_names)
        ]
        # a mistake in the last case is told before the first run; those of the library have none
        refuse_what_cannot_run([job.case() for job in wanted if not job.source.is_relative_to(LIBRARY)])
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
