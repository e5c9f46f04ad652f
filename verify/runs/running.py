"""Running a case with one of its solvers, from the case to the finished run folder."""

import math
import os
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cases import Case, CaseError, load_case
from cases.errors import UserError
from cases.solvers import SOLVERS, Solver
from numerics.costs import Costs
from numerics.status import RunStatus
from verify.runs.frames import FrameWriter
from verify.runs.provenance import PeakMemory, code_version, library_versions, processor_name, source_hash
from verify.runs.run_folder import (
    Checkpoint,
    Discretisation,
    RunFolder,
    RunFolderError,
    RunWriter,
    WriteError,
    as_expected,
    case_folder,
    unfinished_checkpoint,
)

if TYPE_CHECKING:
    from numerics.records import Record

DEFAULT_OUT = Path("reports/out")
DEFAULT_THREADS = min(2, os.cpu_count() or 1)

Listener = Callable[["Record"], None]


class InterruptedRunError(UserError):
    """The user stopped a run; its text says where the unfinished folder is."""

    exit_code = 2


def _builder(solver: Solver) -> Callable[[Case], Discretisation]:
    """What makes a solver's discretisation of a case, or one whose fine cells follow the crack."""

    def build(case: Case) -> Discretisation:
        from numerics.refinement import FollowingDiscretisation

        module, _, name = (solver.dynamic if case.dynamics else solver.quasi_static).partition(":")
        made_by = getattr(import_module(module), name)
        return FollowingDiscretisation(made_by, case) if case.mesh.follow_crack else made_by(case)

    return build


#: name of a solver -> what makes its discretisation of a case
DISCRETISATIONS = {name: _builder(solver) for name, solver in SOLVERS.items()}


def solver_records(discretisation: Any, case: Case, after: Any = None) -> "Iterator[Record]":
    """The increments of a quasi-static run or the instants of a dynamic one, or those behind one of them."""
    from numerics.explicit import instants
    from numerics.quasi_static import increments

    march = instants if case.dynamics else increments
    return march(discretisation, case, after)  # type: ignore[operator]


def case_for_run(case: Case | str | Path, run_name: str, tier: str | None = None) -> Case:
    """The case with the changes of one of its runs merged in.

    Raises
    ------
    CaseError : no such case, tier or run.
    """
    if isinstance(case, Case):
        if case.run == run_name and tier in (None, case.tier):
            return case
        return load_case(case.source, tier or case.tier, run_name)
    return load_case(case, tier, run_name)


def up_to_date(
    case: Case, folder: Path, failures_too: bool = False
) -> RunFolder | None:
    """The finished run in ``folder`` when the same case and the same code would give it again.

    failures_too : a failure that might not come again counts as well
    """
    try:
        finished = RunFolder(folder)
    except RunFolderError:
        return None
    if finished.info["status"] != as_expected(finished.info["status"], case, finished.info["run"]):
        return None
    same = finished.info["case_hash"] == case.hash() and finished.info.get("source_hash") == source_hash()
    return finished if same and (failures_too or finished.info["status"].repeatable) else None


def unfinished(case: Case, folder: Path) -> Checkpoint | None:
    """The checkpoint of an unfinished run of the same case by the same code, if there is one."""
    saved = unfinished_checkpoint(folder)
    return saved if saved is not None and saved.made_by == _identity(case) else None


def _identity(case: Case) -> str:
    return f"{case.hash()} {source_hash()}"


def run(
    case: Case | str | Path,
    run_name: str,
    tier: str | None = None,
    out: Path | str = DEFAULT_OUT,
    listener: Listener | None = None,
    *,
    threads: int = DEFAULT_THREADS,
    force: bool = False,
    resume: bool = False,
) -> RunFolder:
    """Compute one run of a case and return its folder; a run that is up to date is not computed again.

    Parameters
    ----------
    case : a case, the name of one in the library, or the path of a case file.
    run_name : one of the runs that the case describes, such as "fem" or "mpm".
    tier : resolution, "standard" when not given.
    out : folder of all results; the run goes to ``<out>/runs/<case>/<tier>/<run>``.
    listener : called with each record of the history.
    threads : number of threads of compiled loops and linear algebra.
    force : compute even when the finished run is up to date.
    resume : go on behind the checkpoint of an unfinished run of the same case and code, where there is one.

    Raises
    ------
    CaseError : bad case. WriteError : the folder cannot be written. InterruptedRunError : stopped.
    A solver that fails raises nothing: the folder's status and reason tell, beside the last good state where there was
    a way back to it: of a run that blew up there are the snapshots before.
    """
    merged = case_for_run(case, run_name, tier)
    folder = case_folder(Path(out), merged, run_name)
    finished = None if force else up_to_date(merged, folder)
    after = unfinished(merged, folder) if resume else None
    return finished or _compute(merged, run_name, folder, listener, threads, after)


def _compute(
    case: Case,
    run_name: str,
    folder: Path,
    listener: Listener | None,
    threads: int,
    after: Checkpoint | None,
) -> RunFolder:
    from numerics.threads import use_threads

    use_threads(threads)
    files = RunWriter(folder, case.snapshots, _identity(case), after)
    try:
        with files as writer, PeakMemory() as memory:
            attempt = _Attempt(case, run_name, writer, listener, after)
            attempt.solve()
            info = attempt.info() | {"threads": threads, "memory_mb": round(memory.megabytes, 1)}
            info["resumed_after_step"] = after.record.step if after else None
            writer.finish(info, attempt.crack_path)
    except KeyboardInterrupt as stopped:
        raise InterruptedRunError(
            f"Stopped: what was computed so far is in {files.partial} and will not be taken for a result; "
            "`verify run` with --resume goes on from its last checkpoint."
        ) from stopped
    return RunFolder(folder)


class _Attempt:
    """One solution of a case: drives the march and keeps what run.json tells."""

    def __init__(
        self,
        case: Case,
        run_name: str,
        writer: RunWriter,
        listener: Listener | None,
        after: Checkpoint | None,
    ) -> None:
        self.case, self.run_name, self.writer, self.listener = case, run_name, writer, listener
        self.after = after
        self.discretisation: Discretisation | None = None
        self.status: RunStatus = RunStatus.COMPLETE
        self.reason = ""
        self.seconds: dict[str, float] = {}
        self.measures: dict[str, float] = {}
        self.crack_path = np.empty((0, 2))

    def solve(self) -> None:
        """From the case to the last state; a solver's failure becomes the status ``failed``."""
        from numerics.compilation import compilation

        started, processor = time.perf_counter(), time.process_time()
        try:
            with compilation() as compiled:
                self.discretisation = DISCRETISATIONS[self.case.run_spec(self.run_name).solver](self.case)
            self.seconds["set_up"] = time.perf_counter() - started - compiled.wall
            processor = time.process_time() - processor - compiled.processor
            self._warm_up(self.discretisation, compiled.wall)
            self.discretisation.costs.seconds["processor"] = processor
            self._take_up(self.discretisation)
            self._march(self.discretisation)
            if self.status != RunStatus.BLEW_UP:  # it has left the last good state behind
                self._look_at_last_state(self.discretisation)
        except (WriteError, CaseError):
            raise
        except Exception as error:
            self.status, self.reason = RunStatus.FAILED, _one_line(error)
            with suppress(
                OSError
            ):  # the trace is for whoever mends the solver; the reason is enough for the user
                (self.writer.partial / "traceback.txt").write_text(traceback.format_exc(), encoding="utf-8")
        self.seconds["total"] = time.perf_counter() - started

    def _warm_up(self, discretisation: Discretisation, before: float) -> None:
        """Compilation is paid once for each machine, not for each run: its time, that before included, is kept apart."""
        started = time.perf_counter() - before
        warm_up = getattr(discretisation, "warm_up", None)
        if warm_up is not None:
            warm_up()
        self.seconds["warm_up"] = time.perf_counter() - started

    def _take_up(self, discretisation: Discretisation) -> None:
        """State, counters and times of the checkpoint, if the run goes on behind one."""
        if self.after is None:
            return
        discretisation.restore(self.after.state)
        discretisation.costs.count = Counter(self.after.count)
        discretisation.costs.seconds.update(self.after.seconds)
        if self.after.record.is_last:
            self.status, self.reason = self.after.record.status, self.after.record.reason

    def _march(self, discretisation: Discretisation) -> None:
        started = time.perf_counter() - (self.after.record.seconds if self.after else 0.0)
        processor = discretisation.costs.seconds["processor"] - time.process_time()
        behind = (self.after.record,) if self.after else ()
        done = self.after.record.u if self.after else -math.inf
        frames = FrameWriter(self.writer.partial / "frames", self.case.frame_times, done)
        for record in solver_records(discretisation, self.case, *behind):
            # a grid that is refined on the way has a new account
            discretisation.costs.seconds["processor"] = processor + time.process_time()
            if record.is_last:
                self.status, self.reason = record.status, record.reason
            if record.is_good:
                self.writer.record(record, discretisation)
                frames.record(record, discretisation)
            if self.listener is not None:
                self.listener(record)
        self.seconds["increments"] = time.perf_counter() - started

    def _look_at_last_state(self, discretisation: Discretisation) -> None:
        fields = self.writer.last_state(discretisation)
        self.measures = {name: float(value) for name, value in discretisation.measures().items()}
        if fields is not None:
            self.crack_path = _crack_path(fields, self.case)

    def info(self) -> dict[str, Any]:
        """Contents of run.json."""
        costs = self.discretisation.costs if self.discretisation else Costs()
        return {
            "case": self.case.name,
            "title": self.case.title,
            "case_source": str(Path(self.case.source).resolve()),
            "tier": self.case.tier,
            "run": self.run_name,
            "solver": self.case.run_spec(self.run_name).solver,
            "status": as_expected(self.status, self.case, self.run_name),
            "reason": self.reason,
            "case_hash": self.case.hash(),
            "change": self.case.change,
            "code_version": code_version(),
            "source_hash": source_hash(),
            "versions": library_versions(),
            "processor": processor_name(),
            "counters": {name: int(value) for name, value in costs.count.items()},
            "seconds": {
                name: round(float(value), 4) for name, value in (dict(costs.seconds) | self.seconds).items()
            },
            "measures": {
                name: value if math.isfinite(value) else None for name, value in self.measures.items()
            },
        }


def _one_line(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def _crack_path(fields: Any, case: Case) -> np.ndarray:
    """Polyline of the broken state; empty when nothing broke."""
    from verify.metrics.crack_path import crack_path

    return crack_path(fields, case)
