"""Runs to do: one after the other, in several processes at a time, or on the workers of a Dask cluster."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from rich.console import Console

from cases import Case, CaseError, load_case
from numerics.status import RunStatus
from physics.rocking.records import missing_record
from verify.runs.atomic import WriteError
from verify.runs.cluster import LostTask, results
from verify.runs.listeners import Listener, TimeLimit
from verify.runs.memory import TooLargeError
from verify.runs.processes import fresh_processes
from verify.runs.progress import progress_view
from verify.runs.provenance import resident_megabytes, source_hash
from verify.runs.run_folder import RunFolder, case_folder
from verify.runs.running import run, up_to_date

#: memory [MB] of a used process up to which it is kept: little more than a fresh one takes, not a large one's leavings
LARGEST_USED = 450.0
#: what runs need, imported once for all processes
IMPORTED = ("verify.runs.jobs", "verify.runs.preloaded")
GO_ON = "go on behind its last checkpoint with `verify run --resume`"


@dataclass(frozen=True)
class Job:
    """One run to do; plain data, so that another process can take it.

    change : tables laid over those of the run
    timeout : seconds of the wall's clock, from its first state, after which it is given up at its next record
    failures_count : a run that failed is not done again, but for one that ran out of time and has more of it now
    """

    source: Path
    name: str
    run: str
    tier: str
    out: Path
    threads: int
    force: bool = False
    resume: bool = False
    change: dict[str, Any] = field(default_factory=dict)
    timeout: float | None = None
    failures_count: bool = False
    label: str = ""

    @property
    def title(self) -> str:
        """What the run is called while it goes on."""
        return f"{self.name} {self.tier} {self.label or self.run}"

    def case(self) -> Case:
        """The case to be run; CaseError where there is a mistake in it."""
        return load_case(self.source, self.tier, self.run, self.change)

    def folder(self) -> Path:
        """Where its results go."""
        return case_folder(self.out, self.case(), self.run)

    def finished(self) -> RunFolder | None:
        """The run where it need not be done again."""
        case = self.case()
        done = up_to_date(case, case_folder(self.out, case, self.run), self.failures_count)
        return None if done is not None and self._has_more_time_than(done) else done

    def _has_more_time_than(self, done: RunFolder) -> bool:
        late, taken = done.info["status"] == RunStatus.TIMED_OUT, done.info["seconds"].get("total", 0.0)
        return late and (self.timeout is None or self.timeout > taken)


@dataclass(frozen=True)
class Outcome:
    """How a job ended, in words; one that was refused computed nothing because of a mistake in the case, one that needs
    a record because that is not on this machine."""

    title: str
    line: str
    failed: bool
    refused: bool = False
    needs_record: bool = False


def outcomes(todo: list[Job], jobs: int, cluster: str | None = None) -> Iterator[Outcome]:
    """Do all jobs, so many at a time; yields each as it ends.

    cluster : address of a Dask scheduler, on whose workers they are done, one at a time on each

    Raises
    ------
    ClusterError : the cluster cannot be used.
    """
    if cluster is not None:
        yield from _on_cluster(todo, cluster)
        return
    if jobs == 1 or len(todo) < 2:
        yield from map(do, todo)
        return
    free: SimpleQueue[_Process] = SimpleQueue()
    processes, waiting = [_Process() for _ in range(jobs)], Waiting(todo)
    for process in processes:
        free.put(process)

    def in_a_process() -> Outcome:
        process = free.get()
        try:
            return process.do(waiting.next_for(process))
        finally:
            free.put(process)

    slots = ThreadPoolExecutor(jobs)
    try:
        for future in as_completed([slots.submit(in_a_process) for _ in todo]):
            yield future.result()
    finally:
        slots.shutdown(cancel_futures=True)
        for process in processes:
            process.end()


class Waiting:
    """Jobs in their order, but that a process goes on with what it has kernels for, quasi-static runs or moving ones, and
    begins with what no other one compiles."""

    def __init__(self, todo: list[Job]) -> None:
        # all runs of a case move or none
        moves = {source: _moves(job) for source, job in {job.source: job for job in todo}.items()}
        self._todo = [(job, moves[job.source]) for job in todo]
        self._last: dict[object, bool] = {}
        self._lock = threading.Lock()

    def next_for(self, process: object) -> Job:
        """The job that a process does next."""
        with self._lock:
            last, others = self._last.get(process), [moves for one, moves in self._last.items() if one is not process]
            job, moves = min(self._todo, key=lambda waiting: (waiting[1] != last, waiting[1] in others))
            self._todo.remove((job, moves))
            self._last[process] = moves
        return job


def _moves(job: Job) -> bool:
    """Whether it is a moving run; one that cannot be read, which its outcome will tell, is none."""
    try:
        return job.case().dynamics is not None
    except CaseError:
        return False


class _Process:
    """A process that does one job after another, so that kernels are loaded once for all of them.

    It makes way for a fresh one where the number of threads changes, which a used process has fixed, where a run has
    left it large, and where it has ended.
    """

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._threads = 0

    def do(self, job: Job) -> Outcome:
        """The job's end; that of the process is not the end of the others."""
        if job.threads != self._threads:
            self.end()
        if self._pool is None:
            self._pool = ProcessPoolExecutor(1, mp_context=fresh_processes(*IMPORTED), initializer=_watch_parent)
            self._threads = job.threads
        try:
            outcome, megabytes = self._pool.submit(_do_and_weigh, job).result()
        except BrokenProcessPool:
            self.end()
            return Outcome(job.title, f"its process ended before it; {job.folder()}: {GO_ON}", True)
        if megabytes > LARGEST_USED:
            self.end()
        return outcome

    def end(self) -> None:
        """The next job gets a fresh one."""
        if self._pool is not None:
            self._pool.shutdown()
        self._pool = None


def _do_and_weigh(job: Job) -> tuple[Outcome, float]:
    """How it ended, and the memory [MB] that this process has now."""
    return do(job), resident_megabytes()


def _on_cluster(todo: list[Job], address: str) -> Iterator[Outcome]:
    """By workers that see the same files under the same paths."""
    everywhere = [replace(job, source=job.source.resolve(), out=job.out.resolve()) for job in todo]
    tasks = [(job, source_hash()) for job in everywhere]
    for (job, _), outcome in results(_do_on_worker, tasks, address):
        folder = job.folder()
        if isinstance(outcome, LostTask):
            yield Outcome(job.title, f"{outcome.reason}; {folder}: {GO_ON}", True)
        elif not (outcome.failed or folder.exists()):
            yield Outcome(job.title, f"{folder} is not there: the workers must share this machine's file system", True)
        else:
            yield outcome


def _do_on_worker(task: tuple[Job, str]) -> Outcome:
    """A job, where the worker has the same code."""
    job, source = task
    if source_hash() != source:
        return Outcome(job.title, "its worker has another version of the project; install the same everywhere", True)
    return do(job)


def _watch_parent() -> None:
    """From the start: a parent may be killed before it has given its process anything to do."""
    # a shell starts what runs in its background with interrupts ignored, and children take that over
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A run whose parent was killed is interrupted too, behind its last checkpoint, and does not go on alone."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGINT)


def do(job: Job) -> Outcome:
    """One run from start to end; a failure to write or a refusal is a failed run, not the end of the others."""
    finished = None if job.force else job.finished()
    if finished is None and (sentence := missing_record(job.case())):
        return Outcome(job.title, sentence, False, needs_record=True)
    try:
        with _listeners(job, finished) as listeners:
            done = finished or run(
                job.case(), job.run, job.tier, job.out, listeners,
                threads=job.threads, force=True, resume=job.resume,
            )  # fmt: skip
    except WriteError as error:
        return Outcome(job.title, str(error), True)
    except (CaseError, TooLargeError) as error:
        return Outcome(job.title, str(error), True, refused=True)
    return _outcome(job, done, finished is not None)


@contextmanager
def _listeners(job: Job, finished: RunFolder | None) -> Iterator[list[Listener]]:
    """To a run that is to be done: its progress display, and the limit of its time."""
    if finished:
        yield []
        return
    with progress_view(job.title, Console(file=sys.stdout, soft_wrap=not sys.stdout.isatty())) as view:
        yield [view] if job.timeout is None else [view, TimeLimit(job.timeout)]


def _outcome(job: Job, done: RunFolder, was_up_to_date: bool) -> Outcome:
    info = done.info
    state = "up to date" if was_up_to_date else f"{info['seconds'].get('total', 0.0):.1f} s"
    if not was_up_to_date and info.get("resumed_after_step") is not None:
        state += f", resumed after step {info['resumed_after_step']}"
    line = f"{info['status'].words} ({state}), {done.folder}"
    if done.good:
        return Outcome(job.title, line, False)
    kept = "what came before is saved there" if info["increments"] else "there is no good state"
    kept = GO_ON if info["status"] == RunStatus.TIMED_OUT else kept
    return Outcome(job.title, f"{line}; {info['reason']}; {kept}", True)
