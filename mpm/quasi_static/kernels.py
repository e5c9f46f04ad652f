"""Compiled loops over cells and the material points in them.

Arrays: ``nodes`` (n_cells, k) nodes of each cell of the pattern; points ``members[starts[e]:starts[e + 1]]`` lie in
cell e; ``value`` (n_points, k) and ``slope`` (n_points, k, 2) are the basis at the points; ``law`` are the elastic
laws of the bodies (``Law``) and ``body`` (n_points,) each point's body. Local unknowns are ordered node by node, x before
y; local matrices keep the upper half, row by row.
"""

from __future__ import annotations

from numba import njit, prange

from physics.energy_splits import body_response


@njit(cache=True, parallel=True)
def add_gradients(nodes, cell, slope, displacement, committed, gradient):
    """Displacement gradient (n_points, 4) after a grid displacement (n_nodes, 2) on top of the committed one."""
    for p in prange(slope.shape[0]):
        xx, xy, yx, yy = committed[p, 0], committed[p, 1], committed[p, 2], committed[p, 3]
        for a in range(slope.shape[1]):
            node = nodes[cell[p], a]
            ux, uy = displacement[node, 0], displacement[node, 1]
            xx += slope[p, a, 0] * ux
            xy += slope[p, a, 1] * ux
            yx += slope[p, a, 0] * uy
            yy += slope[p, a, 1] * uy
        gradient[p, 0], gradient[p, 1], gradient[p, 2], gradient[p, 3] = xx, xy, yx, yy


@njit(cache=True, parallel=True)
def stresses(gradient, degradation, law, body, stress, psi):
    """Stress (n_points, 3) and psi_plus, psi_minus (n_points, 2) from the displacement gradient."""
    for p in prange(gradient.shape[0]):
        shear = gradient[p, 1] + gradient[p, 2]
        r = body_response(law, body[p], degradation[p], gradient[p, 0], gradient[p, 3], shear)
        stress[p, 0], stress[p, 1], stress[p, 2] = r.sxx, r.syy, r.sxy
        psi[p, 0], psi[p, 1] = r.psi_plus, r.psi_minus


@njit(cache=True, parallel=True)
def internal_forces(starts, members, slope, volume, stress, local):
    """Forces (n_cells, 2k) on the nodes of each cell from the stress of its points, Eq. 3.55."""
    for e in prange(local.shape[0]):
        local[e, :] = 0.0
        for m in range(starts[e], starts[e + 1]):
            p = members[m]
            sxx, syy, sxy = stress[p, 0] * volume[p], stress[p, 1] * volume[p], stress[p, 2] * volume[p]
            for a in range(slope.shape[1]):
                local[e, 2 * a] += slope[p, a, 0] * sxx + slope[p, a, 1] * sxy
                local[e, 2 * a + 1] += slope[p, a, 1] * syy + slope[p, a, 0] * sxy


@njit(cache=True, parallel=True)
def tangents(starts, members, slope, volume, gradient, degradation, law, body, local):
    """Upper halves (n_cells, k (2k + 1)) of each cell's tangent: sum of B^T D B Omega over its points, Eq. 3.59."""
    k = slope.shape[1]
    for e in prange(local.shape[0]):
        local[e, :] = 0.0
        for m in range(starts[e], starts[e + 1]):
            p = members[m]
            shear = gradient[p, 1] + gradient[p, 2]
            r = body_response(law, body[p], degradation[p], gradient[p, 0], gradient[p, 3], shear)
            row = 0
            for a in range(k):
                gx, gy = slope[p, a, 0] * volume[p], slope[p, a, 1] * volume[p]
                row_x0, row_x1, row_x2 = gx * r.d00 + gy * r.d02, gx * r.d01 + gy * r.d12, gx * r.d02 + gy * r.d22
                row_y0, row_y1, row_y2 = gy * r.d01 + gx * r.d02, gy * r.d11 + gx * r.d12, gy * r.d12 + gx * r.d22
                second = row + 2 * (k - a) - 1
                for b in range(a, k):
                    hx, hy, place = slope[p, b, 0], slope[p, b, 1], 2 * (b - a)
                    local[e, row + place] += row_x0 * hx + row_x2 * hy
                    local[e, row + place + 1] += row_x1 * hy + row_x2 * hx
                    local[e, second + place + 1] += row_y1 * hy + row_y2 * hx
                    if b > a:
                        local[e, second + place] += row_y0 * hx + row_y2 * hy
                row += 4 * (k - a) - 1


@njit(cache=True, parallel=True)
def phase_field_systems(
    nodes, starts, members, value, slope, volume, reaction, resistance, diffusion, nodal, local, rest
):
    """Upper halves (n_cells, k (k + 1) / 2) of Eq. 4.17 and out-of-balance vectors (n_cells, k) of Eq. 4.13."""
    k = value.shape[1]
    for e in prange(local.shape[0]):
        local[e, :] = 0.0
        rest[e, :] = 0.0
        for m in range(starts[e], starts[e + 1]):
            p = members[m]
            c = cx = cy = 0.0
            for a in range(k):
                phase = nodal[nodes[e, a]]
                c += value[p, a] * phase
                cx += slope[p, a, 0] * phase
                cy += slope[p, a, 1] * phase
            mass, stiffness = reaction[p] * volume[p], diffusion[p] * volume[p]
            source = (resistance[p] - reaction[p] * c) * volume[p]
            entry = 0
            for a in range(k):
                gx, gy, n = stiffness * slope[p, a, 0], stiffness * slope[p, a, 1], mass * value[p, a]
                rest[e, a] += value[p, a] * source - gx * cx - gy * cy
                for b in range(a, k):
                    local[e, entry] += n * value[p, b] + gx * slope[p, b, 0] + gy * slope[p, b, 1]
                    entry += 1


@njit(cache=True, parallel=True)
def scalar_at_points(nodes, cell, value, slope, nodal, at_points, slope_squared):
    """Value and squared gradient (n_points,) of a nodal scalar."""
    for p in prange(value.shape[0]):
        c = cx = cy = 0.0
        for a in range(value.shape[1]):
            phase = nodal[nodes[cell[p], a]]
            c += value[p, a] * phase
            cx += slope[p, a, 0] * phase
            cy += slope[p, a, 1] * phase
        at_points[p] = c
        slope_squared[p] = cx * cx + cy * cy


@njit(cache=True, parallel=True)
def add_curvature_terms(nodes, starts, members, curvature, volume, bending, nodal, local, rest):
    """Add the fourth-order term of Eq. 5.37 to the systems of ``phase_field_systems``.

    ``curvature`` (n_points, k, 3) are second derivatives of the basis in the material's axes, weighted so that the sum
    of their squares is the quadratic form of gamma; ``bending`` (n_points,) is 2 Gc l0^3.
    """
    for e in prange(local.shape[0]):
        for m in range(starts[e], starts[e + 1]):
            p = members[m]
            if bending[p] > 0.0:
                add_point_curvature(nodes[e], curvature[p], bending[p] * volume[p], nodal, local[e], rest[e])


@njit(cache=True)
def add_point_curvature(nodes, curvature, weight, nodal, local, rest):
    """Add one point's part of the fourth-order term to its cell's system: ``local`` (k (k + 1) / 2,), ``rest`` (k,)."""
    c0 = c1 = c2 = 0.0
    for a in range(nodes.size):
        phase = nodal[nodes[a]]
        c0 += curvature[a, 0] * phase
        c1 += curvature[a, 1] * phase
        c2 += curvature[a, 2] * phase
    entry = 0
    for a in range(nodes.size):
        b0, b1, b2 = weight * curvature[a, 0], weight * curvature[a, 1], weight * curvature[a, 2]
        rest[a] -= b0 * c0 + b1 * c1 + b2 * c2
        for b in range(a, nodes.size):
            local[entry] += b0 * curvature[b, 0] + b1 * curvature[b, 1] + b2 * curvature[b, 2]
            entry += 1


@njit(cache=True, parallel=True)
def curvature_at_points(nodes, cell, curvature, nodal, squared):
    """Quadratic form of gamma (n_points,) in the second derivatives of a nodal scalar."""
    for p in prange(curvature.shape[0]):
        c0 = c1 = c2 = 0.0
        for a in range(curvature.shape[1]):
            phase = nodal[nodes[cell[p], a]]
            c0 += curvature[p, a, 0] * phase
            c1 += curvature[p, a, 1] * phase
            c2 += curvature[p, a, 2] * phase
        squared[p] = c0 * c0 + c1 * c1 + c2 * c2
