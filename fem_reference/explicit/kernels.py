"""Compiled loops of explicit dynamics on a mesh; arrays are named as in ``fem_reference.quasi_static.kernels``.

The stress is kept in two parts, sigma = g sigma_plus + sigma_minus, so that the law is evaluated once in a step although
the phase field, which fixes g, is known only after the strain is.
"""

from __future__ import annotations

from numba import njit, prange

from physics.energy_splits import point_response


@njit(cache=True, parallel=True)
def evaluate_strain(nodes, slope, displacement, split, lam, mu, gradient, plus, minus, psi):
    """Displacement gradient (n_el, n_gauss, 4), both parts of the stress (n_el, n_gauss, 3) and of the energy (.., 2)."""
    for e in prange(nodes.shape[0]):
        for q in range(slope.shape[1]):
            xx = xy = yx = yy = 0.0
            for a in range(nodes.shape[1]):
                ux, uy = displacement[nodes[e, a], 0], displacement[nodes[e, a], 1]
                xx += slope[e, q, a, 0] * ux
                xy += slope[e, q, a, 1] * ux
                yx += slope[e, q, a, 0] * uy
                yy += slope[e, q, a, 1] * uy
            gradient[e, q, 0], gradient[e, q, 1], gradient[e, q, 2], gradient[e, q, 3] = xx, xy, yx, yy
            kept = point_response(split[e], 0.0, xx, yy, xy + yx, lam[e], mu[e])
            whole = point_response(split[e], 1.0, xx, yy, xy + yx, lam[e], mu[e])
            minus[e, q, 0], minus[e, q, 1], minus[e, q, 2] = kept.sxx, kept.syy, kept.sxy
            plus[e, q, 0], plus[e, q, 1] = whole.sxx - kept.sxx, whole.syy - kept.syy
            plus[e, q, 2] = whole.sxy - kept.sxy
            psi[e, q, 0], psi[e, q, 1] = whole.psi_plus, whole.psi_minus


@njit(cache=True, parallel=True)
def element_forces(slope, volume, phase_field, residual_stiffness, plus, minus, force):
    """Forces (n_el, 2k) of the stress degraded by the phase field (n_el, n_gauss)."""
    for e in prange(slope.shape[0]):
        force[e, :] = 0.0
        k_f = residual_stiffness[e]
        for q in range(slope.shape[1]):
            c = phase_field[e, q]
            g = (1.0 - k_f) * c * c + k_f
            w = volume[e, q]
            sxx = w * (g * plus[e, q, 0] + minus[e, q, 0])
            syy = w * (g * plus[e, q, 1] + minus[e, q, 1])
            sxy = w * (g * plus[e, q, 2] + minus[e, q, 2])
            for a in range(slope.shape[2]):
                nx, ny = slope[e, q, a, 0], slope[e, q, a, 1]
                force[e, 2 * a] += nx * sxx + ny * sxy
                force[e, 2 * a + 1] += ny * syy + nx * sxy


@njit(cache=True, parallel=True)
def gather_at_nodes(starts, members, local, total):
    """Sum of the element vectors (n_el, 2k) at each node (n_nodes, 2), in a fixed order.

    Node i has the corners ``members[starts[i]:starts[i + 1]]``, counted element by element.
    """
    flat = local.reshape(-1, 2)
    for i in prange(total.shape[0]):
        x = y = 0.0
        for m in range(starts[i], starts[i + 1]):
            x += flat[members[m], 0]
            y += flat[members[m], 1]
        total[i, 0], total[i, 1] = x, y


@njit(cache=True, parallel=True)
def raise_history(psi, committed, phase_field, at_solution, drive, resistance, irreversible, history, change):
    """History field (n_el, n_gauss), and the largest change of the phase field to expect in each element (n_el,).

    ``at_solution`` (n_el, n_gauss) is the history field for which the phase field was solved.
    """
    for e in prange(psi.shape[0]):
        largest = 0.0
        for q in range(psi.shape[1]):
            value = psi[e, q, 0]
            if irreversible and committed[e, q] > value:
                value = committed[e, q]
            history[e, q] = value
            reaction = drive[e] * value + resistance[e]
            largest = max(largest, drive[e] * abs(value - at_solution[e, q]) * phase_field[e, q] / reaction)
        change[e] = largest
