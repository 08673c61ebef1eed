"""Loops shared out among threads, and a counter that they share.

The loop's body is a serial kernel, the *task*.  ``share_out`` calls it for parts of the loop on the threads of numba's
own pool.  A ``prange`` loop would be compiled three times (its body, the body's wrapper, the code around it) and takes
four times as long to compile (measured: 0.4 s against 0.1 s).  Threads take parts as they become free, so that uneven
work, or another program on one of the cores, does not hold up the rest.

With plain numba (see ``jit``) the task runs once, for the whole loop.
"""

from __future__ import annotations

from copy import copy

from .jit import internals, kernel
from .llvm import cgutils, intrinsic, ir, types

PARTS = 16  # parts of a loop for each thread: few enough for the cost of a call, enough to even out the work


@intrinsic
def taken(typing, counter):
    """Return the number in ``counter`` (1,) int64 and raise it by one; no two threads get the same number."""

    def generate(context, builder, signature, arguments):
        data = context.make_array(counter)(context, builder, arguments[0]).data
        return builder.atomic_rmw("add", data, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(counter), generate


if internals is not None:
    _BYTES = ir.IntType(8).as_pointer()
    # The fields of a job: where the loop is, its length, the length of its parts, whether a part has failed, and the
    # arguments of the task.
    _NEXT, _TOTAL, _PIECE, _FAILED, _ARGUMENTS = range(5)

    @intrinsic
    def share_out(typing, task, count, arguments):
        """Call ``task(begin, end, *arguments)`` on all threads, for parts of [0, count) that together cover it.

        Only under ``jit.parallel_call``, which starts the threads and sets their number.

        Parameters
        ----------
        task : kernel
            Serial, without a return value.  Its parts must not write to the same elements.
        count : int
        arguments : tuple

        Raises
        ------
        MemoryError
            When a part fails: finding no memory for scratch is all that can go wrong in one.
        """
        if not isinstance(task, types.Dispatcher) or not isinstance(arguments, types.BaseTuple):
            return None
        called = typing.resolve_function_type(task, (types.intp, types.intp, *arguments.types), {})

        def generate(context, builder, signature, values):
            _, total, held = values
            intp = context.get_value_type(types.intp)
            job_type = ir.LiteralStructType((intp, intp, intp, intp, held.type))
            overload = task.dispatcher.overloads[tuple(called.args)]
            part_of = internals.OwnCopy(overload.library, builder.function.name)
            context.add_linking_libs((part_of,))
            described = copy(overload.fndesc)
            described.mangled_name = part_of.name_of(described.mangled_name)

            def field(block, job, number):
                return block.gep(job, [ir.IntType(32)(0), ir.IntType(32)(number)])

            # What each thread runs: it takes parts until none is left.  Its type is that of a numpy inner loop.
            part_type = ir.FunctionType(
                ir.VoidType(), (_BYTES.as_pointer(), intp.as_pointer(), intp.as_pointer(), _BYTES)
            )
            part = ir.Function(builder.module, part_type, f"{builder.function.name}.{overload.fndesc.unique_name}.part")
            part.linkage = "internal"
            block = ir.IRBuilder(part.append_basic_block("begin"))
            take, work, fail, done = (part.append_basic_block(name) for name in ("take", "work", "fail", "done"))
            job = block.bitcast(part.args[3], job_type.as_pointer())
            last, piece, packed = (block.load(field(block, job, number)) for number in (_TOTAL, _PIECE, _ARGUMENTS))
            block.branch(take)
            block.position_at_end(take)
            begin = block.atomic_rmw("add", field(block, job, _NEXT), piece, "monotonic")
            block.cbranch(block.icmp_signed("<", begin, last), work, done)
            block.position_at_end(work)
            end = block.add(begin, piece)
            end = block.select(block.icmp_signed("<", end, last), end, last)
            unpacked = [block.extract_value(packed, number) for number in range(len(arguments.types))]
            status, _ = context.call_internal_no_propagate(block, described, called, [begin, end, *unpacked])
            block.cbranch(status.is_error, fail, take)
            block.position_at_end(fail)
            block.store(intp(1), field(block, job, _FAILED))
            block.branch(done)
            block.position_at_end(done)
            block.ret_void()

            threads = builder.call(
                cgutils.get_or_insert_function(builder.module, ir.FunctionType(intp, ()), "get_num_threads"), ()
            )
            piece = builder.sdiv(total, builder.mul(threads, intp(PARTS)))
            piece = builder.select(builder.icmp_signed(">", piece, intp(1)), piece, intp(1))
            job = cgutils.alloca_once(builder, job_type)
            for number, value in enumerate((intp(0), total, piece, intp(0), held)):
                builder.store(value, field(builder, job, number))
            # One item of work for each thread, over an array of no bytes; the job is passed as the loop's own data.
            inputs = cgutils.alloca_once_value(builder, _BYTES(None))
            items, step = (cgutils.alloca_once_value(builder, value) for value in (threads, intp(0)))
            pool = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(ir.VoidType(), (_BYTES,) * 5 + (intp,) * 3), "numba_parallel_for"
            )
            passed = [builder.bitcast(value, _BYTES) for value in (part, inputs, items, step, job)]
            builder.call(pool, [*passed, intp(0), intp(1), threads])
            failed = builder.icmp_signed("!=", builder.load(field(builder, job, _FAILED)), intp(0))
            with builder.if_then(failed, likely=False):
                context.call_conv.return_user_exc(builder, MemoryError, ("no room for a kernel's scratch",))
            return context.get_dummy_value()

        return types.void(task, types.intp, arguments), generate

else:

    @kernel
    def share_out(task, count, arguments):
        """Call the task once for the whole loop."""
        task(0, count, *arguments)
