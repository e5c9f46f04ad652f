"""What a run costs: counters and seconds by part."""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass


class OutOfTimeError(Exception):
    """The time of a run is over in the middle of an increment."""


class Costs:
    """Counters and seconds of the parts of a run.

    Attributes
    ----------
    until : second of ``time.perf_counter`` after which no further iteration begins
    """

    def __init__(self) -> None:
        self.count: Counter[str] = Counter()
        self.seconds: dict[str, float] = {}
        self._parts: list[str] = []
        self._since = 0.0
        self.until = math.inf

    def begin_iteration(self) -> None:
        """Raises OutOfTimeError where none should begin."""
        if time.perf_counter() > self.until:
            raise OutOfTimeError

    def forget(self) -> None:
        """Forget the work so far, not the sizes."""
        self.seconds.clear()
        solving = ("factorisations", "cg_iterations", "gmres_iterations", "newton")
        for work in (*solving, "phase_field_solves", "window_cells"):
            self.count.pop(work, None)

    def timed(self, part: str) -> _Timed:
        """Add the wall time inside to ``seconds[part]``; of parts within parts, the innermost is charged."""
        return _Timed(self, part)

    def begin(self, part: str) -> None:
        """Charge a part from now on."""
        self._charge()
        self._parts.append(part)

    def end(self) -> None:
        """Charge the part around it again."""
        self._charge()
        self._parts.pop()

    def _charge(self) -> None:
        now = time.perf_counter()
        if self._parts:
            self.seconds[self._parts[-1]] = self.seconds.get(self._parts[-1], 0.0) + now - self._since
        self._since = now


@dataclass(slots=True)
class _Timed:
    """A part of the work, as a context: one made by ``contextlib`` would take as long as a small part itself."""

    costs: Costs
    part: str

    def __enter__(self) -> None:
        self.costs.begin(self.part)

    def __exit__(self, *_: object) -> None:
        self.costs.end()
