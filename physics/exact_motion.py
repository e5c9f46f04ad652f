"""Exact solutions of bodies that move: vibration, rotation, sliding, rolling, line contact.

Functions of a case, and of the parameters that a check gives where they have any.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cases import Case

from .elasticity import in_plane_first_lame

#: stress locked into the spinning disc, over Young's modulus
LOCKED_STRESS = 0.03


def _material(case: Case, body: Any):
    return case.materials[body.material]


def _first(case: Case) -> tuple[Any, Any]:
    """The first body that deforms, and its material."""
    body = next(body for body in case.bodies.values() if body.deforms)
    return body, _material(case, body)


def pressure_wave_speed(case: Case) -> float:
    """sqrt((lambda + 2 mu) / density) of the first body that deforms [length/time]."""
    _, material = _first(case)
    lam = in_plane_first_lame(material.lam, material.mu, case.plane.assumption)
    return float(np.sqrt((lam + 2.0 * material.mu) / material.density))


# --- a bar held at its left end and at its sides, in its first mode ------------------------------------


def bar_period(case: Case) -> float:
    """4 L / c of longitudinal waves; held sides keep the strain uniaxial [time]."""
    lower, upper = _first(case)[0].bounds()
    return 4.0 * float(upper[0] - lower[0]) / pressure_wave_speed(case)


def bar_velocity(case: Case, points: NDArray, time: float) -> NDArray:
    """vx = V sin(pi x / (2 L)), V a ten-thousandth of the wave's speed."""
    lower, upper = _first(case)[0].bounds()
    phase = 0.5 * np.pi * (points[:, 0] - lower[0]) / (upper[0] - lower[0])
    speed = 1e-4 * pressure_wave_speed(case) * np.cos(2.0 * np.pi * time / bar_period(case))
    return np.column_stack([speed * np.sin(phase), np.zeros(len(points))])


# --- a disc that spins steadily, with a stress of its own --------------------------------------------


def spinning_stress(case: Case, points: NDArray, time: float) -> NDArray:
    """Stress (n, 3) of a free disc at constant spin, at the present places: of two parts.

    Locked in it, and turning with it, is the stress of Airy's function S R² (1 - q)² (X² - Y²) with X, Y the places in
    the disc over its radius and q = X² + Y², which leaves the rim free. Inertia adds s (R² - r²) radially and
    s (R² - k r²) round about, s = spin² density (3 - 2 nu) / (8 (1 - nu)), k = (1 + 2 nu) / (3 - 2 nu) (Timoshenko
    and Goodier) in plane strain; in plane stress nu / (1 + nu) takes the place of nu.
    """
    body, material = _first(case)
    assert body.shape is not None and body.shape.disc is not None
    spin, outer = body.velocity_gradient[1][0], body.shape.disc.radius
    arm, nu = points - np.asarray(body.shape.disc.centre), material.poisson_ratio
    nu = nu if case.plane.assumption == "strain" else nu / (1.0 + nu)
    stress = _turned(_locked_stress(_turned_places(arm, -spin * time) / outer), spin * time)
    stress *= LOCKED_STRESS * material.young_modulus
    scale = spin**2 * material.density * (3.0 - 2.0 * nu) / (8.0 * (1.0 - nu))
    r = np.hypot(*arm.T)
    radial, hoop = outer**2 - r**2, outer**2 - (1.0 + 2.0 * nu) / (3.0 - 2.0 * nu) * r**2
    polar = np.column_stack([radial, hoop, np.zeros(len(r))])
    return stress + scale * _turned(polar, np.arctan2(arm[:, 1], arm[:, 0]))


def _locked_stress(places: NDArray) -> NDArray:
    """Stress (n, 3) of Airy's function (1 - q)² (X² - Y²)."""
    x, y = places.T
    rest, waves = 1.0 - x**2 - y**2, x**2 - y**2
    xx = (8.0 * x**2 - 4.0 * rest) * waves - 16.0 * x**2 * rest + 2.0 * rest**2
    yy = (8.0 * y**2 - 4.0 * rest) * waves + 16.0 * y**2 * rest - 2.0 * rest**2
    return np.column_stack([yy, xx, -8.0 * x * y * waves])


def _turned_places(arm: NDArray, angle: float) -> NDArray:
    c, s = np.cos(angle), np.sin(angle)
    return arm @ np.array([[c, s], [-s, c]])


def _turned(stress: NDArray, angle: NDArray | float) -> NDArray:
    """Stress (n, 3) turned by angles counter-clockwise."""
    mean, half, shear = 0.5 * (stress[:, 0] + stress[:, 1]), 0.5 * (stress[:, 0] - stress[:, 1]), stress[:, 2]
    c, s = np.cos(2.0 * angle), np.sin(2.0 * angle)
    turned = c * half - s * shear
    return np.column_stack([mean + turned, mean - turned, s * half + c * shear])


def spinning_displacement(case: Case, points: NDArray, time: float) -> NDArray:
    """Displacement (n, 2) of points (n, 2) of the disc at the start: a rigid turn."""
    body, _ = _first(case)
    assert body.shape is not None and body.shape.disc is not None
    arm = points - np.asarray(body.shape.disc.centre)
    return _turned_places(arm, body.velocity_gradient[1][0] * time) - arm


def spinning_strain(case: Case, points: NDArray, time: float) -> NDArray:
    """Strain (n, 3; xx, yy, engineering xy) of the disc's stress."""
    stress = spinning_stress(case, points, time)
    _, material = _first(case)
    lam, mu = in_plane_first_lame(material.lam, material.mu, case.plane.assumption), material.mu
    trace = (stress[:, 0] + stress[:, 1]) / (2.0 * (lam + mu))
    normal = (stress[:, :2] - lam * trace[:, None]) / (2.0 * mu)
    return np.column_stack([normal, stress[:, 2] / mu])


# --- rigid bodies under gravity on a floor along x -------------------------------------------------------


def _gravity(case: Case) -> tuple[float, float]:
    """Along the floor and into it [length/time²]."""
    assert case.dynamics is not None
    return case.dynamics.gravity[0], -case.dynamics.gravity[1]


def _friction(case: Case, body: str) -> float:
    """Coulomb's coefficient between a body and the floor, which is the rigid one."""
    floor = next((number for number, other in enumerate(case.bodies.values()) if other.keeps_velocity), 0)
    return case.friction(list(case.bodies).index(body), floor)


def sliding_distance(case: Case, *, body: str, time: float, direction: str = "x") -> float:
    """Of a block: it stays where gravity along the floor is below friction, else (g_x - mu g_y) t² / 2, with what
    its velocity at the start adds until friction has stopped it; alike to the left [length]."""
    if direction != "x":
        return 0.0  # it stays on the floor
    along, into = _gravity(case)
    resistance = _friction(case, body) * into
    start = case.bodies[body].velocity[0]
    way = -1.0 if (start or along) < 0.0 else 1.0
    start, along = way * start, way * along
    if start == 0.0:
        return way * 0.5 * max(0.0, along - resistance) * time**2
    stop = start / (resistance - along) if resistance > along else np.inf
    moving = min(time, stop)
    back = 0.5 * max(0.0, -along - resistance) * (time - moving) ** 2  # uphill, where friction does not hold it
    return way * (start * moving + 0.5 * (along - resistance) * moving**2 - back)


def rolling_distance(case: Case, *, body: str, time: float, direction: str = "x") -> float:
    """Of a cylinder on an incline, whose gravity is turned with it (Eq. 6.50) [length]."""
    if direction != "x":
        return 0.0  # it stays on the floor
    along, into = _gravity(case)
    way, along = np.copysign(1.0, along), abs(along)
    if along > 3.0 * _friction(case, body) * into:
        return float(way * (0.5 * time**2 * (along - _friction(case, body) * into)))
    return float(way * (along * time**2 / 3.0))


def rolling_spin(case: Case, *, body: str, time: float) -> float:
    """Angular velocity of the cylinder, clockwise negative: 2 mu g_y t / R where it slips, else v / R [1/time]."""
    along, into = _gravity(case)
    shape = case.bodies[body].shape
    assert shape is not None and shape.disc is not None
    way, along, friction = np.copysign(1.0, along), abs(along), _friction(case, body)
    rate = 2.0 * friction * into if along > 3.0 * friction * into else 2.0 * along / 3.0
    return float(-way * (rate * time / shape.disc.radius))


# --- a cylinder that rests on a rigid floor ------------------------------------------------------------------


def _line_load(case: Case) -> tuple[float, float, float]:
    """Weight over thickness [force/length], radius, and E' of a cylinder on a rigid floor; E' = E in plane stress."""
    body, material = _first(case)
    assert body.shape is not None and body.shape.disc is not None
    radius = body.shape.disc.radius
    weight = material.density * np.pi * radius**2 * _gravity(case)[1]
    squared = material.poisson_ratio**2 if case.plane.assumption == "strain" else 0.0
    return weight, radius, material.young_modulus / (1.0 - squared)


def contact_half_width(case: Case) -> float:
    """Hertz's a = sqrt(4 P R / (pi E*)) [length]."""
    weight, radius, stiffness = _line_load(case)
    return float(np.sqrt(4.0 * weight * radius / (np.pi * stiffness)))


def peak_pressure(case: Case) -> float:
    """Hertz's p0 = 2 P / (pi a) [stress]."""
    return 2.0 * _line_load(case)[0] / (np.pi * contact_half_width(case))
