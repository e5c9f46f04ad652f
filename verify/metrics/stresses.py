"""Stress and stress intensity at a place, over the nominal stress of the load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray

from cases.geometry import SAME_LINE
from physics.exact_plates import COMPONENTS, plane_modulus
from verify.metrics.metric import MetricError, history_column, metric, require_stored, run_name
from verify.metrics.release import release_rate

if TYPE_CHECKING:
    from cases.material import Material
    from verify.metrics.metric import RunData

#: share of a load by which another one is the same: that much stress is off
SAME_LOAD = 0.01


@metric("stress", "stress at a place")
def stress_at(run: RunData, *, at: Sequence[float], component: str, radius: float, u: float) -> float:
    """Mean stress of the points within ``radius`` [length] of the place (2,), in the snapshot at u [length, in dynamics
    time].

    component : "xx", "yy" or "xy".
    """
    stored, data = _state(run, u)
    if run.case.dynamics is None and abs(stored - u) > SAME_LOAD * abs(u):
        said = f"has no stress at u = {u:g}, which no increment reaches; the nearest is of u = {stored:g}"
        raise MetricError(f"{run_name(run)}: {said}; make {u:g} a point of load.path, or name another u")
    return _mean_stress(run, data, at, component, radius)


@metric("number", "stress at a place over the load on a nominal section")
def stress_concentration(
    run: RunData, *, at: Sequence[float], component: str, section: float, radius: float, u: float
) -> float:
    """The metric stress_at over force / (section * thickness); section [length].

    The force is that of the one boundary that the load moves.
    """
    data, force, _ = _loaded_state(run, u)
    return _mean_stress(run, data, at, component, radius) * section * run.case.plane.thickness / force


@metric("number", "K_I over the nominal stress times sqrt(pi a)")
def geometry_factor(
    run: RunData, *, tip: Sequence[float], direction: Sequence[float], length: float, section: float,
    inner: float, outer: float, u: float,
) -> float:  # fmt: skip
    """sqrt(J E') / (force / (section * thickness) sqrt(pi length)), in the snapshot nearest to u [length].

    The force is that of the one boundary that the load moves.

    tip, direction, inner, outer : as in `energy_release_rate`. length : a, half of an inner crack [length].
    """
    data, force, at = _loaded_state(run, u)
    nominal = force / (section * run.case.plane.thickness)
    release = release_rate(data, run.case, at, tip, direction, inner, outer)
    material = _material_at(run, tip)
    intensity = np.sqrt(max(release, 0.0) * plane_modulus(material, run.case.plane.assumption))
    return float(intensity / (abs(nominal) * np.sqrt(np.pi * length)))


def _state(run: RunData, wanted: float) -> tuple[float, Mapping[str, NDArray]]:
    """Displacement, in dynamics time, and data of the points of the snapshot nearest to a wanted one."""
    u, _, points = min(run.snapshots(), key=lambda snapshot: abs(snapshot[0] - wanted))
    require_stored(run, u, wanted)
    return u, points.point_data


def _material_at(run: RunData, place: Sequence[float]) -> Material:
    """The isotropic material of the bodies at a place, which has one modulus."""
    bodies, slack = list(run.case.bodies.values()), SAME_LINE * run.case.mesh.h
    at = [body for body in bodies if body.outline().distance(shapely.Point(place)) <= slack]
    materials = [run.case.materials[body.material] for body in at or bodies[:1]]
    said = ""
    if any(material.is_anisotropic for material in materials):
        said = f"{(at or bodies)[0].material!r} is anisotropic"
    elif len({(material.young_modulus, material.poisson_ratio) for material in materials}) > 1:
        said = f"the tip at {tuple(place)} lies on a seam of {' and '.join(sorted({body.material for body in at}))}"
    if said:
        raise MetricError(f"{run_name(run)}: {said}, and K_I is no root of J E' there; ask for energy_release_rate")
    return materials[0]


def _loaded_state(run: RunData, wanted: float) -> tuple[Mapping[str, NDArray], float, float]:
    """Data of the points, the force of the one boundary that the load moves, and u in the snapshot nearest to one wanted.

    F does work on u: it is that force times the constraint's scale, and no force of a section where loads act by a factor
    or several boundaries move.
    """
    if run.case.dynamics is not None:
        said = "moves in time, and has no force on a section"
        raise MetricError(f"{run_name(run)}: {said}; ask for stress_at, or in a quasi-static case")
    u, data = _state(run, wanted)
    moved = [c for c in run.case.constraints if c.follows_load]
    if run.case.tractions or run.case.body_forces or run.case.eigenstrains or len(moved) != 1 or not moved[0].scale:
        said = "F is work per u, and the force on a section only where one constraint with a scale is all that acts"
        raise MetricError(f"{run_name(run)}: {said}; ask for stress_at or energy_release_rate, or load it so")
    force = float(np.interp(u, history_column(run, "u"), history_column(run, "F"))) / abs(moved[0].scale)
    if force == 0.0:
        raise MetricError(f"{run_name(run)}: carries nothing at u = {u:g}; name an output.snapshots with load on it")
    return data, force, u


def _mean_stress(run: RunData, data: Mapping[str, NDArray], at: Sequence[float], component: str, radius: float) -> float:
    if component not in COMPONENTS:
        raise MetricError(f"{run_name(run)}: has no stress {component!r}; give one of {', '.join(COMPONENTS)}")
    near = np.linalg.norm(np.asarray(data["reference"])[:, :2] - np.asarray(at), axis=1) <= radius
    if not near.any():
        raise MetricError(f"{run_name(run)}: has no point within {radius:g} of {tuple(at)}; enlarge the radius")
    stress = np.asarray(data["stress"])[near, COMPONENTS.index(component)]
    return float(np.average(stress, weights=np.asarray(data["volume"])[near]))
