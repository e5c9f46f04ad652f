"""Compiled loops over cells and the material points in them for the phase field: equations of cells, values at points.

``cells`` are ``Cells``, ``basis`` ``BasisValues`` and ``terms`` ``PhaseFieldTerms`` of the points. Local matrices keep
the upper half, row by row. What a loop fills is an argument of its own: numba drops what is written to an array that
was taken out of a tuple.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, parallel=True)
def phase_field_systems(cells, basis, terms, nodal, local, rest):
    """Matrices (n_cells, k (k + 1) / 2) of Eq. 4.17 and out-of-balance vectors (n_cells, k) of Eq. 4.13.

    ``local`` may be of no cells where the matrices are not wanted.
    """
    nodes, starts, members = cells.nodes, cells.starts, cells.members
    value, slope, volume = basis.value, basis.slope, basis.volume
    reaction, resistance, diffusion, _ = terms
    k, wanted = value.shape[1], local.shape[0] > 0
    for e in prange(rest.shape[0]):
        if wanted:
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
                for b in range(a, k if wanted else a):
                    local[e, entry] += n * value[p, b] + gx * slope[p, b, 0] + gy * slope[p, b, 1]
                    entry += 1


@njit(cache=True, parallel=True)
def scalar_at_points(cells, basis, nodal, at_points, slope_squared):
    """Value and squared gradient (n_points,) of a nodal scalar."""
    nodes, cell, value, slope = cells.nodes, cells.cell, basis.value, basis.slope
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
def add_curvature_terms(cells, basis, terms, nodal, local, rest):
    """Add the fourth-order term of Eq. 5.37 to the systems of ``phase_field_systems``."""
    nodes, starts, members = cells.nodes, cells.starts, cells.members
    curvature, volume, bending = basis.curvature, basis.volume, terms.bending
    nothing = np.empty(0)
    for e in prange(rest.shape[0]):
        own = local[e] if local.shape[0] > 0 else nothing
        for m in range(starts[e], starts[e + 1]):
            p = members[m]
            if bending[p] > 0.0:
                add_point_curvature(nodes[e], curvature[p], bending[p] * volume[p], nodal, own, rest[e])


@njit(cache=True)
def add_point_curvature(nodes, curvature, weight, nodal, local, rest):
    """Add one point's part of the fourth-order term to its cell's system: ``local`` (k (k + 1) / 2,), ``rest`` (k,).

    ``local`` may be empty where the matrix is not wanted.
    """
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
        for b in range(a, nodes.size if local.size > 0 else a):
            local[entry] += b0 * curvature[b, 0] + b1 * curvature[b, 1] + b2 * curvature[b, 2]
            entry += 1


@njit(cache=True, parallel=True)
def curvature_at_points(cells, basis, nodal, squared):
    """Quadratic form of gamma (n_points,) in the second derivatives of a nodal scalar."""
    nodes, cell, curvature = cells.nodes, cells.cell, basis.curvature
    for p in prange(curvature.shape[0]):
        c0 = c1 = c2 = 0.0
        for a in range(curvature.shape[1]):
            phase = nodal[nodes[cell[p], a]]
            c0 += curvature[p, a, 0] * phase
            c1 += curvature[p, a, 1] * phase
            c2 += curvature[p, a, 2] * phase
        squared[p] = c0 * c0 + c1 * c1 + c2 * c2
