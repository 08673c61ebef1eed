"""Four-lane arithmetic: the four channels of a voxel are one 128-bit vector.

LLVM's straight-line vectorizer is off in numba, so without these two instructions the horizontal footprint runs
one float at a time (measured: 2.9 ns a pixel against 1.5).  The vectors are LLVM's own, good on any processor.
"""

from __future__ import annotations

from .llvm import intrinsic, ir, numba, types

GROUP = 4  # voxels that are one vector of four channels each

if numba is not None:
    from .vectors import INTEGER, load, place, spread, store

    _LANES = ir.VectorType(ir.FloatType(), 4)
    _CODES = ir.VectorType(INTEGER, 4)

    def _integers(values):
        return ir.Constant(_CODES, list(values))

    def _from_code(builder, bits, kind):
        """A 16-bit float (or four), as an integer of 32 bits, to float32: shifted and brought to its exponent."""
        shift, unbias = (ir.Constant(INTEGER, 12), ir.Constant(ir.FloatType(), 2.0**96))
        if kind is _LANES:
            shift, unbias = _integers([12] * 4), spread(builder, unbias, 4)
        return builder.fmul(builder.bitcast(builder.shl(bits, shift), kind), unbias)

    def _decode_8(builder, code, scale, lanes, at, weight):
        """weight * (density * RGB, density) from four 16-bit floats in one number."""
        words = builder.bitcast(code(at), ir.VectorType(ir.IntType(16), 4))
        values = _from_code(builder, builder.zext(words, _CODES), _LANES)
        return builder.fmul(values, builder.fmul(spread(builder, weight, 4), lanes))

    def _color_and_density(builder, bits, starts, steps, lanes, density):
        """density * (RGB, 1) from linear codes of the color; ``lanes``: the size of their steps."""
        codes = builder.and_(builder.lshr(spread(builder, bits, 4), _integers((*starts, 0))), _integers((*steps, 0)))
        color = builder.fmul(builder.sitofp(codes, _LANES), lanes)
        color = builder.insert_element(color, ir.Constant(ir.FloatType(), 1.0), ir.Constant(INTEGER, 3))
        return builder.fmul(color, spread(builder, density, 4))

    def _decode_6(builder, code, scale, lanes, at, weight):
        """weight * (density * RGB, density) from a 16-bit float and 11, 11 and 10 bits of color."""
        first = builder.mul(at, ir.Constant(at.type, 3))
        density, low, high = (
            builder.zext(code(builder.add(first, ir.Constant(at.type, word))), INTEGER) for word in range(3)
        )
        bits = builder.or_(low, builder.shl(high, ir.Constant(INTEGER, 16)))
        value = builder.fmul(_from_code(builder, density, ir.FloatType()), scale(ir.Constant(at.type, 3)))
        value = builder.fmul(value, weight)
        return _color_and_density(builder, bits, (0, 11, 22), (2047, 2047, 1023), lanes, value)

    def _decode_4(builder, code, scale, lanes, at, weight):
        """weight * (density * RGB, density) from 7 bits a channel and 11 bits that number a density of ``scales``."""
        bits = code(at)
        number = builder.zext(builder.lshr(bits, ir.Constant(INTEGER, 21)), at.type)
        value = builder.fmul(scale(builder.add(number, ir.Constant(at.type, 4))), weight)
        return _color_and_density(builder, bits, (0, 7, 14), (127, 127, 127), lanes, value)

    @intrinsic
    def add4(typing, source, at, weight, target, to):
        """target[to:to+4] += weight * source[at:at+4]; no bounds checks."""

        def generate(context, builder, signature, arguments):
            source, at, weight, target, to = arguments
            source_type, target_type = signature.args[0], signature.args[3]
            pixel = place(context, builder, target_type, target, to)
            value = load(builder, place(context, builder, source_type, source, at), 4)
            product = builder.fmul(spread(builder, weight, 4), value, flags=["contract"])
            store(builder, builder.fadd(load(builder, pixel, 4), product, flags=["contract"]), pixel)
            return context.get_dummy_value()

        return types.void(source, types.intp, types.float32, target, types.intp), generate

    @intrinsic
    def put_group(typing, source, at, weight, target, to):
        """The GROUP voxels target[to:] = weight * source[at:], as if added to nothing; no bounds checks."""

        def generate(context, builder, signature, arguments):
            source, at, weight, target, to = arguments
            source_type, target_type = signature.args[0], signature.args[3]
            value = load(builder, place(context, builder, source_type, source, at), 4 * GROUP)
            product = builder.fmul(spread(builder, weight, 4 * GROUP), value)
            store(builder, product, place(context, builder, target_type, target, to))
            return context.get_dummy_value()

        return types.void(source, types.intp, types.float32, target, types.intp), generate

    @intrinsic
    def clear_group(typing, target, to):
        """The GROUP voxels target[to:] = 0; no bounds checks."""

        def generate(context, builder, signature, arguments):
            nothing = ir.Constant(ir.VectorType(ir.FloatType(), 4 * GROUP), [0.0] * (4 * GROUP))
            store(builder, nothing, place(context, builder, signature.args[0], *arguments))
            return context.get_dummy_value()

        return types.void(target, types.intp), generate

    @intrinsic
    def add_coded(typing, codes, at, scales, weight, target, to):
        """target[to:to+4] += weight * record number ``at`` of ``codes``, coded as ``encode.records`` says.

        ``codes``: flat, uint64 (8 bytes a record), uint16 (6, three numbers each) or uint32 (4).  ``scales``: float32,
        the record's decoding.  No bounds checks.
        """
        decode = {types.uint64: _decode_8, types.uint16: _decode_6, types.uint32: _decode_4}.get(
            getattr(codes, "dtype", None)
        )
        if decode is None:
            return None

        def generate(context, builder, signature, arguments):
            codes, at, scales, weight, target, to = arguments
            codes_type, scales_type, target_type = signature.args[0], signature.args[2], signature.args[4]

            def code(index):
                return builder.load(place(context, builder, codes_type, codes, index))

            def scale(index):
                return builder.load(place(context, builder, scales_type, scales, index))

            lanes = load(builder, place(context, builder, scales_type, scales, ir.Constant(at.type, 0)), 4)
            record = decode(builder, code, scale, lanes, at, weight)
            pixel = place(context, builder, target_type, target, to)
            store(builder, builder.fadd(load(builder, pixel, 4), record, flags=["contract"]), pixel)
            return context.get_dummy_value()

        return types.void(codes, types.intp, scales, types.float32, target, types.intp), generate

else:  # never called: callers take the reference implementation

    def add4(source, at, weight, target, to): ...

    def put_group(source, at, weight, target, to): ...

    def clear_group(target, to): ...

    def add_coded(codes, at, scales, weight, target, to): ...
