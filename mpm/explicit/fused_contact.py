"""Contact of all pairs of bodies in compiled code: what ``Contact`` does in a step, in one call."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import overload
from numpy.typing import NDArray

from mpm.explicit.body_surface import find_gaps, find_normals
from mpm.explicit.contact import (
    MOST_SWEEPS,
    ContactSide,
    ContactSums,
    check_impenetrability,
    count_work,
    load_floor,
    meet,
    share_nodes,
)  # fmt: skip
from mpm.explicit.listed_arrays import (
    MATTER,
    MOTION,
    SORTING,
    SUMS,
    SURFACE,
    TOUCHING,
    VELOCITIES,
    ListedArrays,
    group,
)  # fmt: skip
from mpm.explicit.rigid_contact import FREE, KEPT, RigidSide, count_impulses, press
from mpm.explicit.transfers import transfers

#: columns of ``ListedBodies.whole``: what carries the nodes, as of ``rigid_contact``; nodes of the window in y, and its
#: corner (2,) in the lattice; whether the body is to be mapped to the grid: one at rest is there once for each window
KIND, WIDTH, CORNER, UNMAPPED = 0, 1, 2, 4
#: columns of ``ListedBodies.numbers``: in-plane Lamé constants (2,); how far, and the largest speed, as of ``Wandering``;
#: lag (2,); of a free rigid body how far it reaches from its centre, and the place (2,) of its window's first node
LAW, FAR, SPEED, LAG, REACH, FIRST_NODE = 0, 2, 3, 4, 6, 7
#: rows of ``ListedBodies.rigid``
VELOCITY, BEFORE, PLACE, INVERSES = range(4)


class ListedBodies(NamedTuple):
    """Bodies (n,) as compiled steps take them.

    Attributes
    ----------
    arrays : rows of ``listed_arrays.KINDS``. whole (n, 5), numbers (n, 9) : as the columns above are named.
    rigid : (n, 4, 3) velocity after and before the step and place of free rigid bodies, and one over mass and moment of
        inertia.
    kept_velocities : (n, 2) of bodies that keep theirs.
    """

    arrays: ListedArrays
    whole: NDArray
    numbers: NDArray
    rigid: NDArray
    kept_velocities: NDArray


#: columns of ``ListedPairs.whole``: numbers (2,) of the bodies, whose (2,) normal alone holds, whether one of them keeps
#: its velocity, and whether one is free and rigid
BODIES, HOLDS, ON_FLOOR, IS_FREE_RIGID = 0, 2, 4, 5


class ListedPairs(NamedTuple):
    """Pairs (n_pairs,) of bodies that may touch.

    Attributes
    ----------
    arrays : rows of ``Touching``. whole (n_pairs, 6) : as the columns above are named. friction : (n_pairs,).
    corners (n_pairs, 2, 2), extent (n_pairs, 2) : of the nodes that their windows have in common.
    counts : (n_pairs,) of the nodes that both bodies share. spare : room for as many nodes as all pairs have.
    """

    arrays: ListedArrays
    whole: NDArray
    friction: NDArray
    corners: NDArray
    extent: NDArray
    counts: NDArray
    spare: NDArray


class ContactState(NamedTuple):
    """What contact has done: ``ContactSums``, and the push on bodies that keep their velocity by columns of nodes, of
    which the first has the number ``first_column``."""

    sums: ContactSums
    floor_load: NDArray
    first_column: int


@njit(cache=True)
def _side(bodies, n):
    nodes = group(VELOCITIES, bodies.arrays, n)
    return ContactSide(group(SUMS, bodies.arrays, n).m, nodes, n, bodies.whole[n, KIND] == KEPT)


@njit(cache=True)
def _rigid_side(bodies, n, h):
    nodes, centre = group(VELOCITIES, bodies.arrays, n), np.empty(2)
    for part in range(2):
        centre[part] = bodies.rigid[n, PLACE, part] - bodies.numbers[n, FIRST_NODE + part]
    return RigidSide(
        bodies.whole[n, KIND], group(SUMS, bodies.arrays, n).m, nodes, bodies.rigid[n, VELOCITY], bodies.rigid[n, BEFORE],
        centre, bodies.rigid[n, INVERSES], h, bodies.whole[n, WIDTH], n,
    )  # fmt: skip


# ---------------------------------------------------------------- which nodes touch


def detect(k, bodies, pairs, h, by_distance):
    """Nodes with mass of two bodies (Remark 1), their collinear normals (6.34) and the gaps there; k = order + 1."""


@overload(detect, prefer_literal=True)
def _detect(k, bodies, pairs, h, by_distance):
    loops = transfers(k.literal_value - 1)
    mass_slopes, reaches = loops.mass_slopes, loops.reaches

    def found(k, bodies, pairs, h, by_distance):
        arrays = bodies.arrays
        for n in range(len(pairs.counts)):
            one, two = pairs.whole[n, BODIES], pairs.whole[n, BODIES + 1]
            pairs.counts[n] = share_nodes(
                group(SUMS, arrays, one).m, bodies.whole[one, WIDTH], pairs.corners[n, 0], group(SUMS, arrays, two).m,
                bodies.whole[two, WIDTH], pairs.corners[n, 1], pairs.extent[n], group(TOUCHING, pairs.arrays, n).nodes,
            )  # fmt: skip
        for body in range(len(bodies.whole)):
            nodes = _own_nodes(pairs, body)
            if len(nodes) > 0:
                mass_slopes(
                    nodes, group(SORTING, arrays, body).starts, group(MOTION, arrays, body), group(MATTER, arrays, body),
                    bodies.whole[body, WIDTH], group(SURFACE, arrays, body),
                )  # fmt: skip
        for n in range(len(pairs.counts)):
            if pairs.counts[n] == 0:
                continue
            one, two, touching = pairs.whole[n, BODIES], pairs.whole[n, BODIES + 1], group(TOUCHING, pairs.arrays, n)
            first, second = group(SURFACE, arrays, one), group(SURFACE, arrays, two)
            first_holds, second_holds = pairs.whole[n, HOLDS] == 1, pairs.whole[n, HOLDS + 1] == 1
            count = find_normals(first, second, first_holds, second_holds, touching, pairs.counts[n])
            pairs.counts[n] = count
            if by_distance and count > 0:
                for side in range(2):
                    body = pairs.whole[n, BODIES + side]
                    reaches(
                        group(SORTING, arrays, body).starts, group(MOTION, arrays, body), group(MATTER, arrays, body),
                        bodies.whole[body, WIDTH], bodies.whole[body, KIND] == FREE, group(SURFACE, arrays, body),
                    )  # fmt: skip
                find_gaps(first, second, h, touching, count)

    return found


@njit(cache=True)
def _own_nodes(pairs, body):
    """The nodes that a body shares with any other, in its window."""
    total = 0
    for n in range(len(pairs.counts)):
        for side in range(2):
            if pairs.whole[n, BODIES + side] == body:
                nodes = group(TOUCHING, pairs.arrays, n).nodes
                for i in range(pairs.counts[n]):
                    pairs.spare[total + i] = nodes[side, i]
                total += pairs.counts[n]
    return pairs.spare[:total]


# ---------------------------------------------------------------- impulses


@njit(cache=True)
def meet_pair(bodies, pairs, n, step, contact):
    """Correct the nodes' velocities by contact forces (Eqs. 6.28 to 6.40) of two bodies that are not free and rigid."""
    count, touching = pairs.counts[n], group(TOUCHING, pairs.arrays, n)
    if count > 0:
        first, second = _side(bodies, pairs.whole[n, BODIES]), _side(bodies, pairs.whole[n, BODIES + 1])
        meet(first, second, touching, count, step, pairs.friction[n], bodies.kept_velocities, contact.sums)


@njit(cache=True)
def count_pair(bodies, pairs, n, contact):
    """Count what two bodies that are not free and rigid have done to each other in the step."""
    count, touching = pairs.counts[n], group(TOUCHING, pairs.arrays, n)
    if count > 0:
        first, second = _side(bodies, pairs.whole[n, BODIES]), _side(bodies, pairs.whole[n, BODIES + 1])
        count_work(first, second, touching, count, contact.sums.work)
        _load_floor(bodies, pairs, n, touching, contact)


@njit(forceinline=True)
def _load_floor(bodies, pairs, n, touching, contact):
    if pairs.whole[n, ON_FLOOR] == 1:
        one = pairs.whole[n, BODIES]
        first = bodies.whole[one, CORNER] - contact.first_column
        load_floor(touching, pairs.counts[n], first, bodies.whole[one, WIDTH], contact.floor_load)


@njit(cache=True)
def exchange(bodies, pairs, h, step, sweeps, contact):
    """The same of all pairs, some of them with free rigid bodies."""
    touching = 0
    for n in range(len(pairs.counts)):
        touching += pairs.counts[n] > 0
    for sweep in range(MOST_SWEEPS):
        moved = False
        for n in range(len(pairs.counts)):
            if pairs.counts[n] > 0 and pairs.whole[n, IS_FREE_RIGID] == 1:
                first, second = (
                    _rigid_side(bodies, pairs.whole[n, BODIES], h), _rigid_side(bodies, pairs.whole[n, BODIES + 1], h)
                )  # fmt: skip
                pushed = group(TOUCHING, pairs.arrays, n)
                passes = press(first, second, pushed, pairs.counts[n], step, pairs.friction[n])
                moved = moved or passes > 1
        for n in range(len(pairs.counts)):
            if pairs.whole[n, IS_FREE_RIGID] == 0:
                meet_pair(bodies, pairs, n, step, contact)
        if sweep + 1 >= sweeps and (touching == 1 or not moved):
            break
    for n in range(len(pairs.counts)):
        if pairs.counts[n] > 0:
            _finish(bodies, pairs, n, h, step, sweeps, contact)


@njit(cache=True)
def _finish(bodies, pairs, n, h, step, sweeps, contact):
    """Count what a pair has done, and check it once more where others may have pushed it together again."""
    one, two = pairs.whole[n, BODIES], pairs.whole[n, BODIES + 1]
    touching, count = group(TOUCHING, pairs.arrays, n), pairs.counts[n]
    if pairs.whole[n, IS_FREE_RIGID] == 1:
        first, second = _rigid_side(bodies, one, h), _rigid_side(bodies, two, h)
        count_impulses(first, second, touching, count, step, pairs.friction[n], bodies.kept_velocities, contact.sums)
        _load_floor(bodies, pairs, n, touching, contact)
        return
    count_pair(bodies, pairs, n, contact)
    if sweeps > 1:
        check_impenetrability(_side(bodies, one), _side(bodies, two), touching, count, step, contact.sums.counts)
