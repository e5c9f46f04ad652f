"""How long numba compiles, or loads what it has compiled before, so that a clock can leave it out."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import wraps
from typing import Any

from numba.core import event
from numba.core.caching import Cache


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


def compile_without_cache_where_it_fails() -> None:
    """Kernels that a full disk does not take, or whose kept files are cut, are compiled again and end no run."""
    for name in ("load_overload", "save_overload"):
        method = getattr(Cache, name)
        if not hasattr(method, "__wrapped__"):
            setattr(Cache, name, _none_where_it_fails(method))


def _none_where_it_fails(method: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(method)
    def tried(cache: Cache, signature: object, given: object) -> Any:
        try:
            return method(cache, signature, given)
        except Exception:  # in foreign bytes pickle and LLVM fail in a dozen ways
            with suppress(OSError):  # it would name a file that is cut or another kernel's; a full disk takes no new one
                os.unlink(cache._cache_file._index_path)  # type: ignore[attr-defined]
            return None

    return tried
