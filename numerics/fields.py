"""The fields that any discretisation shows to the outside: a cloud of integration points and a grid."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import NDArray


@dataclass(frozen=True)
class Fields:
    """State at one load, in case units.

    Integration points are the Gauss points of the FEM or the material points of the MPM.

    Attributes
    ----------
    points, reference : (n, 2) current and initial positions.
    volume : (n,) area times thickness.
    displacement : (n, 2).
    gradient : (n, 4) displacement gradient ux,x ux,y uy,x uy,y.
    phase_field, history_field, energy_density : (n,) c, H and the degraded elastic energy density.
    stress : (n, 3) xx, yy, xy.
    body : (n,) number of the body.
    broken_at : (n,) time at which a point of a moving body broke, NaN where it has not; None in statics.
    grid_points : (m, 2); grid_cells : (k, 3 or 4) corners; grid_displacement : (m, 2), NaN on a grid that carries none;
        grid_phase_field : (m,).
    """

    points: NDArray
    reference: NDArray
    volume: NDArray
    displacement: NDArray
    gradient: NDArray
    phase_field: NDArray
    history_field: NDArray
    stress: NDArray
    energy_density: NDArray
    body: NDArray
    grid_points: NDArray
    grid_cells: NDArray
    grid_displacement: NDArray
    grid_phase_field: NDArray
    broken_at: NDArray | None = None
