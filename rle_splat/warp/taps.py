"""Filter taps as vectors: a row of neighboring pixels with four channels each is one load.

LLVM's straight-line vectorizer is off in numba (see ``rle_splat.runtime.lanes``). The vectors are LLVM's own, eight or
sixteen floats wide; LLVM splits them for processors with narrower ones.
"""

from __future__ import annotations

from ..runtime.llvm import intrinsic, ir, types
from ..runtime.vectors import FLOAT, INTEGER, load, pick, place, spread, store

CONTRACT = ["contract"]


def _constant(values):
    """Vector of float constants."""
    return ir.Constant(ir.VectorType(FLOAT, len(values)), [float(value) for value in values])


def _load(context, builder, array_type, array, at, count):
    """Load ``count`` floats of a flat array from index ``at`` on."""
    return load(builder, place(context, builder, array_type, array, at), count)


def _multiply_add(builder, a, b, c):
    """a * b + c; LLVM may fuse it."""
    return builder.fadd(builder.fmul(a, b, flags=CONTRACT), c, flags=CONTRACT)


def _mix(builder, first, second, fraction):
    """first + fraction * (second - first); exactly ``first`` if both are equal."""
    return _multiply_add(builder, fraction, builder.fsub(second, first), first)


def _store_clamped(context, builder, sample, most, target_type, target, to):
    """Store alpha clamped to [0, 1] and color clamped to [0, most * alpha]; neither is ever -0."""
    nothing = _constant([0.0] * 4)
    sample = builder.select(builder.fcmp_ordered(">", sample, nothing), sample, nothing)
    one, last = ir.Constant(FLOAT, 1.0), ir.Constant(INTEGER, 3)
    alpha = builder.extract_element(sample, last)
    alpha = builder.select(builder.fcmp_ordered("<", alpha, one), alpha, one)
    limit = builder.insert_element(spread(builder, builder.fmul(most, alpha), 4), one, last)
    sample = builder.select(builder.fcmp_ordered("<", sample, limit), sample, limit)
    store(builder, sample, place(context, builder, target_type, target, to))


@intrinsic
def tap2x2(typing, source, at, pitch, across, down, most, target, to):
    """target[to:to+4] = color and alpha, interpolated bilinearly from color and transmittance.

    The four pixels are at ``at``, ``at + 4``, and ``pitch`` floats after each. ``source``: flat float32.
    ``across``, ``down``: float32 fractions toward the second pixel and row. ``most``: color is clamped to
    ``most * alpha``. No bounds checks.
    """

    def generate(context, builder, signature, arguments):
        source, at, pitch, across, down, most, target, to = arguments
        source_type, target_type = signature.args[0], signature.args[6]
        upper = _load(context, builder, source_type, source, at, 8)
        lower = _load(context, builder, source_type, source, builder.add(at, pitch), 8)
        both = _mix(builder, upper, lower, spread(builder, down, 8))
        left, right = pick(builder, both, range(4)), pick(builder, both, range(4, 8))
        sample = _mix(builder, left, right, spread(builder, across, 4))
        sample = _multiply_add(builder, sample, _constant([1.0, 1.0, 1.0, -1.0]), _constant([0.0, 0.0, 0.0, 1.0]))
        _store_clamped(context, builder, sample, most, target_type, target, to)
        return context.get_dummy_value()

    return types.void(
        source, types.intp, types.intp, types.float32, types.float32, types.float32, target, types.intp
    ), generate


@intrinsic
def tap4x4(typing, source, at, pitch, across, down, table, most, target, to):
    """target[to:to+4] = color and alpha from 4 x 4 taps, rows ``pitch`` floats apart, the first tap at ``at``.

    ``table``: flat float32, six rows of four taps by four channels: the weights as polynomials of the fraction,
    lowest power first, then a factor of the samples, and a factor of the sum of the weights that is added; these
    two convert samples to color and alpha. Other arguments as of ``tap2x2``.
    """

    def generate(context, builder, signature, arguments):
        source, at, pitch, across, down, table, most, target, to = arguments
        source_type, table_type, target_type = signature.args[0], signature.args[5], signature.args[7]

        def row_of_table(row):
            return _load(context, builder, table_type, table, ir.Constant(at.type, 16 * row), 16)

        powers = [row_of_table(power) for power in range(4)]

        def weights(fraction, lanes):
            fraction = spread(builder, fraction, len(lanes))
            value = pick(builder, powers[3], lanes)
            for power in (2, 1, 0):
                value = _multiply_add(builder, value, fraction, pick(builder, powers[power], lanes))
            return value

        rows = weights(down, range(0, 16, 4))
        total = sum_of_weights = None
        for r in range(4):
            start = builder.add(at, builder.mul(pitch, ir.Constant(at.type, r)))
            weight = builder.extract_element(rows, ir.Constant(INTEGER, r))
            value = _load(context, builder, source_type, source, start, 16)
            term = builder.fmul(spread(builder, weight, 16), value, flags=CONTRACT)
            total = term if total is None else builder.fadd(total, term, flags=CONTRACT)
            sum_of_weights = weight if sum_of_weights is None else builder.fadd(sum_of_weights, weight)
        # Transmittances of one add up to exactly the sum of the weights, so alpha is exactly zero there.
        part = builder.fmul(spread(builder, sum_of_weights, 16), row_of_table(5), flags=CONTRACT)
        total = _multiply_add(builder, total, row_of_table(4), part)
        total = builder.fmul(total, weights(across, range(16)))
        half = builder.fadd(pick(builder, total, range(8)), pick(builder, total, range(8, 16)))
        sample = builder.fadd(pick(builder, half, range(4)), pick(builder, half, range(4, 8)))
        _store_clamped(context, builder, sample, most, target_type, target, to)
        return context.get_dummy_value()

    return types.void(
        source, types.intp, types.intp, types.float32, types.float32, table, types.float32, target, types.intp
    ), generate
