"""Roots of functions of one number, without a library: judging results needs no more."""

from collections.abc import Callable

_HALVINGS = 200


def root(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a continuous function changes sign between two places, by halving down to round-off."""
    sign = function(low) > 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        if (function(middle) > 0.0) == sign:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
