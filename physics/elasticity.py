"""Plane elasticity: in-plane Lamé constants of plane strain and plane stress, and stiffness with a direction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.material import Material
from cases.splits import ROOTED_SPLITS
from physics.splits import GAMMA, SPLIT_CODES

from .surface_energy import curvature_operator, rotation


def in_plane_first_lame(lame_lambda: float, shear_modulus: float, assumption: str) -> float:
    """First Lamé constant that acts on in-plane strains [stress].

    Plane strain keeps lambda; plane stress condenses the free out-of-plane strain:
    lambda* = 2 lambda mu / (lambda + 2 mu).
    """
    if assumption == "strain":
        return lame_lambda
    return 2.0 * lame_lambda * shear_modulus / (lame_lambda + 2.0 * shear_modulus)


def in_plane_stiffness(material: Material, assumption: str) -> NDArray:
    """Matrix C (3, 3) from strains xx, yy, engineering xy to stresses xx, yy, xy [stress]."""
    if material.stiffness is None:
        lam, mu = in_plane_first_lame(material.lam, material.mu, assumption), material.mu
        return np.array([[lam + 2 * mu, lam, 0.0], [lam, lam + 2 * mu, 0.0], [0.0, 0.0, mu]])
    # stresses turn as second derivatives do
    back = rotation(-np.radians(material.stiffness.orientation))
    return back @ material.stiffness.matrix() @ back.T


def energy_root(stiffness: NDArray) -> NDArray:
    """Matrix R (3, 3) with strain~ = R strain, both xx, yy, engineering xy, whose squares are twice the energy.

    It is C^(1/2) of He and Shao (2019, doi 10.1115/1.4042217), there in an orthonormal basis of the strains.
    """
    mandel = np.array([1.0, 1.0, np.sqrt(2.0)])
    eigenvalues, vectors = np.linalg.eigh(stiffness * np.outer(mandel, mandel))
    root = (vectors * np.sqrt(eigenvalues)) @ vectors.T
    return root * np.outer(mandel, 1.0 / mandel)


class Law(NamedTuple):
    """Elastic laws as arrays over bodies, as compiled loops take them.

    ``split`` is a code of ``SPLIT_CODES`` and ``lam``, ``mu`` [stress] are in-plane constants. Where a body
    ``is_rooted``, the split acts on strain~ = R strain, with lambda = 0 and mu = 1/2, and stress = R^T stress~;
    ``root`` (n_bodies, 3, 3) is R of ``energy_root``.
    """

    split: NDArray
    is_rooted: NDArray
    lam: NDArray
    mu: NDArray
    root: NDArray

    @classmethod
    def isotropic(cls, split: str, lam: float, mu: float) -> Law:
        """The law of one isotropic body, for the splits that need no root."""
        code, root = np.array([SPLIT_CODES[split]]), np.zeros((1, 3, 3))
        return cls(code, np.array([False]), np.array([lam]), np.array([mu]), root)

    @classmethod
    def rooted(cls, split: str, stiffness: NDArray) -> Law:
        """The law of one body of any stiffness C (3, 3), split after its strain~ (He and Shao 2019)."""
        code, root = np.array([SPLIT_CODES[split]]), energy_root(stiffness)[None]
        return cls(code, np.array([True]), np.zeros(1), np.full(1, 0.5), root)

    @classmethod
    def of(cls, material: Material, assumption: str) -> Law:
        """The law of a material in a plane case."""
        split = material.fracture.split if material.fracture else "none"
        if material.is_anisotropic or split in ROOTED_SPLITS:
            return cls.rooted(split, in_plane_stiffness(material, assumption))
        return cls.isotropic(split, in_plane_first_lame(material.lam, material.mu, assumption), material.mu)

    def without_split(self) -> Law:
        """The same stiffnesses with all energy degraded."""
        return self._replace(split=np.full_like(self.split, SPLIT_CODES["none"]))


class MaterialTable:
    """Material constants of each body, as arrays indexed by body number (order of ``case.bodies``).

    ``stiffness`` (n_bodies, 3, 3) takes in-plane strains to stresses in the axes x and y; ``lame_lambda`` and
    ``shear_modulus`` are the in-plane constants of isotropic bodies, not a number for others. Bodies that cannot break
    have ``breakable`` False and harmless placeholders for toughness and length scale; a static case may give no
    density. ``is_linear`` are those of the functional AT1. ``curvature`` (n_bodies, 3, 3) are the operators of
    `curvature_operator`, zero but where ``fourth_order``.
    """

    def __init__(self, case: Case) -> None:
        materials = [case.materials[body.material] for body in case.bodies.values()]
        fractures = [material.fracture for material in materials]
        assumption = case.plane.assumption
        self.law = Law(*map(np.concatenate, zip(*(Law.of(m, assumption) for m in materials), strict=True)))
        self.stiffness = np.array([in_plane_stiffness(material, assumption) for material in materials])
        isotropic = ~np.array([material.is_anisotropic for material in materials])
        self.lame_lambda = np.where(isotropic, self.stiffness[:, 0, 1], np.nan)
        self.shear_modulus = np.where(isotropic, self.stiffness[:, 2, 2], np.nan)
        #: in-plane lambda and mu (n_bodies,) of states that can be stiffest, for bounds of time steps: whole, and torn
        #: under pressure, where the star-convex split is stiffer than what is whole
        self.stiffest = [(self.lame_lambda, self.shear_modulus)]
        hardens = np.array([f is not None and f.split == "star_convex" for f in fractures])
        if hardens.any():
            torn = (1.0 + GAMMA) * (self.lame_lambda + self.shear_modulus)
            pair = np.where(hardens, torn, self.lame_lambda), np.where(hardens, 0.0, self.shear_modulus)
            self.stiffest.append(pair)
        self.density = np.array([m.density or 0.0 for m in materials])
        self.breakable = np.array([f is not None for f in fractures])
        self.toughness = np.array([f.toughness if f else 1.0 for f in fractures])
        self.length_scale = np.array([f.length_scale if f else 1.0 for f in fractures])
        self.residual_stiffness = np.array([f.residual_stiffness if f else 0.0 for f in fractures])
        self.is_linear = np.array([f is not None and f.functional == "AT1" for f in fractures])
        self.fourth_order = np.array([f is not None and f.order == 4 for f in fractures])
        self.curvature = np.array([curvature_operator(f) for f in fractures])
