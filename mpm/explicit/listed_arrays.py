"""Arrays of many bodies for one compiled call: a table of their addresses, and the groups that loops take of them.

A call of a compiled loop costs as much for each array that it is given as a step of some ten points, and each array makes
it longer to compile. A table is a single one for any number of arrays; whoever makes it holds them while it is used.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array
from numpy.typing import NDArray

from mpm.explicit.points import ElasticState, Matter, PointMotion, VelocityGradient
from mpm.explicit.window import NodeSums, NodeSurface, NodeVelocities


class Sorting(NamedTuple):
    """Of a body's points: first ones of cells and strips, where the largest squares of speeds go, and the way (n, 2) to
    each from the centre of a free rigid body."""

    starts: NDArray
    strips: NDArray
    fastest: NDArray
    arms: NDArray


class Touching(NamedTuple):
    """Nodes that a pair of bodies shares in a step, with room for more (m).

    ``nodes`` (2, m) in each body's window; ``normal`` (2, m) outwards of the first body, ``gap`` (m,) along it,
    ``offset`` (2, m) from the node to where a free rigid body meets the other, 0 where no gap is measured [length];
    ``opposed`` (m,) where the bodies' own normals oppose each other, as those of two that meet do (C.1); ``pushes`` (m,)
    and ``drags`` (m,) are the normal and tangential impulses of the step [force time].
    """

    nodes: NDArray
    normal: NDArray
    gap: NDArray
    offset: NDArray
    opposed: NDArray
    pushes: NDArray
    drags: NDArray

    @classmethod
    def room(cls, m: int) -> Touching:
        """For so many nodes."""
        gap, pushes, drags = np.zeros((3, m))
        return cls(
            np.zeros((2, m), np.int64), np.zeros((2, m)), gap, np.zeros((2, m)), np.zeros(m, bool), pushes, drags
        )  # fmt: skip


#: groups of a body's arrays in the order in which they are listed; that of a pair is listed alone
KINDS: tuple[Any, ...] = (
    Matter, PointMotion, VelocityGradient, ElasticState, NodeSums, NodeVelocities, NodeSurface, Sorting,
)  # fmt: skip
MATTER, MOTION, GRADIENT, ELASTIC, SUMS, VELOCITIES, SURFACE, SORTING = range(len(KINDS))
TOUCHING = len(KINDS)
_GROUPS = {number: (kind, sum(len(k._fields) for k in KINDS[:number])) for number, kind in enumerate(KINDS)}
_GROUPS[TOUCHING] = (Touching, 0)
#: of arrays that are not (n,) of floats: type, and shape
_FORMS: dict[str, tuple[Any, tuple[int, ...]]] = {
    **dict.fromkeys(("low", "high", "starts", "strips"), (types.int64, (-1,))), "arms": (types.float64, (-1, 2)),
    **dict.fromkeys(("normal", "offset"), (types.float64, (2, -1))), "nodes": (types.int64, (2, -1)),
    "opposed": (types.boolean, (-1,)),
}  # fmt: skip


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


@intrinsic(prefer_literal=True)
def group(typing_context, number, arrays, row):
    """A group of a row by its number among the `KINDS`, as the named tuple that it was listed from."""
    kind, first = _GROUPS[number.literal_value]
    forms = [_FORMS.get(name, (types.float64, (-1,))) for name in kind._fields]
    found = [types.Array(dtype, len(shape), "C") for dtype, shape in forms]
    alike = len(set(found)) == 1
    result = types.NamedUniTuple(found[0], len(found), kind) if alike else types.NamedTuple(tuple(found), kind)

    def generate(context, builder, signature, arguments):
        _, arrays, row = arguments
        tables = [builder.extract_value(arrays, part) for part in range(2)]
        tables = [context.make_array(signature.args[1][part])(context, builder, tables[part]) for part in range(2)]
        columns = builder.extract_value(tables[0].shape, 1)
        made = []
        for n, (kind_of_array, (_, shape)) in enumerate(zip(found, forms, strict=True)):
            place = builder.add(builder.mul(row, columns), row.type(first + n))
            address, length = (builder.load(builder.gep(table.data, [place])) for table in tables)
            made.append(_array(context, builder, kind_of_array, address, length, shape))
        return context.make_tuple(builder, signature.return_type, made)

    return result(number, arrays, row), generate


def _array(context, builder, kind, address, length, shape):
    """An array without gaps of a shape, in which -1 stands for what the length leaves, at an address."""
    array = context.make_array(kind)(context, builder)
    whole, item = length.type, context.get_abi_sizeof(context.get_data_type(kind.dtype))
    others = int(np.prod([size for size in shape if size > 0]))
    left = length if others == 1 else builder.sdiv(length, whole(others))
    sizes = [left if size < 0 else whole(size) for size in shape]
    strides: list[ir.Value] = [whole(item)]
    for size in reversed(sizes[1:]):
        strides.insert(0, builder.mul(strides[0], size))
    populate_array(
        array, data=builder.inttoptr(address, array.data.type), shape=cgutils.pack_array(builder, sizes),
        strides=cgutils.pack_array(builder, strides), itemsize=whole(item), meminfo=None,
    )  # fmt: skip
    return array._getvalue()
