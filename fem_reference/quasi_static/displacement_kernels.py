"""Compiled loops over elements: strains, internal forces, tangents.

Arrays: ``nodes`` (n_el, k) corner numbers; ``slope`` (n_el, n_gauss, k, 2) gradients of the shape functions [1/length];
``volume`` (n_el, n_gauss) weight times thickness; ``dilation`` (n_el, n_gauss, k, 2) half of what the slopes lack to
their mean over the element, by which B-bar adds the mean change of area (Hughes 1980), of no elements where it is off;
``law`` the elastic laws of the bodies (``Law``) and ``body`` (n_el,) each element's body.
Local unknowns are ordered node by node, x before y; local matrices keep the upper half, row by row.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from physics.energy_splits import body_response

#: ``dilation`` of elements that are integrated as they are
WITHOUT_DILATION = np.zeros((0, 0, 0, 0))


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
def even_dilation(nodes, dilation, displacement, gradient):
    """Make the change of area of a displacement the same all over each element, in ``gradient`` in place."""
    for e in prange(dilation.shape[0]):
        for q in range(dilation.shape[1]):
            change = 0.0
            for a in range(nodes.shape[1]):
                node = nodes[e, a]
                change += dilation[e, q, a, 0] * displacement[node, 0] + dilation[e, q, a, 1] * displacement[node, 1]
            gradient[e, q, 0] += change
            gradient[e, q, 3] += change


@njit(cache=True, parallel=True)
def internal_forces(slope, dilation, volume, gradient, degradation, law, body, force, stress, psi):
    """Element forces (n_el, 2k), stress (n_el, n_gauss, 3) and psi_plus, psi_minus (n_el, n_gauss, 2)."""
    even = dilation.shape[0] > 0
    for e in prange(slope.shape[0]):
        for q in range(slope.shape[1]):
            shear = gradient[e, q, 1] + gradient[e, q, 2]
            r = body_response(law, body[e], degradation[e, q], gradient[e, q, 0], gradient[e, q, 3], shear)
            stress[e, q, 0], stress[e, q, 1], stress[e, q, 2] = r.sxx, r.syy, r.sxy
            psi[e, q, 0], psi[e, q, 1] = r.psi_plus, r.psi_minus
        for a in range(slope.shape[2]):
            fx = fy = 0.0
            for q in range(slope.shape[1]):
                sxx, syy, sxy = stress[e, q, 0], stress[e, q, 1], stress[e, q, 2]
                nx, ny = slope[e, q, a, 0] * volume[e, q], slope[e, q, a, 1] * volume[e, q]
                fx += nx * sxx + ny * sxy
                fy += ny * syy + nx * sxy
                if even:
                    pressure = (sxx + syy) * volume[e, q]
                    fx += dilation[e, q, a, 0] * pressure
                    fy += dilation[e, q, a, 1] * pressure
            force[e, 2 * a], force[e, 2 * a + 1] = fx, fy


@njit(cache=True, parallel=True)
def tangents(slope, dilation, volume, gradient, degradation, law, body, local):
    """Upper halves of the element tangents, into ``local`` (n_el, k (2k + 1))."""
    n_unknowns, even = 2 * slope.shape[2], dilation.shape[0] > 0
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
                if even:
                    vx, vy = dilation[e, q, a, 0] * w, dilation[e, q, a, 1] * w
                    s0, s1, s2 = r.d00 + r.d01, r.d01 + r.d11, r.d02 + r.d12
                    x0, x1, x2 = x0 + vx * s0, x1 + vx * s1, x2 + vx * s2
                    y0, y1, y2 = y0 + vy * s0, y1 + vy * s1, y2 + vy * s2
                length = n_unknowns - 2 * a
                for b in range(a, slope.shape[2]):
                    mx, my = slope[e, q, b, 0], slope[e, q, b, 1]
                    column = 2 * (b - a)
                    local[e, entry + column] += x0 * mx + x2 * my
                    local[e, entry + column + 1] += x1 * my + x2 * mx
                    if b > a:
                        local[e, entry + length + column - 1] += y0 * mx + y2 * my
                    local[e, entry + length + column] += y1 * my + y2 * mx
                    if even:
                        vx, vy = dilation[e, q, b, 0], dilation[e, q, b, 1]
                        local[e, entry + column] += (x0 + x1) * vx
                        local[e, entry + column + 1] += (x0 + x1) * vy
                        if b > a:
                            local[e, entry + length + column - 1] += (y0 + y1) * vx
                        local[e, entry + length + column] += (y0 + y1) * vy
                entry += 2 * length - 1
