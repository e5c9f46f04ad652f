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
    return _row_of(builder, [builder.extract_value(numbers, lane) for lane in range(_LANES)])


def _row_of(builder, numbers):
    row = ir.Constant(_ROW, ir.Undefined)
    for lane, number in enumerate(numbers):
        row = builder.insert_element(row, number, _INT(lane))
    return row


def _numbers(builder, tuples, part, count):
    """The first numbers of a part of a tuple of tuples."""
    numbers = builder.extract_value(tuples, part)
    return [builder.extract_value(numbers, i) for i in range(count)]


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


def _nodes(context, builder, array_type, fields, first, width, a, k):
    """Addresses of the four fields at the k nodes of a row."""
    values = context.make_array(array_type)(context, builder, fields).data
    start = builder.add(first, builder.mul(width, width.type(a)))
    for b in range(k):
        node = builder.add(start, width.type(b))
        yield builder.bitcast(builder.gep(values, [builder.mul(node, node.type(_LANES))]), _ROW.as_pointer())


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
def add_fields(typing_context, k, fields, first, width, across, along, even, across_slopes, along_slopes):
    """Add to four fields that lie side by side at each node, (4 n_nodes,).

    Each node takes ``across[0][a] along[0][b]`` times ``even``, four numbers, and ``across_slopes`` and ``along_slopes``
    times the same product with one factor exchanged: the first two numbers with ``across[1]`` (``along[1]``), the others
    with ``across[2]`` (``along[2]``).
    """
    count = k.literal_value

    def generate(context, builder, signature, arguments):
        _, fields, first, width, across, along, *numbers = arguments
        even, *slopes = (_row(builder, four) for four in numbers)
        weights = [[_repeated(builder, w) for w in _numbers(builder, pair, 0, count)] for pair in (across, along)]
        exchanged = [
            [
                _row_of(builder, (one, one, two, two))
                for one, two in zip(*(_numbers(builder, three, part, count) for part in (1, 2)), strict=True)
            ]
            for three in (across, along)
        ]
        for a in range(count):
            row = builder.fmul(weights[0][a], even)
            row = builder.fadd(row, builder.fmul(exchanged[0][a], slopes[0]))
            slope = builder.fmul(weights[0][a], slopes[1])
            for b, address in enumerate(_nodes(context, builder, signature.args[1], fields, first, width, a, count)):
                total = builder.fadd(_loaded(builder, address), builder.fmul(weights[1][b], row))
                total = builder.fadd(total, builder.fmul(exchanged[1][b], slope))
                builder.store(total, address).align = 8
        return context.get_dummy_value()

    arguments = (k, fields, first, width, across, along, even, across_slopes, along_slopes)
    return types.void(*arguments), generate


@intrinsic(prefer_literal=True)
def sum_fields(typing_context, k, fields, first, width, across, along):
    """Sums and their slopes of four fields that lie side by side at each node: twelve numbers.

    ``fields`` (4 n_nodes,); ``across`` and ``along`` are pairs of the weights of a row or column and their slopes. The
    four sums of weights come first, then those of the slopes across, then those of the slopes along.
    """
    count = k.literal_value

    def generate(context, builder, signature, arguments):
        _, fields, first, width, across, along = arguments
        weights, slopes = (
            [[_repeated(builder, w) for w in _numbers(builder, pair, part, count)] for pair in (across, along)]
            for part in range(2)
        )
        sums = [None, None, None]
        for a in range(count):
            addresses = _nodes(context, builder, signature.args[1], fields, first, width, a, count)
            nodes = [_loaded(builder, address) for address in addresses]
            row, slope = _weighted(builder, nodes, weights[1]), _weighted(builder, nodes, slopes[1])
            for number, (part, weight) in enumerate(((row, weights[0]), (row, slopes[0]), (slope, weights[0]))):
                product = builder.fmul(weight[a], part)
                sums[number] = product if a == 0 else builder.fadd(sums[number], product)
        found = [builder.extract_element(total, _INT(lane)) for total in sums for lane in range(_LANES)]
        return context.make_tuple(builder, signature.return_type, found)

    return types.UniTuple(types.float64, 3 * _LANES)(k, fields, first, width, across, along), generate


def _weighted(builder, vectors, weights):
    """Sum of vectors times weights."""
    total = builder.fmul(weights[0], vectors[0])
    for weight, vector in zip(weights[1:], vectors[1:], strict=True):
        total = builder.fadd(total, builder.fmul(weight, vector))
    return total
