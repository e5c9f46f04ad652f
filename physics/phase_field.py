"""Degradation, crack density and the history field of the phase field (thesis 2.6.2 and 5.2).

The phase field c is 1 where the material is intact and 0 where it is broken. Solvers use the variational
form of Eq. 2.58, weighted by Gc / (2 l0), so that bodies of different toughness can meet:

    [2 (1 - k_f) H + Gc / (2 l0)] c  -  div(2 Gc l0 grad c)  +  2 Gc l0^3 gamma_ijkl c,ijkl  =  Gc / (2 l0)

whose last term on the left is that of materials of order 4 alone. That is the functional AT2. With AT1 (Pham et al.
2011, doi 10.1177/1056789510386852; their length is 2 l0) it is, under the bound c <= 1,

    2 (1 - k_f) H c  -  div(3/2 Gc l0 grad c)  =  3 Gc / (16 l0)
"""

from __future__ import annotations

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from cases import Case

from .broken import BROKEN
from .elasticity import MaterialTable


@register_jitable
def degradation(phase_field: NDArray, residual_stiffness: NDArray | float) -> NDArray:
    """g = (1 - k_f) c^2 + k_f, Eq. 2.48; for arrays, and for one point in compiled loops."""
    return (1.0 - residual_stiffness) * phase_field**2 + residual_stiffness


@register_jitable
def crack_density(
    phase_field: NDArray, gradient_squared: NDArray, length_scale: NDArray, curvature_squared: NDArray | float = 0.0
) -> NDArray:
    """Z_c = (c - 1)^2 / (4 l0) + l0 |grad c|^2 + l0^3 gamma_ijkl c,ij c,kl [1/length], Eqs. 2.46 and 5.3.

    ``curvature_squared`` (n,) is the quadratic form gamma_ijkl c,ij c,kl [1/length^4].
    """
    density = (phase_field - 1.0) ** 2 / (4.0 * length_scale) + length_scale * gradient_squared
    return density + length_scale**3 * curvature_squared


def linear_crack_density(phase_field: NDArray, gradient_squared: NDArray, length_scale: NDArray) -> NDArray:
    """Z_c = 3 (1 - c) / (16 l0) + 3/4 l0 |grad c|^2 [1/length] of the functional AT1."""
    return 3.0 * (1.0 - phase_field) / (16.0 * length_scale) + 0.75 * length_scale * gradient_squared


@register_jitable
def expected_change(phase_field, history_field, solved_for, drive, resistance):
    """How much the phase field, found for one history field [stress], would change for another where it has no gradient.

    drive, resistance [stress] : as in `PhaseFieldCoefficients`.
    """
    return drive * abs(history_field - solved_for) * phase_field / (drive * history_field + resistance)


@register_jitable
def breaks_now(phase_field, broken_at):
    """Whether a crack has reached a point that had not broken before; ``broken_at`` is the time when it did, or NaN."""
    return (phase_field < BROKEN) & np.isnan(broken_at)


def update_history(committed: NDArray, tensile_energy: NDArray) -> NDArray:
    """H = max over time of psi_plus (Eq. 2.59) [stress]."""
    return np.maximum(committed, tensile_energy)


class PhaseFieldCoefficients:
    """Coefficients of the phase field equation at the points of one discretisation, all (n,)."""

    def __init__(self, materials: MaterialTable, body: NDArray) -> None:
        self.toughness = materials.toughness[body]
        self.length_scale = materials.length_scale[body]
        self.residual_stiffness = materials.residual_stiffness[body]
        self.drive = np.where(materials.breakable[body], 2.0 * (1.0 - self.residual_stiffness), 0.0)
        self.is_linear = materials.is_linear[body]
        share = np.where(self.is_linear, 3.0 / 16.0, 0.5)
        self.resistance = share * self.toughness / self.length_scale
        self.diffusion = np.where(self.is_linear, 1.5, 2.0) * self.toughness * self.length_scale
        #: what is there of the reaction without history field [stress]
        self._at_rest = np.where(self.is_linear, 0.0, self.resistance)
        self._any_linear = bool(np.any(self.is_linear))
        self.bending = np.where(materials.fourth_order[body], 2.0 * self.toughness * self.length_scale**3, 0.0)

    def reaction(self, history_field: NDArray) -> NDArray:
        """Factor of c in the equation [stress], from the history field (n,) [stress]."""
        return self.drive * history_field + self._at_rest

    def energy_density(self, value: NDArray, slope_squared: NDArray, curvature_squared: NDArray) -> NDArray:
        """Gc times the crack density [stress], the arguments those of `crack_density`."""
        quadratic = crack_density(value, slope_squared, self.length_scale, curvature_squared)
        if not self._any_linear:
            return self.toughness * quadratic
        linear = linear_crack_density(value, slope_squared, self.length_scale)
        return self.toughness * np.where(self.is_linear, linear, quadratic)


def initial_history(
    case: Case, points: NDArray, toughness: NDArray | float, length_scale: NDArray | float
) -> NDArray:
    """History field (...) [stress] of the notches of kind "history" at points (..., 2), zero elsewhere.

    toughness, length_scale : of the points' material, (...) or one for all.
    """
    history_field = np.zeros(points.shape[:-1])
    for notch in case.notches:
        if notch.kind == "history":
            start, end = np.array(notch.start, float), np.array(notch.end, float)
            crack = notch_history(points, start, end, notch.factor, toughness, length_scale)
            history_field = np.maximum(history_field, crack)
    return history_field


def notch_history(
    points: NDArray,
    start: NDArray,
    end: NDArray,
    factor: float,
    toughness: NDArray | float,
    length_scale: NDArray | float,
) -> NDArray:
    """Initial history field (...) [stress] that stands for a crack from start to end, Eq. 6.51, at points (..., 2).

    H = B Gc / (4 l0) (1 - d / l0) within the distance l0 of the segment, 0 beyond.
    """
    direction = end - start
    along = np.clip((points - start) @ direction / (direction @ direction), 0.0, 1.0)
    distance = np.linalg.norm(points - start - along[..., None] * direction, axis=-1)
    return factor * toughness / (4.0 * length_scale) * np.maximum(0.0, 1.0 - distance / length_scale)
