"""What quasi-static material points show of their state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mpm.quasi_static.point_basis import PointBasis
from mpm.quasi_static.point_state import PointState, TrialState
from numerics.fields import Fields


def fields_of(state: PointState, trial: TrialState, basis: PointBasis, energy_density: NDArray) -> Fields:
    """Points as they stand and the occupied cells of the grid; ``energy_density`` (n_points,) is degraded [stress]."""
    corners, cells, phase_field = basis.active.corner_values(trial.nodal_phase_field)
    return Fields(
        points=state.positions.copy(),
        reference=basis.cloud.positions,
        volume=basis.cloud.volume,
        displacement=state.displacement.copy(),
        gradient=state.gradient.copy(),
        phase_field=trial.at_points.value.copy(),
        history_field=state.history_field.copy(),
        stress=trial.stress.copy(),
        energy_density=energy_density,
        body=basis.cloud.body,
        grid_points=corners,
        grid_cells=cells,
        grid_displacement=np.full_like(corners, np.nan),
        grid_phase_field=phase_field,
    )
