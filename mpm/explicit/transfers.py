"""Compiled loops between the points of a body and the nodes of its window, one set for each order of the splines.

Points are sorted by columns of cells, and columns are grouped in strips. Points of one strip write to the nodes of their
strip and of the margins of its neighbours; strips of one colour (every second one) share no node, so that threads need
no atomics and sums are the same for any number of threads.

The loops take their arrays out of the groups first, so that compiled code holds no more of these than it uses.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from mpm.explicit.cell_splines import ROUNDED, basis, splines
from mpm.explicit.stencil_sums import ROWS, add_fields, add_products, sum_fields
from mpm.explicit.tiles import follow, give, weigh
from numerics.lanes import LANES, TILE, apart, borrowed, same

#: cells that a point may wander from where it was sorted, in each direction
DRIFT = 1
#: points tell how far a body reaches at a node when the normal there passes within this part of their size: more would
#: make flats of round bodies' lowest points, half is the least that leaves no hole between points
LATERAL = 0.75
#: in cells and their squares, more than the round-off of places
SLACK = 1e-9
#: columns of cells in a strip: two strips of one colour must stay apart for cubic splines and drifting points
STRIP = 6


class PointUpdate(NamedTuple):
    """How points follow the nodes in a step.

    Attributes
    ----------
    factor : the step over the spacing. flip : share of FLIP in the velocities. corotational : strains turn.
    affine : one over the spacing where velocity gradients are kept, else 0 [1/length].
    velocities, strains, stresses : whether velocities are updated, strains with places, and stresses where the body
        cannot break.
    lam, mu : in-plane Lamé constants [stress].
    lag_x, lag_y : by which all places move more slowly than the nodes [length/time].
    """

    factor: float
    flip: float
    corotational: bool
    affine: float
    velocities: bool
    strains: bool
    stresses: bool
    lam: float
    mu: float
    lag_x: float
    lag_y: float


def _to_grid(k):
    @njit(cache=True, parallel=True, fastmath=ROUNDED)
    def to_grid(strips, motion, matter, gradient, elastic, h, affine, width, sums):
        """Masses (Eq. 3.58), momenta (6.24) and minus internal forces (6.25) of the nodes.

        affine : 1 where momenta count the points' velocity gradients about them, else 0.
        """
        m, fields = sums
        over_h, arm = 1.0 / h, affine * h
        for row in prange(len(m) // width):
            m[row * width : (row + 1) * width] = 0.0
            fields[4 * row * width : 4 * (row + 1) * width] = 0.0
        for colour in range(2):
            for half in prange((len(strips) - colour) // 2):
                strip = 2 * half + colour
                weights, gifts, firsts = np.empty((ROWS, TILE)), np.empty((16, TILE)), np.empty(TILE, np.int64)
                for start in range(strips[strip], strips[strip + 1], TILE):
                    number = min(strips[strip + 1] - start, TILE)
                    points = borrowed(motion), borrowed(matter), borrowed(gradient), borrowed(elastic)
                    rows, own, nodes = borrowed(weights), borrowed(gifts), borrowed(firsts)
                    for q in range(0, number, LANES):
                        if number - q >= LANES:
                            give(k, start + q, LANES, q, over_h, arm, points, width, rows, nodes, own)
                        else:
                            give(k, start + q, number - q, q, over_h, arm, points, width, rows, nodes, own)
                    for q in range(number):
                        add_fields(k, m, fields, firsts[q], width, weights, gifts, q)

    return to_grid


def _masses(k):
    @njit(cache=True, parallel=True, fastmath=ROUNDED)
    def masses(strips, motion, matter, width, m):
        """Masses of the nodes alone (Eq. 3.58)."""
        x, y, mass = motion.x, motion.y, matter.mass
        for row in prange(len(m) // width):
            m[row * width : (row + 1) * width] = 0.0
        for colour in range(2):
            for half in prange((len(strips) - colour) // 2):
                strip = 2 * half + colour
                for p in range(np.uintp(strips[strip]), np.uintp(strips[strip + 1])):
                    i, j = int(x[p]), int(y[p])
                    (wx, _), (wy, _) = splines(k, x[p] - i), splines(k, y[p] - j)
                    add_products(k, m, i * width + j, width, ((mass[p], wx, wy),))

    return masses


def _to_points(k):
    @njit(cache=True, parallel=True, fastmath=ROUNDED, error_model="numpy")
    def to_points(strips, velocities, width, update, motion, gradient, elastic, fastest):
        """Velocities of the points (Eq. 6.43) and how far they move in a unit of time (Eq. 6.45); strains and places;
        stresses where the body cannot break.

        ``fastest`` (n_strips,) takes the largest square of the velocity that carries a point of each strip.
        """
        old_x, old_y, new_x, new_y, _, _, packed = velocities
        for row in prange(len(new_x) // width):
            for node in range(row * width, (row + 1) * width):
                packed[4 * node], packed[4 * node + 1] = new_x[node], new_y[node]
                packed[4 * node + 2], packed[4 * node + 3] = new_x[node] - old_x[node], new_y[node] - old_y[node]
        for strip in prange(len(strips) - 1):
            weights, firsts, sums = np.empty((ROWS, TILE)), np.empty(TILE, np.int64), np.empty((8, TILE))
            largest = same(0.0)
            for start in range(strips[strip], strips[strip + 1], TILE):
                number = min(strips[strip + 1] - start, TILE)
                points = borrowed(motion), borrowed(gradient), borrowed(elastic)
                rows, nodes, found = borrowed(weights), borrowed(firsts), borrowed(sums)
                for q in range(0, number, LANES):
                    if number - q >= LANES:
                        weigh(k, start + q, LANES, q, points[0].x, points[0].y, width, rows, nodes)
                    else:
                        weigh(k, start + q, number - q, q, points[0].x, points[0].y, width, rows, nodes)
                for q in range(number):
                    sum_fields(k, packed, firsts[q], width, weights, sums, q)
                for q in range(0, number, LANES):
                    if number - q >= LANES:
                        largest = follow(start + q, LANES, q, update, points, found, largest)
                    else:
                        largest = follow(start + q, number - q, q, update, points, found, largest)
            fastest[strip] = max(apart(largest))

    return to_points


def _mass_slopes(k):
    @njit(cache=True)
    def mass_slopes(nodes, starts, motion, matter, width, surface):
        """Gradients of the mass (Eq. 6.33) at nodes (n,), times the spacing; keeps which points are near them."""
        x, y, mass = motion.x, motion.y, matter.mass
        slope_x, slope_y, low, high = surface.slope_x, surface.slope_y, surface.low, surface.high
        find_near(nodes, k - 1, width, low, high)
        slope_x[:], slope_y[:], surface.reach[:] = 0.0, 0.0, np.inf
        for column in range(len(low)):
            for p in near(starts, column * width, low[column], high[column]):
                i, j = int(x[p]), int(y[p])
                (wx, dx), (wy, dy) = splines(k, x[p] - i), splines(k, y[p] - j)
                add_products(k, slope_x, i * width + j, width, ((mass[p], dx, wy),))
                add_products(k, slope_y, i * width + j, width, ((mass[p], wx, dy),))

    return mass_slopes


@njit(cache=True)
def find_near(nodes, order, width, low, high):
    """Rows from ``low`` (n_columns,) up to before ``high`` of the cells in which points of nodes (n,) were sorted."""
    low[:], high[:] = width, 0
    for node in nodes:
        i, j = node // width, node % width
        for column in range(max(0, i - order - DRIFT), min(len(low) - 1, i + DRIFT) + 1):
            low[column] = min(low[column], max(0, j - order - DRIFT))
            high[column] = max(high[column], min(width - 1, j + DRIFT) + 1)


@njit(forceinline=True)
def near(starts, first, low, high):
    """Numbers of the points that were sorted into a part of a column of cells whose first cell is ``first``."""
    return range(starts[first + low], starts[first + high]) if low < high else range(0, 0)


def _reaches(k):
    @njit(cache=True)
    def reaches(starts, motion, matter, width, has_edges, surface):
        """Largest place along the nodes' normals to which the points near them reach, from the nodes, in cells.

        It is infinite, and not sought, where a node has no normal. A body that ``has_edges`` tells its farthest point
        within a cell as well, and how far beside the node it ends.
        """
        x, y, size_x, size_y = motion.x, motion.y, matter.size_x, matter.size_y
        normal_x, normal_y, reach = surface.normal_x, surface.normal_y, surface.reach
        for column in range(len(surface.low)):
            for p in near(starts, column * width, surface.low[column], surface.high[column]):
                i, j = int(x[p]), int(y[p])
                for a in range(k):
                    for b in range(k):
                        node = (i + a) * width + j + b
                        if reach[node] == np.inf:
                            continue
                        nx, ny = normal_x[node], normal_y[node]
                        # a node stands (order - 1) / 2 cells before the cell's corner of the same number
                        off_x, off_y = x[p] - (i + a) + 0.5 * (k - 2), y[p] - (j + b) + 0.5 * (k - 2)
                        along, aside = off_x * nx + off_y * ny, off_y * nx - off_x * ny
                        # most points can be told without a root
                        most = along + 0.5 * (abs(size_x[p] * nx) + abs(size_y[p] * ny)) + SLACK
                        if most <= reach[node] and (not has_edges or most <= surface.farthest[node]):
                            continue
                        square = (size_x[p] * ny) ** 2 + (size_y[p] * nx) ** 2
                        if not has_edges and aside * aside > LATERAL * LATERAL * square + SLACK:
                            continue
                        size = np.sqrt(square)
                        is_near = abs(aside) <= LATERAL * size
                        if not is_near and not has_edges:
                            continue
                        along += 0.5 * np.sqrt((size_x[p] * nx) ** 2 + (size_y[p] * ny) ** 2)
                        if is_near:
                            reach[node] = max(reach[node], along)
                        if has_edges and abs(aside) <= 1.0 and along > surface.farthest[node]:
                            surface.farthest[node] = along
                            surface.aside[node] = np.sign(aside) * max(0.0, abs(aside) - 0.5 * size)

    return reaches


def _spread(k):
    @njit(cache=True)
    def spread(x, y, force_x, force_y, width, forces):
        """Add forces at places to those of the nodes (``NodeTractions``)."""
        wx, dx, wy, dy = np.empty(k), np.empty(k), np.empty(k), np.empty(k)
        for p in range(len(x)):
            i, j = int(x[p]), int(y[p])
            basis(k, x[p] - i, wx, dx)
            basis(k, y[p] - j, wy, dy)
            for a in range(k):
                for b in range(k):
                    forces.x[(i + a) * width + j + b] += wx[a] * wy[b] * force_x[p]
                    forces.y[(i + a) * width + j + b] += wx[a] * wy[b] * force_y[p]

    return spread


#: what makes each loop for k = order + 1 functions in each direction; k is the closures' only variable, so that compiled
#: code can be kept on disk
_MAKERS = (
    _to_grid,
    _masses,
    _to_points,
    _mass_slopes,
    _reaches,
    _spread,
)


@cache
def transfers(order: int) -> SimpleNamespace:
    """Compiled loops for splines of an order, by their names.

    Common arguments: ``strips`` (n_strips + 1,) first point of each strip; groups of a body's ``Points`` and of the nodes
    of its ``GridWindow``; ``width`` nodes of the window in y.
    """
    return SimpleNamespace(**{make.__name__.removeprefix("_"): make(order + 1) for make in _MAKERS})


@njit(cache=True, parallel=True)
def trial_velocities(width, step, gravity_x, gravity_y, damping, sums, velocities):
    """Velocities of the nodes before the step, from their momenta, and without contact after it (Eqs. 6.26, 6.27)."""
    m, fields = sums
    old_x, old_y, vx, vy = velocities.old_x, velocities.old_y, velocities.vx, velocities.vy
    for row in prange(len(m) // width):
        for node in range(row * width, (row + 1) * width):
            if m[node] > 0.0:
                over = 1.0 / m[node]
                old_x[node], old_y[node] = fields[4 * node] * over, fields[4 * node + 1] * over
                vx[node] = old_x[node] + step * (fields[4 * node + 2] * over + gravity_x - damping * old_x[node])
                vy[node] = old_y[node] + step * (fields[4 * node + 3] * over + gravity_y - damping * old_y[node])
            else:
                old_x[node] = old_y[node] = vx[node] = vy[node] = 0.0


@njit(forceinline=True)
def before_step(last, old):
    """Velocity with which a node has gone before the step; that which it starts with, where it was not there."""
    return old if np.isnan(last) else last


@njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def work_on_nodes(m, velocities):
    """Work of all forces on the nodes in the step, on the mean of the velocities that the steps before and now leave to
    them [energy]; keeps the latter for the next step.

    Strains and places follow these velocities, so that the work of the stresses in it is what elastic energy loses.
    """
    old_x, old_y, vx, vy = velocities.old_x, velocities.old_y, velocities.vx, velocities.vy
    last_x, last_y = velocities.last_x, velocities.last_y
    work = 0.0
    for node in range(len(m)):
        x, y = before_step(last_x[node], old_x[node]), before_step(last_y[node], old_y[node])
        work += m[node] * ((vx[node] - old_x[node]) * (vx[node] + x) + (vy[node] - old_y[node]) * (vy[node] + y))
        last_x[node] = vx[node] if m[node] > 0.0 else np.nan
        last_y[node] = vy[node] if m[node] > 0.0 else np.nan
    return 0.5 * work


@njit(cache=True)
def carried(m, velocities):
    """Sums over the nodes of mass, mass times velocity x, y before the step and after it, and times both velocities."""
    old_x, old_y, vx, vy = velocities.old_x, velocities.old_y, velocities.vx, velocities.vy
    mass = before_x = before_y = x = y = damped = 0.0
    for node in range(len(m)):
        mass += m[node]
        before_x += m[node] * old_x[node]
        before_y += m[node] * old_y[node]
        x += m[node] * vx[node]
        y += m[node] * vy[node]
        damped += m[node] * (old_x[node] * vx[node] + old_y[node] * vy[node])
    return mass, before_x, before_y, x, y, damped
