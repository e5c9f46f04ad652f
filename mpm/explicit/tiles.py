"""What the loops between points and nodes do with the points of a tile, four at once.

``p`` is the first of four points, of which so many are ``left``, and ``q`` tells how many of the tile come before it;
arrays are borrowed (`numerics.lanes`). k = order + 1.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numba.extending import overload

from mpm.explicit.cell_splines import ROUNDED, cubic, linear, quadratic
from mpm.explicit.stencil_sums import ACROSS, ALONG, OFF_ACROSS, OFF_ALONG, SLOPES_ACROSS, SLOPES_ALONG
from mpm.explicit.stresses import elastic_stress, turned_strain
from numerics.lanes import (
    greatest,
    least,
    load,
    load_turned,
    only,
    same,
    store,
    store_rows,
    store_turned,
    store_whole,
    whole,
)


@njit(fastmath=ROUNDED)
def _times_offset(k, weight, xi):
    """The k of four weights times the way from a point at xi of a cell to their nodes, in cells."""
    start = 0.5 * (k - 2) + xi
    return (-start * weight[0], (1.0 - start) * weight[1], (2.0 - start) * weight[2], (3.0 - start) * weight[3])


def weigh(k, p, left, q, x, y, width, weights, firsts):
    """First nodes around four points, and weights there: places in the cells, weights across rows of nodes and along."""


@overload(weigh, prefer_literal=True, jit_options={"fastmath": ROUNDED, "forceinline": True})
def _weigh(k, p, left, q, x, y, width, weights, firsts):
    basis_of = {2: linear, 3: quadratic, 4: cubic}[k.literal_value]

    def weighed(k, p, left, q, x, y, width, weights, firsts):
        at_x, at_y = load(x, p, left), load(y, p, left)
        i, j = whole(at_x), whole(at_y)
        store_whole(firsts, q, i * width + j)
        xi, eta = at_x - i, at_y - j
        (wx, dx), (wy, dy) = basis_of(xi), basis_of(eta)
        store_rows(k, weights, ACROSS, q, wx)
        store_rows(k, weights, SLOPES_ACROSS, q, dx)
        store_rows(k, weights, ALONG, q, wy)
        store_rows(k, weights, SLOPES_ALONG, q, dy)
        return xi, eta, wx, wy

    return weighed


def give(k, p, left, q, over_h, arm, points, width, weights, firsts, gifts):
    """`weigh`, and what the points give, as ``add_fields`` takes it."""


@overload(give, prefer_literal=True, jit_options={"fastmath": ROUNDED, "forceinline": True})
def _give(k, p, left, q, over_h, arm, points, width, weights, firsts, gifts):
    def given(k, p, left, q, over_h, arm, points, width, weights, firsts, gifts):
        motion, matter, gradient, elastic = points
        xi, eta, wx, wy = weigh(k, p, left, q, motion.x, motion.y, width, weights, firsts)
        store_rows(k, weights, OFF_ACROSS, q, _times_offset(k, wx, xi))
        store_rows(k, weights, OFF_ALONG, q, _times_offset(k, wy, eta))
        mass, v = load(matter.mass, p, left), -load(matter.volume, p, left) * over_h
        one = mass * arm
        sxx, syy, sxy = load(elastic.sxx, p, left), load(elastic.syy, p, left), load(elastic.sxy, p, left)
        cxx, cxy = load(gradient.cxx, p, left), load(gradient.cxy, p, left)
        cyx, cyy = load(gradient.cyx, p, left), load(gradient.cyy, p, left)
        store_turned(gifts, 0, q, (mass * wy[0], mass * wy[1], mass * wy[2], mass * wy[3]))
        store_turned(gifts, 1, q, (mass * load(motion.vx, p, left), mass * load(motion.vy, p, left), 0.0, 0.0))
        store_turned(gifts, 2, q, (one * cxx, one * cyx, v * sxx, v * sxy))
        store_turned(gifts, 3, q, (one * cxy, one * cyy, v * sxy, v * syy))

    return given


@njit(fastmath=ROUNDED, forceinline=True)
def _speed_up(p, left, update, motion, sums):
    """Velocities of points p, p + 1, ... from the sums there; the squares of those that carry them."""
    ux, uy, cx, cy = sums
    flip = update.flip
    store(motion.vx, p, left, flip * (load(motion.vx, p, left) + cx) + (1.0 - flip) * ux)
    store(motion.vy, p, left, flip * (load(motion.vy, p, left) + cy) + (1.0 - flip) * uy)
    store(motion.moved_x, p, left, ux - update.lag_x)
    store(motion.moved_y, p, left, uy - update.lag_y)
    return only(ux * ux + uy * uy, left)


@njit(fastmath=ROUNDED, forceinline=True)
def _keep_gradients(p, left, affine, gradient, slopes):
    """Velocity gradients of points."""
    lxx, lyx, lxy, lyy = slopes
    store(gradient.cxx, p, left, affine * lxx)
    store(gradient.cxy, p, left, affine * lxy)
    store(gradient.cyx, p, left, affine * lyx)
    store(gradient.cyy, p, left, affine * lyy)


@njit(fastmath=ROUNDED, forceinline=True)
def _strained(factor, corotational, exx, eyy, gxy, slopes):
    """Strains after the step."""
    lxx, lyx, lxy, lyy = slopes
    return turned_strain(exx, eyy, gxy, factor * lxx, factor * lxy, factor * lyx, factor * lyy, corotational)


@njit(fastmath=ROUNDED, forceinline=True)
def _load_three(p, left, one, two, three):
    """Numbers of three arrays."""
    return load(one, p, left), load(two, p, left), load(three, p, left)


@njit(fastmath=ROUNDED, forceinline=True)
def _store_three(p, left, one, two, three, numbers):
    """Numbers into three arrays."""
    store(one, p, left, numbers[0])
    store(two, p, left, numbers[1])
    store(three, p, left, numbers[2])


@njit(fastmath=ROUNDED, forceinline=True)
def _move_on(p, left, factor, motion):
    """New places of points."""
    store(motion.x, p, left, load(motion.x, p, left) + factor * load(motion.moved_x, p, left))
    store(motion.y, p, left, load(motion.y, p, left) + factor * load(motion.moved_y, p, left))


@njit(fastmath=ROUNDED, forceinline=True)
def follow(p, left, q, update, points, sums, largest):
    """New velocities, strains, stresses and places of points p, p + 1, ..., from the sums behind q points of a tile.

    Returns the largest squares so far of the velocities that carry them, infinite where one is not finite.
    """
    motion, gradient, elastic = points
    if update.velocities:
        squares = _speed_up(p, left, update, motion, load_turned(sums, 0, q))
        largest = greatest(least(squares, same(np.inf)), largest)
    if update.strains:
        slopes = load_turned(sums, 1, q)
        if update.affine > 0.0:
            _keep_gradients(p, left, update.affine, gradient, slopes)
        exx, eyy, gxy = _load_three(p, left, elastic.exx, elastic.eyy, elastic.gxy)
        strain = _strained(update.factor, update.corotational, exx, eyy, gxy, slopes)
        _store_three(p, left, elastic.exx, elastic.eyy, elastic.gxy, strain)
        if update.stresses:
            stress = elastic_stress(*strain, update.lam, update.mu)
            _store_three(p, left, elastic.sxx, elastic.syy, elastic.sxy, stress)
        _move_on(p, left, update.factor, motion)
    return largest
