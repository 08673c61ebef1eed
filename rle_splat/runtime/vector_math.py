"""Reciprocals, roots and powers of float32 lanes without divisions, for light on 8 bits.

Divisions and roots of eight lanes take as long as a dozen products (Agner Fog's tables of instructions).  All begin at
the exponent field of a float32, so they have the same bits on every processor that fuses products and sums.
"""

from __future__ import annotations

from .llvm import ir
from .vectors import FLOAT, INTEGER, Vector

ROOT_START, START = 0x5F375A86, 0x7EF127EA  # bits of a float32 minus those of a number (halved): 1 / root, 1 / number
LOG2 = (0.44191699633798726, -0.2671790585094208, 0.1484258785568708, -0.045148546185885735)  # error 1.6e-5
EXP2 = (0.19307216586860743, 0.046425123660484194, 0.006850995923310956)  # error 2.4e-6
LEAST_EXPONENT = -60.0  # products of a smaller power might be denormal numbers, which are slow


def _bits(vector: Vector):
    return vector.builder.bitcast(vector.value, ir.VectorType(INTEGER, vector.count))


def _numbers(builder, bits) -> Vector:
    return Vector(builder, builder.bitcast(bits, ir.VectorType(FLOAT, bits.type.count)))


def inverse_root(square: Vector) -> Vector:
    """1 / sqrt of positive numbers: three of Newton's steps, relative error 2e-7."""
    builder, bits = square.builder, _bits(square)
    halved = builder.lshr(bits, ir.Constant(bits.type, [1] * square.count))
    found = _numbers(builder, builder.sub(ir.Constant(bits.type, [ROOT_START] * square.count), halved))
    for _ in range(3):
        found = found * (square * found * found).fused(-0.5, Vector(builder, square.like(1.5)))
    return found


def inverse(number: Vector) -> Vector:
    """1 / positive numbers: two of Newton's steps, relative error 7e-6."""
    builder, bits = number.builder, _bits(number)
    found = _numbers(builder, builder.sub(ir.Constant(bits.type, [START] * number.count), bits))
    for _ in range(2):
        found = found * (number * found).fused(-1.0, Vector(builder, number.like(2.0)))
    return found


def _polynomial(t: Vector, factors) -> Vector:
    """factors[0] + factors[1] t + ..."""
    total = Vector(t.builder, t.like(factors[-1]))
    for factor in reversed(factors[:-1]):
        total = total.fused(t, Vector(t.builder, t.like(factor)))
    return total


def power(base: Vector, exponent: Vector) -> Vector:
    """base**exponent of positive, normal numbers up to 1, and exponents that are not negative, to 4e-4.

    log2(1 + t) is t + t (1 - t) p(t) and 2**-t is 1 - t / 2 - t (1 - t) q(-t) for t in [0, 1], which meet where the
    exponent field changes; p and q by least squares, weighted until the error was even.
    """
    builder, bits = base.builder, _bits(base)
    kind = bits.type

    def whole(number):
        return ir.Constant(kind, [number] * base.count)

    mantissa = _numbers(builder, builder.or_(builder.and_(bits, whole(0x007FFFFF)), whole(0x3F800000)))
    field = Vector(builder, builder.sub(builder.lshr(bits, whole(23)), whole(127))).as_float()
    one = Vector(builder, base.like(1.0))
    t = mantissa - 1.0
    log2 = field + (t * (one - t)).fused(_polynomial(t, LOG2), t)
    x = (log2 * exponent).most(LEAST_EXPONENT).least(0.0)
    n = x.truncated()
    t = x - n.as_float()
    part = (t * (one + t)).fused(_polynomial(t, EXP2), t.fused(0.5, one))
    return part * n.power_of_two()
