"""Compiled loops over cells and the material points in them: strains, stresses, internal forces, tangents.

``cells`` are ``Cells`` and ``basis`` ``BasisValues``; ``law`` are the elastic laws of the bodies (``Law``) and ``body``
(n_points,) each point's body. Local unknowns are ordered node by node, x before y; local matrices keep the upper half,
row by row.
"""

from __future__ import annotations

from numba import njit, prange

from physics.energy_splits import body_response


@njit(cache=True, parallel=True)
def add_gradients(cells, basis, displacement, committed, gradient):
    """Displacement gradient (n_points, 4) after a grid displacement (n_nodes, 2) on top of the committed one."""
    nodes, cell, slope = cells.nodes, cells.cell, basis.slope
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
def internal_forces(cells, basis, stress, local):
    """Forces (n_cells, 2k) on the nodes of each cell from the stress of its points, Eq. 3.55."""
    starts, members, slope, volume = cells.starts, cells.members, basis.slope, basis.volume
    for e in prange(local.shape[0]):
        local[e, :] = 0.0
        for m in range(starts[e], starts[e + 1]):
            p = members[m]
            sxx, syy, sxy = stress[p, 0] * volume[p], stress[p, 1] * volume[p], stress[p, 2] * volume[p]
            for a in range(slope.shape[1]):
                local[e, 2 * a] += slope[p, a, 0] * sxx + slope[p, a, 1] * sxy
                local[e, 2 * a + 1] += slope[p, a, 1] * syy + slope[p, a, 0] * sxy


@njit(cache=True, parallel=True)
def tangents(cells, basis, gradient, degradation, law, body, local):
    """Upper halves (n_cells, k (2k + 1)) of each cell's tangent: sum of B^T D B Omega over its points, Eq. 3.59."""
    starts, members, slope, volume = cells.starts, cells.members, basis.slope, basis.volume
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
