"""How a body moves as a whole."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from cases import Case
from mpm.explicit.points import Points
from mpm.explicit.window import GridWindow, Lattice
from mpm.grid import GridError
from mpm.placement import PointCloud

if TYPE_CHECKING:
    from mpm.explicit.moving_body import MovingBody

#: least moment of inertia of a body that can spin, over that about the window's corner: less is round-off
LEAST_INERTIA = 1e-14


@dataclass(frozen=True)
class BodyMotion:
    """Mass, centre of mass (2,) [length], momentum (2,), angular velocity [1/time], kinetic energy of a body."""

    mass: float
    place: NDArray
    momentum: NDArray
    spin: float
    energy: float

    @classmethod
    def of_points(cls, window: GridWindow, lattice: Lattice, points: Points) -> BodyMotion:
        """That of points in a window, in one pass over them."""
        parts = np.zeros((len(window.strips) - 1, 8))
        sum_motion(window.strips, points.motion, points.matter.mass, parts)
        mass, x, y, square, momentum_x, momentum_y, turning, energy = parts.sum(axis=0)
        middle = np.array([x, y]) / mass
        inertia = square - mass * float(middle @ middle)
        turning -= float(middle[0] * momentum_y - middle[1] * momentum_x)
        # a single point has no spin
        spin = turning / (lattice.h * inertia) if inertia > LEAST_INERTIA * square else 0.0
        place = lattice.origin + lattice.h * (window.corner + middle)
        return cls(float(mass), place, np.array([momentum_x, momentum_y]), float(spin), float(energy))


def body_angle(body: MovingBody, reference: NDArray, within: NDArray | None = None) -> float:
    """Angle by which a body has turned [rad], counter-clockwise, within ±pi: that of atan2(Σ m X×x, Σ m X·x).

    reference : (n, 2) first places of all points, about whose centre of mass X is, as x about the present one [length].
    within : mask (n,) of the points of the part that is asked for; the whole body without.
    """
    mass = body.points.matter.mass
    if within is not None:
        mass = mass * within[body.points.number]
    first, present = reference[body.points.number], body.positions()
    first, present = (places - (mass @ places) / mass.sum() for places in (first, present))
    cross = first[:, 0] * present[:, 1] - first[:, 1] * present[:, 0]
    return math.atan2(float((mass * cross).sum()), float((mass * (first * present).sum(axis=1)).sum()))


#: body, first places of all points and mask of those in it, as `body_angle` takes them
Region = tuple["MovingBody", NDArray, NDArray]


def regions_of(case: Case, bodies: Sequence[MovingBody], cloud: PointCloud) -> dict[str, Region]:
    """The regions of a case by their names; GridError for one without points."""
    found: dict[str, Region] = {}
    numbers = {name: number for number, name in enumerate(case.bodies)}
    for name, region in case.output.regions.items():
        number = numbers[region.body]
        within = region.within.contains(cloud.positions) & (cloud.body == number)
        if not within.any():
            raise GridError(f"{case.source}: output.regions.{name}.within: no point of {region.body} is there; move it.")
        found[name] = bodies[number], cloud.positions, within
    return found


@njit(cache=True, parallel=True)
def sum_motion(strips, motion, mass, parts):
    """Sums over the points of each strip (n_strips, 8): mass, its moments and second moment about the window's corner,
    momentum, its moment, and kinetic energy; places in cells."""
    x, y, vx, vy = motion.x, motion.y, motion.vx, motion.vy
    for strip in prange(len(strips) - 1):
        m = mx = my = square = px = py = turning = energy = 0.0
        for p in range(strips[strip], strips[strip + 1]):
            one, two = mass[p] * vx[p], mass[p] * vy[p]
            m += mass[p]
            mx += mass[p] * x[p]
            my += mass[p] * y[p]
            square += mass[p] * (x[p] * x[p] + y[p] * y[p])
            px += one
            py += two
            turning += x[p] * two - y[p] * one
            energy += 0.5 * (one * vx[p] + two * vy[p])
        sums = (m, mx, my, square, px, py, turning, energy)
        for k in range(len(sums)):
            parts[strip, k] = sums[k]
