"""Tasks on the workers of a Dask cluster, one at a time on each.

A worker is given its next task only when it has done the last one, so that a run has a process to itself, and a task
whose worker ends is not begun again on another: it comes back as `LostTask`.
"""

import re
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from cases.errors import UserError

#: seconds to wait for a scheduler, and for a worker where there is none: one that is started anew takes some
PATIENCE = 30.0
#: seconds between two looks at the tasks
PAUSE = 0.1
_ADDRESS = re.compile(r"([a-z]+://)?.+:[0-9]+(/.*)?")


class ClusterError(UserError):
    """A cluster cannot be used; its text is one sentence with the address and the remedy."""


@dataclass(frozen=True)
class LostTask:
    """What is left of a task whose worker has ended."""

    reason: str


def worker_count(address: str) -> int:
    """Number of workers at a scheduler's address, such as ``tcp://host:8786``.

    Raises
    ------
    ClusterError : Dask is not installed, no scheduler answers there, or it has no worker.
    """
    with _connected(address) as client:
        return len(_workers(client))


def results(task: Callable[[Any], Any], items: Iterable[Any], address: str) -> Iterator[tuple[Any, Any]]:
    """Each item with what its task gave or `LostTask`, in the order in which they end.

    Raises
    ------
    ClusterError : as in `worker_count`, or the workers do not know the task.
    """
    waiting = deque(items)
    with _connected(address) as client:
        busy: dict[str, tuple[Any, Any]] = {}
        while waiting or busy:
            there = _workers(client)
            for worker in there - busy.keys():
                if waiting:
                    item = waiting.popleft()
                    busy[worker] = item, client.submit(task, item, workers=[worker], pure=False)
            for worker in [name for name, (_, future) in busy.items() if name not in there or future.done()]:
                item, future = busy.pop(worker)
                yield item, _result(future, worker)
            if not (busy or _has_worker(client)):
                yield from ((item, LostTask(f"no worker is left at {address}")) for item in waiting)
                return
            time.sleep(PAUSE)


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    """A client of the scheduler, which has a worker."""
    try:
        from distributed import Client
    except ImportError as missing:
        raise ClusterError(
            f"{address}: a cluster needs Dask, which is not installed; do it with `pip install 'dask[distributed]'`."
        ) from missing
    try:
        if not _ADDRESS.fullmatch(address):
            raise ValueError("Dask would take it for a name and look for it for a minute")
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"{address}: no Dask scheduler answers there; start one with `dask scheduler` and give its address, "
            "such as tcp://127.0.0.1:8786."
        ) from error
    with client:
        if not _has_worker(client):
            raise ClusterError(f"{address}: has no worker; start one with `dask worker {address} --nthreads 1`.")
        yield client


def _workers(client: Any) -> set[str]:
    # asked of the scheduler: what the client knows of it is overwritten in the background, without workers
    return set(client.ncores())


def _has_worker(client: Any) -> bool:
    """Whether there is a worker, or one comes within some seconds."""
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        return False
    return True


def _result(future: Any, worker: str) -> Any:
    """What a task gave that is done or whose worker is no longer there."""
    from distributed import KilledWorker

    try:
        if future.done():
            return future.result()
    except (KilledWorker, CancelledError):
        pass
    except ModuleNotFoundError as error:
        raise ClusterError(f"{worker}: {error}; install this version of the project where the workers run.") from error
    future.cancel()
    return LostTask(f"its worker {worker} ended before it")
