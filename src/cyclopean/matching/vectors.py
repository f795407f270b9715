"""Vectors of 16 numbers for the semi-global aggregation, written out in LLVM.

A pixel has a few dozen hypotheses only. Loops that short gain nothing from automatic vectorisation, because each
begins with tests for overlap and ends with single steps. LLVM turns the vectors here into those of any processor.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 16
FAR = 30000  # state of a hypothesis that nothing comes from
NOTHING = 65535  # a sum that is larger than any

_BYTE, _SHORT, _WORD, _LONG = (ir.IntType(bits) for bits in (8, 16, 32, 64))
_SHORTS = ir.VectorType(_SHORT, LANES)
_BYTES = ir.VectorType(_BYTE, LANES)
_ORDER = ir.Constant(_SHORTS, list(range(LANES)))


def _same(number):
    return ir.Constant(_SHORTS, [number] * LANES)


def _splat(builder, value):
    """A vector of equal numbers."""
    single = builder.insert_element(ir.Constant(_SHORTS, ir.Undefined), value, ir.Constant(_WORD, 0))
    mask = ir.Constant(ir.VectorType(_WORD, LANES), [0] * LANES)
    return builder.shuffle_vector(single, ir.Constant(_SHORTS, ir.Undefined), mask)


def _long(number):
    return ir.Constant(_LONG, number)


def _read(builder, pointer, index, by=0, kind=_SHORTS):
    """The vector that begins at a place of an array."""
    place = builder.gep(pointer, [builder.add(index, _long(by))])
    return builder.load(builder.bitcast(place, kind.as_pointer()), align=1)


def _write(builder, vector, pointer, index, by=0):
    place = builder.gep(pointer, [builder.add(index, _long(by))])
    builder.store(vector, builder.bitcast(place, vector.type.as_pointer()), align=1)


def _min(builder, a, b):
    return builder.select(builder.icmp_unsigned("<", a, b), a, b)


def _joined(builder, a, b, begin):
    """Sixteen numbers out of two vectors one after the other."""
    order = ir.Constant(ir.VectorType(_WORD, LANES), list(range(begin, begin + LANES)))
    return builder.shuffle_vector(a, b, order)


def _least(builder, vector):
    """The least number of a vector."""
    kind = ir.FunctionType(_SHORT, [_SHORTS])
    reduce = cgutils.get_or_insert_function(builder.module, kind, "llvm.vector.reduce.umin.v16i16")
    return builder.call(reduce, [vector])


def _data(context, builder, kind, value):
    return context.make_array(kind)(context, builder, value).data


def _in_vectors(builder, count, chunk):
    """Call ``chunk(k, inside)`` for vectors from 0 to count; the last may be partly inside, else inside is None."""
    whole = builder.and_(count, _long(-LANES))
    with cgutils.for_range_slice(builder, _long(0), whole, _long(LANES), _LONG) as (k, _):
        chunk(k, None)
    rest = builder.sub(count, whole)
    with builder.if_then(builder.icmp_signed(">", rest, _long(0)), likely=False):
        chunk(whole, builder.icmp_unsigned("<", _ORDER, _splat(builder, builder.trunc(rest, _SHORT))))


def _beside(builder, states, before):
    """States of hypotheses k - 1, k and k + 1 and so on, as a function of k."""
    return lambda k: [_read(builder, states, builder.add(before, k), by) for by in (-1, 0, 1)]


def _handed_on(builder, states, before):
    """The same of a path whose state was written a moment ago, for rising k.

    The processor hands on what was just written if it is read in the same vectors; other reads have to wait.
    """
    margin = builder.load(builder.gep(states, [builder.add(before, _long(-1))]))
    last = cgutils.alloca_once_value(builder, _splat(builder, margin))
    same = cgutils.alloca_once_value(builder, _read(builder, states, before))

    def near(k):
        a, b, c = builder.load(last), builder.load(same), _read(builder, states, builder.add(before, k), LANES)
        builder.store(b, last)
        builder.store(c, same)
        return _joined(builder, a, b, LANES - 1), b, _joined(builder, b, c, 1)

    return near


class _Path:
    """One path as it enters a pixel."""

    def __init__(self, builder, states, before, after, near, small, large):
        self.builder, self.states, self.after, self.near, self.small = builder, states, after, near, small
        self.base = _read(builder, states, before, -2 * LANES)
        self.jump = builder.add(self.base, large)
        self.least = cgutils.alloca_once_value(builder, _same(NOTHING))

    def step(self, k, cost, inside):
        """The next sixteen states, written and returned."""
        builder = self.builder
        lower, same, upper = self.near(k)
        move = builder.add(_min(builder, lower, upper), self.small)
        best = _min(builder, _min(builder, same, self.jump), move)
        value = builder.add(cost, builder.sub(best, self.base))
        kept = value if inside is None else builder.select(inside, value, _same(FAR))
        _write(builder, kept, self.states, builder.add(self.after, k))
        builder.store(_min(builder, builder.load(self.least), kept), self.least)
        return value

    def finish(self, count):
        """Write what lies before and behind the state."""
        least = _splat(self.builder, _least(self.builder, self.builder.load(self.least)))
        _write(self.builder, least, self.states, self.after, -2 * LANES)
        _write(self.builder, _same(FAR), self.states, self.builder.add(self.after, count))


@intrinsic
def advance(_, volume, at, count, states, before, after, small, large, totals, more):
    """Go one pixel on along several paths at once.

    A path's state is `count` sums less a common number, Hirschmueller (2008), equation 13. Two vectors lie before it:
    the least of the sums over and over, and a margin whose last number stands for hypothesis -1. Another lies behind.

    Parameters
    ----------
    volume : flat uint8 array
        Costs; those of this pixel begin at `at`.
    states : flat uint16 array
        States of the paths; they begin at `before` and `after`, tuples of as many numbers as there are paths. The
        first path runs along the row.
    small, large : uint16
        Penalties for a change by one hypothesis, and by more.
    totals : flat uint16 array
        Sums of all paths, laid out as the costs; the new states are added to them if `more`, or else replace them.
    """
    index = types.UniTuple(types.int64, before.count)
    numbers = (types.uint16, types.uint16)
    kinds = (volume, types.int64, types.int64, states, index, index, *numbers, totals, types.boolean)

    def codegen(context, builder, signature, arguments):
        _, at, count, _, before, after, small, large, _, more = arguments
        costs, state, total = (_data(context, builder, signature.args[i], arguments[i]) for i in (0, 3, 8))
        penalties = _splat(builder, small), _splat(builder, large)
        before, after = cgutils.unpack_tuple(builder, before), cgutils.unpack_tuple(builder, after)
        near = [(_beside if i else _handed_on)(builder, state, place) for i, place in enumerate(before)]
        paths = [_Path(builder, state, *path, *penalties) for path in zip(before, after, near)]
        old = _splat(builder, builder.sext(more, _SHORT))

        def chunk(k, inside):
            here = builder.add(at, k)
            cost = builder.zext(_read(builder, costs, here, kind=_BYTES), _SHORTS)
            summed = builder.and_(_read(builder, total, here), old)
            for path in paths:
                summed = builder.add(summed, path.step(k, cost, inside))
            _write(builder, summed, total, here)

        _in_vectors(builder, count, chunk)
        for path in paths:
            path.finish(count)
        return context.get_dummy_value()

    return types.void(*kinds), codegen


@intrinsic
def smallest(_, totals, at, count, avoid):
    """The least of `count` sums from `at` on that is not next to number `avoid`, the first of several.

    Returns
    -------
    int64
        65536 times the sum, NOTHING if there is none, and its number.
    """

    def codegen(context, builder, signature, arguments):
        _, at, count, avoid = arguments
        total = _data(context, builder, signature.args[0], arguments[0])
        near = _splat(builder, builder.sub(builder.trunc(avoid, _SHORT), ir.Constant(_SHORT, 1)))
        least = cgutils.alloca_once_value(builder, _same(NOTHING))
        number = cgutils.alloca_once_value(builder, _same(NOTHING))

        def chunk(k, inside):
            order = builder.add(_ORDER, _splat(builder, builder.trunc(k, _SHORT)))
            value = _read(builder, total, builder.add(at, k))
            allowed = builder.icmp_unsigned(">", builder.sub(order, near), _same(2))
            allowed = allowed if inside is None else builder.and_(allowed, inside)
            value = builder.select(allowed, value, _same(NOTHING))
            better = builder.icmp_unsigned("<", value, builder.load(least))
            builder.store(builder.select(better, value, builder.load(least)), least)
            builder.store(builder.select(better, order, builder.load(number)), number)

        _in_vectors(builder, count, chunk)
        value = _least(builder, builder.load(least))
        equal = builder.icmp_unsigned("==", builder.load(least), _splat(builder, value))
        first = _least(builder, builder.select(equal, builder.load(number), _same(NOTHING)))
        high = builder.shl(builder.zext(value, _LONG), ir.Constant(_LONG, 16))
        return builder.or_(high, builder.zext(first, _LONG))

    return types.int64(totals, types.int64, types.int64, types.int64), codegen


@intrinsic
def transpose(_, planes, k, y, x, volume, at, stride):
    """Write planes[k : k + 16, y, x : x + 16] to the volume: 16 pixels from `at` on, `stride` apart, 16 costs each."""

    def codegen(context, builder, signature, arguments):
        _, k, y, x, _, at, stride = arguments
        source = context.make_array(signature.args[0])(context, builder, arguments[0])
        target = _data(context, builder, signature.args[4], arguments[4])
        pitches = cgutils.unpack_tuple(builder, source.strides)
        corner = x
        for index, pitch in zip((k, y), pitches):
            corner = builder.add(corner, builder.mul(index, pitch))
        places = [builder.add(corner, builder.mul(_long(i), pitches[0])) for i in range(LANES)]
        rows = [_read(builder, source.data, place, kind=_BYTES) for place in places]
        for _ in range(4):  # each turns the eight bits of (row, column) by one
            rows = [_zip(builder, rows[i // 2], rows[i // 2 + 8], i % 2) for i in range(LANES)]
        for i, row in enumerate(rows):
            _write(builder, row, target, builder.add(at, builder.mul(_long(i), stride)))
        return context.get_dummy_value()

    return types.void(planes, *3 * [types.int64], volume, types.int64, types.int64), codegen


def _zip(builder, a, b, half):
    """Numbers of one half of two vectors in turn."""
    order = [i // 2 + 8 * half + 16 * (i % 2) for i in range(LANES)]
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_WORD, LANES), order))
