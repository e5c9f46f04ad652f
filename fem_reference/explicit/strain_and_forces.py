"""Compiled loops from the displacement of a mesh to strains, stresses and forces.

The stress is kept in two parts, sigma = g sigma_plus + sigma_minus, so that the law is evaluated once in a step although
the phase field, which fixes g, is known only after the strain is.

``elements`` (n_el, k) corner numbers; ``slope`` (n_el, n_gauss, k, 2) gradients of the shape functions [1/length];
``volume`` (n_el, n_gauss) weight times thickness. Local unknowns are ordered node by node, x before y.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from physics.elasticity import MaterialTable
from physics.energy_splits import inlined_response
from physics.phase_field import degradation, expected_change

#: points that one thread takes at a time
CHUNK = 4096


class ElementLaw(NamedTuple):
    """Code of the split and in-plane Lamé constants [stress] of the one body."""

    split: int
    lam: float
    mu: float

    @classmethod
    def of(cls, materials: MaterialTable) -> ElementLaw:
        """The law of the first body."""
        return cls(int(materials.law.split[0]), float(materials.lame_lambda[0]), float(materials.shear_modulus[0]))


class Strain(NamedTuple):
    """What follows from the displacement alone: its gradient (n_el, n_gauss, 4), the parts of the stress that are
    degraded and not (n_el, n_gauss, 3), and those of the energy (n_el, n_gauss, 2)."""

    gradient: NDArray
    plus: NDArray
    minus: NDArray
    psi: NDArray

    @classmethod
    def zero(cls, shape: tuple[int, int]) -> Strain:
        """No strain at points (n_el, n_gauss)."""
        return cls(np.zeros((*shape, 4)), np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.zeros((*shape, 2)))


def evaluate_strain(elements: NDArray, slope: NDArray, displacement: NDArray, law: ElementLaw, strain: Strain) -> None:
    """The strain of a displacement (n_nodes, 2), and what follows from it."""
    _displacement_gradients(elements, slope, displacement, strain.gradient)
    gradient, plus, minus, psi = (part.reshape(-1, part.shape[-1]) for part in strain)
    _stress_parts(law.split)(gradient, law.lam, law.mu, plus, minus, psi)


@njit(cache=True, parallel=True)
def _displacement_gradients(elements, slope, displacement, gradient):
    for e in prange(elements.shape[0]):
        for q in range(slope.shape[1]):
            xx = xy = yx = yy = 0.0
            for a in range(elements.shape[1]):
                ux, uy = displacement[elements[e, a], 0], displacement[elements[e, a], 1]
                xx += slope[e, q, a, 0] * ux
                xy += slope[e, q, a, 1] * ux
                yx += slope[e, q, a, 0] * uy
                yy += slope[e, q, a, 1] * uy
            gradient[e, q, 0], gradient[e, q, 1], gradient[e, q, 2], gradient[e, q, 3] = xx, xy, yx, yy


@cache
def _stress_parts(split: int) -> Callable[..., None]:
    """The loop by the split of this code, known to the compiler, which takes several points at once then."""

    @njit(cache=True, parallel=True, error_model="numpy")
    def stress_parts(gradient, lam, mu, plus, minus, psi):
        """Parts of the stress (n, 3) and the energy (n, 2) for displacement gradients (n, 4)."""
        for chunk in prange((len(gradient) + CHUNK - 1) // CHUNK):
            for p in range(chunk * CHUNK, min(len(gradient), (chunk + 1) * CHUNK)):
                xx, yy, xy = gradient[p, 0], gradient[p, 3], gradient[p, 1] + gradient[p, 2]
                kept = inlined_response(split, 0.0, xx, yy, xy, lam, mu)
                whole = inlined_response(split, 1.0, xx, yy, xy, lam, mu)
                minus[p, 0], minus[p, 1], minus[p, 2] = kept.sxx, kept.syy, kept.sxy
                plus[p, 0], plus[p, 1] = whole.sxx - kept.sxx, whole.syy - kept.syy
                plus[p, 2] = whole.sxy - kept.sxy
                psi[p, 0], psi[p, 1] = whole.psi_plus, whole.psi_minus

    return stress_parts


@njit(cache=True, parallel=True)
def element_forces(slope, volume, phase_field, residual_stiffness, strain, force):
    """Forces (n_el, 2k) of the stress degraded by the phase field (n_el, n_gauss)."""
    plus, minus = strain.plus, strain.minus
    for e in prange(slope.shape[0]):
        force[e, :] = 0.0
        for q in range(slope.shape[1]):
            g = degradation(phase_field[e, q], residual_stiffness[e])
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
def raise_history(psi, committed, phase_field, solved_for, drive, resistance, irreversible, history, change):
    """History field (n_el, n_gauss), and the largest change of the phase field to expect in each element (n_el,).

    ``solved_for`` (n_el, n_gauss) is the history field for which the phase field was solved.
    """
    for e in prange(psi.shape[0]):
        largest = 0.0
        for q in range(psi.shape[1]):
            value = psi[e, q, 0]
            if irreversible and committed[e, q] > value:
                value = committed[e, q]
            history[e, q] = value
            largest = max(largest, expected_change(phase_field[e, q], value, solved_for[e, q], drive[e], resistance[e]))
        change[e] = largest
