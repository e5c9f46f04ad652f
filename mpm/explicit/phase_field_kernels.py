"""Compiled loops of the phase field of points on a uniform grid, for splines of any order.

Strips of one colour share no cell, so that threads need no atomics. ``strips`` and the groups of a body's ``Points`` are
those of ``mpm.explicit.transfers``; ``over_h`` is one over the spacing.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mpm.explicit.cell_splines import ROUNDED, basis, second_derivatives
from numerics.lanes import LANES, load, store
from physics.phase_field import breaks_now, crack_density, expected_change


class PhaseFieldLaw(NamedTuple):
    """Coefficients of a body's phase field (`PhaseFieldCoefficients`); ``operator`` (3, 3) takes second derivatives in
    its axes before it turned to ones whose squares add up to the quadratic form of gamma."""

    drive: float
    resistance: float
    diffusion: float
    bending: float
    toughness: float
    length_scale: float
    operator: NDArray


class CellEquations(NamedTuple):
    """Upper halves (m, n (n + 1) / 2) of Eq. 4.17 and its right sides (m, n), n = (order + 1)² nodes a cell.

    ``number`` (n_cells,) tells which cells of the window take part and how they are counted, -1 for the others; ``width``
    is that of the window in nodes.
    """

    width: int
    number: NDArray
    local: NDArray
    right_side: NDArray


class NodalPhaseField(NamedTuple):
    """Phase field (n_nodes,) of a window of ``width`` nodes in y; ``inside`` (n_cells,) are cells where it was found."""

    width: int
    inside: NDArray
    values: NDArray


@njit
def _pairs(k):
    """Numbers (k, k) of the unordered pairs of the functions of one direction."""
    pair, count = np.empty((k, k), np.int64), 0
    for a in range(k):
        for b in range(a, k):
            pair[a, b] = pair[b, a] = count
            count += 1
    return pair


@njit
def _places(k, row):
    """Where the entries of a cell's upper half stand among the products of pairs, with so many numbers in a ``row``."""
    pair, places, entry = _pairs(k), np.empty(k * k * (k * k + 1) // 2, np.int64), 0
    for a in range(k * k):
        for b in range(a, k * k):
            places[entry] = pair[a // k, b // k] * row + pair[a % k, b % k]
            entry += 1
    return places


@njit
def _cell_of(p, end, x, y, width, number):
    """Number of a point's cell, -1 where it takes no part or the points are at their end."""
    return int(number[int(x[p]) * width + int(y[p])]) if p < end else -1


def _add_points(k):
    @njit(cache=True, parallel=True, fastmath=ROUNDED)
    def add_points(strips, motion, matter, history, law, over_h, equations):
        """Sum up the equations over points without the fourth-order term; ``history`` (n,) is their history field.

        An entry is a sum of products of a pair of functions in x and one in y, and there are few pairs: points of one
        cell that follow one another are summed up over the products of pairs first.
        """
        x, y, volume = motion.x, motion.y, matter.volume
        drive, resistance, diffusion = law.drive, law.resistance, law.diffusion
        width, number, local, right_side = equations
        n_pairs = k * (k + 1) // 2
        row = (n_pairs + LANES - 1) // LANES * LANES
        for colour in range(2):
            for half in prange((len(strips) - colour) // 2):
                strip = 2 * half + colour
                wx, dx, wy, dy = np.empty(k), np.empty(k), np.empty(k), np.empty(k)
                across, steep, along, flat = np.empty(n_pairs), np.empty(n_pairs), np.zeros(row), np.zeros(row)
                sums, places, last = np.zeros(n_pairs * row), _places(k, row), -1
                for p in range(strips[strip], strips[strip + 1] + 1):
                    cell = _cell_of(p, strips[strip + 1], x, y, width, number)
                    if cell != last:
                        if last >= 0:
                            for entry in range(len(places)):
                                local[last, entry] += sums[places[entry]]
                        sums[:] = 0.0
                        last = cell
                    if cell < 0:
                        continue
                    basis(k, x[p] - int(x[p]), wx, dx)
                    basis(k, y[p] - int(y[p]), wy, dy)
                    source = resistance * volume[p]
                    mass = drive * history[p] * volume[p] + source
                    stiffness = diffusion * volume[p] * over_h * over_h
                    pair = 0
                    for a in range(k):
                        for b in range(a, k):
                            across[pair], steep[pair] = wx[a] * wx[b], dx[a] * dx[b]
                            flat[pair] = stiffness * wy[a] * wy[b]
                            along[pair] = mass * wy[a] * wy[b] + stiffness * dy[a] * dy[b]
                            pair += 1
                    for pair in range(n_pairs):
                        for first in range(0, row, LANES):
                            place = pair * row + first
                            total = load(sums, place, LANES) + across[pair] * load(along, first, LANES)
                            store(sums, place, LANES, total + steep[pair] * load(flat, first, LANES))
                    for a in range(k):
                        for b in range(k):
                            right_side[cell, a * k + b] += source * wx[a] * wy[b]

    return add_points


def _to_points(k):
    @njit(cache=True, parallel=True)
    def to_points(strips, motion, history, law, over_h, nodal, now, crack):
        """Phase field, energy of cracks (Eq. 2.46) and time of breaking of the points in the cells inside."""
        x, y = motion.x, motion.y
        c, energy, solved_for, broken_at = crack.c, crack.energy, crack.solved_for, crack.broken_at
        toughness, length_scale = law.toughness, law.length_scale
        width, inside, values = nodal
        for strip in prange(len(strips) - 1):
            wx, dx, wy, dy = np.empty(k), np.empty(k), np.empty(k), np.empty(k)
            for p in range(strips[strip], strips[strip + 1]):
                i, j = int(x[p]), int(y[p])
                if not inside[i * width + j]:
                    continue
                basis(k, x[p] - i, wx, dx)
                basis(k, y[p] - j, wy, dy)
                value = cx = cy = 0.0
                for a in range(k):
                    first = (i + a) * width + j
                    for b in range(k):
                        value += wx[a] * wy[b] * values[first + b]
                        cx += dx[a] * wy[b] * values[first + b]
                        cy += wx[a] * dy[b] * values[first + b]
                c[p] = value
                squared = (cx * cx + cy * cy) * over_h * over_h
                energy[p] = toughness * crack_density(value, squared, length_scale)
                solved_for[p] = history[p]
                if breaks_now(value, broken_at[p]):
                    broken_at[p] = now

    return to_points


@cache
def loops(order: int) -> SimpleNamespace:
    """Compiled loops between points and cells for splines of an order, by their names: known when they are compiled, the
    number of functions makes them faster."""
    return SimpleNamespace(add_points=_add_points(order + 1), to_points=_to_points(order + 1))


@njit(cache=True, parallel=True)
def mark_changing(strips, motion, crack, history, law, tolerance, block, marked):
    """Mark the blocks (n_x, n_y) of ``block`` x ``block`` cells that hold a point whose phase field would change by more
    than the tolerance."""
    x, y, c, solved_for, drive, resistance = motion.x, motion.y, crack.c, crack.solved_for, law.drive, law.resistance
    for strip in prange(len(strips) - 1):
        for p in range(strips[strip], strips[strip + 1]):
            if expected_change(c[p], history[p], solved_for[p], drive, resistance) > tolerance:
                marked[int(x[p]) // block, int(y[p]) // block] = True


@njit(forceinline=True)
def _curvatures(order, x, y, over_h, operator, turn, splines, form, bend):
    """Second derivatives ``bend`` (k², 3) of a cell's functions whose squares add up to the quadratic form of gamma.

    ``turn`` is that of the material since the operator was its own [radian]. Room is needed for the ``splines`` (6, k),
    their values, slopes and second derivatives in both directions, and for ``form`` (3, 3), the operator in present axes.
    """
    wx, dx, bx, wy, dy, by = splines[0], splines[1], splines[2], splines[3], splines[4], splines[5]
    k = order + 1
    xi, eta = x - int(x), y - int(y)
    basis(k, xi, wx, dx)
    basis(k, eta, wy, dy)
    second_derivatives(k, xi, bx)
    second_derivatives(k, eta, by)
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
def add_curvature_terms(order, strips, motion, matter, axes, law, over_h, equations):
    """Add the fourth-order term of Eq. 5.37 to the equations."""
    x, y, volume, turn, operator, bending = motion.x, motion.y, matter.volume, axes.turn, law.operator, law.bending
    width, number, local = equations.width, equations.number, equations.local
    k = order + 1
    for colour in range(2):
        for half in prange((len(strips) - colour) // 2):
            strip = 2 * half + colour
            splines, form, bend = np.empty((6, k)), np.empty((3, 3)), np.empty((k * k, 3))
            for p in range(strips[strip], strips[strip + 1]):
                cell = number[int(x[p]) * width + int(y[p])]
                if cell < 0:
                    continue
                _curvatures(order, x[p], y[p], over_h, operator, turn[p], splines, form, bend)
                weight = bending * volume[p]
                entry = 0
                for a in range(k * k):
                    one, two, three = weight * bend[a, 0], weight * bend[a, 1], weight * bend[a, 2]
                    for b in range(a, k * k):
                        local[cell, entry] += one * bend[b, 0] + two * bend[b, 1] + three * bend[b, 2]
                        entry += 1


@njit(cache=True, parallel=True)
def add_curvature_energy(order, strips, motion, axes, law, over_h, nodal, energy):
    """Add the fourth-order term of Eq. 5.3 to the points' energy of cracks."""
    x, y, turn, operator, factor = motion.x, motion.y, axes.turn, law.operator, 0.5 * law.bending
    width, inside, values = nodal
    k = order + 1
    for strip in prange(len(strips) - 1):
        splines, form, bend = np.empty((6, k)), np.empty((3, 3)), np.empty((k * k, 3))
        for p in range(strips[strip], strips[strip + 1]):
            node = int(x[p]) * width + int(y[p])
            if not inside[node]:
                continue
            _curvatures(order, x[p], y[p], over_h, operator, turn[p], splines, form, bend)
            one = two = three = 0.0
            for a in range(k):
                for b in range(k):
                    c = values[node + a * width + b]
                    one += bend[a * k + b, 0] * c
                    two += bend[a * k + b, 1] * c
                    three += bend[a * k + b, 2] * c
            energy[p] += factor * (one * one + two * two + three * three)


@njit(cache=True)
def mark_outside(order, motion, width, number, held):
    """Mark the nodes of points whose cell takes no part."""
    x, y = motion.x, motion.y
    for p in range(len(x)):
        cell = int(x[p]) * width + int(y[p])
        if number[cell] < 0:
            for a in range(order + 1):
                for b in range(order + 1):
                    held[cell + a * width + b] = True


@njit(cache=True)
def cells_around(marked, rings, block, shape, order):
    """Cells (m,) in the blocks within so many ``rings`` of a marked one, as numbers of their first nodes.

    ``shape`` (2,) is that of the window in nodes.
    """
    chosen = np.zeros(marked.shape, np.bool_)
    for a in range(marked.shape[0]):
        for b in range(marked.shape[1]):
            if marked[a, b]:
                chosen[max(0, a - rings) : a + rings + 1, max(0, b - rings) : b + rings + 1] = True
    n_x, n_y = shape[0] - order, shape[1] - order
    cells, count = np.empty(n_x * n_y, np.int64), 0
    for i in range(n_x):
        for b in range(marked.shape[1]):
            if chosen[i // block, b]:
                for j in range(b * block, min(n_y, (b + 1) * block)):
                    cells[count] = i * shape[1] + j
                    count += 1
    return cells[:count].copy()


class Rows(NamedTuple):
    """Which ``nodes`` (n,) are solved for; the row of their ``neighbours`` (n, (2 order + 1)²), and those of the nodes
    ``of_cells`` (m, (order + 1)²); n stands for nodes that are not."""

    nodes: NDArray
    neighbours: NDArray
    of_cells: NDArray


@njit(cache=True)
def number_rows(cells, order, width, held):
    """Number the nodes of cells that are not held (n_nodes,) in the order of the window."""
    k, reach = order + 1, 2 * order + 1
    rows = np.full(len(held), -1, np.int32)
    for cell in cells:
        for a in range(k):
            for b in range(k):
                rows[cell + a * width + b] = 0
    n = 0
    for node in range(len(held)):
        if rows[node] == 0 and not held[node]:
            n += 1
    nodes, row = np.empty(n, np.int64), 0
    for node in range(len(held)):
        if rows[node] == 0 and not held[node]:
            nodes[row], rows[node] = node, row
            row += 1
        else:
            rows[node] = n
    neighbours, of_cells = np.full((n, reach * reach), n, np.int32), np.empty((len(cells), k * k), np.uint32)
    for row in range(n):
        for a in range(reach):
            for b in range(reach):
                near = nodes[row] + (a - order) * width + b - order
                if 0 <= near < len(rows):
                    neighbours[row, a * reach + b] = rows[near]
    for c in range(len(cells)):
        for a in range(k):
            for b in range(k):
                of_cells[c, a * k + b] = rows[cells[c] + a * width + b]
    return Rows(nodes, neighbours, of_cells)


@njit(cache=True)
def left_over(nodes, order, width, values, nodal, sources):
    """Residual (n,) of rows at the nodal values that there are."""
    reach = 2 * order + 1
    residual = sources[: len(nodes)].copy()
    for row in range(len(nodes)):
        for a in range(reach):
            for b in range(reach):
                near = nodes[row] + (a - order) * width + b - order
                if 0 <= near < len(nodal):
                    residual[row] -= values[row, a * reach + b] * nodal[near]
    return residual
