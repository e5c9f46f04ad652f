"""The nodes of a mesh in motion: their mass, what pulls at them and what holds them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cases import Case
from fem_reference.boundary import NodeConstraints
from fem_reference.element_basis import ElementBasis
from fem_reference.explicit.strain_and_forces import Strain, element_forces, gather_at_nodes
from fem_reference.tractions import traction_forces
from physics.moving_frame import MovingFrame


@dataclass
class NodalMotion:
    """Displacement, velocity and last increment of the displacement, all (n_nodes, 2).

    The velocity belongs to a time that is ``ahead`` before that of the displacement.
    """

    displacement: NDArray
    velocity: NDArray
    moved: NDArray
    ahead: float = 0.0

    def arrays(self) -> dict[str, NDArray]:
        """Its arrays by name, for a checkpoint."""
        return {"displacement": self.displacement, "velocity": self.velocity, "moved": self.moved}

    @classmethod
    def of(cls, saved: Mapping[str, NDArray], ahead: float) -> NodalMotion:
        """From copies of its arrays by name."""
        return cls(saved["displacement"].copy(), saved["velocity"].copy(), saved["moved"].copy(), ahead)


class MovingNodes:
    """Equations of motion of the nodes.

    Attributes
    ----------
    mass : (n_nodes,) row sums.
    held : (n_nodes, 2) components whose velocity is prescribed, at the start as ``held_velocity`` (n_nodes, 2).
    inner_forces, applied, acceleration : (n_nodes, 2) at the time for which forces were last evaluated.
    """

    def __init__(self, case: Case, basis: ElementBasis, density: NDArray, constraints: NodeConstraints) -> None:
        """``density`` (n_el,)."""
        assert case.dynamics is not None
        n_nodes, corners = len(basis.nodes), basis.elements.ravel()
        self._basis, self._frame, self._damping = basis, MovingFrame(case), 0.0
        (self._body,) = case.bodies
        self._corners = np.argsort(corners, kind="stable")
        self._starts = np.searchsorted(corners[self._corners], np.arange(n_nodes + 1))
        share = np.einsum("qa,eq->ea", basis.shape, basis.volume) * density[:, None]
        self.mass = np.bincount(corners, weights=share.ravel(), minlength=n_nodes)
        self.held = constraints.prescribed.reshape(-1, 2)
        self.held_velocity = constraints.prescribed_velocity().reshape(-1, 2)
        self._constraints = constraints
        self.loaded_edges = traction_forces(case, basis)
        self.inner_forces, self.applied = np.zeros((n_nodes, 2)), np.zeros((n_nodes, 2))
        self.acceleration = np.zeros((n_nodes, 2))
        self._element_forces = np.empty((len(basis.elements), 2 * basis.elements.shape[1]))

    def evaluate_forces(self, strain: Strain, phase_field: NDArray, residual_stiffness: NDArray, now: float) -> None:
        """Forces and acceleration from the strain and the phase field (n_el, n_gauss) of a time."""
        basis, local = self._basis, self._element_forces
        element_forces(basis.slope, basis.volume, phase_field, residual_stiffness, strain, local)
        gather_at_nodes(self._starts, self._corners, local, self.inner_forces)
        pulls = sum(edge.traction.share(now) * edge.forces for edge in self.loaded_edges)
        self.applied = self.mass[:, None] * self._frame.acceleration(now) + pulls
        self._damping = self._frame.damping(now)
        self.acceleration = (self.applied - self.inner_forces) / self.mass[:, None]
        self.acceleration[self.held] = 0.0

    def with_held(self, velocity: NDArray, start: float, end: float) -> tuple[NDArray, float]:
        """Velocity (n_nodes, 2) with what tables prescribe between two times, and the work that this takes [energy]."""
        after = velocity.copy()
        self._constraints.prescribe_velocity(after.reshape(-1), start, end)
        return after, 0.5 * float((self.mass[:, None] * (after**2 - velocity**2)).sum())

    def velocity_after(self, velocity: NDArray, interval: float) -> NDArray:
        """Velocity (n_nodes, 2) an interval after another one, damped by the mean of both; what is held keeps its own."""
        loss = 0.5 * self._damping * interval
        kept, gained = (1.0 - loss) / (1.0 + loss), interval / (1.0 + loss)
        return np.where(self.held, velocity, kept * velocity + gained * self.acceleration)

    def outer_forces(self, velocity: NDArray) -> NDArray:
        """External forces, damping and reactions included (n_nodes, 2), but for those that change held velocities."""
        free = self.applied
        if self._damping:
            free = free - self._damping * self.mass[:, None] * velocity
        return np.where(self.held, self.inner_forces, free)

    def as_a_whole(self, displacement: NDArray, velocity: NDArray) -> dict[str, float]:
        """Columns of the body's motion: centre of mass [length], momentum, and angular velocity [1/time]."""
        mass = self.mass[:, None]
        middle, momentum = ((mass * of).sum(axis=0) for of in (self._basis.nodes + displacement, velocity))
        middle = middle / mass.sum()
        x, y = (self._basis.nodes + displacement - middle).T
        spin = (self.mass * (x * velocity[:, 1] - y * velocity[:, 0])).sum() / (self.mass * (x**2 + y**2)).sum()
        values = {"x": middle[0], "y": middle[1], "momentum_x": momentum[0], "momentum_y": momentum[1], "spin": spin}
        return {f"{self._body}_{key}": float(value) for key, value in values.items()}
