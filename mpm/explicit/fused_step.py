"""Algorithm 3 for all bodies of a case in compiled code, and many steps of it in one call."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.extending import overload
from numpy.typing import NDArray

from mpm.explicit.fused_contact import ContactState, ListedPairs, detect, exchange, exchange_with_rigid
from mpm.explicit.listed_arrays import (
    ListedArrays, arms_of, elastic_of, fastest_of, gradient_of, matter_of, motion_of, strips_of, sums_of, velocities_of,
)  # fmt: skip
from mpm.explicit.prescribed import hold
from mpm.explicit.rigid_body import put_points
from mpm.explicit.rigid_contact import FREE, KEPT, OWN_MASS
from mpm.explicit.transfers import DRIFT, PointUpdate, carried, transfers, trial_velocities

#: no line has lost its body
NO_LINE = -1


class ListedBodies(NamedTuple):
    """Bodies (n,) as compiled steps take them.

    Attributes
    ----------
    arrays : rows as ``listed_arrays`` names them. kinds : what carries their nodes, as of ``rigid_contact``.
    widths : nodes of their windows in y. corner, first_node : (n, 2) of these in the lattice, and its place [length].
    laws : (n, 2) in-plane Lamé constants. kept_velocities : (n, 2) of those that keep theirs.
    unmapped : those that are to be mapped to the grid; a body at rest is there once for each window.
    wandered : (n, 2) how far, and the largest speed, as of ``Wandering``. lag : (n, 2).
    velocity, before, place : (n, 3) of free rigid bodies after and before the step; inverses : (n, 2); reach : of their
        points from the centre [length].
    """

    arrays: ListedArrays
    kinds: NDArray
    widths: NDArray
    corner: NDArray
    first_node: NDArray
    laws: NDArray
    kept_velocities: NDArray
    unmapped: NDArray
    wandered: NDArray
    lag: NDArray
    velocity: NDArray
    before: NDArray
    place: NDArray
    inverses: NDArray
    reach: NDArray


class ListedLines(NamedTuple):
    """Lines (n,) on which a component of a body's velocity is prescribed; line n has the rows from ``first[n]`` on."""

    bodies: NDArray
    components: NDArray
    strides: NDArray
    cells: NDArray
    rows: NDArray
    first: NDArray


class Driving(NamedTuple):
    """What acts in each step: acceleration (n_steps, 2) of the frame, damping (n_steps,), and of each line its velocity and
    place in its body's window (n_steps, n_lines), in cells."""

    acceleration: NDArray
    damping: NDArray
    velocities: NDArray
    places: NDArray


class Scheme(NamedTuple):
    """How a case is integrated: spacing, origin (2,) of the lattice, share of FLIP, whether strains turn, 1 where momenta are
    affine, whether strains come last and gaps are measured; sweeps over the pairs, whether the frame accelerates bodies."""

    h: float
    origin: NDArray
    flip: float
    corotational: bool
    affine: float
    updates_last: bool
    by_distance: bool
    sweeps: int
    accelerates: bool


# ---------------------------------------------------------------- points to nodes


def map_to_grid(k, bodies, scheme, body):
    """Mass, momentum and minus internal forces of a body to the nodes; k = order + 1."""


@overload(map_to_grid, prefer_literal=True)
def _map_to_grid(k, bodies, scheme, body):
    to_grid = transfers(k.literal_value - 1).to_grid

    def mapped(k, bodies, scheme, body):
        a = bodies.arrays
        to_grid(
            strips_of(a, body), motion_of(a, body), matter_of(a, body), gradient_of(a, body), elastic_of(a, body),
            scheme.h, scheme.affine, bodies.widths[body], sums_of(a, body),
        )  # fmt: skip

    return mapped


def map_masses(k, bodies, body):
    """Mass of a body to the nodes."""


@overload(map_masses, prefer_literal=True)
def _map_masses(k, bodies, body):
    masses = transfers(k.literal_value - 1).masses

    def mapped(k, bodies, body):
        a = bodies.arrays
        masses(strips_of(a, body), motion_of(a, body), matter_of(a, body), bodies.widths[body], sums_of(a, body).m)

    return mapped


@njit
def momentum_to_velocities(bodies, body):
    """Velocities of the nodes from their momenta (MUSL)."""
    (m, fields), velocities = sums_of(bodies.arrays, body), velocities_of(bodies.arrays, body)
    for node in range(len(m)):
        over = 1.0 / m[node] if m[node] > 0.0 else 0.0
        velocities.vx[node], velocities.vy[node] = fields[4 * node] * over, fields[4 * node + 1] * over


# ---------------------------------------------------------------- nodes


@njit
def find_trial_velocities(bodies, body, step, gravity_x, gravity_y, damping):
    """Velocities of a body or its nodes without contact after the step."""
    if bodies.kinds[body] == FREE:
        bodies.before[body] = bodies.velocity[body]
        for n in range(3):
            pull = gravity_x if n == 0 else gravity_y if n == 1 else 0.0
            bodies.velocity[body, n] += step * (pull - damping * bodies.velocity[body, n])
        return
    if bodies.kinds[body] == KEPT:
        gravity_x = gravity_y = 0.0
    velocities = velocities_of(bodies.arrays, body)
    trial_velocities(
        bodies.widths[body], step, gravity_x, gravity_y, damping, sums_of(bodies.arrays, body), velocities
    )
    if bodies.kinds[body] == KEPT:
        velocities.vx[:], velocities.vy[:] = bodies.kept_velocities[body, 0], bodies.kept_velocities[body, 1]


@njit
def hold_lines(k, bodies, lines, velocities, places, impulses):
    """Prescribe velocities and add the impulses that it takes; the first line that has lost its body, or `NO_LINE`."""
    for n in range(len(lines.bodies)):
        cell = int(np.floor(places[n] + 1e-9))
        held, impulse = False, 0.0
        if 0 <= cell < lines.cells[n]:
            m, nodes = sums_of(bodies.arrays, lines.bodies[n]).m, velocities_of(bodies.arrays, lines.bodies[n])
            held, impulse = hold(
                lines.rows[lines.first[n] : lines.first[n + 1]], cell * lines.strides[n], lines.strides[n], k - 1,
                places[n] - cell, m, nodes.vx if lines.components[n] == 0 else nodes.vy, velocities[n],
            )  # fmt: skip
        if not held:
            return n
        impulses[n] += impulse
    return NO_LINE


@njit
def carried_by(bodies, body):
    """What a body carries over the step: ``Carried`` as six numbers."""
    if bodies.kinds[body] != FREE:
        return carried(sums_of(bodies.arrays, body).m, velocities_of(bodies.arrays, body))
    mass, inertia = 1.0 / bodies.inverses[body, 0], 1.0 / bodies.inverses[body, 1]
    now, before = bodies.velocity[body], bodies.before[body]
    damped = mass * (now[0] * before[0]) + mass * (now[1] * before[1]) + inertia * (now[2] * before[2])
    return mass, mass * before[0], mass * before[1], mass * now[0], mass * now[1], damped


@njit
def count_work(bodies, scheme, step, acceleration, damping, impulses, velocities, work):
    """Outer work and power (2,) of lines, damping and frame; lets the middle of each body go with its mean velocity."""
    n_bodies, damped, given = len(bodies.kinds), 0.0, 0.0
    sums = np.zeros((n_bodies, 6))
    if scheme.accelerates or damping != 0.0:
        for body in range(n_bodies):
            if bodies.kinds[body] != KEPT:
                found = carried_by(bodies, body)
                for n in range(len(found)):
                    sums[body, n] = found[n]
                damped += found[5]
    for n in range(len(impulses)):
        given += impulses[n] * velocities[n]
    given += step * (0.0 - damping * damped)
    work[0] += given
    work[1] = given / step
    if not scheme.accelerates:
        return
    for body in range(n_bodies):
        if bodies.kinds[body] != KEPT:
            mass, before, after = sums[body, 0], sums[body, 1:3], sums[body, 3:5]
            for n in range(2):
                bodies.lag[body, n] = 0.5 * (after[n] - before[n]) / mass
            pulled = acceleration[0] * (before[0] + after[0]) + acceleration[1] * (before[1] + after[1])
            work[0] += 0.5 * step * pulled


# ---------------------------------------------------------------- nodes to points


def move_points(k, bodies, scheme, body, step, with_velocities, with_strains):
    """Points of a deforming body follow the nodes; k = order + 1."""


@overload(move_points, prefer_literal=True)
def _move_points(k, bodies, scheme, body, step, with_velocities, with_strains):
    to_points = transfers(k.literal_value - 1).to_points

    def moved(k, bodies, scheme, body, step, with_velocities, with_strains):
        a, factor, fastest = bodies.arrays, step / scheme.h, fastest_of(bodies.arrays, body)
        affine = scheme.affine / scheme.h
        update = PointUpdate(
            factor, scheme.flip, scheme.corotational, affine, with_velocities, with_strains, True,
            bodies.laws[body, 0], bodies.laws[body, 1], bodies.lag[body, 0], bodies.lag[body, 1],
        )  # fmt: skip
        to_points(
            strips_of(a, body), velocities_of(a, body), bodies.widths[body], update, motion_of(a, body),
            gradient_of(a, body), elastic_of(a, body), fastest,
        )  # fmt: skip
        if with_velocities:
            bodies.wandered[body, 1] = np.sqrt(fastest.max())
            bodies.wandered[body, 0] += factor * bodies.wandered[body, 1]

    return moved


@njit
def move_rigid(bodies, scheme, body, step):
    """New places of a body that does not deform."""
    motion, wandered = motion_of(bodies.arrays, body), bodies.wandered[body]
    if bodies.kinds[body] == KEPT:
        speed_x, speed_y = bodies.kept_velocities[body, 0], bodies.kept_velocities[body, 1]
        for p in range(len(motion.x)):
            motion.x[p] += step / scheme.h * speed_x
            motion.y[p] += step / scheme.h * speed_y
        wandered[0] += step / scheme.h * max(abs(speed_x), abs(speed_y))
        return
    place, velocity, lag = bodies.place[body], bodies.velocity[body], bodies.lag[body]
    for n in range(3):
        place[n] += step * (velocity[n] - (lag[n] if n < 2 else 0.0))
    centre, spin = (place[:2] - scheme.origin) / scheme.h - bodies.corner[body], velocity[2]
    put_points(arms_of(bodies.arrays, body), centre, place[2], velocity, scheme.h, motion)
    gradient = gradient_of(bodies.arrays, body)
    gradient.cxy[:], gradient.cyx[:] = -spin, spin
    wandered[1] = np.hypot(velocity[0], velocity[1]) + abs(spin) * bodies.reach[body]
    wandered[0] += step / scheme.h * wandered[1]


# ---------------------------------------------------------------- steps


@njit
def is_sorted(bodies, h, step):
    """No point can leave the cells around that in which it was sorted in this step."""
    for body in range(len(bodies.kinds)):
        move = step / h * bodies.wandered[body, 1]
        if not move <= DRIFT or bodies.wandered[body, 0] + 1.5 * move > DRIFT:
            return False
    return True


def map_bodies(k, with_rigid, bodies, scheme):
    """All bodies to the grid."""


@overload(map_bodies, prefer_literal=True)
def _map_bodies(k, with_rigid, bodies, scheme):
    count, rigid = k.literal_value, with_rigid.literal_value

    def mapped(k, with_rigid, bodies, scheme):
        for body in range(len(bodies.kinds)):
            if rigid and bodies.kinds[body] == FREE:
                map_masses(count, bodies, body)
            elif bodies.unmapped[body]:
                map_to_grid(count, bodies, scheme, body)
                at_rest = bodies.kept_velocities[body, 0] == 0.0 and bodies.kept_velocities[body, 1] == 0.0
                bodies.unmapped[body] = bodies.kinds[body] != KEPT or not at_rest

    return mapped


def move_bodies(k, with_rigid, bodies, scheme, lines, velocities, places, impulses, step):
    """Velocities, places, strains and stresses of all points; the first line that has lost its body, or `NO_LINE`."""


@overload(move_bodies, prefer_literal=True)
def _move_bodies(k, with_rigid, bodies, scheme, lines, velocities, places, impulses, step):
    count = k.literal_value

    def moved(k, with_rigid, bodies, scheme, lines, velocities, places, impulses, step):
        for body in range(len(bodies.kinds)):
            if bodies.kinds[body] == OWN_MASS:
                move_points(count, bodies, scheme, body, step, True, not scheme.updates_last)
            else:
                move_rigid(bodies, scheme, body, step)
        if not scheme.updates_last:
            return NO_LINE
        for body in range(len(bodies.kinds)):
            if bodies.kinds[body] == OWN_MASS:
                map_to_grid(count, bodies, scheme, body)
                momentum_to_velocities(bodies, body)
        lost = hold_lines(k, bodies, lines, velocities, places, impulses)
        if lost == NO_LINE:
            for body in range(len(bodies.kinds)):
                if bodies.kinds[body] == OWN_MASS:
                    move_points(count, bodies, scheme, body, step, False, True)
        return lost

    return moved


@cache
def steps_of(order: int, with_rigid: bool) -> Any:
    """Compiled steps for splines of an order, with or without bodies that move freely as rigid ones."""
    return _steps(order + 1, with_rigid)


def _steps(k, with_rigid):
    @njit(cache=True)
    def steps(bodies, pairs, contact, lines, driving, scheme, step, work):
        """Steps until all are done, points are to be sorted anew, or a line has lost its body.

        Returns the number of steps done and the line, or `NO_LINE`. ``work`` (2,) takes the work from outside and its power.
        """
        impulses = np.zeros(len(lines.bodies))
        for n in range(len(driving.damping)):
            if n > 0 and not is_sorted(bodies, scheme.h, step):
                return n, NO_LINE
            acceleration, damping, velocities, places = (
                driving.acceleration[n], driving.damping[n], driving.velocities[n], driving.places[n],
            )  # fmt: skip
            map_bodies(k, with_rigid, bodies, scheme)
            for body in range(len(bodies.kinds)):
                find_trial_velocities(bodies, body, step, acceleration[0], acceleration[1], damping)
            impulses[:] = 0.0
            lost = hold_lines(k, bodies, lines, velocities, places, impulses)
            if lost != NO_LINE:
                return n, lost
            detect(k, bodies, pairs, scheme.h, scheme.by_distance)
            if with_rigid:
                exchange_with_rigid(bodies, pairs, scheme.h, step, scheme.sweeps, contact)
            else:
                exchange(bodies, pairs, scheme.h, step, scheme.sweeps, contact)
            lost = hold_lines(k, bodies, lines, velocities, places, impulses)
            if lost != NO_LINE:
                return n, lost
            count_work(bodies, scheme, step, acceleration, damping, impulses, velocities, work)
            lost = move_bodies(k, with_rigid, bodies, scheme, lines, velocities, places, impulses, step)
            if lost != NO_LINE:
                return n, lost
        return len(driving.damping), NO_LINE

    return steps
