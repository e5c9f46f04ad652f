"""Exact solutions, by the names that case files use (``exact = ...`` and ``motion = ...``)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cases import Case, CaseError

from . import exact_motion, exact_plates
from .elasticity import MaterialTable, in_plane_stiffness
from .surface_energy import SurfaceEnergy, profile

#: a vector or scalar field: (case, points (n, 2), load) -> (n, 2) or (n,)
Field = Callable[[Case, NDArray, float], NDArray]


@dataclass(frozen=True)
class ExactSolution:
    """What is known exactly of a case; None where nothing is.

    ``velocity`` (n, 2) and ``strain`` (n, 3; xx, yy, engineering xy) are those at the start of a dynamic case, whose
    load is the time. ``force`` is (case, load) -> F.
    """

    displacement: Field | None = None
    body_force: Field | None = None
    velocity: Field | None = None
    strain: Field | None = None
    stress: Field | None = None
    phase_field: Field | None = None
    force: Callable[[Case, float], float] | None = None
    fracture_energy: Callable[[Case], float] | None = None
    values: Mapping[str, Callable[..., float]] = field(default_factory=dict)


def _first_material(case: Case):
    return next(iter(case.materials.values()))


def _isotropic_material(case: Case):
    """The first material. Raises CaseError where it has no Young's modulus."""
    name, material = next(iter(case.materials.items()))
    if material.is_anisotropic:
        raise CaseError(
            f"{case.source}: materials.{name}.stiffness: the case's exact solution or motion is that of an isotropic"
            " material; give an isotropic pair, or remove exact and motion."
        )
    return material


def mode_one_displacement(case: Case, points: NDArray, load: float) -> NDArray:
    """Displacement (n, 2) of the mode I field with its tip at (load, 0) and K^2 = E' Gc, of either plane assumption.

    This is the "surfing" boundary condition of Hossain et al. (2014); the crack lies on y = 0, x < load.
    """
    material = _isotropic_material(case)
    mu, nu = material.mu, material.poisson_ratio
    intensity = np.sqrt(material.young_modulus * material.fracture.toughness / (1.0 - nu**2))
    if case.plane.assumption == "stress":
        intensity, nu = np.sqrt(material.young_modulus * material.fracture.toughness), nu / (1.0 + nu)
    x, y = points[:, 0] - load, points[:, 1]
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    factor = intensity / (2.0 * mu) * np.sqrt(radius / (2.0 * np.pi)) * (3.0 - 4.0 * nu - np.cos(angle))
    return np.column_stack([factor * np.cos(0.5 * angle), factor * np.sin(0.5 * angle)])


def _sine_displacement(case: Case, points: NDArray, load: float) -> NDArray:
    """u = load (sin 2 pi x sin pi y, sin pi x sin 2 pi y), zero on the edges of the unit square."""
    x, y = np.pi * points.T
    return load * np.column_stack([np.sin(2 * x) * np.sin(y), np.sin(x) * np.sin(2 * y)])


def _sine_body_force(case: Case, points: NDArray, load: float) -> NDArray:
    """b = -div stress of ``_sine_displacement`` [force / length^3]."""
    c = MaterialTable(case).stiffness[0]
    x, y = np.pi * points.T
    square = np.pi**2 * load
    ux_xx, ux_yy = -4 * square * np.sin(2 * x) * np.sin(y), -square * np.sin(2 * x) * np.sin(y)
    uy_xx, uy_yy = -square * np.sin(x) * np.sin(2 * y), -4 * square * np.sin(x) * np.sin(2 * y)
    ux_xy = 2 * square * np.cos(2 * x) * np.cos(y)
    uy_xy = 2 * square * np.cos(x) * np.cos(2 * y)
    shear = c[0, 1] + c[2, 2]
    bx = c[0, 0] * ux_xx + c[2, 2] * ux_yy + shear * uy_xy + c[0, 2] * (2 * ux_xy + uy_xx) + c[1, 2] * uy_yy
    by = c[1, 1] * uy_yy + c[2, 2] * uy_xx + shear * ux_xy + c[1, 2] * (2 * uy_xy + ux_yy) + c[0, 2] * ux_xx
    return -np.column_stack([bx, by])


#: direction of a crack along y
_UPRIGHT = 0.5 * np.pi


def _crack_profile(case: Case, points: NDArray, load: float) -> NDArray:
    """Phase field beside a crack at x = 0, the end of the bar far away: c = 1 - exp(-x / (2 l0)), or that of order 4.

    With AT1 it is c = 1 - (1 - x / (4 l0))^2, whole from 4 l0 on.
    """
    fracture = _first_material(case).fracture
    if fracture.functional == "AT1":
        return 1.0 - np.maximum(0.0, 1.0 - points[:, 0] / (4.0 * fracture.length_scale)) ** 2
    gamma = float(SurfaceEnergy.of(fracture).directional_gamma(_UPRIGHT))
    return profile(points[:, 0] / fracture.length_scale, gamma)[0]


def _crack_energy(case: Case) -> float:
    """Half of a crack's energy: half its surface energy times its area (the bar's depth times thickness)."""
    lower, upper = case.bounding_box()
    depth = upper[1] - lower[1]
    energy = float(SurfaceEnergy.of(_first_material(case).fracture).energy(_UPRIGHT))
    return 0.5 * energy * depth * case.plane.thickness


def _bar_axis(case: Case) -> int:
    """Along which the bar is pulled."""
    return next((int(c.direction == "y") for c in case.constraints if c.follows_load), 0)


def _bar_strain(case: Case, load: float) -> float:
    lower, upper = case.bounding_box()
    axis = _bar_axis(case)
    return load / (upper[axis] - lower[axis])


def _bar_modulus(case: Case) -> float:
    """Stress over strain under uniaxial stress [stress]; the bar is free to shear, as off-axis ones do."""
    material, axis = _first_material(case), _bar_axis(case)
    if material.is_anisotropic:
        return 1.0 / float(np.linalg.inv(in_plane_stiffness(material, case.plane.assumption))[axis, axis])
    return exact_plates.plane_modulus(material, case.plane.assumption)


def _bar_phase_field(case: Case, load: float) -> float:
    """c = 1 / (1 + 4 l0 H / Gc) with H = (1 - k_f) E' strain^2 / 2, all energy degraded, uniaxial stress.

    With AT1 it is 1 up to H = 3 Gc / (32 l0), that is, to the stress sqrt(3 Gc E / (16 l0)), and falls as 1 / H.
    """
    fracture = _first_material(case).fracture
    if fracture is None:
        return 1.0
    history_field = (1.0 - fracture.residual_stiffness) * (0.5 * _bar_modulus(case) * _bar_strain(case, load) ** 2)
    if fracture.functional == "AT1":
        threshold = 3.0 * fracture.toughness / (32.0 * fracture.length_scale)
        return min(1.0, threshold / history_field) if history_field else 1.0
    return 1.0 / (1.0 + 4.0 * fracture.length_scale * history_field / fracture.toughness)


def _bar_force(case: Case, load: float) -> float:
    """F = ((1 - k_f) c^2 + k_f) E' strain times the cross-section."""
    lower, upper = case.bounding_box()
    across = 1 - _bar_axis(case)
    section = (upper[across] - lower[across]) * case.plane.thickness
    stress = _bar_modulus(case) * _bar_strain(case, load)
    fracture = _first_material(case).fracture
    left = fracture.residual_stiffness if fracture else 0.0
    return ((1.0 - left) * _bar_phase_field(case, load) ** 2 + left) * stress * section


SOLUTIONS: dict[str, ExactSolution] = {
    "elastic_sine": ExactSolution(displacement=_sine_displacement, body_force=_sine_body_force),
    "crack_profile": ExactSolution(phase_field=_crack_profile, fracture_energy=_crack_energy),
    "homogeneous_bar": ExactSolution(force=_bar_force),
    "vibrating_bar": ExactSolution(velocity=exact_motion.bar_velocity, values={"period": exact_motion.bar_period}),
    "spinning_disc": ExactSolution(
        displacement=exact_motion.spinning_displacement, strain=exact_motion.spinning_strain,
        stress=exact_motion.spinning_stress,
    ),
    "sliding_block": ExactSolution(values={"travel": exact_motion.sliding_distance}),
    "brazilian_disc": ExactSolution(
        values={"stress_concentration": exact_plates.disc_concentration, "peak_force": exact_plates.disc_strength}
    ),
    "bimaterial_strip": ExactSolution(
        values={"energy_release_rate": exact_plates.strip_release_rate, "stress_at": exact_plates.strip_stress}
    ),
    "double_edge_notch": ExactSolution(
        values={
            "geometry_factor": exact_plates.double_edge_geometry_factor, "peak_force": exact_plates.double_edge_strength,
        }
    ),
    "line_contact": ExactSolution(
        values={
            "contact_half_width": exact_motion.contact_half_width, "peak_pressure": exact_motion.peak_pressure,
        }
    ),
    "rolling_cylinder": ExactSolution(
        values={"travel": exact_motion.rolling_distance, "angular_velocity": exact_motion.rolling_spin}
    ),
}

MOTIONS: dict[str, Field] = {"mode_one": mode_one_displacement}
