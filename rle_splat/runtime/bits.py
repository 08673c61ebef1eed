"""Words of bits: which blocks or voxels are meant, a bit each; finding and counting them takes one instruction."""

from __future__ import annotations

from .llvm import intrinsic, ir, types


@intrinsic
def lowest_bit(typing, word):
    """The number of a word's lowest bit that is set; the word is not zero."""

    def generate(context, builder, signature, arguments):
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.uint64), generate


@intrinsic
def count_bits(typing, word):
    """How many bits of a word are set."""

    def generate(context, builder, signature, arguments):
        return builder.ctpop(arguments[0])

    return types.int64(types.uint64), generate


@intrinsic
def eight_bytes(typing, row, at):
    """Eight bytes of a row of bytes (n,), from number ``at`` on, as one number.  (A view of the row would have
    numba compile two functions more.)"""

    def generate(context, builder, signature, arguments):
        data = context.make_array(row)(context, builder, arguments[0]).data
        place = builder.gep(data, [arguments[1]])
        return builder.load(builder.bitcast(place, ir.IntType(64).as_pointer()), align=1)

    return types.uint64(row, types.intp), generate


def _copier_of(size):
    @intrinsic
    def copy(typing, source, at, target, to):
        """So many bytes from number ``at`` of ``source`` on to number ``to`` of ``target`` on, both (n,) uint8."""

        def generate(context, builder, signature, arguments):
            source, at, target, to = arguments
            kind = ir.VectorType(ir.IntType(8), size).as_pointer()
            here, there = (
                builder.bitcast(builder.gep(context.make_array(of)(context, builder, array).data, [place]), kind)
                for of, array, place in ((signature.args[0], source, at), (signature.args[2], target, to))
            )
            builder.store(builder.load(here, align=1), there, align=1)
            return context.get_dummy_value()

        return types.void(source, types.intp, target, types.intp), generate

    return copy


copy_16, copy_4, copy_1 = (_copier_of(size) for size in (16, 4, 1))
