"""What a run costs: counters and seconds by part."""

from __future__ import annotations

import time
from collections import Counter


class Costs:
    """Counters and seconds of the parts of a run."""

    def __init__(self) -> None:
        self.count: Counter[str] = Counter()
        self.seconds: Counter[str] = Counter()

    def forget(self) -> None:
        """Forget the work so far, not the sizes."""
        self.seconds.clear()
        for work in ("factorisations", "cg_iterations", "gmres_iterations", "newton"):
            self.count.pop(work, None)

    def timed(self, part: str) -> _Timer:
        """Context that adds its wall time to ``seconds[part]``."""
        return _Timer(self.seconds, part)


class _Timer:
    def __init__(self, seconds: Counter[str], part: str) -> None:
        self._seconds, self._part = seconds, part

    def __enter__(self) -> None:
        self._start = time.perf_counter()

    def __exit__(self, *_exception: object) -> None:
        self._seconds[self._part] += time.perf_counter() - self._start  # type: ignore[assignment]
