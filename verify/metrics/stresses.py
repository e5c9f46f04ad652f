"""Stress and stress intensity at a place, over the nominal stress of the load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physics.exact_plates import COMPONENTS, plane_modulus
from verify.metrics.energy_release import energy_release_rate as release_rate
from verify.metrics.metric import MetricError, history_column, metric, require_stored, run_name

if TYPE_CHECKING:
    from verify.metrics.metric import RunData


@metric("stress", "stress at a place")
def stress_at(run: RunData, *, at: Sequence[float], component: str, radius: float, u: float) -> float:
    """Mean stress of the points within ``radius`` [length] of the place (2,), in the snapshot nearest to u [length, in
    dynamics time].

    component : "xx", "yy" or "xy".
    """
    return _mean_stress(run, _state(run, u)[1], at, component, radius)


@metric("number", "stress at a place over the load on a nominal section")
def stress_concentration(
    run: RunData, *, at: Sequence[float], component: str, section: float, radius: float, u: float
) -> float:
    """The metric stress_at over F / (section * thickness); section [length]."""
    data, force = _loaded_state(run, u)
    return _mean_stress(run, data, at, component, radius) * section * run.case.plane.thickness / force


@metric("number", "K_I over the nominal stress times sqrt(pi a)")
def geometry_factor(
    run: RunData, *, tip: Sequence[float], direction: Sequence[float], length: float, section: float,
    inner: float, outer: float, u: float,
) -> float:  # fmt: skip
    """sqrt(J E') / (F / (section * thickness) sqrt(pi length)), in the snapshot nearest to u [length].

    tip, direction, inner, outer : as in `energy_release_rate`. length : a, half of an inner crack [length].
    """
    data, force = _loaded_state(run, u)
    nominal = force / (section * run.case.plane.thickness)
    release = release_rate(
        np.asarray(data["reference"])[:, :2], np.asarray(data["volume"]), run.case.plane.thickness,
        np.asarray(data["stress"]), np.asarray(data["gradient"]), np.asarray(data["energy_density"]),
        tip, inner, outer, direction,
    )  # fmt: skip
    material = next(iter(run.case.materials.values()))
    intensity = np.sqrt(max(release, 0.0) * plane_modulus(material, run.case.plane.assumption))
    return float(intensity / (abs(nominal) * np.sqrt(np.pi * length)))


def _state(run: RunData, wanted: float) -> tuple[float, Mapping[str, NDArray]]:
    """Displacement, in dynamics time, and data of the points of the snapshot nearest to a wanted one."""
    u, _, points = min(run.snapshots(), key=lambda snapshot: abs(snapshot[0] - wanted))
    require_stored(run, u, wanted)
    return u, points.point_data


def _loaded_state(run: RunData, wanted: float) -> tuple[Mapping[str, NDArray], float]:
    """Data of the points, and force, in the snapshot nearest to a displacement."""
    if run.case.dynamics is not None:
        said = "moves in time, and has no force on a section"
        raise MetricError(f"{run_name(run)}: {said}; ask for stress_at, or in a quasi-static case")
    u, data = _state(run, wanted)
    force = float(np.interp(u, history_column(run, "u"), history_column(run, "F")))
    if force == 0.0:
        raise MetricError(f"{run_name(run)}: carries nothing at u = {u:g}; name an output.snapshots with load on it")
    return data, force


def _mean_stress(run: RunData, data: Mapping[str, NDArray], at: Sequence[float], component: str, radius: float) -> float:
    if component not in COMPONENTS:
        raise MetricError(f"{run_name(run)}: has no stress {component!r}; give one of {', '.join(COMPONENTS)}")
    near = np.linalg.norm(np.asarray(data["reference"])[:, :2] - np.asarray(at), axis=1) <= radius
    if not near.any():
        raise MetricError(f"{run_name(run)}: has no point within {radius:g} of {tuple(at)}; enlarge the radius")
    stress = np.asarray(data["stress"])[near, COMPONENTS.index(component)]
    return float(np.average(stress, weights=np.asarray(data["volume"])[near]))
