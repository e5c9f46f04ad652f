"""What a run tells after each accepted increment of the load or every so many steps in time."""

from __future__ import annotations

from typing import Protocol

from .status import RunStatus


class Record(Protocol):
    """One row of a run's history: the discretisation holds its state while the record is being listened to.

    ``u`` is the load parameter, in dynamics the time; ``share`` is the part of the run that is done; ``seconds``
    have passed since its start.
    """

    @property
    def step(self) -> int: ...
    @property
    def u(self) -> float: ...
    @property
    def share(self) -> float: ...
    @property
    def seconds(self) -> float: ...
    @property
    def status(self) -> RunStatus: ...
    @property
    def reason(self) -> str: ...

    @property
    def is_last(self) -> bool:
        """Nothing comes after it, whatever is left of the run."""

    @property
    def is_good(self) -> bool:
        """It holds a new state of the history."""

    def row(self) -> dict[str, float]:
        """Columns of the history in their order."""

    def text(self) -> str:
        """A few words for the progress display."""
