"""Four numbers at once in compiled code: the compiler finds no vector code of its own in loops over points.

A function of floats takes ``Lanes`` in their place where it does no more than add, subtract, multiply and divide.
"""

from __future__ import annotations

import operator

from llvmlite import ir
from numba import types
from numba.core.typing import signature
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, lower_builtin, models, register_model

#: numbers at once, and of a tile, which loops go through part by part: a processor begins with the next numbers while it
#: waits for the first ones where a loop is short
LANES, TILE = 4, 32
INT, LONG, DOUBLE = ir.IntType(32), ir.IntType(64), ir.DoubleType()
VECTOR = ir.VectorType(DOUBLE, LANES)


class Lanes(types.Type):
    """Numba's type of four floats side by side."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


LANES_TYPE = Lanes()


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind) -> None:
        super().__init__(manager, kind, VECTOR)


# ---------------------------------------------------------------- arithmetic


def picked(builder, one, two, lanes):
    """The numbers of two vectors in the places that are given."""
    return builder.shuffle_vector(one, two, ir.Constant(ir.VectorType(INT, len(lanes)), lanes))


def repeated(builder, number):
    """A vector of one number."""
    nothing = ir.Constant(VECTOR, ir.Undefined)
    return picked(builder, builder.insert_element(nothing, number, INT(0)), nothing, [0] * LANES)


def _as_lanes(context, builder, kind, value):
    if isinstance(kind, Lanes):
        return value
    return repeated(builder, context.cast(builder, value, kind, types.float64))


def _define(symbol, instruction) -> None:
    @infer_global(symbol)
    class _Template(AbstractTemplate):
        def generic(self, args, kws):
            if any(isinstance(kind, Lanes) for kind in args):
                return signature(LANES_TYPE, *args)
            return None

    def lower(context, builder, sig, args):
        one, two = (_as_lanes(context, builder, *pair) for pair in zip(sig.args, args, strict=True))
        return getattr(builder, instruction)(one, two)

    for number in (types.Float, types.Integer):
        lower_builtin(symbol, Lanes, number)(lower)
        lower_builtin(symbol, number, Lanes)(lower)
    lower_builtin(symbol, Lanes, Lanes)(lower)


for _symbol, _instruction in (
    (operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv"),
):  # fmt: skip
    _define(_symbol, _instruction)


@infer_global(operator.neg)
class _Negative(AbstractTemplate):
    def generic(self, args, kws):
        return signature(LANES_TYPE, *args) if isinstance(args[0], Lanes) else None


@lower_builtin(operator.neg, Lanes)
def _negative(context, builder, sig, args):
    return builder.fneg(args[0])


@intrinsic
def same(typing_context, number):
    """One number in all places."""
    return LANES_TYPE(types.float64), lambda context, builder, sig, args: repeated(builder, args[0])


@intrinsic
def least(typing_context, one, two):
    """The smaller ones of two; those of the second where there is one that is not a number."""
    return _chosen("<")


@intrinsic
def greatest(typing_context, one, two):
    """The larger ones of two; those of the second where there is one that is not a number."""
    return _chosen(">")


def _chosen(order):
    def generate(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered(order, *args), *args)

    return LANES_TYPE(LANES_TYPE, LANES_TYPE), generate


@intrinsic
def whole(typing_context, numbers):
    """Their whole parts, of numbers that are not negative."""

    def generate(context, builder, sig, args):
        return builder.sitofp(builder.fptosi(args[0], ir.VectorType(INT, LANES)), VECTOR)

    return LANES_TYPE(LANES_TYPE), generate


@intrinsic
def apart(typing_context, numbers):
    """A tuple of the four numbers."""

    def generate(context, builder, sig, args):
        found = [builder.extract_element(args[0], INT(lane)) for lane in range(LANES)]
        return context.make_tuple(builder, sig.return_type, found)

    return types.UniTuple(types.float64, LANES)(LANES_TYPE), generate


def turned(builder, rows):
    """Four vectors whose first one holds the first numbers of four others, the second one the second, ..."""
    low = [picked(builder, rows[n], rows[n + 1], [0, 4, 2, 6]) for n in (0, 2)]
    high = [picked(builder, rows[n], rows[n + 1], [1, 5, 3, 7]) for n in (0, 2)]
    return [picked(builder, *pair, lanes) for lanes in ([0, 1, 4, 5], [2, 3, 6, 7]) for pair in (low, high)]


# ---------------------------------------------------------------- memory


@intrinsic
def borrowed(typing_context, held):
    """Addresses in place of an array or a named tuple of arrays of one type; the arrays must outlive them.

    Functions that take arrays and have branches count who holds the arrays, which takes longer than four numbers do.
    """
    if isinstance(held, types.Array):
        found = types.CPointer(held.dtype)
    else:
        found = types.NamedUniTuple(types.CPointer(held.dtype.dtype), held.count, held.instance_class)

    def generate(context, builder, sig, args):
        if isinstance(sig.return_type, types.CPointer):
            return data_of(context, builder, sig.args[0], args[0])
        kinds = zip(sig.args[0], (builder.extract_value(args[0], n) for n in range(held.count)), strict=True)
        return context.make_tuple(builder, sig.return_type, [data_of(context, builder, *pair) for pair in kinds])

    return found(held), generate


def data_of(context, builder, kind, array):
    """Address of the first item of an array, or that which was borrowed."""
    return array if isinstance(kind, types.CPointer) else context.make_array(kind)(context, builder, array).data


def _place(context, builder, array_type, array, first):
    return builder.bitcast(builder.gep(data_of(context, builder, array_type, array), [first]), VECTOR.as_pointer())


def _first(builder, left):
    """Whether a place is before so many."""
    nothing = ir.Constant(ir.VectorType(LONG, LANES), ir.Undefined)
    lefts = builder.insert_element(nothing, left, INT(0))
    lefts = picked(builder, lefts, nothing, [0] * LANES)
    return builder.icmp_signed("<", ir.Constant(ir.VectorType(LONG, LANES), list(range(LANES))), lefts)


@intrinsic
def load(typing_context, array, first, left):
    """Numbers first, first + 1, ... of an array, no more than are left, and zeros behind them."""

    def generate(context, builder, sig, args):
        address = _place(context, builder, sig.args[0], *args[:2])
        mask = ir.VectorType(ir.IntType(1), LANES)
        kind = ir.FunctionType(VECTOR, [VECTOR.as_pointer(), INT, mask, VECTOR])
        name = f"llvm.masked.load.v{LANES}f64.p0v{LANES}f64"
        function = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
        return builder.call(function, [address, INT(8), _first(builder, args[2]), ir.Constant(VECTOR, [0.0] * LANES)])

    return LANES_TYPE(array, types.int64, types.int64), generate


@intrinsic
def only(typing_context, numbers, left):
    """The numbers, no more than are left, and zeros behind them."""

    def generate(context, builder, sig, args):
        return builder.select(_first(builder, args[1]), args[0], ir.Constant(VECTOR, [0.0] * LANES))

    return LANES_TYPE(LANES_TYPE, types.int64), generate


@intrinsic
def store(typing_context, array, first, left, numbers):
    """array[first], array[first + 1], ... = the numbers, no more than are left."""

    def generate(context, builder, sig, args):
        address = _place(context, builder, sig.args[0], *args[:2])
        mask = ir.VectorType(ir.IntType(1), LANES)
        kind = ir.FunctionType(ir.VoidType(), [VECTOR, VECTOR.as_pointer(), INT, mask])
        name = f"llvm.masked.store.v{LANES}f64.p0v{LANES}f64"
        function = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
        builder.call(function, [args[3], address, INT(8), _first(builder, args[2])])
        return context.get_dummy_value()

    return types.void(array, types.int64, types.int64, LANES_TYPE), generate


@intrinsic
def store_whole(typing_context, array, first, numbers):
    """Four numbers that are whole into an array of integers."""

    def generate(context, builder, sig, args):
        numbers = builder.sext(builder.fptosi(args[2], ir.VectorType(INT, LANES)), ir.VectorType(LONG, LANES))
        address = builder.gep(data_of(context, builder, sig.args[0], args[0]), [args[1]])
        builder.store(numbers, builder.bitcast(address, numbers.type.as_pointer())).align = 8
        return context.get_dummy_value()

    return types.void(array, types.int64, LANES_TYPE), generate


@intrinsic(prefer_literal=True)
def store_rows(typing_context, count, array, row, first, numbers):
    """The first ones of a tuple of lanes into the rows of an array (n, TILE) from a row on, behind so many numbers."""

    def generate(context, builder, sig, args):
        start = builder.add(builder.mul(args[2], LONG(TILE)), args[3])
        for n in range(count.literal_value):
            value = _as_lanes(context, builder, sig.args[4][n], builder.extract_value(args[4], n))
            place = builder.add(start, LONG(n * TILE))
            builder.store(value, _place(context, builder, sig.args[1], args[1], place)).align = 8
        return context.get_dummy_value()

    return types.void(count, array, types.int64, types.int64, numbers), generate


@intrinsic
def store_turned(typing_context, array, part, first, numbers):
    """Four lanes into a part of an array (n, TILE, 4): the first numbers of all side by side, then the second ones."""

    def generate(context, builder, sig, args):
        lanes = [_as_lanes(context, builder, sig.args[3][n], builder.extract_value(args[3], n)) for n in range(LANES)]
        for value, address in zip(turned(builder, lanes), _fours(context, builder, sig, args), strict=True):
            builder.store(value, address).align = 8
        return context.get_dummy_value()

    return types.void(array, types.int64, types.int64, numbers), generate


@intrinsic
def load_turned(typing_context, array, part, first):
    """And back."""

    def generate(context, builder, sig, args):
        rows = [builder.load(address) for address in _fours(context, builder, sig, args)]
        for row in rows:
            row.align = 8
        return context.make_tuple(builder, sig.return_type, turned(builder, rows))

    return types.UniTuple(LANES_TYPE, LANES)(array, types.int64, types.int64), generate


def _fours(context, builder, sig, args):
    """Addresses of four rows in a part of an array (n, TILE, 4)."""
    start = builder.mul(builder.add(builder.mul(args[1], LONG(TILE)), args[2]), LONG(LANES))
    return [_place(context, builder, sig.args[0], args[0], builder.add(start, LONG(n * LANES))) for n in range(LANES)]
