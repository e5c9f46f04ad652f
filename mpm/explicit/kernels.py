"""Compiled loops of the explicit material point method on uniform grids, one set for each order of the splines.

Points are sorted by columns of cells, and columns are grouped in strips. Points of one strip write to the nodes of their
strip and of the margins of its neighbours; strips of one colour (every second one) share no node, so that threads need
no atomics and sums are the same for any number of threads.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import njit, prange

from mpm.explicit.stencil_sums import add_products, sum_products
from physics.energy_splits import point_response

#: cells that a point may wander from where it was sorted, in each direction
DRIFT = 1
#: points tell how far a body reaches at a node when the normal there passes within this part of their size: more would
#: make flats of round bodies' lowest points, half is the least that leaves no hole between points
LATERAL = 0.75
#: liberties of the compiler that change results by round-off alone
ROUNDED = {"contract", "nsz", "arcp"}
#: columns of cells in a strip: two strips of one colour must stay apart for cubic splines and drifting points
STRIP = 6


@njit(fastmath=ROUNDED)
def _linear(xi):
    return (1.0 - xi, xi, 0.0, 0.0), (-1.0, 1.0, 0.0, 0.0)


@njit(fastmath=ROUNDED)
def _quadratic(xi):
    eta = 1.0 - xi
    return (0.5 * eta * eta, 0.5 + xi * eta, 0.5 * xi * xi, 0.0), (-eta, eta - xi, xi, 0.0)


@njit(fastmath=ROUNDED)
def _cubic(xi):
    eta = 1.0 - xi
    one, two = (4.0 - 3.0 * xi * xi * (1.0 + eta)) / 6.0, (4.0 - 3.0 * eta * eta * (1.0 + xi)) / 6.0
    value = (eta * eta * eta / 6.0, one, two, xi * xi * xi / 6.0)
    inner = (0.5 * xi * (xi - 2.0 * eta - 2.0), -0.5 * eta * (eta - 2.0 * xi - 2.0))
    return value, (-0.5 * eta * eta, inner[0], inner[1], 0.5 * xi * xi)


@njit(fastmath=ROUNDED)
def _splines(k, xi):
    """Values and slopes of the k = order + 1 splines of a cell at xi in [0, 1), tuples of four with zeros behind them."""
    if k == 3:
        return _quadratic(xi)
    if k == 4:
        return _cubic(xi)
    return _linear(xi)


@njit(inline="always")
def _basis(k, xi, value, slope):
    """Values and slopes (k,) of the k = order + 1 splines of a cell at xi in [0, 1), slopes for cells of size one."""
    values, slopes = _splines(k, xi)
    for a in range(k):
        value[a], slope[a] = values[a], slopes[a]


@njit(inline="always")
def _second_derivatives(k, xi, bend):
    """Second derivatives (k,) of the splines of ``_basis``; none of linear ones is square integrable."""
    if k == 3:
        bend[0], bend[1], bend[2] = 1.0, -2.0, 1.0
    else:
        bend[0], bend[1], bend[2], bend[3] = 1.0 - xi, 3.0 * xi - 2.0, 1.0 - 3.0 * xi, xi


@njit(cache=True)
def spline_values(order, xi):
    """Values (order + 1,) of the splines of a cell at xi in [0, 1]."""
    value, slope = np.empty(order + 1), np.empty(order + 1)
    _basis(order + 1, xi, value, slope)
    return value


@njit(inline="always")
def turned_strain(exx, eyy, gxy, l00, l01, l10, l11, corotational):
    """Strain after a step with the displacement gradients l of the step.

    Additive: the symmetric part is summed in fixed axes (Eq. 6.41). Corotational: the gradient is taken on the middle
    of the step, l (1 + l/2)^-1, whose symmetric part a rigid turn leaves zero; the strain so far turns with the
    material (Hughes and Winget 1980).
    """
    if not corotational:
        return exx + l00, eyy + l11, gxy + l01 + l10
    a, b, c, d = 1.0 + 0.5 * l00, 0.5 * l01, 0.5 * l10, 1.0 + 0.5 * l11
    over = 1.0 / (a * d - b * c)
    m00, m01 = (l00 * d - l01 * c) * over, (l01 * a - l00 * b) * over
    m10, m11 = (l10 * d - l11 * c) * over, (l11 * a - l10 * b) * over
    half = 0.25 * (m10 - m01)  # half of the angle
    # cosine and sine of twice the angle, as the deviator turns, by Cayley's formula: half is the tangent of a quarter
    even, odd = 1.0 - half * half, 2.0 * half
    over = 1.0 / ((1.0 + half * half) * (1.0 + half * half))
    cosine, sine = (even * even - odd * odd) * over, 2.0 * even * odd * over
    mean, difference, shear = 0.5 * (exx + eyy), 0.5 * (exx - eyy), 0.5 * gxy
    turned, sheared = cosine * difference - sine * shear, sine * difference + cosine * shear
    return mean + turned + m00, mean - turned + m11, 2.0 * sheared + m01 + m10


def _to_grid(k):
    @njit(cache=True, parallel=True, fastmath=ROUNDED)
    def to_grid(strips, x, y, vx, vy, mass, volume, sxx, syy, sxy, over_h, width, m, px, py, fx, fy):
        """Masses (Eq. 3.58), momenta (6.24) and minus internal forces (6.25) of the nodes."""
        for colour in range(2):
            for half in prange((len(strips) - colour) // 2):
                strip = 2 * half + colour
                for p in range(np.uintp(strips[strip]), np.uintp(strips[strip + 1])):
                    i, j = int(x[p]), int(y[p])
                    (wx, dx), (wy, dy) = _splines(k, x[p] - i), _splines(k, y[p] - j)
                    first, v = i * width + j, -volume[p] * over_h
                    add_products(k, m, first, width, ((mass[p], wx, wy),))
                    add_products(k, px, first, width, ((mass[p] * vx[p], wx, wy),))
                    add_products(k, py, first, width, ((mass[p] * vy[p], wx, wy),))
                    add_products(k, fx, first, width, ((v * sxx[p], dx, wy), (v * sxy[p], wx, dy)))
                    add_products(k, fy, first, width, ((v * sxy[p], dx, wy), (v * syy[p], wx, dy)))

    return to_grid


@njit(fastmath=ROUNDED)
def _times_offset(k, weight, xi):
    """The k of four weights times the way from a point at xi of a cell to their nodes, in cells."""
    start = 0.5 * (k - 2) + xi
    return (-start * weight[0], (1.0 - start) * weight[1], (2.0 - start) * weight[2], (3.0 - start) * weight[3])


def _affine_to_grid(k):
    @njit(cache=True, parallel=True, fastmath=ROUNDED)
    def affine_to_grid(strips, x, y, mass, cxx, cxy, cyx, cyy, h, width, px, py):
        """Momenta of the points' velocity gradients c about the points, added to those of the nodes."""
        for colour in range(2):
            for half in prange((len(strips) - colour) // 2):
                strip = 2 * half + colour
                for p in range(np.uintp(strips[strip]), np.uintp(strips[strip + 1])):
                    i, j = int(x[p]), int(y[p])
                    wx, wy = _splines(k, x[p] - i)[0], _splines(k, y[p] - j)[0]
                    off_x, off_y = _times_offset(k, wx, x[p] - i), _times_offset(k, wy, y[p] - j)
                    first, arm = i * width + j, h * mass[p]
                    add_products(k, px, first, width, ((arm * cxx[p], off_x, wy), (arm * cxy[p], wx, off_y)))
                    add_products(k, py, first, width, ((arm * cyx[p], off_x, wy), (arm * cyy[p], wx, off_y)))

    return affine_to_grid


def _momentum_to_grid(k):
    @njit(cache=True, parallel=True, fastmath=ROUNDED)
    def momentum_to_grid(strips, x, y, vx, vy, mass, width, px, py):
        """Momenta of the nodes (Eq. 6.24) alone."""
        for colour in range(2):
            for half in prange((len(strips) - colour) // 2):
                strip = 2 * half + colour
                for p in range(np.uintp(strips[strip]), np.uintp(strips[strip + 1])):
                    i, j = int(x[p]), int(y[p])
                    wx, wy = _splines(k, x[p] - i)[0], _splines(k, y[p] - j)[0]
                    add_products(k, px, i * width + j, width, ((mass[p] * vx[p], wx, wy),))
                    add_products(k, py, i * width + j, width, ((mass[p] * vy[p], wx, wy),))

    return momentum_to_grid


# without liberties, which it would else take over from the loop that compiles it first: the same strain, the same bits
@njit(fastmath=False)
def _elastic_stress(exx, eyy, gxy, lam, mu):
    pressure = lam * (exx + eyy)
    return pressure + 2.0 * mu * exx, pressure + 2.0 * mu * eyy, mu * gxy


def _to_points(k):
    @njit(cache=True, parallel=True, fastmath=ROUNDED)
    def to_points(
        strips, x, y, vx, vy, grid_vx, grid_vy, grid_dx, grid_dy, width, factor, flip, corotational, affine,
        with_velocities, with_strains, with_stresses, lam, mu,
        exx, eyy, gxy, sxx, syy, sxy, cxx, cxy, cyx, cyy, moved_x, moved_y, fastest,
    ):  # fmt: skip
        """Velocities of the points (Eq. 6.43) and how far they move in a unit of time (Eq. 6.45); strains and places;
        stresses where the body cannot break.

        ``grid_dx, grid_dy`` are the changes of the nodes' velocities in the step; ``factor`` is the step over the
        spacing. Where ``affine`` is positive, it is one over the spacing and the velocity gradients c are kept.
        """
        for strip in prange(len(strips) - 1):
            largest = 0.0
            for p in range(np.uintp(strips[strip]), np.uintp(strips[strip + 1])):
                i, j = int(x[p]), int(y[p])
                (wx, dx), (wy, dy) = _splines(k, x[p] - i), _splines(k, y[p] - j)
                first = i * width + j
                # all sums before anything is stored, so that what they share is computed once
                ux = sum_products(k, grid_vx, first, width, wx, wy)
                uy = sum_products(k, grid_vy, first, width, wx, wy)
                cx = sum_products(k, grid_dx, first, width, wx, wy)
                cy = sum_products(k, grid_dy, first, width, wx, wy)
                l00 = sum_products(k, grid_vx, first, width, dx, wy)
                l01 = sum_products(k, grid_vx, first, width, wx, dy)
                l10 = sum_products(k, grid_vy, first, width, dx, wy)
                l11 = sum_products(k, grid_vy, first, width, wx, dy)
                if with_velocities:
                    vx[p] = flip * (vx[p] + cx) + (1.0 - flip) * ux
                    vy[p] = flip * (vy[p] + cy) + (1.0 - flip) * uy
                    moved_x[p], moved_y[p] = ux, uy
                    largest = max(largest, ux * ux + uy * uy)
                    if not largest >= ux * ux + uy * uy:
                        largest = np.inf
                if with_strains:
                    xx, yy, xy = turned_strain(
                        exx[p], eyy[p], gxy[p], factor * l00, factor * l01, factor * l10, factor * l11, corotational
                    )
                    exx[p], eyy[p], gxy[p] = xx, yy, xy
                    if with_stresses:
                        sxx[p], syy[p], sxy[p] = _elastic_stress(xx, yy, xy, lam, mu)
                    if affine > 0.0:
                        cxx[p], cxy[p], cyx[p], cyy[p] = affine * l00, affine * l01, affine * l10, affine * l11
                    x[p] += factor * moved_x[p]
                    y[p] += factor * moved_y[p]
            fastest[strip] = largest

    return to_points


def _mass_slopes(k):
    @njit(cache=True, parallel=True)
    def mass_slopes(strips, x, y, mass, cell_touches, width, slope_x, slope_y):
        """Gradients of the mass (Eq. 6.33) at the nodes of the marked cells, times the spacing."""
        for colour in range(2):
            for half in prange((len(strips) - colour) // 2):
                strip = 2 * half + colour
                for p in range(np.uintp(strips[strip]), np.uintp(strips[strip + 1])):
                    i, j = int(x[p]), int(y[p])
                    if not cell_touches[i * width + j]:
                        continue
                    (wx, dx), (wy, dy) = _splines(k, x[p] - i), _splines(k, y[p] - j)
                    add_products(k, slope_x, i * width + j, width, ((mass[p], dx, wy),))
                    add_products(k, slope_y, i * width + j, width, ((mass[p], wx, dy),))

    return mass_slopes


def _reaches(k):
    @njit(cache=True, parallel=True)
    def reaches(strips, x, y, size_x, size_y, cell_touches, width, normal_x, normal_y, reach):
        """Largest place along the nodes' normals to which the points beside them reach, from the nodes, in cells."""
        for colour in range(2):
            for half in prange((len(strips) - colour) // 2):
                strip = 2 * half + colour
                for p in range(strips[strip], strips[strip + 1]):
                    i, j = int(x[p]), int(y[p])
                    if not cell_touches[i * width + j]:
                        continue
                    for a in range(k):
                        for b in range(k):
                            node = (i + a) * width + j + b
                            nx, ny = normal_x[node], normal_y[node]
                            # a node stands (order - 1) / 2 cells before the cell's corner of the same number
                            off_x, off_y = x[p] - (i + a) + 0.5 * (k - 2), y[p] - (j + b) + 0.5 * (k - 2)
                            aside = np.sqrt((size_x[p] * ny) ** 2 + (size_y[p] * nx) ** 2)
                            if abs(off_y * nx - off_x * ny) > LATERAL * aside:
                                continue
                            along = off_x * nx + off_y * ny
                            along += 0.5 * np.sqrt((size_x[p] * nx) ** 2 + (size_y[p] * ny) ** 2)
                            reach[node] = max(reach[node], along)

    return reaches


def _spread(k):
    @njit(cache=True)
    def spread(x, y, force_x, force_y, width, fx, fy):
        """Add forces at places to the nodes."""
        wx, dx, wy, dy = np.empty(k), np.empty(k), np.empty(k), np.empty(k)
        for p in range(len(x)):
            i, j = int(x[p]), int(y[p])
            _basis(k, x[p] - i, wx, dx)
            _basis(k, y[p] - j, wy, dy)
            for a in range(k):
                for b in range(k):
                    fx[(i + a) * width + j + b] += wx[a] * wy[b] * force_x[p]
                    fy[(i + a) * width + j + b] += wx[a] * wy[b] * force_y[p]

    return spread


#: what makes each loop for k = order + 1 functions in each direction; k is the closures' only variable, so that compiled
#: code can be kept on disk
_MAKERS = (
    _to_grid,
    _affine_to_grid,
    _momentum_to_grid,
    _to_points,
    _mass_slopes,
    _reaches,
    _spread,
)


@cache
def kernels(order: int) -> SimpleNamespace:
    """Compiled loops for splines of an order, by their names.

    Common arguments: ``strips`` (n_strips + 1,) first point of each strip; ``x, y`` positions of a body's points in
    cells from the lower corner of its window; ``width`` nodes of the window in y; arrays over nodes are flat.
    """
    return SimpleNamespace(**{make.__name__.removeprefix("_"): make(order + 1) for make in _MAKERS})


@njit(cache=True, parallel=True)
def elastic_stresses(exx, eyy, gxy, lam, mu, sxx, syy, sxy):
    """Stresses of a body that cannot break."""
    for p in prange(len(exx)):
        sxx[p], syy[p], sxy[p] = _elastic_stress(exx[p], eyy[p], gxy[p], lam, mu)


@njit(cache=True, parallel=True)
def degraded_stresses(exx, eyy, gxy, lam, mu, split, g, sxx, syy, sxy, psi_plus, psi_minus):
    """Stresses (Eq. 2.50) and both parts of the energy density of a body that can break."""
    for p in prange(len(exx)):
        r = point_response(split, g[p], exx[p], eyy[p], gxy[p], lam, mu)
        sxx[p], syy[p], sxy[p] = r.sxx, r.syy, r.sxy
        psi_plus[p], psi_minus[p] = r.psi_plus, r.psi_minus


@njit(cache=True, parallel=True)
def trial_velocities(width, step, gravity_x, gravity_y, damping, m, px, py, fx, fy, old_x, old_y, vx, vy):
    """Velocities of the nodes before the step, from their momenta, and without contact after it (Eqs. 6.26, 6.27)."""
    for row in prange(len(m) // width):
        for node in range(row * width, (row + 1) * width):
            if m[node] > 0.0:
                over = 1.0 / m[node]
                old_x[node], old_y[node] = px[node] * over, py[node] * over
                vx[node] = old_x[node] + step * (fx[node] * over + gravity_x - damping * old_x[node])
                vy[node] = old_y[node] + step * (fy[node] * over + gravity_y - damping * old_y[node])
            else:
                old_x[node] = old_y[node] = vx[node] = vy[node] = 0.0
