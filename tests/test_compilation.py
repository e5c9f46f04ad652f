"""Compilation is timed apart."""

import time

from numba import njit

from numerics.compilation import compilation


def test_compiling_is_counted_and_work_is_not() -> None:
    @njit
    def inner(x):
        return x + 1.0

    @njit
    def outer(x):
        return inner(x) * 2.0

    started = time.perf_counter()
    with compilation() as spent:
        outer(1.0)
    whole = time.perf_counter() - started
    assert 0.01 < spent.wall <= whole and spent.processor > 0.0
    before = spent.wall
    with compilation() as again:
        outer(2.0)
        time.sleep(0.01)
    assert again.wall == 0.0 and spent.wall == before
