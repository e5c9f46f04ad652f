"""Compiled loops of the phase field of points on a uniform grid, for splines of any order.

Arguments are named as in ``explicit_kernels``; ``number`` (n_cells,) tells which cells of the body's window take part and
how they are counted, -1 for the others. Strips of one colour share no cell, so that threads need no atomics.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from mpm.explicit.kernels import _basis, _second_derivatives


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


@njit(inline="always")
def _curvatures(order, x, y, over_h, operator, turn, wx, dx, bx, wy, dy, by, form, bend):
    """Second derivatives ``bend`` (n, 3) of a cell's functions whose squares add up to the quadratic form of gamma.

    operator : (3, 3) of the body before it turned. turn : of the material since then [radian]. form : (3, 3), where the
    operator in present axes is put.
    """
    k = order + 1
    xi, eta = x - int(x), y - int(y)
    _basis(k, xi, wx, dx)
    _basis(k, eta, wy, dy)
    _second_derivatives(k, xi, bx)
    _second_derivatives(k, eta, by)
    c, s = np.cos(turn), np.sin(turn)
    square = over_h * over_h
    for i in range(3):
        one, two, mixed = operator[i, 0] * square, operator[i, 1] * square, operator[i, 2] * square
        form[i, 0] = one * c * c + two * s * s - mixed * c * s
        form[i, 1] = one * s * s + two * c * c + mixed * c * s
        form[i, 2] = 2.0 * (one - two) * c * s + mixed * (c * c - s * s)
    for a in range(k):
        for b in range(k):
            xx, yy, xy = bx[a] * wy[b], wx[a] * by[b], dx[a] * dy[b]
            for i in range(3):
                bend[a * k + b, i] = form[i, 0] * xx + form[i, 1] * yy + form[i, 2] * xy


@njit(cache=True, parallel=True)
def add_curvature_terms(order, strips, x, y, volume, turn, operator, bending, over_h, width, number, local):
    """Add the fourth-order term of Eq. 5.37 to the matrices of ``cell_equations``; ``bending`` is 2 Gc l0³."""
    k = order + 1
    for colour in range(2):
        for half in prange((len(strips) - colour) // 2):
            strip = 2 * half + colour
            wx, dx, bx, wy, dy, by = np.empty(k), np.empty(k), np.empty(k), np.empty(k), np.empty(k), np.empty(k)
            form, bend = np.empty((3, 3)), np.empty((k * k, 3))
            for p in range(strips[strip], strips[strip + 1]):
                cell = number[int(x[p]) * width + int(y[p])]
                if cell < 0:
                    continue
                _curvatures(order, x[p], y[p], over_h, operator, turn[p], wx, dx, bx, wy, dy, by, form, bend)
                weight = bending * volume[p]
                entry = 0
                for a in range(k * k):
                    one, two, three = weight * bend[a, 0], weight * bend[a, 1], weight * bend[a, 2]
                    for b in range(a, k * k):
                        local[cell, entry] += one * bend[b, 0] + two * bend[b, 1] + three * bend[b, 2]
                        entry += 1


@njit(cache=True, parallel=True)
def add_curvature_energy(order, strips, x, y, turn, operator, factor, over_h, width, inside, nodal, density):
    """Add the fourth-order term of Eq. 5.3 to the densities of ``to_points``; ``factor`` is Gc l0³."""
    k = order + 1
    for strip in prange(len(strips) - 1):
        wx, dx, bx, wy, dy, by = np.empty(k), np.empty(k), np.empty(k), np.empty(k), np.empty(k), np.empty(k)
        form, bend = np.empty((3, 3)), np.empty((k * k, 3))
        for p in range(strips[strip], strips[strip + 1]):
            node = int(x[p]) * width + int(y[p])
            if not inside[node]:
                continue
            _curvatures(order, x[p], y[p], over_h, operator, turn[p], wx, dx, bx, wy, dy, by, form, bend)
            one = two = three = 0.0
            for a in range(k):
                for b in range(k):
                    c = nodal[node + a * width + b]
                    one += bend[a * k + b, 0] * c
                    two += bend[a * k + b, 1] * c
                    three += bend[a * k + b, 2] * c
            density[p] += factor * (one * one + two * two + three * three)


@njit(cache=True)
def mark_outside(order, x, y, width, number, held):
    """Mark the nodes of points whose cell takes no part."""
    for p in range(len(x)):
        cell = int(x[p]) * width + int(y[p])
        if number[cell] < 0:
            for a in range(order + 1):
                for b in range(order + 1):
                    held[cell + a * width + b] = True
