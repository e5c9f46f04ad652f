"""Algorithm 3 for all bodies of a case in compiled code, and many steps of it in one call.

Each function that another one calls is optimised once more with it: those that hold loops over points stand right below
`steps_of`, which takes longest to compile.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.extending import overload
from numpy.typing import NDArray

from mpm.explicit.fused_contact import (
    BEFORE,
    CORNER,
    FAR,
    INVERSES,
    KIND,
    LAG,
    LAW,
    PLACE,
    REACH,
    SPEED,
    UNMAPPED,
    VELOCITY,
    WIDTH,
    count_pair,
    detect,
    exchange,
    meet_pair,
)  # fmt: skip
from mpm.explicit.listed_arrays import ELASTIC, GRADIENT, MATTER, MOTION, SORTING, SUMS, VELOCITIES, group
from mpm.explicit.prescribed import hold
from mpm.explicit.rigid_body import put_points
from mpm.explicit.rigid_contact import FREE, KEPT, OWN_MASS
from mpm.explicit.transfers import DRIFT, PointUpdate, carried, transfers, trial_velocities, work_on_nodes

#: what meets: nothing, two bodies of which none is free and rigid, any bodies
ALONE, PAIR, MANY = range(3)
#: no line has lost its body
NO_LINE = -1
#: columns of ``ListedLines.whole``
BODY, COMPONENT, STRIDE, CELLS, FIRST_ROW, BEHIND_ROWS = range(6)


class ListedLines(NamedTuple):
    """Lines (n,) on which a component of a body's velocity is prescribed: ``whole`` (n, 6) as the columns are named, and
    the first nodes of the ``rows`` of all of them."""

    whole: NDArray
    rows: NDArray


class Driving(NamedTuple):
    """What acts in each step: acceleration (n_steps, 2) of the frame, damping (n_steps,), and of lines velocities and
    places across the windows of their bodies (2, n_lines, n_steps), in cells."""

    acceleration: NDArray
    damping: NDArray
    lines: NDArray


class Scheme(NamedTuple):
    """How a case is integrated: spacing, origin (2,) of the lattice, share of FLIP, whether strains turn, 1 where momenta
    are affine, whether strains come last and gaps are measured, sweeps over the pairs, whether the frame accelerates."""

    h: float
    origin: NDArray
    flip: float
    corotational: bool
    affine: float
    updates_last: bool
    by_distance: bool
    sweeps: int
    accelerates: bool


# ---------------------------------------------------------------- nodes


@njit(cache=True)
def find_trial_velocities(bodies, body, step, gravity_x, gravity_y, damping):
    """Velocities of a body or its nodes without contact after the step."""
    kind = bodies.whole[body, KIND]
    if kind == FREE:
        pull = (gravity_x, gravity_y, 0.0)
        for n in range(3):
            before = bodies.rigid[body, VELOCITY, n]
            bodies.rigid[body, BEFORE, n] = before
            bodies.rigid[body, VELOCITY, n] = before + step * (pull[n] - damping * before)
        return
    if kind == KEPT:
        gravity_x = gravity_y = 0.0
    sums, velocities = group(SUMS, bodies.arrays, body), group(VELOCITIES, bodies.arrays, body)
    trial_velocities(bodies.whole[body, WIDTH], step, gravity_x, gravity_y, damping, sums, velocities)
    if kind == KEPT:
        for node in range(len(velocities.vx)):
            velocities.vx[node] = bodies.kept_velocities[body, 0]
            velocities.vy[node] = bodies.kept_velocities[body, 1]


@njit(cache=True)
def momentum_to_velocities(bodies, body):
    """Velocities of the nodes from their momenta (MUSL)."""
    (m, fields), velocities = group(SUMS, bodies.arrays, body), group(VELOCITIES, bodies.arrays, body)
    for node in range(len(m)):
        over = 1.0 / m[node] if m[node] > 0.0 else 0.0
        velocities.vx[node], velocities.vy[node] = fields[4 * node] * over, fields[4 * node + 1] * over
        velocities.last_x[node], velocities.last_y[node] = velocities.vx[node], velocities.vy[node]


@njit(cache=True)
def hold_lines(order, bodies, lines, driven, now, impulses):
    """Prescribe velocities and add the impulses that it takes; the first line that has lost its body, or `NO_LINE`."""
    for n in range(len(lines.whole)):
        line, velocity, place = lines.whole[n], driven[0, n, now], driven[1, n, now]
        cell = int(np.floor(place + 1e-9))
        held, impulse = False, 0.0
        if 0 <= cell < line[CELLS]:
            m, nodes = group(SUMS, bodies.arrays, line[BODY]).m, group(VELOCITIES, bodies.arrays, line[BODY])
            held, impulse = hold(
                lines.rows[line[FIRST_ROW] : line[BEHIND_ROWS]], cell * line[STRIDE], line[STRIDE], order, place - cell,
                m, nodes.vx if line[COMPONENT] == 0 else nodes.vy, velocity,
            )  # fmt: skip
        if not held:
            return n
        impulses[n] += impulse
    return NO_LINE


@njit(cache=True)
def carried_by(bodies, body, moved):
    """What a body carries over the step: ``Carried`` as six numbers, written to ``moved`` (6,)."""
    if bodies.whole[body, KIND] != FREE:
        m, velocities = group(SUMS, bodies.arrays, body).m, group(VELOCITIES, bodies.arrays, body)
        moved[0], moved[1], moved[2], moved[3], moved[4], moved[5] = carried(m, velocities)
        return
    now, before, inverses = bodies.rigid[body, VELOCITY], bodies.rigid[body, BEFORE], bodies.rigid[body, INVERSES]
    mass, inertia = 1.0 / inverses[0], 1.0 / inverses[1]
    moved[0] = mass
    for n in range(2):
        moved[1 + n], moved[3 + n] = mass * before[n], mass * now[n]
    moved[5] = mass * (now[0] * before[0]) + mass * (now[1] * before[1]) + inertia * (now[2] * before[2])


@njit(cache=True)
def count_work(bodies, accelerates, step, acceleration, damping, impulses, velocities, work):
    """Outer work and power of lines, damping and frame, and work on nodes (3,); lets the middle of each body go with its
    mean velocity."""
    damped, given, on_nodes = 0.0, 0.0, 0.0
    for body in range(len(bodies.whole)):
        if bodies.whole[body, KIND] == OWN_MASS:
            mass = group(SUMS, bodies.arrays, body).m
            on_nodes += work_on_nodes(mass, group(VELOCITIES, bodies.arrays, body))
    work[2] += on_nodes
    for n in range(len(impulses)):
        given += impulses[n] * velocities[n]
    moved = np.empty((len(bodies.whole), 6))
    if accelerates or damping != 0.0:
        for body in range(len(bodies.whole)):
            if bodies.whole[body, KIND] != KEPT:
                carried_by(bodies, body, moved[body])
                damped += moved[body, 5]
    given += step * (0.0 - damping * damped)
    work[0] += given
    work[1] = given / step
    if not accelerates:
        return
    for body in range(len(bodies.whole)):
        if bodies.whole[body, KIND] != KEPT:
            (before_x, before_y), (x, y) = (moved[body, 1], moved[body, 2]), (moved[body, 3], moved[body, 4])
            bodies.numbers[body, LAG] = 0.5 * (x - before_x) / moved[body, 0]
            bodies.numbers[body, LAG + 1] = 0.5 * (y - before_y) / moved[body, 0]
            pulled = acceleration[0] * (before_x + x) + acceleration[1] * (before_y + y)
            work[0] += 0.5 * step * pulled


# ---------------------------------------------------------------- points


@njit(cache=True)
def move_rigid(bodies, scheme, body, step):
    """New places of a body that does not deform."""
    motion, numbers = group(MOTION, bodies.arrays, body), bodies.numbers[body]
    if bodies.whole[body, KIND] == KEPT:
        speed_x, speed_y = bodies.kept_velocities[body, 0], bodies.kept_velocities[body, 1]
        for p in range(len(motion.x)):
            motion.x[p] += step / scheme.h * speed_x
            motion.y[p] += step / scheme.h * speed_y
        numbers[FAR] += step / scheme.h * max(abs(speed_x), abs(speed_y))
        return
    place, velocity, centre = bodies.rigid[body, PLACE], bodies.rigid[body, VELOCITY], np.empty(2)
    for n in range(2):
        place[n] += step * (velocity[n] - numbers[LAG + n])
        centre[n] = (place[n] - scheme.origin[n]) / scheme.h - bodies.whole[body, CORNER + n]
    place[2] += step * velocity[2]
    put_points(group(SORTING, bodies.arrays, body).arms, centre, place[2], velocity, scheme.h, motion)
    gradient = group(GRADIENT, bodies.arrays, body)
    for p in range(len(motion.x)):
        gradient.cxy[p], gradient.cyx[p] = -velocity[2], velocity[2]
    numbers[SPEED] = np.hypot(velocity[0], velocity[1]) + abs(velocity[2]) * numbers[REACH]
    numbers[FAR] += step / scheme.h * numbers[SPEED]


@njit(cache=True)
def is_sorted(bodies, h, step):
    """No point can leave the cells around that in which it was sorted in this step."""
    for body in range(len(bodies.whole)):
        move = step / h * bodies.numbers[body, SPEED]
        if not move <= DRIFT or bodies.numbers[body, FAR] + 1.5 * move > DRIFT:
            return False
    return True


def map_to_grid(k, meeting, bodies, scheme, again):
    """Mass, momentum and minus internal forces of bodies to the nodes; ``again``, of those that deform; k = order + 1."""


@overload(map_to_grid, prefer_literal=True)
def _map_to_grid(k, meeting, bodies, scheme, again):
    loops, rigid = transfers(k.literal_value - 1), meeting.literal_value == MANY
    to_grid, masses = loops.to_grid, loops.masses

    def mapped(k, meeting, bodies, scheme, again):
        for body in range(len(bodies.whole)):
            kind, arrays = bodies.whole[body, KIND], bodies.arrays
            strips, motion = group(SORTING, arrays, body).strips, group(MOTION, arrays, body)
            if rigid and kind == FREE and not again:
                sums = group(SUMS, arrays, body)
                masses(strips, motion, group(MATTER, arrays, body), bodies.whole[body, WIDTH], sums.m)
                continue
            if kind == OWN_MASS or (kind == KEPT and bodies.whole[body, UNMAPPED] == 1 and not again):
                to_grid(
                    strips, motion, group(MATTER, arrays, body), group(GRADIENT, arrays, body),
                    group(ELASTIC, arrays, body), scheme.h, scheme.affine, bodies.whole[body, WIDTH],
                    group(SUMS, arrays, body),
                )  # fmt: skip
                at_rest = bodies.kept_velocities[body, 0] == 0.0 and bodies.kept_velocities[body, 1] == 0.0
                bodies.whole[body, UNMAPPED] = kind == OWN_MASS or not at_rest

    return mapped


def move_points(k, bodies, scheme, step, with_velocities, with_strains):
    """Points of deforming bodies follow the nodes; k = order + 1."""


@overload(move_points, prefer_literal=True)
def _move_points(k, bodies, scheme, step, with_velocities, with_strains):
    to_points = transfers(k.literal_value - 1).to_points

    def moved(k, bodies, scheme, step, with_velocities, with_strains):
        arrays, factor = bodies.arrays, step / scheme.h
        for body in range(len(bodies.whole)):
            if bodies.whole[body, KIND] != OWN_MASS:
                continue
            numbers, sorting = bodies.numbers[body], group(SORTING, arrays, body)
            update = PointUpdate(
                factor, scheme.flip, scheme.corotational, scheme.affine / scheme.h, with_velocities, with_strains,
                True, numbers[LAW], numbers[LAW + 1], numbers[LAG], numbers[LAG + 1],
            )  # fmt: skip
            to_points(
                sorting.strips, group(VELOCITIES, arrays, body), bodies.whole[body, WIDTH], update,
                group(MOTION, arrays, body), group(GRADIENT, arrays, body), group(ELASTIC, arrays, body), sorting.fastest,
            )  # fmt: skip
            if with_velocities:
                largest = 0.0
                for square in sorting.fastest:
                    largest = max(largest, square)
                numbers[SPEED] = np.sqrt(largest)
                numbers[FAR] += factor * numbers[SPEED]

    return moved


# ---------------------------------------------------------------- steps


@cache
def steps_of(order: int, meeting: int) -> Any:
    """Compiled steps for splines of an order, where `ALONE`, a `PAIR` or `MANY` bodies meet."""
    return _steps(order + 1, meeting)


def _steps(k, meeting):
    @njit(cache=True)
    def steps(bodies, pairs, contact, lines, driving, scheme, step, work):
        """Take steps until all are done, points are to be sorted anew, or a line has lost its body.

        Returns the number of steps done, and the line or `NO_LINE`. ``work`` (3,) takes outer work, its power and that on
        nodes.
        """
        impulses, last = np.zeros(len(lines.whole)), len(driving.damping)
        for n in range(last):
            if n > 0 and not is_sorted(bodies, scheme.h, step):
                return n, NO_LINE
            acceleration, damping = driving.acceleration[n], driving.damping[n]
            impulses[:] = 0.0
            # the second time behind contact, the third where strains come last
            for part in range(3 if scheme.updates_last else 2):
                if part != 1:
                    map_to_grid(k, meeting, bodies, scheme, part == 2)
                for body in range(len(bodies.whole)):
                    if part == 0:
                        find_trial_velocities(bodies, body, step, acceleration[0], acceleration[1], damping)
                    elif part == 2 and bodies.whole[body, KIND] == OWN_MASS:
                        momentum_to_velocities(bodies, body)
                if meeting != ALONE and part == 1:
                    detect(k, bodies, pairs, scheme.h, scheme.by_distance)
                    if meeting == PAIR:
                        meet_pair(bodies, pairs, 0, step, contact)
                        count_pair(bodies, pairs, 0, contact)
                    else:
                        exchange(bodies, pairs, scheme.h, step, scheme.sweeps, contact)
                lost = hold_lines(k - 1, bodies, lines, driving.lines, n, impulses)
                if lost != NO_LINE:
                    return n, lost
                if part == 1:
                    count_work(
                        bodies, scheme.accelerates, step, acceleration, damping, impulses, driving.lines[0, :, n], work
                    )  # fmt: skip
                    for body in range(len(bodies.whole)):
                        if bodies.whole[body, KIND] != OWN_MASS:
                            move_rigid(bodies, scheme, body, step)
                if part > 0:
                    move_points(k, bodies, scheme, step, part == 1, part == 2 or not scheme.updates_last)
        return last, NO_LINE

    return steps
