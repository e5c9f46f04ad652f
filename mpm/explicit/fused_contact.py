"""Contact of all pairs of bodies in compiled code: what ``Contact`` does in a step, in one call."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import overload
from numpy.typing import NDArray

from mpm.explicit.body_surface import find_gaps, find_normals
from mpm.explicit.contact import (
    MOST_SWEEPS, ContactSide, ContactSums, Touching, check_impenetrability, load_floor, meet, share_nodes,
)  # fmt: skip
from mpm.explicit.listed_arrays import (
    ListedArrays, floats, floats_in_two_rows, integers_in_two_rows, matter_of, motion_of, starts_of, sums_of, surface_of,
    truths, velocities_of,
)  # fmt: skip
from mpm.explicit.rigid_contact import FREE, KEPT, RigidSide, count_impulses, press
from mpm.explicit.transfers import transfers


class ListedPairs(NamedTuple):
    """Pairs (n_pairs,) of bodies that may touch; rows of ``arrays`` are those of ``Touching``.

    ``bodies`` (n_pairs, 2) their numbers; ``holds`` (n_pairs, 2) whose normal alone holds; ``on_floor``, ``is_free_rigid``
    and ``friction`` as of ``Pair``; ``corners`` (n_pairs, 2, 2) and ``extent`` (n_pairs, 2) of the nodes that windows have
    in common; ``counts`` (n_pairs,) of those that both bodies share.
    """

    arrays: ListedArrays
    bodies: NDArray
    holds: NDArray
    on_floor: NDArray
    is_free_rigid: NDArray
    friction: NDArray
    corners: NDArray
    extent: NDArray
    counts: NDArray


class ContactState(NamedTuple):
    """What contact has done: ``ContactSums``, and the push on bodies that keep their velocity by columns of nodes, of
    which the first has the number ``first_column``."""

    sums: ContactSums
    floor_load: NDArray
    first_column: int


@njit
def touching_of(pairs, n):
    """``Touching`` of a pair."""
    a = pairs.arrays
    return Touching(
        integers_in_two_rows(a, n, 0), floats_in_two_rows(a, n, 1), floats(a, n, 2), truths(a, n, 3), floats(a, n, 4),
        floats(a, n, 5),
    )  # fmt: skip


@njit
def _side(bodies, n):
    velocities = velocities_of(bodies.arrays, n)
    return ContactSide(sums_of(bodies.arrays, n).m, velocities.vx, velocities.vy, n, bodies.kinds[n] == KEPT)


@njit
def _rigid_side(bodies, n, h):
    velocities, centre = velocities_of(bodies.arrays, n), bodies.place[n, :2] - bodies.first_node[n]
    return RigidSide(
        bodies.kinds[n], sums_of(bodies.arrays, n).m, velocities.vx, velocities.vy, bodies.velocity[n], centre,
        bodies.inverses[n], h, bodies.widths[n], n,
    )  # fmt: skip


def detect(k, bodies, pairs, h, by_distance):
    """Nodes with mass of two bodies (Remark 1), their collinear normals (6.34) and the gaps there; k = order + 1."""


@overload(detect, prefer_literal=True)
def _detect(k, bodies, pairs, h, by_distance):
    count = k.literal_value

    def found(k, bodies, pairs, h, by_distance):
        for n in range(len(pairs.counts)):
            _share(bodies, pairs, n)
        for body in range(len(bodies.kinds)):
            _find_slopes(count, bodies, pairs, body)
        for n in range(len(pairs.counts)):
            if pairs.counts[n] > 0:
                _touch(count, bodies, pairs, n, h, by_distance)

    return found


@njit
def _share(bodies, pairs, n):
    one, two = pairs.bodies[n, 0], pairs.bodies[n, 1]
    pairs.counts[n] = share_nodes(
        sums_of(bodies.arrays, one).m, bodies.widths[one], pairs.corners[n, 0], sums_of(bodies.arrays, two).m,
        bodies.widths[two], pairs.corners[n, 1], pairs.extent[n], touching_of(pairs, n).nodes,
    )  # fmt: skip


@njit
def _own_nodes(pairs, body):
    """The nodes that a body shares with any other, in its window."""
    count = 0
    for n in range(len(pairs.counts)):
        if pairs.bodies[n, 0] == body or pairs.bodies[n, 1] == body:
            count += pairs.counts[n]
    nodes, start = np.empty(count, np.int64), 0
    for n in range(len(pairs.counts)):
        for side in range(2):
            if pairs.bodies[n, side] == body:
                nodes[start : start + pairs.counts[n]] = touching_of(pairs, n).nodes[side, : pairs.counts[n]]
                start += pairs.counts[n]
    return nodes


def _find_slopes(k, bodies, pairs, body):
    """Mass gradients of a body at its shared nodes."""


@overload(_find_slopes, prefer_literal=True)
def _find_slopes_of_order(k, bodies, pairs, body):
    mass_slopes = transfers(k.literal_value - 1).mass_slopes

    def found(k, bodies, pairs, body):
        nodes, arrays = _own_nodes(pairs, body), bodies.arrays
        if len(nodes) > 0:
            mass_slopes(
                nodes, starts_of(arrays, body), motion_of(arrays, body), matter_of(arrays, body), bodies.widths[body],
                surface_of(arrays, body),
            )  # fmt: skip

    return found


def _touch(k, bodies, pairs, n, h, by_distance):
    """Collinear normals and gaps of a pair."""


@overload(_touch, prefer_literal=True)
def _touch_of_order(k, bodies, pairs, n, h, by_distance):
    reaches = transfers(k.literal_value - 1).reaches

    def found(k, bodies, pairs, n, h, by_distance):
        one, two, arrays, touching = pairs.bodies[n, 0], pairs.bodies[n, 1], bodies.arrays, touching_of(pairs, n)
        first, second = surface_of(arrays, one), surface_of(arrays, two)
        pairs.counts[n] = find_normals(first, second, pairs.holds[n, 0], pairs.holds[n, 1], touching, pairs.counts[n])
        if by_distance and pairs.counts[n] > 0:
            for body in (one, two):
                reaches(
                    starts_of(arrays, body), motion_of(arrays, body), matter_of(arrays, body), bodies.widths[body],
                    surface_of(arrays, body),
                )  # fmt: skip
            find_gaps(first, second, h, touching, pairs.counts[n])

    return found


@njit
def exchange(bodies, pairs, h, step, sweeps, contact):
    """Correct the nodes' velocities by the contact forces of pairs without a free rigid body (Eqs. 6.28 to 6.40)."""
    for sweep in range(sweeps):
        for n in range(len(pairs.counts)):
            if pairs.counts[n] > 0:
                _meet(bodies, pairs, n, step, contact)
    if sweeps > 1:
        _check(bodies, pairs, step, contact)


@njit
def exchange_with_rigid(bodies, pairs, h, step, sweeps, contact):
    """The same where bodies move freely as rigid ones."""
    touching = 0
    for n in range(len(pairs.counts)):
        touching += pairs.counts[n] > 0
        if pairs.counts[n] > 0 and pairs.is_free_rigid[n]:
            pushed = touching_of(pairs, n)
            pushed.pushes[: pairs.counts[n]] = 0.0
            pushed.drags[: pairs.counts[n]] = 0.0
    for sweep in range(MOST_SWEEPS):
        moved = False
        for n in range(len(pairs.counts)):
            if pairs.counts[n] > 0 and pairs.is_free_rigid[n]:
                first, second = _rigid_side(bodies, pairs.bodies[n, 0], h), _rigid_side(bodies, pairs.bodies[n, 1], h)
                passes = press(first, second, touching_of(pairs, n), pairs.counts[n], step, pairs.friction[n])
                moved = moved or passes > 1
        for n in range(len(pairs.counts)):
            if pairs.counts[n] > 0 and not pairs.is_free_rigid[n]:
                _meet(bodies, pairs, n, step, contact)
        if sweep + 1 >= sweeps and (touching == 1 or not moved):
            break
    for n in range(len(pairs.counts)):
        if pairs.counts[n] > 0 and pairs.is_free_rigid[n]:
            first, second = _rigid_side(bodies, pairs.bodies[n, 0], h), _rigid_side(bodies, pairs.bodies[n, 1], h)
            count_impulses(
                first, second, touching_of(pairs, n), pairs.counts[n], step, pairs.friction[n], bodies.kept_velocities,
                contact.sums,
            )  # fmt: skip
            _load_floor(bodies, pairs, n, contact)
    if sweeps > 1:
        _check(bodies, pairs, step, contact)


@njit
def _meet(bodies, pairs, n, step, contact):
    meet(
        _side(bodies, pairs.bodies[n, 0]), _side(bodies, pairs.bodies[n, 1]), touching_of(pairs, n), pairs.counts[n], step,
        pairs.friction[n], bodies.kept_velocities, contact.sums,
    )  # fmt: skip
    _load_floor(bodies, pairs, n, contact)


@njit
def _load_floor(bodies, pairs, n, contact):
    if pairs.on_floor[n]:
        one = pairs.bodies[n, 0]
        first = bodies.corner[one, 0] - contact.first_column
        load_floor(touching_of(pairs, n), pairs.counts[n], first, bodies.widths[one], contact.floor_load)


@njit
def _check(bodies, pairs, step, contact):
    for n in range(len(pairs.counts)):
        if pairs.counts[n] > 0 and not pairs.is_free_rigid[n]:
            first, second = _side(bodies, pairs.bodies[n, 0]), _side(bodies, pairs.bodies[n, 1])
            check_impenetrability(first, second, touching_of(pairs, n), pairs.counts[n], step, contact.sums.counts)
