"""Compiled loops over elements: internal forces, tangents, phase field matrices.

Arrays: ``nodes`` (n_el, k) corner numbers; ``shape`` (n_gauss, k) shape functions; ``slope`` (n_el, n_gauss, k, 2)
their gradients [1/length]; ``volume`` (n_el, n_gauss) weight times thickness; ``material`` one constant per element;
``law`` the elastic laws of the bodies (``Law``) and ``body`` (n_el,) each element's body.
Local unknowns are ordered node by node, x before y; local matrices keep the upper half, row by row.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from physics.energy_splits import body_response


@njit(cache=True, parallel=True)
def displacement_gradients(nodes, slope, displacement, before, gradient):
    """Displacement gradient ux,x ux,y uy,x uy,y on top of one before, into ``gradient`` (n_el, n_gauss, 4)."""
    for e in prange(nodes.shape[0]):
        for q in range(slope.shape[1]):
            xx, xy, yx, yy = before[e, q, 0], before[e, q, 1], before[e, q, 2], before[e, q, 3]
            for a in range(nodes.shape[1]):
                ux, uy = displacement[nodes[e, a], 0], displacement[nodes[e, a], 1]
                xx += slope[e, q, a, 0] * ux
                xy += slope[e, q, a, 1] * ux
                yx += slope[e, q, a, 0] * uy
                yy += slope[e, q, a, 1] * uy
            gradient[e, q, 0], gradient[e, q, 1], gradient[e, q, 2], gradient[e, q, 3] = xx, xy, yx, yy


@njit(cache=True, parallel=True)
def internal_forces(slope, volume, gradient, degradation, law, body, force, stress, psi):
    """Element forces (n_el, 2k), stress (n_el, n_gauss, 3) and psi_plus, psi_minus (n_el, n_gauss, 2)."""
    for e in prange(slope.shape[0]):
        force[e, :] = 0.0
        for q in range(slope.shape[1]):
            shear = gradient[e, q, 1] + gradient[e, q, 2]
            r = body_response(law, body[e], degradation[e, q], gradient[e, q, 0], gradient[e, q, 3], shear)
            stress[e, q, 0], stress[e, q, 1], stress[e, q, 2] = r.sxx, r.syy, r.sxy
            psi[e, q, 0], psi[e, q, 1] = r.psi_plus, r.psi_minus
            for a in range(slope.shape[2]):
                nx, ny = slope[e, q, a, 0] * volume[e, q], slope[e, q, a, 1] * volume[e, q]
                force[e, 2 * a] += nx * r.sxx + ny * r.sxy
                force[e, 2 * a + 1] += ny * r.syy + nx * r.sxy


@njit(cache=True, parallel=True)
def tangents(slope, volume, gradient, degradation, law, body, local):
    """Upper halves of the element tangents, into ``local`` (n_el, k (2k + 1))."""
    n_unknowns = 2 * slope.shape[2]
    for e in prange(slope.shape[0]):
        local[e, :] = 0.0
        for q in range(slope.shape[1]):
            shear = gradient[e, q, 1] + gradient[e, q, 2]
            r = body_response(law, body[e], degradation[e, q], gradient[e, q, 0], gradient[e, q, 3], shear)
            w = volume[e, q]
            entry = 0
            for a in range(slope.shape[2]):
                nx, ny = slope[e, q, a, 0] * w, slope[e, q, a, 1] * w
                # rows x and y of B_a^T D
                x0, x1, x2 = nx * r.d00 + ny * r.d02, nx * r.d01 + ny * r.d12, nx * r.d02 + ny * r.d22
                y0, y1, y2 = ny * r.d01 + nx * r.d02, ny * r.d11 + nx * r.d12, ny * r.d12 + nx * r.d22
                length = n_unknowns - 2 * a
                for b in range(a, slope.shape[2]):
                    mx, my = slope[e, q, b, 0], slope[e, q, b, 1]
                    column = 2 * (b - a)
                    local[e, entry + column] += x0 * mx + x2 * my
                    local[e, entry + column + 1] += x1 * my + x2 * mx
                    if b > a:
                        local[e, entry + length + column - 1] += y0 * mx + y2 * my
                    local[e, entry + length + column] += y1 * my + y2 * mx
                entry += 2 * length - 1


@njit(cache=True, parallel=True)
def phase_field_matrices(
    nodes, shape, slope, volume, reaction, resistance, diffusion, nodal, local, out_of_balance
):
    """Phase field equation of each element at a nodal phase field.

    Upper halves of the matrices into ``local`` (n_el, k (k + 1) / 2) and the residual with its sign turned into
    ``out_of_balance`` (n_el, k).
    """
    for e in prange(slope.shape[0]):
        local[e, :] = 0.0
        out_of_balance[e, :] = 0.0
        for q in range(slope.shape[1]):
            c = cx = cy = 0.0
            for a in range(nodes.shape[1]):
                c += shape[q, a] * nodal[nodes[e, a]]
                cx += slope[e, q, a, 0] * nodal[nodes[e, a]]
                cy += slope[e, q, a, 1] * nodal[nodes[e, a]]
            w_mass, w_slope = reaction[e, q] * volume[e, q], diffusion[e] * volume[e, q]
            source = (resistance[e] - reaction[e, q] * c) * volume[e, q]
            entry = 0
            for a in range(slope.shape[2]):
                nx, ny = w_slope * slope[e, q, a, 0], w_slope * slope[e, q, a, 1]
                out_of_balance[e, a] += shape[q, a] * source - nx * cx - ny * cy
                for b in range(a, slope.shape[2]):
                    slopes = nx * slope[e, q, b, 0] + ny * slope[e, q, b, 1]
                    local[e, entry] += w_mass * shape[q, a] * shape[q, b] + slopes
                    entry += 1


@njit(cache=True, parallel=True)
def scalar_at_points(nodes, shape, slope, nodal, value, slope_squared):
    """Value and squared gradient of a nodal scalar at the Gauss points, both (n_el, n_gauss)."""
    for e in prange(nodes.shape[0]):
        for q in range(slope.shape[1]):
            c = cx = cy = 0.0
            for a in range(nodes.shape[1]):
                c += shape[q, a] * nodal[nodes[e, a]]
                cx += slope[e, q, a, 0] * nodal[nodes[e, a]]
                cy += slope[e, q, a, 1] * nodal[nodes[e, a]]
            value[e, q] = c
            slope_squared[e, q] = cx * cx + cy * cy


@njit(cache=True, parallel=True)
def fourth_order_matrices(
    unknowns, kind, value, slopes, bends, volume, reaction, resistance, diffusion, bending, nodal, local, out_of_balance
):
    """The same as ``phase_field_matrices`` with the fourth-order term (Eq. 5.37), on a smooth basis.

    ``value`` (n_kinds, n_gauss, k); ``slopes`` and ``bends`` (n_kinds, k (k + 1) / 2) are the integrals of the products
    of slopes and of second derivatives, which no history field changes.
    """
    n_unknowns = unknowns.shape[1]
    for e in prange(unknowns.shape[0]):
        parts, rest = local[e], out_of_balance[e]
        at = value[kind[e]]
        for entry in range(parts.size):
            parts[entry] = diffusion[e] * slopes[kind[e], entry] + bending[e] * bends[kind[e], entry]
        _subtract_product(parts, nodal, unknowns[e], rest)
        for q in range(volume.shape[1]):
            c = 0.0
            for a in range(n_unknowns):
                c += at[q, a] * nodal[unknowns[e, a]]
            source, weight = (resistance[e] - reaction[e, q] * c) * volume[e, q], reaction[e, q] * volume[e, q]
            entry = 0
            for a in range(n_unknowns):
                rest[a] += at[q, a] * source
                for b in range(a, n_unknowns):
                    parts[entry] += weight * at[q, a] * at[q, b]
                    entry += 1


@njit(inline="always")
def _subtract_product(matrix, nodal, unknowns, rest):
    """The product of a packed upper half with an element's unknowns, with its sign turned, into ``rest`` (k,)."""
    rest[:] = 0.0
    entry = 0
    for a in range(rest.size):
        own = nodal[unknowns[a]]
        rest[a] -= matrix[entry] * own
        entry += 1
        for b in range(a + 1, rest.size):
            rest[a] -= matrix[entry] * nodal[unknowns[b]]
            rest[b] -= matrix[entry] * own
            entry += 1


@njit(cache=True, parallel=True)
def smooth_scalar_at_points(unknowns, kind, value, slope, curvature, nodal, scalar, slope_squared, curvature_squared):
    """Value, squared gradient and quadratic form of gamma of a scalar at the Gauss points, all (n_el, n_gauss).

    ``slope`` (n_kinds, n_gauss, k, 2); ``curvature`` (n_kinds, n_gauss, k, 3) are second derivatives whose squares add
    up to the quadratic form of gamma.
    """
    for e in prange(unknowns.shape[0]):
        of = kind[e]
        for q in range(value.shape[1]):
            c = cx = cy = c0 = c1 = c2 = 0.0
            for a in range(unknowns.shape[1]):
                phase = nodal[unknowns[e, a]]
                c += value[of, q, a] * phase
                cx += slope[of, q, a, 0] * phase
                cy += slope[of, q, a, 1] * phase
                c0 += curvature[of, q, a, 0] * phase
                c1 += curvature[of, q, a, 1] * phase
                c2 += curvature[of, q, a, 2] * phase
            scalar[e, q] = c
            slope_squared[e, q] = cx * cx + cy * cy
            curvature_squared[e, q] = c0 * c0 + c1 * c1 + c2 * c2


def packed(n_unknowns: int, n_cells: int) -> np.ndarray:
    """Room for the upper halves of ``n_cells`` local matrices."""
    return np.empty((n_cells, n_unknowns * (n_unknowns + 1) // 2))
