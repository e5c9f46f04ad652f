"""Metrics of the waves in a case's materials, which bound the speed of cracks and the time step."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physics import waves
from verify.metrics.metric import MetricError, RunData, metric

if TYPE_CHECKING:
    from cases.material import Material


@metric("velocity", "speed of surface waves")
def rayleigh_speed(run: RunData, *, material: str = "") -> float:
    """Of the material that is named, or of the first one."""
    return waves.rayleigh_speed(_material(run, material))


@metric("time", "time step that waves allow")
def critical_step(run: RunData, *, h: float, share: float = 1.0, material: str = "") -> float:
    """A share of the spacing h over the speed of pressure waves (Eqs. 6.46 to 6.49), of a material as above."""
    return share * h / waves.pressure_speed(_material(run, material))


def _material(run: RunData, name: str) -> Material:
    materials = run.case.materials
    if name and name not in materials:
        raise MetricError(f"case {run.case.name}: has no material {name!r}; name one of {', '.join(materials)}")
    material = materials[name] if name else next(iter(materials.values()))
    if material.density is None or material.is_anisotropic:
        named = name or next(iter(materials))
        raise MetricError(f"case {run.case.name}: material {named!r} must be isotropic and have a density")
    return material
