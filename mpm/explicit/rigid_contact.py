"""Contact of a body that moves freely as a rigid one: impulses at all shared nodes at once.

A node of a deformable body stops by itself what its own mass carries; a rigid body is stopped by all nodes together. The
impulses are those of Signorini's and Coulomb's conditions at every node for the velocities after the step, found node by
node with the rigid body's velocity kept up to date (projected Gauss-Seidel: Jean 1999, Moreau's contact dynamics). They
converge fast where the nodes are lighter than the body; between two rigid bodies they are not unique, the velocities are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mpm.explicit.moving_body import MovingBody
from mpm.explicit.rigid_body import FreeRigidBody
from mpm.explicit.transfers import before_step
from mpm.explicit.window import NodeVelocities

#: what carries a node of a side: a mass of its own, a body that keeps its velocity, a free rigid body
OWN_MASS, KEPT, FREE = range(3)
#: change of a relative velocity, over the largest, at which the impulses are found, and most passes over the nodes
SOLVED, MOST_PASSES = 1e-10, 500
#: relative error of a condition at a node that counts as a violation
ALLOWED = 1e-9


class RigidSide(NamedTuple):
    """One body of a pair of which one is free and rigid.

    ``kind`` of what carries the nodes; ``mass`` and ``nodes``, the velocities, of all nodes of its window; of a free
    rigid body ``velocity, before`` (3,) x, y and spin now and before the step, ``centre`` (2,) of mass from the window's
    first node [length], ``inverses`` (2,) of mass and moment of inertia; ``h`` spacing and ``width`` of the window; the
    body's ``number``.
    """

    kind: int
    mass: NDArray
    nodes: NodeVelocities
    velocity: NDArray
    before: NDArray
    centre: NDArray
    inverses: NDArray
    h: float
    width: int
    number: int


def rigid_side(number: int, body: MovingBody) -> RigidSide:
    """The body of a number as it is now."""
    window, lattice = body.window, body.lattice
    velocity, before, centre, inverses = np.zeros(3), np.zeros(3), np.zeros(2), np.zeros(2)
    kind = KEPT if body.keeps_velocity else OWN_MASS
    if isinstance(body, FreeRigidBody):
        kind, velocity, before, inverses = FREE, body.velocity, body.velocity_before, body.inverses
        centre = body.place[:2] - window.first_node(lattice)
    return RigidSide(
        kind, window.sums.m, window.velocities, velocity, before, centre, inverses, lattice.h, window.width, number
    )


@njit(forceinline=True)
def _meeting(side, touching, n, node):
    """A common node of a side, and the way from the centre of mass of a free rigid body to where the bodies meet there.

    They meet off the node: a body that turned about the node itself would slide, and let go where its edge leaves it.
    """
    if side.kind != FREE:
        return node, 0.0, 0.0
    x = (node // side.width) * side.h - side.centre[0] + touching.offset[0, n]
    return node, x, (node % side.width) * side.h - side.centre[1] + touching.offset[1, n]


@njit(forceinline=True)
def _velocity(side, at):
    """Of a side at a common node."""
    node, x, y = at
    if side.kind != FREE:
        return side.nodes.vx[node], side.nodes.vy[node]
    return side.velocity[0] - side.velocity[2] * y, side.velocity[1] + side.velocity[2] * x


@njit(forceinline=True)
def _velocity_before(side, at):
    """With which a side goes at a common node before the step."""
    node, x, y = at
    v = side.nodes
    if side.kind == KEPT:
        return v.vx[node], v.vy[node]
    if side.kind != FREE:
        return before_step(v.last_x[node], v.old_x[node]), before_step(v.last_y[node], v.old_y[node])
    return side.before[0] - side.before[2] * y, side.before[1] + side.before[2] * x


@njit(forceinline=True)
def _relative(first, second, at_first, at_second):
    """Velocity of the first side over that of the second at their common node."""
    (ax, ay), (bx, by) = _velocity(first, at_first), _velocity(second, at_second)
    return ax - bx, ay - by


@njit(forceinline=True)
def _yield_of(side, at, x, y):
    """Change of the velocity along a direction by a unit impulse along it."""
    node, arm_x, arm_y = at
    if side.kind == FREE:
        turning = arm_x * y - arm_y * x
        return side.inverses[0] + turning * turning * side.inverses[1]
    return 1.0 / side.mass[node] if side.kind == OWN_MASS else 0.0


@njit(forceinline=True)
def _give(side, at, x, y):
    """An impulse to a side at a common node."""
    node, arm_x, arm_y = at
    if side.kind == FREE:
        side.velocity[0] += side.inverses[0] * x
        side.velocity[1] += side.inverses[0] * y
        side.velocity[2] += side.inverses[1] * (arm_x * y - arm_y * x)
    elif side.kind == OWN_MASS:
        side.nodes.vx[node] += x / side.mass[node]
        side.nodes.vy[node] += y / side.mass[node]


@njit(cache=True)
def largest_speed(first, second, touching, count):
    """Of either side at their common nodes, or taken there by an impulse: what velocities are small against."""
    largest = 0.0
    for n in range(count):
        nx, ny = touching.normal[0, n], touching.normal[1, n]
        a = _meeting(first, touching, n, touching.nodes[0, n])
        b = _meeting(second, touching, n, touching.nodes[1, n])
        (ax, ay), (bx, by) = _velocity(first, a), _velocity(second, b)
        taken = touching.pushes[n] * (_yield_of(first, a, nx, ny) + _yield_of(second, b, nx, ny))
        largest = max(largest, abs(ax) + abs(ay), abs(bx) + abs(by), taken)
    return largest


@njit(cache=True)
def press(first, second, touching, count, step, friction):
    """Add to the impulses ``touching.pushes, drags`` until no node's conditions change them; the number of passes.

    ``first, second`` : `RigidSide`. Normal impulses outwards of the first side act on the second, tangential ones to the
    left of them (Eqs. 6.32 to 6.40, with the masses of the whole bodies). A gap may close within the step.
    """
    nodes, normal, gap, pushes, drags = touching.nodes, touching.normal, touching.gap, touching.pushes, touching.drags
    limit = SOLVED * largest_speed(first, second, touching, count)
    for number in range(MOST_PASSES):
        change = 0.0
        for n in range(count):
            if gap[n] == np.inf:
                continue
            a, b = _meeting(first, touching, n, nodes[0, n]), _meeting(second, touching, n, nodes[1, n])
            nx, ny = normal[0, n], normal[1, n]
            rx, ry = _relative(first, second, a, b)
            give = _yield_of(first, a, nx, ny) + _yield_of(second, b, nx, ny)
            push = max(0.0, pushes[n] + (rx * nx + ry * ny - max(gap[n], 0.0) / step) / give)
            change = max(change, abs(push - pushes[n]) * give)
            _give(first, a, -(push - pushes[n]) * nx, -(push - pushes[n]) * ny)
            _give(second, b, (push - pushes[n]) * nx, (push - pushes[n]) * ny)
            pushes[n] = push
            rx, ry = _relative(first, second, a, b)
            give = _yield_of(first, a, -ny, nx) + _yield_of(second, b, -ny, nx)
            drag = min(max(drags[n] + (-rx * ny + ry * nx) / give, -friction * push), friction * push)
            change = max(change, abs(drag - drags[n]) * give)
            _give(first, a, (drag - drags[n]) * ny, -(drag - drags[n]) * nx)
            _give(second, b, -(drag - drags[n]) * ny, (drag - drags[n]) * nx)
            drags[n] = drag
        if change <= limit:
            return number + 1
    return MOST_PASSES


@njit(cache=True)
def count_impulses(first, second, touching, count, step, friction, kept_velocities, sums):
    """Impulses, their work, and the checks of Algorithm 3 after `press`; momentum (C.2) is kept at each impulse."""
    total_x = total_y = 0.0
    small = ALLOWED * largest_speed(first, second, touching, count)
    for n in range(count):
        nx, ny, push, drag = touching.normal[0, n], touching.normal[1, n], touching.pushes[n], touching.drags[n]
        a = _meeting(first, touching, n, touching.nodes[0, n])
        b = _meeting(second, touching, n, touching.nodes[1, n])
        rx, ry = _relative(first, second, a, b)
        approach, slip = rx * nx + ry * ny - max(touching.gap[n], 0.0) / step, -rx * ny + ry * nx
        sums.counts[3] += approach > small
        if push == 0.0:
            continue
        sums.counts[0] += 1
        sums.counts[1] += not touching.opposed[n]
        sums.counts[3] += approach < -small
        sums.counts[4] += abs(slip) > small and abs(abs(drag) - friction * push) > ALLOWED * push
        (ax, ay), (bx, by) = _velocity_before(first, a), _velocity_before(second, b)
        x, y = 0.5 * (rx + ax - bx), 0.5 * (ry + ay - by)
        sums.work[0] -= drag * (y * nx - x * ny)
        sums.work[1] -= push * (x * nx + y * ny)
        total_x += push * nx - drag * ny
        total_y += push * ny + drag * nx
    for side, sign in ((first, 1.0), (second, -1.0)):
        x, y = -sign * total_x, -sign * total_y
        sums.impulse[side.number, 0] += x
        sums.impulse[side.number, 1] += y
        sums.work[2] -= x * kept_velocities[side.number, 0] + y * kept_velocities[side.number, 1]
