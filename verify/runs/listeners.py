"""What listens to the records of a run: the writers of its folder, the progress display, the limit of its time.

The march yields records and knows nothing of them.
"""

import math
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

import numpy as np

from numerics.status import RunStatus
from physics.rocking.motion import settled_verdict

if TYPE_CHECKING:
    from cases import Case
    from numerics.costs import Costs
    from numerics.fields import Fields
    from numerics.records import Record


class ObservedDiscretisation(Protocol):
    """What a run needs from a solver besides its march."""

    costs: "Costs"

    def fields(self) -> "Fields":
        """Everything to be seen now."""

    def measures(self) -> dict[str, float]:
        """Scalars that only the solver can tell."""

    def checkpoint(self) -> dict[str, np.ndarray]:
        """Arrays from which `restore` makes the state again."""

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        """Go back to the state of a checkpoint of the same case."""


class Listener:
    """Takes part in a run from its start on; what it has no use for it leaves as it is here."""

    def start(self, after: "Record | None", note: str) -> None:
        """The run begins, behind a record where it goes on with a stopped one; ``note`` says so, or why it does not."""

    def record(self, record: "Record", discretisation: ObservedDiscretisation) -> None:
        """A record has come; where it is good the discretisation holds its state. May raise `StoppedError`."""

    def finish(self, discretisation: ObservedDiscretisation, fields: "Fields") -> None:
        """The march has ended; the discretisation holds the last good state, whose fields these are."""


class StoppedError(Exception):
    """A listener ends the run behind the present record: how it is called then, and why."""

    def __init__(self, status: RunStatus, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, reason


class SettledVerdict(Listener):
    """Ends a run where the verdict on the body that rocks can change no longer.

    Behind a checkpoint it knows the motion from there on only, and may end the run later than it could.
    """

    def __init__(self, case: "Case") -> None:
        assert case.rocking is not None
        from physics.rocking.of_case import block_of, ground_motion  # compiled: on use

        self._body, self._block, self._end = case.rocking.body, block_of(case), ground_motion(case).end
        self._time: list[float] = []
        self._angle: list[float] = []

    def record(self, record: "Record", discretisation: ObservedDiscretisation) -> None:
        """Raises `StoppedError` where the verdict is settled."""
        row = record.row()
        self._time.append(record.u)
        self._angle.append(row[f"{self._body}_angle"])
        if record.u < self._end and abs(self._angle[-1]) < 1.0:
            return
        angle, rate = np.unwrap(self._angle), row[f"{self._body}_spin"]
        if settled_verdict(self._block, self._end, self._time, angle, rate) is not None:
            raise StoppedError(RunStatus.COMPLETE, f"the verdict on {self._body} is settled, at t = {record.u:.6g}")


class TimeLimit(Listener):
    """Ends a run that goes on for more than so many seconds from its first record on: compilation does not count."""

    def __init__(self, seconds: float) -> None:
        self._seconds, self._started = seconds, math.nan

    def record(self, record: "Record", discretisation: ObservedDiscretisation) -> None:
        """Raises `StoppedError` where time is over and something is left of the run."""
        if math.isnan(self._started):
            self._started = time.perf_counter()
            discretisation.costs.until = self._started + self._seconds
        late = time.perf_counter() - self._started > self._seconds
        if late and not record.is_last and record.share < 1.0:
            raise StoppedError(RunStatus.TIMED_OUT, f"more than {self._seconds:g} s, at u = {record.u:.6g}")
