"""Arrays of many bodies for one compiled call: tables of their addresses, and the groups that loops make of them.

A call of a compiled loop costs as much for each array that it is given as a step of some ten points. A table is one array
for any number of bodies; whoever makes it holds the arrays for as long as it is used.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import carray, njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from mpm.explicit.points import ElasticState, Matter, PointMotion, VelocityGradient
from mpm.explicit.window import NodeSums, NodeSurface, NodeVelocities

#: groups of a body's arrays in the order in which they are listed, before single ones
_KINDS: tuple[Any, ...] = (
    Matter, PointMotion, VelocityGradient, ElasticState, NodeSums, NodeVelocities, NodeSurface,
)  # fmt: skip
_FIRST = np.cumsum([0, *(len(kind._fields) for kind in _KINDS)]).tolist()
_MATTER, _MOTION, _GRADIENT, _ELASTIC, _SUMS, _VELOCITIES, _SURFACE, _STARTS = _FIRST
_STRIPS, _FASTEST, _ARMS = _STARTS + 1, _STARTS + 2, _STARTS + 3


class ListedArrays(NamedTuple):
    """Addresses and lengths (n, m) of n times m arrays without gaps."""

    addresses: NDArray
    lengths: NDArray

    @classmethod
    def of(cls, rows: Sequence[Iterable[NDArray]]) -> ListedArrays:
        """The arrays of each row; whoever asks holds them."""
        listed = [[(array.__array_interface__["data"][0], array.size) for array in row] for row in rows]
        pairs = np.array(listed, np.int64).reshape(len(rows), -1 if rows else 0, 2)
        return cls(np.ascontiguousarray(pairs[..., 0]), np.ascontiguousarray(pairs[..., 1]))


@intrinsic
def _pointer(typing_context, address):
    """The address as one of compiled code."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), generate


@njit(inline="always")
def floats(listed, row, number):
    """An array of a row as the caller made it, flat."""
    return carray(_pointer(listed.addresses[row, number]), (listed.lengths[row, number],), np.float64)


@njit(inline="always")
def integers(listed, row, number):
    """The same for whole numbers."""
    return carray(_pointer(listed.addresses[row, number]), (listed.lengths[row, number],), np.int64)


@njit(inline="always")
def floats_in_two_rows(listed, row, number):
    """An array (2, m) of a row."""
    return carray(_pointer(listed.addresses[row, number]), (2, listed.lengths[row, number] // 2), np.float64)


@njit(inline="always")
def integers_in_two_rows(listed, row, number):
    """The same for whole numbers."""
    return carray(_pointer(listed.addresses[row, number]), (2, listed.lengths[row, number] // 2), np.int64)


@njit(inline="always")
def truths(listed, row, number):
    """An array of truth values of a row."""
    return carray(_pointer(listed.addresses[row, number]), (listed.lengths[row, number],), np.bool_)


# ---------------------------------------------------------------- of a body


@njit
def matter_of(listed, body):
    """``Matter`` of a body."""
    n = _MATTER
    return Matter(
        floats(listed, body, n), floats(listed, body, n + 1), floats(listed, body, n + 2), floats(listed, body, n + 3)
    )


@njit
def motion_of(listed, body):
    """``PointMotion`` of a body."""
    n = _MOTION
    return PointMotion(
        floats(listed, body, n), floats(listed, body, n + 1), floats(listed, body, n + 2), floats(listed, body, n + 3),
        floats(listed, body, n + 4), floats(listed, body, n + 5),
    )  # fmt: skip


@njit
def gradient_of(listed, body):
    """``VelocityGradient`` of a body."""
    n = _GRADIENT
    return VelocityGradient(
        floats(listed, body, n), floats(listed, body, n + 1), floats(listed, body, n + 2), floats(listed, body, n + 3)
    )


@njit
def elastic_of(listed, body):
    """``ElasticState`` of a body."""
    n = _ELASTIC
    return ElasticState(
        floats(listed, body, n), floats(listed, body, n + 1), floats(listed, body, n + 2), floats(listed, body, n + 3),
        floats(listed, body, n + 4), floats(listed, body, n + 5),
    )  # fmt: skip


@njit
def sums_of(listed, body):
    """``NodeSums`` of a body's window."""
    return NodeSums(floats(listed, body, _SUMS), floats(listed, body, _SUMS + 1))


@njit
def velocities_of(listed, body):
    """``NodeVelocities`` of a body's window."""
    n = _VELOCITIES
    return NodeVelocities(
        floats(listed, body, n), floats(listed, body, n + 1), floats(listed, body, n + 2), floats(listed, body, n + 3),
        floats(listed, body, n + 4),
    )  # fmt: skip


@njit
def surface_of(listed, body):
    """``NodeSurface`` of a body's window."""
    n = _SURFACE
    return NodeSurface(
        floats(listed, body, n), floats(listed, body, n + 1), floats(listed, body, n + 2), floats(listed, body, n + 3),
        floats(listed, body, n + 4), integers(listed, body, n + 5), integers(listed, body, n + 6),
    )  # fmt: skip


@njit
def starts_of(listed, body):
    """First points of the cells of a body's window."""
    return integers(listed, body, _STARTS)


@njit
def strips_of(listed, body):
    """First points of its strips."""
    return integers(listed, body, _STRIPS)


@njit
def fastest_of(listed, body):
    """Where its points' update leaves the largest squares of speeds."""
    return floats(listed, body, _FASTEST)


@njit
def arms_of(listed, body):
    """From the centre of a free rigid body to its points (n, 2)."""
    return carray(_pointer(listed.addresses[body, _ARMS]), (listed.lengths[body, _ARMS] // 2, 2), np.float64)
