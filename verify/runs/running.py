"""Running a case with one of its solvers, from the case to the finished run folder."""

import math
import os
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from cases import Case, CaseError, load_case, of_its_file
from cases.errors import UserError
from cases.solvers import SOLVERS, Solver
from numerics.costs import Costs
from numerics.description import remarks
from numerics.status import RunStatus
from physics.exact_rules import require_exact
from verify.extras import missing_extra
from verify.runs.atomic import WriteError
from verify.runs.checkpoint import CHECKPOINT_FILE, Checkpoint, CheckpointError, CheckpointWriter
from verify.runs.frames import FrameWriter
from verify.runs.importing import history_of
from verify.runs.listeners import Listener, ObservedDiscretisation, SettledVerdict, StoppedError
from verify.runs.memory import require_memory
from verify.runs.provenance import PeakMemory, code_version, library_versions, processor_name, source_hash
from verify.runs.run_folder import RunFolder, RunFolderError, as_expected, case_folder, require_own_folder
from verify.runs.run_writer import RunWriter, write_run

if TYPE_CHECKING:
    import pandas as pd

    from numerics.fields import Fields
    from numerics.records import Record

DEFAULT_OUT = Path("reports/out")
DEFAULT_THREADS = min(2, os.cpu_count() or 1)


class InterruptedRunError(UserError):
    """The user stopped a run; its text says where the unfinished folder is."""

    exit_code = 2


def _builder(solver: Solver) -> Callable[[Case], ObservedDiscretisation]:
    """What makes a solver's discretisation of a case, or one whose fine cells follow the crack."""

    def build(case: Case) -> ObservedDiscretisation:
        from numerics.compilation import compile_without_cache_where_it_fails
        from numerics.refinement import FollowingDiscretisation

        compile_without_cache_where_it_fails()
        module, name = _home(solver, case)
        made_by = getattr(import_module(module), name)
        return FollowingDiscretisation(made_by, case) if case.mesh.follow_crack else made_by(case)

    return build


def _home(solver: Solver, case: Case) -> tuple[str, str]:
    """Module and name of the discretisation of a solver."""
    module, _, name = (solver.dynamic if case.dynamics else solver.quasi_static).partition(":")
    return module, name


class _Discretisations(dict[str, Callable[[Case], ObservedDiscretisation]]):
    """Those of solvers that other packages register are made when they are asked for."""

    def __missing__(self, name: str) -> Callable[[Case], ObservedDiscretisation]:
        return self.setdefault(name, _builder(SOLVERS[name]))


#: name of a solver -> what makes its discretisation of a case
DISCRETISATIONS = _Discretisations()


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
    CaseError : no such case, tier or run, or one that was changed after it was read.
    """
    if isinstance(case, Case):
        if case.run == run_name and tier in (None, case.tier):
            return case
        return of_its_file(case, tier, run_name)
    return load_case(case, tier, run_name)


def up_to_date(case: Case, folder: Path, failures_too: bool = False) -> RunFolder | None:
    """The finished run in ``folder`` when the same case, the same code and the same libraries would give it again.

    failures_too : a failure that might not come again counts as well
    """
    try:
        finished = RunFolder(folder)
    except RunFolderError:
        return None
    if finished.info["status"] != as_expected(finished.info["status"], case, finished.info["run"]):
        return None
    made_by = {"case_hash": case.hash(), "source_hash": source_hash(), "versions": library_versions()}
    same = all(finished.info.get(name) == value for name, value in made_by.items())
    return finished if same and (failures_too or finished.info["status"].repeatable) else None


def run(
    case: Case | str | Path,
    run_name: str,
    tier: str | None = None,
    out: Path | str = DEFAULT_OUT,
    listeners: Sequence[Listener] = (),
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
    tier : resolution; that of a case, "standard" of a name or path when not given.
    out : folder of all results; the run goes to ``<out>/runs/<case>/<tier>/<run>``.
    listeners : hear of every record, after those that write the folder.
    threads : number of threads of compiled loops and linear algebra.
    force : compute even when the finished run is up to date.
    resume : go on behind the checkpoint of a stopped run of the same case and code, where there is one; where there is
        one that cannot be gone on with, the listeners are told why and where it is kept.

    Raises
    ------
    CaseError : bad case. UserError : another argument is none, or the run needs more memory than this machine has.
    WriteError : the folder cannot be written.
    InterruptedRunError : stopped.
    A solver that fails raises nothing: the folder's status and reason tell, beside the last good state where there was
    a way back to it: of a run that blew up there are the snapshots before.
    """
    _require_usable(run_name, out, listeners, threads)
    merged = case_for_run(case, run_name, tier)
    require_exact(merged)
    folder = case_folder(Path(out), merged, run_name)
    finished = None if force else up_to_date(merged, folder)
    require_own_folder(folder, merged)
    if finished:
        return finished
    if SOLVERS[merged.run_spec(run_name).solver].table:
        return tabulate(merged, run_name, folder)
    require_memory(merged, run_name)
    return _compute(merged, run_name, folder, listeners, threads, resume)


def _require_usable(run_name: object, out: object, listeners: object, threads: object) -> None:
    """Raise UserError for an argument of `run` that is not what it should be."""
    said = ""
    if not isinstance(run_name, str):
        said = f"run_name = {run_name!r} is no text; give the name of one of the case's runs, such as 'fem'"
    elif not isinstance(out, str | Path) or not str(out).strip():
        said = f"out = {out!r} is no path; give a folder"
    elif isinstance(threads, bool) or not isinstance(threads, Integral) or threads < 1:
        said = f"threads = {threads!r} is no number of threads; give 1 or more"
    elif not isinstance(listeners, Sequence):
        said = f"listeners = {listeners!r} is no list; give one of verify.runs.listeners.Listener each"
    else:
        asked = [name for name in vars(Listener) if not name.startswith("_")]
        for listener in listeners:
            if missing := [name for name in asked if not callable(getattr(listener, name, None))]:
                remedy = "derive it from verify.runs.listeners.Listener"
                said = f"the listener {listener!r} has no {', '.join(missing)}; {remedy}"
                break
    if said:
        raise UserError(f"run: {said}.")


def tabulate(case: Case, run_name: str, folder: Path) -> RunFolder:
    """The run folder of a solver that gives a table, or of a result from elsewhere; a failure is recorded as ours are.

    Raises UserError for a table that cannot be used.
    """
    module, _, name = SOLVERS[case.run_spec(run_name).solver].table.partition(":")
    info, table, path = _Attempt(case, run_name, None, ()).info(), pd.DataFrame(), np.empty((0, 2))
    states: dict[int, Fields] = {}
    started = time.perf_counter()
    try:
        made = getattr(import_module(module), name)(case)
        given, path, states, *_ = (*made, {}) if isinstance(made, tuple) else (made, path, {})
        table = history_of(given, case)
        path = _traced(states, case) if len(path) == 0 else path
        if states:
            from verify.runs.field_energies import complete

            info["remarks"] = complete(table, states, case)
    except UserError:
        raise
    except ModuleNotFoundError as error:
        raise missing_extra(error) or error from error
    except Exception as error:
        info |= {"status": as_expected(RunStatus.FAILED, case, run_name), "reason": _one_line(error)}
    info["seconds"] = {"total": round(time.perf_counter() - started, 4)}
    write_run(folder, table, path, info, states, case.units)
    return RunFolder(folder)


def _traced(states: "Mapping[int, Fields]", case: Case) -> np.ndarray:
    """The crack path (n, 2) of the last state of a table's run; none without fields."""
    if not states:
        return np.empty((0, 2))
    from verify.metrics.crack_path import crack_path

    return crack_path(states[max(states)], case)


def _compute(
    case: Case, run_name: str, folder: Path, listeners: Sequence[Listener], threads: int, resume: bool
) -> RunFolder:
    from numerics.threads import use_threads

    use_threads(threads)
    identity = f"{case.hash()} {source_hash()}"
    files = RunWriter(folder, case.snapshots, case.units)
    try:
        with files, PeakMemory() as memory:
            after, note = _beginning(files, identity, resume)
            checkpoints = CheckpointWriter(files.partial / CHECKPOINT_FILE, identity, files.flush_to_disk)
            frames = FrameWriter(files.partial / "frames", case.frame_times)
            settled = [SettledVerdict(case)] if case.rocking and case.rocking.stop_when_settled else []
            attempt = _Attempt(case, run_name, after, [files, frames, checkpoints, *listeners, *settled])
            attempt.solve(note, files.partial / "traceback.txt")
            attempt.examine(files.history())
            info = attempt.info() | {"threads": threads, "memory_mb": round(memory.megabytes, 1)}
            info["resumed_after_step"] = after.record.step if after else None
            files.close(info, attempt.crack_path)
    except CaseError:
        files.discard()
        raise
    except KeyboardInterrupt as stopped:
        raise InterruptedRunError(
            f"Stopped: what was computed so far is in {files.partial} and will not be taken for a result; "
            "`verify run` with --resume goes on from its last checkpoint."
        ) from stopped
    return RunFolder(folder)


def _beginning(files: RunWriter, identity: str, resume: bool) -> tuple[Checkpoint | None, str]:
    """The checkpoint to go on behind, and what is said of it."""
    try:
        after = files.checkpoint(identity) if resume else None
    except CheckpointError as error:
        return None, f"begins anew, its checkpoint {error}; what there was is kept in {files.set_aside}"
    return after, f"goes on after step {after.record.step}" if after else ""


class _Attempt:
    """One solution of a case: drives the march and keeps what run.json tells."""

    def __init__(self, case: Case, run_name: str, after: Checkpoint | None, listeners: Sequence[Listener]) -> None:
        self.case, self.run_name, self.after, self.listeners = case, run_name, after, listeners
        self.discretisation: ObservedDiscretisation | None = None
        self.status, self.reason = RunStatus.COMPLETE, ""
        self.seconds: dict[str, float] = {}
        self.measures: dict[str, float] = {}
        self.health: dict[str, float] = {}
        self.crack_path = np.empty((0, 2))
        self._fields: Fields | None = None

    def solve(self, note: str, trace: Path) -> None:
        """From the case to the last state; a solver's failure becomes the status ``failed``."""
        started = time.perf_counter()
        for listener in self.listeners:
            listener.start(self.after.record if self.after else None, note)
        try:
            self.discretisation = discretisation = self._build()
            self._take_up(discretisation)
            self._march(discretisation)
            if self.status != RunStatus.BLEW_UP:  # it has left the last good state behind
                self._finish(discretisation)
        except (WriteError, CaseError):
            raise
        except ModuleNotFoundError as error:
            raise missing_extra(error) or error from error
        except Exception as error:
            self.status, self.reason = RunStatus.FAILED, _one_line(error)
            with suppress(OSError):  # for whoever mends the solver; the reason is enough for the user
                trace.write_text(traceback.format_exc(), encoding="utf-8")
        self.seconds["total"] = time.perf_counter() - started

    def _build(self) -> ObservedDiscretisation:
        """The discretisation; imports and compilation are not paid for each run: their time is kept apart."""
        from numerics.compilation import compilation

        solver = self.case.run_spec(self.run_name).solver
        import_module(_home(SOLVERS[solver], self.case)[0])
        started, processor = time.perf_counter(), time.process_time()
        with compilation() as compiled:
            discretisation = DISCRETISATIONS[solver](self.case)
        self.seconds["set_up"] = time.perf_counter() - started - compiled.wall
        processor = time.process_time() - processor - compiled.processor
        started = time.perf_counter() - compiled.wall
        warm_up = getattr(discretisation, "warm_up", None)
        if warm_up is not None:
            warm_up()
        self.seconds["warm_up"] = time.perf_counter() - started
        discretisation.costs.seconds["processor"] = processor
        return discretisation

    def _take_up(self, discretisation: ObservedDiscretisation) -> None:
        """State, counters and times of the checkpoint, if the run goes on behind one."""
        if self.after is None:
            return
        discretisation.restore(self.after.state)
        discretisation.costs.count = Counter(self.after.count)
        discretisation.costs.seconds.update(self.after.seconds)
        if self.after.record.is_last:
            self.status, self.reason = self.after.record.status, self.after.record.reason

    def _march(self, discretisation: ObservedDiscretisation) -> None:
        from numerics.compilation import compilation

        behind = (self.after.record,) if self.after else ()
        started = time.perf_counter() - (self.after.record.seconds if self.after else 0.0)
        processor = discretisation.costs.seconds["processor"] - time.process_time()
        try:
            with compilation() as compiled:
                for record in solver_records(discretisation, self.case, *behind):
                    # a grid that is refined on the way has a new account
                    discretisation.costs.seconds["processor"] = processor + time.process_time() - compiled.processor
                    if record.is_last:
                        self.status, self.reason = record.status, record.reason
                    for listener in self.listeners:
                        listener.record(record, discretisation)
        except StoppedError as stopped:
            self.status, self.reason = stopped.status, stopped.reason
        self.seconds["increments"] = time.perf_counter() - started

    def _finish(self, discretisation: ObservedDiscretisation) -> None:
        """The last good state: its fields, what only the solver can tell, and the crack."""
        from verify.metrics.crack_path import crack_path

        self._fields = fields = discretisation.fields()
        for listener in self.listeners:
            listener.finish(discretisation, fields)
        self.measures = {name: float(value) for name, value in discretisation.measures().items()}
        self.crack_path = crack_path(fields, self.case)

    def examine(self, history: "pd.DataFrame") -> None:
        """The health record of what was computed."""
        from verify.health import health

        if RunStatus(self.status).good:
            self.health = health(self.case, history, self._fields, self.measures)

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
            "units": self.case.history_units,
            "case_hash": self.case.hash(),
            "change": self.case.change,
            "health": {name: round(value, 12) for name, value in self.health.items()},
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
            "remarks": [f"run {self.run_name}: {said}" for said in remarks(self.case)],
        }


def _one_line(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"

