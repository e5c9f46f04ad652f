"""Compilation is timed apart."""

import time

import numpy as np
from numba import njit

from mpm.explicit.stresses import elastic_stress
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


def test_the_elastic_stress_takes_no_liberties_whichever_loop_compiles_it_first() -> None:
    @njit(fastmath={"contract"})
    def free(strain):
        return elastic_stress(strain, strain, strain, strain, strain)

    free(np.float32(1.0))  # numbers that no other loop has compiled it for
    compiled = elastic_stress.inspect_llvm().items()
    found = [text for types, text in compiled if str(types[0]) == "float32"]
    assert found and not any(" contract " in text for text in found)
