"""Groups of voxels of a scanline in vector registers: what two slices hold of them, mixed, as float32 planes.

Runs are short, a dozen voxels often, too short for what a loop's vectorizer makes of them.  So they are taken in groups
of a fixed size, of which the last may lie over the one before: a voxel has the same bits in whichever group it is.
"""

from __future__ import annotations

import numpy as np

from ..runtime.llvm import intrinsic, ir, types
from ..runtime.vectors import FLOAT, INTEGER, Vector, place

MANY, FEW = 16, 4  # voxels of a group
CODE_BITS = np.uint32(12)  # a 16-bit code of light becomes float32 by a shift and a product: encode/records.py


def _load(builder, pointer, count):
    """``count`` lanes of whatever the pointer is of, from memory of any alignment."""
    kind = pointer.type.pointee
    value = builder.load(builder.bitcast(pointer, ir.VectorType(kind, count).as_pointer()))
    value.align = 1
    return value


def _as_single(builder, value, dtype):
    """Lanes of numbers of numba's type ``dtype`` as float32."""
    single = ir.VectorType(FLOAT, value.type.count)
    if isinstance(dtype, types.Float):
        return value if dtype.bitwidth == 32 else builder.fptrunc(value, single)
    return (builder.sitofp if dtype.signed else builder.uitofp)(value, single)


def _mixed(builder, near, far, weight, far_weight, pair):
    """``weight`` of one and ``far_weight`` of the other where they are a pair, else the near one as it is."""
    count = near.type.count
    weight, far_weight = (Vector.spread(builder, number, count) for number in (weight, far_weight))
    both = Vector(builder, near).mixed(weight, Vector(builder, far), far_weight)
    return Vector(builder, builder.select(pair, both.value, near))


def _mixer_of_scalars(count):
    @intrinsic
    def mix(typing, line, to, scalars, near, far, weight, far_weight, pair):
        """Scalars from numbers ``near`` and ``far`` on, mixed, to ``line`` from ``to`` on."""
        if scalars.layout != "C":
            return None

        def generate(context, builder, signature, arguments):
            line, to, scalars, near, far, weight, far_weight, pair = arguments
            line_type, _, scalars_type = signature.args[:3]
            near, far = (
                _as_single(
                    builder, _load(builder, place(context, builder, scalars_type, scalars, at), count),
                    scalars_type.dtype,
                )
                for at in (near, far)
            )
            mixed = _mixed(builder, near, far, weight, far_weight, pair)
            mixed.store(place(context, builder, line_type, line, to))
            return context.get_dummy_value()

        numbers = (types.float32, types.float32, types.boolean)
        return types.void(line, types.intp, scalars, types.intp, types.intp, *numbers), generate

    return mix


def _mixer_of_lights(count):
    @intrinsic
    def mix(typing, line, stride, to, lights, near, far, weight, far_weight, unit, pair, matt, gloss):
        """Light of voxels ``near`` and ``far`` and of the next ones, mixed, to the planes of ``line`` that follow
        the first, ``stride`` numbers apart, from number ``to`` on.

        ``lights``: (m, channels) codes, and as many channels as planes in ``matt`` and ``gloss`` together.
        """
        if lights.layout != "C":
            return None
        channels = len(matt.types) + len(gloss.types)

        def generate(context, builder, signature, arguments):
            line, stride, to, lights, near, far, weight, far_weight, unit, pair = arguments[:10]
            line_type, lights_type = signature.args[0], signature.args[3]
            unit = Vector.spread(builder, unit, count)

            def number(n):
                return ir.Constant(to.type, n)

            def numbers(voxel, channel):
                first = place(context, builder, lights_type, lights, builder.mul(voxel, number(channels)))
                codes = _load(builder, first, count * channels)
                lanes = [channel + channels * n for n in range(count)]
                mask = ir.Constant(ir.VectorType(INTEGER, count), lanes)
                codes = builder.shuffle_vector(codes, codes, mask)
                bits = builder.zext(codes, ir.VectorType(INTEGER, count))
                bits = builder.shl(bits, ir.Constant(bits.type, [int(CODE_BITS)] * count))
                return (Vector(builder, builder.bitcast(bits, ir.VectorType(FLOAT, count))) * unit).value

            for channel in range(channels):
                mixed = _mixed(
                    builder, numbers(near, channel), numbers(far, channel), weight, far_weight, pair
                )
                plane = builder.mul(stride, number(channel + 1))
                mixed.store(place(context, builder, line_type, line, builder.add(plane, to)))
            return context.get_dummy_value()

        numbers = (types.float32, types.float32, types.float32, types.boolean)
        places = (types.intp, types.intp)
        return types.void(line, *places, lights, *places, *numbers, matt, gloss), generate

    return mix


mix_many_scalars, mix_few_scalars, mix_one_scalar = (_mixer_of_scalars(count) for count in (MANY, FEW, 1))
mix_many_lights, mix_few_lights, mix_one_light = (_mixer_of_lights(count) for count in (MANY, FEW, 1))
