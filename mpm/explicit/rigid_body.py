"""Bodies that do not deform: those that keep their velocity, and those that move freely (Newton and Euler)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cases import Case
from mpm.explicit.body_motion import BodyMotion
from mpm.explicit.moving_body import Carried, MovingBody
from mpm.explicit.window import GridWindow
from mpm.placement import PointCloud


def make_body(case: Case, number: int, cloud: PointCloud) -> MovingBody:
    """The body of a number, as its case has it move."""
    body = list(case.bodies.values())[number]
    kind = FreeRigidBody if body.is_free_rigid else BodyOfKeptVelocity if body.keeps_velocity else MovingBody
    return kind(case, number, cloud)


class BodyOfKeptVelocity(MovingBody):
    """It keeps its velocity whatever meets it.

    Attributes
    ----------
    velocity : (2,) [length/time].
    """

    deforms, keeps_velocity = False, True

    def __init__(self, case: Case, number: int, cloud: PointCloud) -> None:
        super().__init__(case, number, cloud)
        self.velocity = np.array(list(case.bodies.values())[number].velocity)
        self._mapped: GridWindow | None = None

    def map_to_grid(self) -> None:
        """Mass and momentum to the nodes; once for a body at rest."""
        if self._mapped is not self.window or self.velocity.any():
            self._mapped = self.window
            super().map_to_grid()

    def find_trial_velocities(self, step: float, acceleration: NDArray, damping: float) -> None:
        """Velocities of the nodes before and after the step: the body's."""
        super().find_trial_velocities(step, np.zeros(2), damping)
        velocities = self.window.velocities
        velocities.vx[:], velocities.vy[:] = self.velocity

    def update_points(self, step: float) -> None:
        """New places."""
        motion, h = self.points.motion, self.lattice.h
        motion.x[:] += step / h * self.velocity[0]
        motion.y[:] += step / h * self.velocity[1]
        self.wandering.far += step / h * float(np.abs(self.velocity).max())

    def update_all(self, step: float) -> None:
        """The same: there are no strains."""
        self.update_points(step)


class FreeRigidBody(MovingBody):
    """It moves and turns as gravity, the motion of the ground and contact have it.

    Its points stand where its centre of mass and its angle put them, so that its shape never drifts; nodes have its mass,
    by which contact finds them, and no velocities of their own.

    Attributes
    ----------
    place, velocity : (3,) of the centre of mass x, y [length] and the angle, counter-clockwise [radian], and their rates,
        which contact changes. velocity_before : (3,) the rates before the step.
    inverses : (2,) one over mass and moment of inertia, that of the points' rectangles included.
    reach : of its points from the centre of mass [length].
    """

    deforms = False

    def __init__(self, case: Case, number: int, cloud: PointCloud) -> None:
        super().__init__(case, number, cloud)
        body, matter, places = list(case.bodies.values())[number], self.points.matter, self.positions()
        mass, order = matter.mass.sum(), np.argsort(self.points.number)
        centre = matter.mass @ places / mass
        arms, sizes = places - centre, self.lattice.h * np.column_stack([matter.size_x, matter.size_y])
        inertia = matter.mass @ (arms**2 + sizes**2 / 12.0).sum(axis=1)
        self._numbers, self._arms = self.points.number[order], arms[order]
        self._arms_as_sorted, self._sorted_in = arms, self.window
        self.reach = float(np.hypot(*arms.T).max())
        self.place = np.append(centre, 0.0)
        self.velocity = np.append(body.initial_velocity(centre), body.velocity_gradient[1][0])
        self.inverses, self.velocity_before = 1.0 / np.array([mass, inertia]), self.velocity.copy()
        self._put_points()

    @property
    def angle(self) -> float:
        """By which it has turned, counter-clockwise, over all turns [radian]."""
        return float(self.place[2])

    # ---------------------------------------------------------------- a step

    def map_to_grid(self) -> None:
        """Mass to the nodes."""
        window, points = self.window, self.points
        self.transfers.masses(window.strips, points.motion, points.matter, window.width, window.sums.m)

    def find_trial_velocities(self, step: float, acceleration: NDArray, damping: float) -> None:
        """The body's velocity without contact after the step."""
        self.velocity_before[:] = self.velocity
        self.velocity += step * (np.append(acceleration, 0.0) - damping * self.velocity)

    def update_points(self, step: float) -> None:
        """New places."""
        self.place += step * (self.velocity - np.append(self.lag, 0.0))
        self._put_points()
        self.wandering.far += step / self.lattice.h * self.wandering.largest_speed

    def update_all(self, step: float) -> None:
        """The same: there are no strains."""
        self.update_points(step)

    def arms(self) -> NDArray:
        """From the centre of mass to the points (n, 2) in their present order, when the body is not turned [length]."""
        if self._sorted_in is not self.window:
            self._sorted_in = self.window
            self._arms_as_sorted = self._arms[np.searchsorted(self._numbers, self.points.number)]
        return self._arms_as_sorted

    def _put_points(self) -> None:
        """Places, velocities and velocity gradients of the points from those of the body."""
        points, lattice, spin = self.points, self.lattice, self.velocity[2]
        centre = (self.place[:2] - lattice.origin) / lattice.h - self.window.corner
        put_points(self.arms(), centre, self.place[2], self.velocity, lattice.h, points.motion)
        points.gradient.cxy[:], points.gradient.cyx[:] = -spin, spin
        self.wandering.largest_speed = float(np.hypot(*self.velocity[:2]) + abs(spin) * self.reach)

    # ---------------------------------------------------------------- what can be seen

    def whole_motion(self) -> BodyMotion:
        """Its present motion."""
        mass, inertia = 1.0 / self.inverses
        momentum, spin = mass * self.velocity[:2], float(self.velocity[2])
        energy = 0.5 * (float(momentum @ self.velocity[:2]) + inertia * spin**2)
        return BodyMotion(float(mass), self.place[:2].copy(), momentum, spin, energy)

    def carried(self) -> Carried:
        """As that of other bodies."""
        mass, inertia = 1.0 / self.inverses
        each, now, before = np.array([mass, mass, inertia]), self.velocity, self.velocity_before
        return Carried(float(mass), mass * before[:2], mass * now[:2], float(each @ (now * before)))

    def checkpoint(self) -> dict[str, NDArray]:
        """Everything that the next step needs."""
        return super().checkpoint() | {"place": self.place.copy(), "velocity": self.velocity.copy()}

    def restore(self, saved: Mapping[str, NDArray]) -> None:
        """Go back to a checkpoint."""
        super().restore(saved)
        self.place, self.velocity = saved["place"].copy(), saved["velocity"].copy()


@njit(cache=True)
def put_points(arms, centre, angle, velocity, h, motion):
    """Places, in cells, and velocities of points at arms (n, 2) [length] about the centre (2,) of a body."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y, vx, vy, moved_x, moved_y = motion
    for p in range(len(arms)):
        along = cosine * arms[p, 0] - sine * arms[p, 1]
        aside = sine * arms[p, 0] + cosine * arms[p, 1]
        x[p], y[p] = centre[0] + along / h, centre[1] + aside / h
        vx[p] = moved_x[p] = velocity[0] - velocity[2] * aside
        vy[p] = moved_y[p] = velocity[1] + velocity[2] * along
