"""Sums over the nodes around a point in vector code, which the compiler does not find in scattered additions by itself.

A stencil is the product of ``k`` numbers across the rows of nodes with four along a row, tuples of four both, of which
those beyond k are zero. A row's four nodes are read and written at once: the fourth must exist, and is not changed.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

_LANES = 4
_DOUBLE, _INT = ir.DoubleType(), ir.IntType(32)
_ROW = ir.VectorType(_DOUBLE, _LANES)


def _row(builder, numbers):
    """A vector of a tuple's numbers."""
    row = ir.Constant(_ROW, ir.Undefined)
    for lane in range(_LANES):
        row = builder.insert_element(row, builder.extract_value(numbers, lane), _INT(lane))
    return row


def _repeated(builder, number):
    """A vector of one number."""
    nothing = ir.Constant(_ROW, ir.Undefined)
    row = builder.insert_element(nothing, number, _INT(0))
    return builder.shuffle_vector(row, nothing, ir.Constant(ir.VectorType(_INT, _LANES), [0] * _LANES))


def _rows(context, builder, array_type, array, first, width, k):
    """Addresses of the vectors of k rows in an array over nodes."""
    nodes = context.make_array(array_type)(context, builder, array).data
    for a in range(k):
        node = builder.add(first, builder.mul(width, width.type(a)))
        yield builder.bitcast(builder.gep(nodes, [node]), _ROW.as_pointer())


def _loaded(builder, address):
    row = builder.load(address)
    row.align = 8
    return row


@intrinsic(prefer_literal=True)
def add_products(typing_context, k, array, first, width, terms):
    """array[first + a width + b] += sum over the terms (factor, across, along) of factor across[a] along[b]."""
    count = k.literal_value

    def generate(context, builder, signature, arguments):
        _, array, first, width, terms = arguments
        parts = []
        for i in range(len(signature.args[4])):
            term = builder.extract_value(terms, i)
            factor, across, along = (builder.extract_value(term, part) for part in range(3))
            parts.append((across, builder.fmul(_repeated(builder, factor), _row(builder, along))))
        for a, address in enumerate(_rows(context, builder, signature.args[1], array, first, width, count)):
            total = _loaded(builder, address)
            for across, along in parts:
                total = builder.fadd(total, builder.fmul(_repeated(builder, builder.extract_value(across, a)), along))
            builder.store(total, address).align = 8
        return context.get_dummy_value()

    return types.void(k, array, first, width, terms), generate


@intrinsic(prefer_literal=True)
def sum_products(typing_context, k, array, first, width, across, along):
    """Sum of across[a] along[b] array[first + a width + b]."""
    count = k.literal_value

    def generate(context, builder, signature, arguments):
        _, array, first, width, across, along = arguments
        total = None
        for a, address in enumerate(_rows(context, builder, signature.args[1], array, first, width, count)):
            part = builder.fmul(_repeated(builder, builder.extract_value(across, a)), _loaded(builder, address))
            total = part if total is None else builder.fadd(total, part)
        total = builder.fmul(total, _row(builder, along))
        lanes = [builder.extract_element(total, _INT(lane)) for lane in range(count)]
        found = lanes[0]
        for lane in lanes[1:]:
            found = builder.fadd(found, lane)
        return found

    return types.float64(k, array, first, width, across, along), generate
