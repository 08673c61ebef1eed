"""Memory asked for before it is needed: what a loop reads next would else be waited for, one cache line at a time."""

from __future__ import annotations

from .llvm import cgutils, intrinsic, ir, types
from .vectors import place

LINE = 64  # bytes that come together


@intrinsic
def fetch_ahead(typing, array, first, count):
    """Ask for ``count`` numbers of an array, flat, from number ``first`` on; they need not exist.

    Nothing but time depends on it.
    """

    def generate(context, builder, signature, arguments):
        array, first, count = arguments
        array_type = signature.args[0]
        intp, byte = first.type, ir.IntType(8)
        size = context.get_abi_sizeof(context.get_value_type(array_type.dtype))
        fetch = cgutils.get_or_insert_function(
            builder.module,
            ir.FunctionType(ir.VoidType(), (byte.as_pointer(), *(ir.IntType(32),) * 3)),
            "llvm.prefetch.p0i8",
        )
        start = builder.bitcast(place(context, builder, array_type, array, first), byte.as_pointer())
        read, near, data = (ir.Constant(ir.IntType(32), number) for number in (0, 3, 1))
        with cgutils.for_range_slice(builder, intp(0), builder.mul(count, intp(size)), intp(LINE), intp) as (offset, _):
            builder.call(fetch, (builder.gep(start, [offset]), read, near, data))
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp), generate
