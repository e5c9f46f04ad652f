"""What is said of a cell of a map."""

import math
from dataclasses import dataclass

STABLE, DRIFT, BLEW_UP = "stable", "energy drift", "blew up"
NO_CONVERGENCE, TIMEOUT, NOT_POSSIBLE = "no convergence", "timeout", "not possible"
NUMERICAL_FRACTURE = "numerical fracture"
#: of a block on an incline
HOLDS, SLIDES = "holds", "slides"


@dataclass(frozen=True)
class Verdict:
    """The verdict on a cell and what it rests on.

    value, error : of the judged metric, its distance from the target
    step, u : at which it failed, or the last ones
    newton, iterations : of Newton's method and of an iterative linear solver, 0 where there are none
    """

    verdict: str
    value: float = math.nan
    error: float = math.nan
    step: int = 0
    u: float = math.nan
    reason: str = ""
    seconds: float = math.nan
    newton: int = 0
    iterations: int = 0


def accuracy(error: float, limits: tuple[float, ...]) -> str:
    """The verdict on an error: within the smallest limit that it keeps, or beyond all."""
    kept = [limit for limit in limits if error <= limit]
    return f"within {100 * min(kept):g} %" if kept else f"beyond {100 * max(limits):g} %"
