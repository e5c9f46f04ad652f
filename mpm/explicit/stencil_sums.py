"""Sums over the nodes around a point in vector code, which the compiler does not find in scattered additions by itself.

A stencil is the product of ``k`` numbers across the rows of nodes with four along a row, tuples of four both, of which
those beyond k are zero. A row's four nodes are read and written at once: the fourth must exist, and is not changed.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from numerics.lanes import INT, LANES, LONG, TILE, VECTOR, data_of, picked, repeated

#: rows of a tile: of its points' weights: weights of the rows of nodes, of their slopes, and weights times the way
#: from the point; the same along a row of nodes; and how many rows
ACROSS, SLOPES_ACROSS, OFF_ACROSS, ALONG, SLOPES_ALONG, OFF_ALONG, ROWS = range(0, 28, 4)


def _row(builder, numbers):
    """A vector of a tuple's numbers."""
    row = ir.Constant(VECTOR, ir.Undefined)
    for lane in range(LANES):
        row = builder.insert_element(row, builder.extract_value(numbers, lane), INT(lane))
    return row


def _loaded(builder, address):
    row = builder.load(builder.bitcast(address, VECTOR.as_pointer()))
    row.align = 8
    return row


def _store(builder, row, address):
    builder.store(row, builder.bitcast(address, VECTOR.as_pointer())).align = 8


def _rows(context, builder, array_type, array, first, width, k):
    """Addresses of the vectors of k rows in an array over nodes."""
    nodes = data_of(context, builder, array_type, array)
    for a in range(k):
        node = builder.add(first, builder.mul(width, width.type(a)))
        yield builder.gep(nodes, [node])


def _nodes(context, builder, array_type, fields, first, width, a, k):
    """Addresses of the four fields at the k nodes of a row."""
    values = data_of(context, builder, array_type, fields)
    start = builder.add(first, builder.mul(width, width.type(a)))
    for b in range(k):
        node = builder.add(start, width.type(b))
        yield builder.gep(values, [builder.mul(node, node.type(LANES))])


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
            parts.append((across, builder.fmul(repeated(builder, factor), _row(builder, along))))
        for a, address in enumerate(_rows(context, builder, signature.args[1], array, first, width, count)):
            total = _loaded(builder, address)
            for across, along in parts:
                total = builder.fadd(total, builder.fmul(repeated(builder, builder.extract_value(across, a)), along))
            _store(builder, total, address)
        return context.get_dummy_value()

    return types.void(k, array, first, width, terms), generate


@intrinsic(prefer_literal=True)
def add_fields(typing_context, k, m, fields, first, width, weights, gifts, point):
    """Add what a point of a tile gives to the mass (n_nodes,) and to four fields that lie side by side at each node.

    weights : (ROWS, TILE). gifts : (4, TILE, 4), four numbers a point of each: mass times the weights along a row of
    nodes; what a node takes of the product of both weights; and what it takes of that product with the weight across
    (along) exchanged, in the first two fields for the weight times the way from the point, in the others for the slope.
    """
    count = k.literal_value

    def generate(context, builder, signature, arguments):
        _, m, fields, first, width, weights, gifts, point = arguments
        number = _Number(context, builder, signature.args[5], weights, point)
        own, start = data_of(context, builder, signature.args[6], gifts), builder.mul(point, LONG(LANES))
        rows = [builder.gep(own, [builder.add(start, LONG(n * LANES * TILE))]) for n in range(4)]
        mass, even, *slopes = (_loaded(builder, row) for row in rows)
        along = [number(ALONG + b) for b in range(count)]
        exchanged = [number.pair(OFF_ALONG + b, SLOPES_ALONG + b) for b in range(count)]
        masses = list(_rows(context, builder, signature.args[1], m, first, width, count))
        for a in range(count):
            weight = number(ACROSS + a)
            _store(builder, builder.fadd(_loaded(builder, masses[a]), builder.fmul(weight, mass)), masses[a])
            row = builder.fmul(weight, even)
            row = builder.fadd(row, builder.fmul(number.pair(OFF_ACROSS + a, SLOPES_ACROSS + a), slopes[0]))
            slope = builder.fmul(weight, slopes[1])
            for b, address in enumerate(_nodes(context, builder, signature.args[2], fields, first, width, a, count)):
                total = builder.fadd(_loaded(builder, address), builder.fmul(along[b], row))
                _store(builder, builder.fadd(total, builder.fmul(exchanged[b], slope)), address)
        return context.get_dummy_value()

    return types.void(k, m, fields, types.int64, width, weights, gifts, types.int64), generate


@intrinsic(prefer_literal=True)
def sum_fields(typing_context, k, fields, first, width, weights, sums, point):
    """Sums of four fields that lie side by side at each node (4 n_nodes,), and slopes of two, at a point of a tile.

    weights : (ROWS, TILE). sums : (2, TILE, 4) takes the sums; then the slopes of the first and second field across the
    rows of nodes and along them.
    """
    count = k.literal_value

    def generate(context, builder, signature, arguments):
        _, fields, first, width, weights, sums, point = arguments
        number = _Number(context, builder, signature.args[4], weights, point)
        nodes = []
        for a in range(count):
            addresses = _nodes(context, builder, signature.args[1], fields, first, width, a, count)
            nodes.append([_loaded(builder, address) for address in addresses])
        rows, start = data_of(context, builder, signature.args[5], sums), builder.mul(point, LONG(LANES))
        for part, row in enumerate(_sums(builder, nodes, number, count)):
            _store(builder, row, builder.gep(rows, [builder.add(start, LONG(part * LANES * TILE))]))
        return context.get_dummy_value()

    return types.void(k, fields, types.int64, width, weights, sums, types.int64), generate


def _sums(builder, nodes, number, count):
    """Sums of the fields at a point, and slopes of the first two, of rows of nodes."""
    along, slopes_along = ([number(part + b) for b in range(count)] for part in (ALONG, SLOPES_ALONG))
    total, across, up = None, None, None
    for a in range(count):
        row, slope = _weighted(builder, nodes[a], along), _weighted(builder, nodes[a], slopes_along)
        weight = number(ACROSS + a)
        total = _added(builder, total, weight, row)
        across = _added(builder, across, number(SLOPES_ACROSS + a), row)
        up = _added(builder, up, weight, slope)
    return total, picked(builder, across, up, [0, 1, 4, 5])


def _added(builder, total, weight, vector):
    product = builder.fmul(weight, vector)
    return product if total is None else builder.fadd(total, product)


class _Number:
    """Vectors of one number each, from the rows of an array (n, TILE) for one of its points."""

    def __init__(self, context, builder, array_type, array, point) -> None:
        self._builder, self._point = builder, point
        self._numbers = data_of(context, builder, array_type, array)

    def __call__(self, row):
        place = self._builder.add(self._point, self._point.type(row * TILE))
        return repeated(self._builder, self._builder.load(self._builder.gep(self._numbers, [place])))

    def pair(self, one, two):
        """Of the number of one row twice, then of that of another one."""
        return picked(self._builder, self(one), self(two), [0, 1, 6, 7])


def _weighted(builder, vectors, weights):
    """Sum of vectors times weights."""
    total = builder.fmul(weights[0], vectors[0])
    for weight, vector in zip(weights[1:], vectors[1:], strict=True):
        total = builder.fadd(total, builder.fmul(weight, vector))
    return total
