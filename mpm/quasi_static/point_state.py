"""What material points and grid hold between two steps and within one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from numerics.newton import load_ratio
from numerics.phase_field_equation import ScalarAtPoints
from numerics.refinement import carried


class Places(NamedTuple):
    """Where and in which direction (0 or 1) a body is held: positions (n, 2), component (n,)."""

    positions: NDArray
    component: NDArray


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

    @classmethod
    def first(
        cls, positions: NDArray, history_field: NDArray, nodal: NDArray, sizes: tuple[int, int], load: float
    ) -> PointState:
        """Whole, unloaded material; ``sizes`` are the numbers of springs and of tied places."""
        return cls(
            positions=positions.copy(),
            displacement=np.zeros((len(positions), 2)),
            gradient=np.zeros((len(positions), 4)),
            phase_field=np.ones(len(positions)),
            history_field=history_field,
            nodal_phase_field=nodal,
            so_far=np.zeros((len(nodal), 2)),
            held=np.zeros(sizes[0]),
            tied=np.zeros(sizes[1]),
            load=load,
        )

    def carried(self, origin: NDArray, fresh: PointState, held: Places, nodes: NDArray) -> PointState:
        """This state of points that began at ``origin`` (m, 2) as that of ``fresh`` ones, which have not moved yet.

        held : places of the springs. nodes : (n_nodes, 2) of the grid of the fresh points.
        """
        nearest, displacement = carried(fresh.positions, origin, self.displacement, self.gradient)
        of_springs = carried(held.positions, origin, self.displacement, self.gradient)[1]
        return replace(
            self,
            positions=fresh.positions,
            displacement=displacement,
            gradient=self.gradient[nearest],
            phase_field=self.phase_field[nearest],
            history_field=self.history_field[nearest],
            nodal_phase_field=fresh.nodal_phase_field,
            so_far=carried(nodes, origin, self.displacement, self.gradient)[1],
            held=of_springs[np.arange(len(of_springs)), held.component],
            tied=self.tied.copy(),
        )


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

    def go_to(self, load: float, so_far: NDArray) -> None:
        """Begin with a new load: with the displacement of the grid's nodes so far (n_nodes, 2) grown with it."""
        if load != self.load:
            further = load_ratio(load, self.load) - 1.0
            self.increment += further * so_far
            self.tied = (1.0 + further) * self.tied
            self.load = load

    def committed(self, before: PointState, displacement: NDArray, held: NDArray) -> PointState:
        """The state with what has changed since the one before; displacements (n_points, 2) and (n_springs,)."""
        return replace(
            before,
            displacement=displacement,
            gradient=self.gradient.copy(),
            phase_field=self.at_points.value.copy(),
            nodal_phase_field=self.nodal_phase_field,
            so_far=before.so_far + self.increment,
            held=held,
            tied=self.tied,
            load=self.load,
            # not before: a load step starts from a jump whose forces say nothing
            force_scale=max(before.force_scale, self.applied),
        )
