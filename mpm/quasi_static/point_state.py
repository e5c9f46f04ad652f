"""What material points and grid hold between two steps and within one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from numerics.phase_field_equation import ScalarAtPoints


@dataclass
class PointState:
    """What is carried from step to step.

    positions, displacement : (n_points, 2). gradient : (n_points, 4). phase_field, history_field : (n_points,).
    nodal_phase_field : (n_nodes,). so_far : (n_nodes, 2) displacement that the grid's nodes have given so far: roughly
    the material's there, for a first guess. held : (n_springs,) displacement of the places held.
    tied : (n_tied,) displacement of tied places. force_scale : largest forces applied so far.
    constraint_error : largest one so far.
    """

    positions: NDArray
    displacement: NDArray
    gradient: NDArray
    phase_field: NDArray
    history_field: NDArray
    nodal_phase_field: NDArray
    so_far: NDArray
    held: NDArray
    tied: NDArray
    load: float
    force_scale: float = 0.0
    constraint_error: float = 0.0


@dataclass
class TrialState:
    """What a step works on.

    increment : (n_nodes, 2) of the grid's displacement. gradient, stress : (n_points, 4 and 3). energy : (n_points, 2)
    psi_plus and psi_minus [stress]. nodal_phase_field : (n_nodes,), at_points : the phase field there.
    degradation : (n_points,). tied : (n_tied,). nodal_forces : (2 n_nodes,) out of balance.
    applied : norm of the forces applied.
    """

    increment: NDArray
    gradient: NDArray
    stress: NDArray
    energy: NDArray
    nodal_phase_field: NDArray
    at_points: ScalarAtPoints
    degradation: NDArray
    tied: NDArray
    nodal_forces: NDArray
    load: float
    applied: float = 0.0

    @classmethod
    def of(cls, state: PointState) -> TrialState:
        """The trial state from which nothing has moved yet."""
        n_points, n_nodes = len(state.positions), len(state.so_far)
        return cls(
            increment=np.zeros((n_nodes, 2)),
            gradient=np.zeros((n_points, 4)),
            stress=np.zeros((n_points, 3)),
            energy=np.zeros((n_points, 2)),
            nodal_phase_field=state.nodal_phase_field,
            at_points=ScalarAtPoints.intact(n_points),
            degradation=np.ones(n_points),
            tied=state.tied.copy(),
            nodal_forces=np.zeros(2 * n_nodes),
            load=state.load,
        )
