"""One place that sets how many threads compiled loops and linear algebra use."""

from __future__ import annotations

import os

import numba
from threadpoolctl import threadpool_limits

_limiter: threadpool_limits | None = None


def use_threads(count: int) -> None:
    """Use ``count`` threads in numba's loops and in the linear algebra of this process."""
    global _limiter
    os.environ["MKL_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = str(count)
    numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))  # type: ignore[attr-defined]
    _limiter = threadpool_limits(limits=count)
