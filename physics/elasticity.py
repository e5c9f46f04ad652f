"""Plane elasticity: the in-plane Lamé constants of plane strain and plane stress."""

from __future__ import annotations

import numpy as np

from cases import Case

from .surface_energy import curvature_operator


def in_plane_first_lame(lame_lambda: float, shear_modulus: float, assumption: str) -> float:
    """First Lamé constant that acts on in-plane strains [stress].

    Plane strain keeps lambda; plane stress condenses the free out-of-plane strain:
    lambda* = 2 lambda mu / (lambda + 2 mu).
    """
    if assumption == "strain":
        return lame_lambda
    return 2.0 * lame_lambda * shear_modulus / (lame_lambda + 2.0 * shear_modulus)


class MaterialTable:
    """Material constants of each body, as arrays indexed by body number (order of ``case.bodies``).

    ``lame_lambda`` is the in-plane constant; bodies that cannot break have ``breakable`` False and
    harmless placeholders for toughness and length scale; a static case may give no density. ``curvature``
    (n_bodies, 3, 3) are the operators of `curvature_operator`, zero but where ``fourth_order``.
    """

    def __init__(self, case: Case) -> None:
        materials = [case.materials[body.material] for body in case.bodies.values()]
        fractures = [material.fracture for material in materials]
        assumption = case.plane.assumption
        self.lame_lambda = np.array([in_plane_first_lame(m.lam, m.mu, assumption) for m in materials])
        self.shear_modulus = np.array([m.mu for m in materials])
        self.density = np.array([m.density or 0.0 for m in materials])
        self.breakable = np.array([f is not None for f in fractures])
        self.toughness = np.array([f.toughness if f else 1.0 for f in fractures])
        self.length_scale = np.array([f.length_scale if f else 1.0 for f in fractures])
        self.residual_stiffness = np.array([f.residual_stiffness if f else 0.0 for f in fractures])
        self.fourth_order = np.array([f is not None and f.order == 4 for f in fractures])
        self.curvature = np.array([curvature_operator(f) for f in fractures])
        self.split = np.array([SPLIT_CODES[f.split] if f else SPLIT_CODES["none"] for f in fractures])


SPLIT_CODES = {"none": 0, "volumetric_deviatoric": 1, "spectral": 2}
