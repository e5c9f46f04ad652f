"""Compiled loops of the phase field of points on a uniform grid, for splines of any order.

Arguments are named as in ``explicit_kernels``; ``number`` (n_cells,) tells which cells of the body's window take part and
how they are counted, -1 for the others. Strips of one colour share no cell, so that threads need no atomics.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from .explicit_kernels import _basis


@njit(cache=True, parallel=True)
def cell_equations(
    order, strips, x, y, volume, history, drive, resistance, diffusion, over_h, width, number, local, right_side
):
    """Upper halves (m, n (n + 1) / 2) of Eq. 4.17 and its right sides (m, n), n = k² nodes a cell."""
    k = order + 1
    for colour in range(2):
        for half in prange((len(strips) - colour) // 2):
            strip = 2 * half + colour
            wx, dx, wy, dy = np.empty(k), np.empty(k), np.empty(k), np.empty(k)
            value, slope_x, slope_y = np.empty(k * k), np.empty(k * k), np.empty(k * k)
            for p in range(strips[strip], strips[strip + 1]):
                i, j = int(x[p]), int(y[p])
                cell = number[i * width + j]
                if cell < 0:
                    continue
                _basis(k, x[p] - i, wx, dx)
                _basis(k, y[p] - j, wy, dy)
                for a in range(k):
                    for b in range(k):
                        value[a * k + b] = wx[a] * wy[b]
                        slope_x[a * k + b], slope_y[a * k + b] = dx[a] * wy[b], wx[a] * dy[b]
                source = resistance * volume[p]
                mass = drive * history[p] * volume[p] + source
                stiffness = diffusion * volume[p] * over_h * over_h
                entry = 0
                for a in range(k * k):
                    n, gx, gy = mass * value[a], stiffness * slope_x[a], stiffness * slope_y[a]
                    right_side[cell, a] += source * value[a]
                    for b in range(a, k * k):
                        local[cell, entry] += n * value[b] + gx * slope_x[b] + gy * slope_y[b]
                        entry += 1

@njit(cache=True, parallel=True)
def to_points(
    order, strips, x, y, over_h, width, inside, nodal, history, toughness, length_scale, now, broken_below,
    c, density, solved_for, broken_at,
):  # fmt: skip
    """Phase field and surface energy density (Eq. 2.46) of the points in the marked cells."""
    k = order + 1
    for strip in prange(len(strips) - 1):
        wx, dx, wy, dy = np.empty(k), np.empty(k), np.empty(k), np.empty(k)
        for p in range(strips[strip], strips[strip + 1]):
            i, j = int(x[p]), int(y[p])
            if not inside[i * width + j]:
                continue
            _basis(k, x[p] - i, wx, dx)
            _basis(k, y[p] - j, wy, dy)
            value = cx = cy = 0.0
            for a in range(k):
                first = (i + a) * width + j
                for b in range(k):
                    value += wx[a] * wy[b] * nodal[first + b]
                    cx += dx[a] * wy[b] * nodal[first + b]
                    cy += wx[a] * dy[b] * nodal[first + b]
            c[p] = value
            squared = (cx * cx + cy * cy) * over_h * over_h
            density[p] = toughness * ((value - 1.0) ** 2 / (4.0 * length_scale) + length_scale * squared)
            solved_for[p] = history[p]
            if value < broken_below and not broken_at[p] <= now:
                broken_at[p] = now


@njit(cache=True, parallel=True)
def mark_changing(strips, x, y, history, solved_for, c, drive, resistance, tolerance, block, blocks_in_y, marked):
    """Mark the blocks of ``block`` x ``block`` cells that hold a point whose phase field would change by more."""
    for strip in prange(len(strips) - 1):
        for p in range(strips[strip], strips[strip + 1]):
            # the time step is short: most points have not met a larger energy
            rise = drive * abs(history[p] - solved_for[p])
            if rise * c[p] > tolerance * (drive * history[p] + resistance):
                marked[(int(x[p]) // block) * blocks_in_y + int(y[p]) // block] = True
