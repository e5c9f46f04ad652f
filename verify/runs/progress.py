"""How a run tells where it is: a bar with the time left on a terminal, now and then a line elsewhere."""

import time
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from verify.runs.listeners import Listener, ObservedDiscretisation

if TYPE_CHECKING:
    from numerics.records import Record


class Bar(Listener):
    """Progress bar over the share of the run that is done; its time left assumes an even pace."""

    def __init__(self, title: str, console: Console) -> None:
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[state]}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        )
        self._title, self._progress = title, Progress(*columns, console=console)
        self._task = self._progress.add_task(title, total=1.0, state="")

    def __enter__(self) -> "Bar":
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def start(self, after: "Record | None", note: str) -> None:
        """Say what there is to say above the bar."""
        if note:
            self._progress.console.print(f"{self._title}: {note}", markup=False, highlight=False)

    def record(self, record: "Record", discretisation: ObservedDiscretisation) -> None:
        """Move the bar."""
        self._progress.update(self._task, completed=record.share, state=record.text())


class Lines(Listener):
    """One plain line every ``interval`` seconds at most, for logs."""

    def __init__(self, title: str, console: Console, interval: float = 5.0) -> None:
        self._title, self._console, self._interval = title, console, interval
        self._started = self._said_at = time.monotonic()

    def __enter__(self) -> "Lines":
        return self

    def __exit__(self, *_: object) -> None:
        self._say(f"ended after {time.monotonic() - self._started:.1f} s")

    def start(self, after: "Record | None", note: str) -> None:
        """Say that it has begun, and where."""
        self._say(note or "started")

    def record(self, record: "Record", discretisation: ObservedDiscretisation) -> None:
        """Say how far it is, now and then."""
        now = time.monotonic()
        if now - self._said_at < self._interval:
            return
        self._said_at = now
        left = ""
        if record.share > 0:
            left = f"  about {(now - self._started) * (1.0 / record.share - 1.0):.0f} s left"
        self._say(f"{100 * record.share:5.1f} %  {record.text()}{left}")

    def _say(self, text: str) -> None:
        self._console.print(f"{self._title}: {text}", markup=False, highlight=False, soft_wrap=True)


def progress_view(title: str, console: Console) -> Bar | Lines:
    """A bar when ``console`` is a terminal, lines otherwise."""
    return Bar(title, console) if console.is_terminal else Lines(title, console)
