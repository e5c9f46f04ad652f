"""Compiled loops over elements for the phase field: equations of each element, values at the Gauss points.

Bases are ``ElementValues`` or ``SmoothValues``; ``terms`` are ``PhaseFieldTerms`` with one reaction for each Gauss point
and one of the others for each element. Local matrices keep the upper half, row by row. What a loop fills is an argument
of its own: numba drops what is written to an array that was taken out of a tuple.
"""

from __future__ import annotations

from typing import NamedTuple

from numba import njit, prange
from numpy.typing import NDArray


class ElementValues(NamedTuple):
    """Bilinear or linear functions of elements.

    nodes : (n_el, k) corner numbers. shape : (n_gauss, k). slope : (n_el, n_gauss, k, 2) gradients [1/length].
    volume : (n_el, n_gauss) weight times thickness.
    """

    nodes: NDArray
    shape: NDArray
    slope: NDArray
    volume: NDArray


class SmoothValues(NamedTuple):
    """Functions of ``SmoothBasis``.

    unknowns : (n_el, k). kind : (n_el,). value : (n_kinds, n_gauss, k). slope : (n_kinds, n_gauss, k, 2).
    curvature : (n_kinds, n_gauss, k, 3) second derivatives whose squares add up to the quadratic form of gamma.
    """

    unknowns: NDArray
    kind: NDArray
    value: NDArray
    slope: NDArray
    curvature: NDArray


@njit(cache=True, parallel=True)
def phase_field_systems(basis, terms, nodal, local, out_of_balance):
    """Phase field equation of each element at a nodal phase field.

    Upper halves of the matrices into ``local`` (n_el, k (k + 1) / 2), which may be of no elements where they are not
    wanted, and the residual with its sign turned into ``out_of_balance`` (n_el, k).
    """
    nodes, shape, slope, volume = basis
    reaction, resistance, diffusion, _ = terms
    wanted = local.shape[0] > 0
    for e in prange(slope.shape[0]):
        if wanted:
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
                for b in range(a, slope.shape[2] if wanted else a):
                    slopes = nx * slope[e, q, b, 0] + ny * slope[e, q, b, 1]
                    local[e, entry] += w_mass * shape[q, a] * shape[q, b] + slopes
                    entry += 1


@njit(cache=True, parallel=True)
def scalar_at_points(basis, nodal, value, slope_squared):
    """Value and squared gradient of a nodal scalar at the Gauss points, both (n_el, n_gauss)."""
    nodes, shape, slope, _ = basis
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
def fourth_order_systems(basis, forms, volume, terms, nodal, local, out_of_balance):
    """The same as ``phase_field_systems`` with the fourth-order term (Eq. 5.37), on a smooth basis.

    ``forms`` are the integrals of the products of slopes and of second derivatives, which no history field changes, both
    (n_kinds, k (k + 1) / 2); ``volume`` (n_el, n_gauss).
    """
    unknowns, kind, value, _, _ = basis
    slopes, bends = forms
    reaction, resistance, diffusion, bending = terms
    n_unknowns, wanted = unknowns.shape[1], local.shape[0] > 0
    for e in prange(unknowns.shape[0]):
        rest, at = out_of_balance[e], value[kind[e]]
        rest[:] = 0.0
        slope, bend, entry = diffusion[e], bending[e], 0
        for a in range(n_unknowns):
            own = nodal[unknowns[e, a]]
            for b in range(a, n_unknowns):
                of_gradients = slope * slopes[kind[e], entry] + bend * bends[kind[e], entry]
                rest[a] -= of_gradients * nodal[unknowns[e, b]]
                if b > a:
                    rest[b] -= of_gradients * own
                if wanted:
                    local[e, entry] = of_gradients
                entry += 1
        for q in range(volume.shape[1]):
            c = 0.0
            for a in range(n_unknowns):
                c += at[q, a] * nodal[unknowns[e, a]]
            source, weight = (resistance[e] - reaction[e, q] * c) * volume[e, q], reaction[e, q] * volume[e, q]
            entry = 0
            for a in range(n_unknowns):
                rest[a] += at[q, a] * source
                for b in range(a, n_unknowns if wanted else a):
                    local[e, entry] += weight * at[q, a] * at[q, b]
                    entry += 1


@njit(cache=True, parallel=True)
def smooth_scalar_at_points(basis, nodal, scalar, slope_squared, curvature_squared):
    """Value, squared gradient and quadratic form of gamma of a scalar at the Gauss points, all (n_el, n_gauss)."""
    unknowns, kind, value, slope, curvature = basis
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
