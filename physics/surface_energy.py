"""Fracture energy with a direction: the fourth-order crack density and its surface energy (thesis 5.2, appendix C).

The crack density is that of the second order plus l0³ v·γ v with v = (c,11, c,22, c,12) in the material's axes. Angles
are counter-clockwise: the crack runs along (cos θ, sin θ) and the material's axis 1 along (cos φ, sin φ). The thesis
prints rotation matrices that turn clockwise (Eqs. 5.7, 5.39, C.13), so that its φ is -φ here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cases.material import Fracture
from physics.roots import root

#: directions over half a turn between which extremes and changes of sign are looked for
_SAMPLES = 1440
#: relative difference of energies that are equal but for round-off
_SAME_ENERGY = 1e-9
#: share of γ's largest entry below which γ_θ is round-off
_NO_GAMMA = 1e-14


def rotation(angle: float) -> NDArray:
    """Matrix (3, 3) that gives (c,11, c,22, c,12) in axes turned by an angle [radian] from x and y (Eq. 5.38)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c * c, s * s, 2 * c * s], [s * s, c * c, -2 * c * s], [-c * s, c * s, c * c - s * s]])


def curvature_operator(fracture: Fracture | None) -> NDArray:
    """Matrix B (3, 3) with |B v|² = v'·γ v' for v = (c,xx, c,yy, c,xy) and v' the same in the material's axes.

    Zero for materials of order 2 and for those that cannot break.
    """
    if fracture is None or fracture.order == 2:
        return np.zeros((3, 3))
    eigenvalues, vectors = np.linalg.eigh(fracture.gamma.matrix())
    root = np.sqrt(np.maximum(eigenvalues, 0.0))[:, None] * vectors.T
    return root @ rotation(np.radians(fracture.orientation))


def profile(distance: ArrayLike, gamma: float) -> tuple[NDArray, NDArray, NDArray]:
    """c, c' and c'' beside a crack at distances (n,) in units of l0: the exact solution of Eqs. 5.10-5.11.

    ``gamma`` is γ_θ; derivatives are with respect to the distance in units of l0. For γ_θ = 0 it is that of the
    second order, whose slope jumps at the crack.
    """
    x = np.abs(np.asarray(distance, dtype=float))
    sign = np.where(np.asarray(distance, dtype=float) < 0.0, -1.0, 1.0)
    if gamma == 0.0:
        rest = np.exp(-0.5 * x)
        return 1.0 - rest, 0.5 * sign * rest, -0.25 * rest
    # 1 - c = exp(-a x) (cosh(b x) + a sinh(b x) / b), from the roots a ± b of 1 - 4 s² + 4 γ s⁴ = 0
    product = 0.5 / np.sqrt(gamma)
    a = 0.5 * np.sqrt(1.0 / gamma + 2.0 * product)
    b = np.sqrt(complex(a * a - product)) or complex(np.finfo(float).tiny)
    slow, difference = np.exp((b - a) * x), np.expm1(-2.0 * b * x)
    even, odd = slow * (1.0 + 0.5 * difference), -0.5 * slow * difference / b
    value = 1.0 - even - a * odd
    slope = product * odd
    bend = product * (even - a * odd)
    return value.real, sign * slope.real, bend.real


@dataclass(frozen=True)
class SurfaceEnergy:
    """𝒢c(θ) of a material with its orientation; angles θ in radian.

    Attributes
    ----------
    toughness : the factor of the crack density, Ḡc [force/length].
    gamma : (3, 3) matrix of Eq. 5.5 in the axes x and y.
    """

    toughness: float
    gamma: NDArray

    @classmethod
    def of(cls, fracture: Fracture) -> SurfaceEnergy:
        """The surface energy of a material."""
        operator = curvature_operator(fracture)
        return cls(fracture.toughness, operator.T @ operator)

    def directional_gamma(self, theta: ArrayLike) -> NDArray:
        """γ_θ (n,) of a crack along θ (Eq. 5.9)."""
        return self._derivatives(theta)[0]

    def _derivatives(self, theta: ArrayLike) -> tuple[NDArray, NDArray, NDArray]:
        """γ_θ and its first two derivatives, all (n,): m·γ m with m = (sin², cos², -sin cos)."""
        double = 2.0 * np.asarray(theta, dtype=float)
        cosine, sine = np.cos(double), np.sin(double)
        m = 0.5 * np.stack([1.0 - cosine, 1.0 + cosine, -sine])
        first = np.stack([sine, -sine, -cosine])
        second = 2.0 * np.stack([cosine, -cosine, sine])

        def form(a: NDArray, b: NDArray) -> NDArray:
            return np.einsum("i...,ij,j...->...", a, self.gamma, b)

        return np.maximum(form(m, m), 0.0), 2.0 * form(first, m), 2.0 * (form(first, first) + form(second, m))

    def energy(self, theta: ArrayLike) -> NDArray:
        """𝒢c(θ) = Ḡc sqrt(1 + sqrt(γ_θ)) (n,) [force/length]: Eq. 5.17 of the exact profile."""
        return self.toughness * np.sqrt(1.0 + np.sqrt(self.directional_gamma(theta)))

    def stiffness(self, theta: ArrayLike) -> NDArray:
        """Surface stiffness 𝒢c'' + 𝒢c (n,) [force/length] (Eq. 5.18); negative where a crack is forbidden.

        Infinite where γ_θ is zero without being so everywhere: 𝒢c has a kink there, such as that of a weakest direction.
        """
        gamma, first, second = self._derivatives(theta)
        if not self.gamma.any():
            return self.energy(theta)
        is_kink = gamma <= _NO_GAMMA * np.abs(self.gamma).max()
        root = np.sqrt(np.where(is_kink, 1.0, gamma))
        f = np.sqrt(1.0 + root)
        slope = 0.25 / (root * f)
        bend = -slope * (0.5 / root**2 + 0.25 / (root * f * f))
        return np.where(is_kink, np.inf, self.toughness * (slope * second + bend * first**2 + f))

    def extremes(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Least and largest 𝒢c over all directions: (𝒢c, θ) of each, θ in [0, π)."""
        stationary = self._stationary_directions()
        energies = self.energy(stationary)
        least, largest = int(np.argmin(energies)), int(np.argmax(energies))
        return (float(energies[least]), float(stationary[least])), (float(energies[largest]), float(stationary[largest]))

    def weak_directions(self) -> NDArray:
        """Directions θ (n,) in [0, π) of the least 𝒢c; all of them stationary ones."""
        stationary = self._stationary_directions()
        energies = self.energy(stationary)
        return stationary[energies <= energies.min() * (1.0 + _SAME_ENERGY)]

    def _stationary_directions(self) -> NDArray:
        theta = np.arange(_SAMPLES) * np.pi / _SAMPLES
        return np.unique(np.concatenate([[0.0], _zeros(lambda t: self._derivatives(t)[1], theta)]))

    def forbidden(self) -> list[tuple[float, float]]:
        """Intervals of θ within [0, π] in which no crack runs, because the surface stiffness is negative."""
        theta = np.arange(_SAMPLES) * np.pi / _SAMPLES
        ends = _zeros(self.stiffness, theta)
        bounds = np.concatenate([[0.0], ends, [np.pi]])
        middles = 0.5 * (bounds[1:] + bounds[:-1])
        return [
            (float(a), float(b))
            for a, b, middle in zip(bounds[:-1], bounds[1:], middles, strict=True)
            if b > a and self.stiffness(middle) < 0.0
        ]

    @property
    def is_convex(self) -> bool:
        """The polar plot of 1/𝒢c is convex: no direction is forbidden."""
        return not self.forbidden()


def _zeros(function, samples: NDArray) -> NDArray:
    """Zeros (n,) of a function of period π: samples that are zero, and changes of sign between samples."""
    ends = np.append(samples, np.pi)
    values = function(ends)
    crossing = np.flatnonzero(values[:-1] * values[1:] < 0.0)
    between = [root(function, ends[i], ends[i + 1]) for i in crossing]
    return np.sort(np.concatenate([samples[values[:-1] == 0.0], between]))


#: functional -> what cells of size h raise the toughness by, over the toughness: in words, and at h = l0
RAISED = {"AT2": ("h / (4 l0)", 0.25), "AT1": ("3 h / (16 l0)", 3.0 / 16.0)}


def seen_toughness(fracture: Fracture, h: float) -> float:
    """Gc (1 + h / (4 l0)): what cells of size h make of the toughness (Bourdin, Francfort and Marigo 2008).

    With AT1 it is Gc (1 + 3 h / (16 l0)).
    """
    return fracture.toughness * (1.0 + RAISED[fracture.functional][1] * h / fracture.length_scale)
