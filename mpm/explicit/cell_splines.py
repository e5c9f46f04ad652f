"""Compiled B-splines of a cell of a uniform grid; those over any knots are in ``mpm.splines``."""

from __future__ import annotations

import numpy as np
from numba import njit

#: liberties of the compiler that change results by round-off alone
ROUNDED = {"contract", "nsz", "arcp"}


@njit(fastmath=ROUNDED)
def linear(xi):
    return (1.0 - xi, xi, 0.0, 0.0), (-1.0, 1.0, 0.0, 0.0)


@njit(fastmath=ROUNDED)
def quadratic(xi):
    eta = 1.0 - xi
    return (0.5 * eta * eta, 0.5 + xi * eta, 0.5 * xi * xi, 0.0), (-eta, eta - xi, xi, 0.0)


@njit(fastmath=ROUNDED)
def cubic(xi):
    eta = 1.0 - xi
    one, two = (4.0 - 3.0 * xi * xi * (1.0 + eta)) / 6.0, (4.0 - 3.0 * eta * eta * (1.0 + xi)) / 6.0
    value = (eta * eta * eta / 6.0, one, two, xi * xi * xi / 6.0)
    inner = (0.5 * xi * (xi - 2.0 * eta - 2.0), -0.5 * eta * (eta - 2.0 * xi - 2.0))
    return value, (-0.5 * eta * eta, inner[0], inner[1], 0.5 * xi * xi)


@njit(fastmath=ROUNDED)
def splines(k, xi):
    """Values and slopes of the k = order + 1 splines of a cell at xi in [0, 1), tuples of four with zeros behind them."""
    if k == 3:
        return quadratic(xi)
    if k == 4:
        return cubic(xi)
    return linear(xi)


@njit(forceinline=True)
def basis(k, xi, value, slope):
    """Values and slopes (k,) of the k = order + 1 splines of a cell at xi in [0, 1), slopes for cells of size one."""
    values, slopes = splines(k, xi)
    for a in range(k):
        value[a], slope[a] = values[a], slopes[a]


@njit(forceinline=True)
def second_derivatives(k, xi, bend):
    """Second derivatives (k,) of the splines of ``basis``; none of linear ones is square integrable."""
    if k == 3:
        bend[0], bend[1], bend[2] = 1.0, -2.0, 1.0
    else:
        bend[0], bend[1], bend[2], bend[3] = 1.0 - xi, 3.0 * xi - 2.0, 1.0 - 3.0 * xi, xi


@njit(cache=True)
def spline_values(order, xi):
    """Values (order + 1,) of the splines of a cell at xi in [0, 1]."""
    value, slope = np.empty(order + 1), np.empty(order + 1)
    basis(order + 1, xi, value, slope)
    return value
