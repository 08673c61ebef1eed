"""Where in a slab the transmittance falls below one half, for the depth channel: a block of pixels at a time."""

from __future__ import annotations

from ..runtime.llvm import intrinsic, ir, types
from ..runtime.vectors import DOUBLE, INTEGER, Vector, place
from .pixel_block import BLOCK, kind_of

LEAST = 1e-37  # a normal number, below which nothing shines
# log2(1 + t) / t on [0, 1], interpolated at Chebyshev's ten nodes: relative error 2e-8.  Written out, because each
# version of numpy rounds them in its own way, and kernels that are shipped have to be those that are asked for.
LOG2_OVER_T = (
    1.4426950331796218, -0.7213459716833145, 0.48084608050883537, -0.35997573043364656, 0.28368108253566504,
    -0.22029472952668006, 0.15211233746360794, -0.08132993153045574, 0.02819390710338469, -0.004582081698033347,
)  # fmt: skip


def _log2_of_more(t):
    """log2(1 + t) of lanes 0 <= t <= 1, to float32's relative precision however small t is."""
    value = t * 0.0 + LOG2_OVER_T[-1]
    for term in LOG2_OVER_T[-2::-1]:
        value = value * t + term
    return value * t


@intrinsic
def half_way(typing, before, after, at, parts):
    """Which of BLOCK pixels have just lost half their light, a bit each, and where in the slab, a part of it.

    ``before``, ``after[at:]``: transmittance ahead of the slab and behind it.  Inside a homogeneous slab it is
    exponential in depth: the part is log(2 * before) / log(before / after).  Out: ``parts`` (BLOCK,) float32.
    """

    def generate(context, builder, signature, arguments):
        before, after, at, parts = arguments
        before_type, after_type, _, parts_type = signature.args
        begin = place(context, builder, before_type, before, ir.Constant(at.type, 0))
        end = place(context, builder, after_type, after, at)
        ahead, behind = (
            Vector.load(builder, pointer, BLOCK, kind_of(kind))
            for pointer, kind in ((begin, before_type), (end, after_type))
        )
        if kind_of(before_type) == DOUBLE:
            ahead, behind = ahead.as_single(), behind.as_single()
        crossed = builder.and_(ahead.at_least(0.5), builder.not_(behind.at_least(0.5)))
        shines = behind.at_least(LEAST)
        behind = behind.most(LEAST)
        rest = (ahead - behind) / behind
        ratio = rest + 1.0
        # ratio = 2**exponent * (1 + t): the exponent is a field of the number.
        bits = builder.bitcast(ratio.value, ir.VectorType(INTEGER, BLOCK))
        exponent = builder.sub(builder.lshr(bits, _whole(23)), _whole(127))
        mantissa = builder.or_(builder.and_(bits, _whole((1 << 23) - 1)), _whole(127 << 23))
        t = Vector(builder, builder.bitcast(mantissa, ratio.value.type)) - 1.0
        t = rest.where(builder.icmp_signed("==", exponent, _whole(0)), t)
        whole = Vector(builder, exponent).as_float()
        part = _log2_of_more(ahead * 2.0 - 1.0) / (whole + _log2_of_more(t.most(0.0).least(1.0))).most(LEAST)
        part = part.most(0.0).least(1.0).where(shines, 0.0)  # opaque at once: where it begins
        part.store(place(context, builder, parts_type, parts, ir.Constant(at.type, 0)))
        return builder.zext(builder.bitcast(crossed, ir.IntType(BLOCK)), ir.IntType(64))

    return types.uint64(before, after, types.intp, parts), generate


def _whole(number):
    return ir.Constant(ir.VectorType(INTEGER, BLOCK), [number] * BLOCK)
