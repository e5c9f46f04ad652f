"""Closed forms of plates: a disc pressed along its diameter, cracks in plates and strips."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cases import Case
from cases.material import Material

from .elasticity import in_plane_stiffness
from .surface_energy import seen_toughness

#: of a stress, in the order of its entries
COMPONENTS = ("xx", "yy", "xy")


def plane_modulus(material: Material, assumption: str) -> float:
    """E' = K^2 / G: Young's modulus in plane stress, E / (1 - nu^2) in plane strain [stress]."""
    young = material.young_modulus
    return young if assumption == "stress" else young / (1.0 - material.poisson_ratio**2)


def bar_strength(material: Material) -> float:
    """Largest stress of a bar whose energy is all degraded [stress].

    With AT2 9/16 sqrt(E Gc / (6 l0)), where c = 3/4; with AT1 sqrt(3 E Gc / (16 l0)), up to which c = 1.
    """
    assert material.fracture is not None
    fracture = material.fracture
    if fracture.functional == "AT1":
        return float(np.sqrt(3.0 * material.young_modulus * fracture.toughness / (16.0 * fracture.length_scale)))
    return 9.0 / 16.0 * float(np.sqrt(material.young_modulus * fracture.toughness / (6.0 * fracture.length_scale)))


def pressed_disc_stress(points: NDArray, force: float, radius: float, thickness: float) -> NDArray:
    """Stress (n, 3) xx, yy, xy at points (n, 2) of a disc about the origin that two forces press along y.

    Two half planes under a force each, and an even tension that frees the rim (Timoshenko and Goodier, Theory of
    Elasticity, 3rd ed., section 41).
    """
    stress = np.zeros((len(points), 3))
    for sign in (1.0, -1.0):
        x, depth = points[:, 0], radius - sign * points[:, 1]
        factor = -2.0 * force / (np.pi * thickness * (x**2 + depth**2) ** 2)
        stress += factor[:, None] * np.column_stack([x**2 * depth, depth**3, -sign * x * depth**2])
    return stress + force / (np.pi * radius * thickness) * np.array([1.0, 1.0, 0.0])


def disc_concentration(
    case: Case, *, at: Sequence[float], component: str, section: float, radius: float, u: float
) -> float:
    """The metric stress_concentration of the case's disc under two line loads."""
    lower, upper = case.bounding_box()
    middle, disc_radius = (lower + upper) / 2.0, float(upper[0] - lower[0]) / 2.0
    stress = pressed_disc_stress(np.array([at]) - middle, 1.0, disc_radius, 1.0)
    return float(stress[0, COMPONENTS.index(component)]) * section


def disc_strength(case: Case) -> float:
    """Force at which the tension across the disc's middle, 2 P / (pi D t), is the strength of a bar."""
    lower, upper = case.bounding_box()
    strength = bar_strength(next(iter(case.materials.values())))
    return strength * np.pi / 2.0 * float(upper[0] - lower[0]) * case.plane.thickness


def double_edge_factor(share: float) -> float:
    """K_I / (stress sqrt(pi a)) of a long plate of width 2 b with a crack of a = share * b from either edge.

    Tada, Paris and Irwin, The Stress Analysis of Cracks Handbook (2000), section 2.6, within 0.5 % for any share.
    """
    polynomial = 1.122 - 0.561 * share - 0.205 * share**2 + 0.471 * share**3 - 0.190 * share**4
    return polynomial / float(np.sqrt(1.0 - share))


def _double_edge_share(case: Case) -> tuple[float, float]:
    """Length a of the notches [length], and over half of the plate's width."""
    lower, upper = case.bounding_box()
    return case.notches[0].length, 2.0 * case.notches[0].length / float(upper[0] - lower[0])


def double_edge_geometry_factor(case: Case, **_: float | Sequence[float]) -> float:
    """The metric geometry_factor at either tip."""
    return double_edge_factor(_double_edge_share(case)[1])


def double_edge_strength(case: Case) -> float:
    """Force at which the plate's energy release rate is the toughness that the mesh sees."""
    material = next(iter(case.materials.values()))
    assert material.fracture is not None
    lower, upper = case.bounding_box()
    length, share = _double_edge_share(case)
    toughness = seen_toughness(material.fracture, case.mesh.h)
    intensity = np.sqrt(toughness * plane_modulus(material, case.plane.assumption))
    stress = intensity / (double_edge_factor(share) * np.sqrt(np.pi * length))
    return float(stress * (upper[0] - lower[0]) * case.plane.thickness)


def _strip_tension(case: Case) -> float:
    """Tension across the uncracked strip [stress], whose bodies lie on each other, all of them held along it."""
    compliance = 0.0
    for body in case.bodies.values():
        lower, upper = body.bounds()
        stiffness = in_plane_stiffness(case.materials[body.material], case.plane.assumption)
        compliance += float(upper[1] - lower[1]) / stiffness[1, 1]
    return case.load.path[-1] / compliance


def strip_release_rate(case: Case, **_: float | Sequence[float]) -> float:
    """Energy release rate of a crack along a long strip with clamped edges [force/length].

    The energy of a length of strip far ahead of the crack, none of which is left far behind it (Rivlin and Thomas 1953,
    doi 10.1002/pol.1953.120100303); seams along the crack change nothing of it.
    """
    return 0.5 * _strip_tension(case) * case.load.path[-1]


def strip_stress(case: Case, *, at: Sequence[float], component: str, **_: float) -> float:
    """Stress far ahead of the crack [stress]."""
    body = list(case.bodies.values())[case.inside([at])[0]]
    stiffness = in_plane_stiffness(case.materials[body.material], case.plane.assumption)
    return float(stiffness[COMPONENTS.index(component), 1] / stiffness[1, 1]) * _strip_tension(case)
