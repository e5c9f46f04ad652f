"""B-splines on rectilinear grids with arbitrary knots (thesis 3.9.9)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


class Axis:
    """B-spline basis of one direction over sorted breakpoints, with open ends.

    Parameters
    ----------
    breakpoints : (n_cells + 1,) cell boundaries, increasing.
    order : polynomial order 1, 2 or 3.
    multiplicity : knots that repeat, as {index of breakpoint: times}; ``order`` makes the basis C0 there,
        ``order + 1`` breaks it.
    """

    def __init__(self, breakpoints: NDArray, order: int, multiplicity: dict[int, int] | None = None) -> None:
        self.breakpoints, self.order = np.asarray(breakpoints, float), order
        times = np.ones(len(breakpoints), dtype=int)
        for index, repeat in (multiplicity or {}).items():
            times[index] = max(times[index], repeat)
        times[0] = times[-1] = order + 1
        self.knots = np.repeat(self.breakpoints, times)
        self.n_functions = len(self.knots) - order - 1
        #: (n_cells,) last knot at or before each cell; the first function of the cell is this minus the order
        self.spans = np.cumsum(times)[:-1] - 1

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.breakpoints) - 1

    def locate(self, positions: NDArray) -> NDArray:
        """Cell (n,) of each position; -1 or n_cells outside."""
        return np.searchsorted(self.breakpoints, positions, side="right") - 1

    def evaluate(self, positions: NDArray, cells: NDArray) -> tuple[NDArray, NDArray]:
        """Values and slopes (n, order + 1) of the functions of a cell; beyond the cell they go on as polynomials."""
        shape = (len(positions), self.order + 1)
        values, slopes = np.empty(shape), np.empty(shape)
        _evaluate(self.knots, self.order, self.spans[cells], positions, values, slopes)
        return values, slopes

    def second_derivatives(self, positions: NDArray, cells: NDArray) -> NDArray:
        """Second derivatives (n, order + 1) of the functions of a cell, Eq. 3.67 applied twice; zero for order 1."""
        if self.order == 1:
            return np.zeros((len(positions), 2))
        spans, degree = self.spans[cells], self.order - 2
        lower = np.empty((len(positions), degree + 1))
        _evaluate(self.knots, degree, spans, positions, lower, np.empty_like(lower))
        return self._derivatives(self._derivatives(lower, spans), spans)

    def _derivatives(self, lower: NDArray, spans: NDArray) -> NDArray:
        """Derivatives (n, d + 1) of functions of degree d from functions of degree d - 1, or their derivatives (n, d)."""
        degree = lower.shape[1]
        first = (spans - degree)[:, None] + np.arange(1, degree + 1)
        parts = degree * lower / (self.knots[first + degree] - self.knots[first])
        return np.pad(parts, ((0, 0), (1, 0))) - np.pad(parts, ((0, 0), (0, 1)))

    def greville(self) -> NDArray:
        """Greville abscissae (n_functions,): where each control value belongs."""
        windows = np.lib.stride_tricks.sliding_window_view(self.knots[1:-1], self.order)
        return windows.mean(axis=1)

    def support(self) -> tuple[NDArray, NDArray]:
        """Left and right end (n_functions,) of each function's support."""
        return self.knots[: self.n_functions], self.knots[self.order + 1 :]


@njit(cache=True)
def _evaluate(knots, order, spans, positions, values, slopes):
    """Cox - de Boor recursion (Eq. 3.65) over the functions that live on a span, and Eq. 3.67."""
    left, right, lower = np.empty(order + 1), np.empty(order + 1), np.empty(order + 1)
    for p in range(len(positions)):
        span, x = spans[p], positions[p]
        lower[0] = 1.0
        values[p, 0] = 1.0
        for degree in range(1, order + 1):
            left[degree] = x - knots[span + 1 - degree]
            right[degree] = knots[span + degree] - x
            for r in range(degree):
                lower[r] = values[p, r]
            carried = 0.0
            for r in range(degree):
                part = lower[r] / (right[r + 1] + left[degree - r])
                values[p, r] = carried + right[r + 1] * part
                carried = left[degree - r] * part
            values[p, degree] = carried
        # ``lower`` now holds the functions of one order less
        for r in range(order + 1):
            first = span - order + r
            slope = 0.0
            if r > 0:
                slope += lower[r - 1] / (knots[first + order] - knots[first])
            if r < order:
                slope -= lower[r] / (knots[first + order + 1] - knots[first + 1])
            slopes[p, r] = order * slope
