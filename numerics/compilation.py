"""How long numba compiles, or loads what it has compiled before, so that a clock can leave it out."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from numba.core import event


@dataclass
class Compilation:
    """Seconds of the wall's clock and of the processor spent on compiling and loading."""

    wall: float = 0.0
    processor: float = 0.0


class _Listener(event.Listener):
    """Functions that are compiled for another one are counted with it."""

    def __init__(self, spent: Compilation) -> None:
        self._spent, self._depth = spent, 0

    def on_start(self, _: event.Event) -> None:
        """One more function has begun to be compiled or loaded."""
        if self._depth == 0:
            self._wall, self._processor = time.perf_counter(), time.process_time()
        self._depth += 1

    def on_end(self, _: event.Event) -> None:
        """It is there."""
        self._depth -= 1
        if self._depth == 0:
            self._spent.wall += time.perf_counter() - self._wall
            self._spent.processor += time.process_time() - self._processor


@contextmanager
def compilation() -> Iterator[Compilation]:
    """What is spent inside the context on compiling and on loading compiled code, for which numba holds this lock."""
    spent = Compilation()
    with event.install_listener("numba:compiler_lock", _Listener(spent)):
        yield spent
