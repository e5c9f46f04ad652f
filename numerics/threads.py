"""One place that sets how many threads compiled loops and linear algebra use."""

from __future__ import annotations

import os

import numba
from threadpoolctl import ThreadpoolController, threadpool_limits

_limiters: list[object] = []


def use_threads(count: int) -> None:
    """Use ``count`` threads in numba's loops, one in numpy's products and in PARDISO (which sees to that itself).

    Both would sum by threads, whose number would be seen in the last digits.
    """
    os.environ["MKL_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = str(count)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))  # type: ignore[attr-defined]
    of_numpy = ThreadpoolController().select(internal_api="openblas")
    _limiters[:] = [threadpool_limits(limits=count), of_numpy.limit(limits=1)]
