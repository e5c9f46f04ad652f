"""Checkpoints: the last good state of a run in one file, from which a run that was stopped goes on."""

import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from numerics.status import RunStatus
from verify.runs.atomic import write_file
from verify.runs.listeners import Listener, ObservedDiscretisation

if TYPE_CHECKING:
    from numerics.fields import Fields
    from numerics.records import Record

CHECKPOINT_FILE = "checkpoint.npz"


class CheckpointError(Exception):
    """Why there is no going on behind a checkpoint, as the predicate of a sentence."""


@dataclass(frozen=True)
class Checkpoint:
    """The last good state of a run, as it is kept in ``checkpoint.npz``.

    ``made_by`` identifies case and code; ``count`` and ``seconds`` are what the run has cost by then; ``state`` is what
    the discretisation restores.
    """

    made_by: str
    record: "Record"
    count: dict[str, int]
    seconds: dict[str, float]
    state: dict[str, np.ndarray]

    def write(self, path: Path) -> None:
        """Into one file of arrays and a line of JSON."""
        told = {"made_by": self.made_by, "kind": type(self.record).__name__, "record": asdict(self.record)}  # type: ignore[call-overload]
        told |= {"count": self.count, "seconds": self.seconds, "arrays": list(self.state)}
        np.savez(path, told=np.array(json.dumps(told)), **self.state)  # type: ignore[arg-type]

    @classmethod
    def read(cls, path: Path) -> "Checkpoint":
        """Raises CheckpointError where the file is missing, cut or foreign."""
        try:
            with np.load(path, allow_pickle=False) as arrays:
                state = dict(arrays)
            told = json.loads(str(state.pop("told")))
            if told["arrays"] != list(state):  # a zip file guards what it holds, not its names
                raise KeyError("arrays of other names")
            return cls(
                made_by=str(told["made_by"]),
                record=_record(told["kind"], told["record"]),
                count={str(name): int(value) for name, value in told["count"].items()},
                seconds={str(name): float(value) for name, value in told["seconds"].items()},
                state=state,
            )
        except Exception as error:  # in foreign bytes zipfile, zlib, numpy and json fail in a dozen ways
            raise CheckpointError("is missing or unreadable") from error


def _record(kind: str, values: dict[str, Any]) -> "Record":
    from numerics.explicit import Balance, Instant
    from numerics.quasi_static import Increment, MarchState

    values["status"] = RunStatus(values["status"])
    if kind == "Increment":
        return Increment(**(values | {"march": MarchState(**values["march"])}))
    balance = values["balance"]
    return Instant(**(values | {"balance": Balance(**(balance | {"momentum": tuple(balance["momentum"])}))}))


class CheckpointWriter(Listener):
    """Saves the state now and then and at the end.

    Parameters
    ----------
    path : of the file.
    made_by : what identifies case and code, so that a checkpoint of others is not taken up.
    before : called before each saving: no checkpoint may be ahead of its history.

    Raises
    ------
    WriteError : the file cannot be written.
    """

    interval = 20.0  # seconds between two savings, at least
    largest_share = 0.02  # of the time that savings may take: two million points write 600 MB

    def __init__(self, path: Path, made_by: str, before: Callable[[], None]) -> None:
        self._path, self._made_by, self._before = path, made_by, before
        self._last: Record | None = None
        self._save_after = math.inf

    def start(self, after: "Record | None", note: str) -> None:
        """The first saving is due an interval from now."""
        self._last, self._save_after = after, time.monotonic() + self.interval

    def record(self, record: "Record", discretisation: ObservedDiscretisation) -> None:
        """Save the state where it is due."""
        if not record.is_good:
            return
        self._last = record
        if time.monotonic() > self._save_after:
            self._save(discretisation)

    def finish(self, discretisation: ObservedDiscretisation, fields: "Fields") -> None:
        """Save the last good state."""
        if self._last is not None:
            self._save(discretisation)

    def _save(self, discretisation: ObservedDiscretisation) -> None:
        assert self._last is not None
        started = time.monotonic()
        self._before()
        costs = discretisation.costs
        checkpoint = Checkpoint(
            made_by=self._made_by,
            record=self._last,
            count={name: int(value) for name, value in costs.count.items()},
            seconds={name: float(value) for name, value in costs.seconds.items()},
            state=discretisation.checkpoint(),
        )
        write_file(self._path, checkpoint.write)
        saved = time.monotonic()
        self._save_after = saved + max(self.interval, (saved - started) / self.largest_share)
