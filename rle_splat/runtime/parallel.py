"""Loops shared out among threads: numba's own pool of threads, called from a serial kernel.

A kernel with ``prange`` is compiled three times over (its loop's body, the body's wrapper, what is round it) and takes
four times as long to compile as a serial one.  Here the body is a kernel of its own, compiled once, and the call to the
pool is written out (measured: 0.4 s of compiling against 0.1 s).  The parts of a loop are handed out as threads
become free, so uneven work, or another program on one of the cores, does not hold up the rest.
"""

from __future__ import annotations

from .jit import numba

PARTS = 16  # pieces of a loop for each thread: little enough to be called for, small enough to even out

if numba is not None:
    from llvmlite import ir
    from numba.core import cgutils, types
    from numba.extending import intrinsic

    _BYTES = ir.IntType(8).as_pointer()
    # Where a loop is, how far it goes, the length of its pieces, whether a piece failed, and the arguments of its body.
    _NEXT, _TOTAL, _PIECE, _FAILED, _ARGUMENTS = range(5)

    @intrinsic
    def share_out(typing, task, count, arguments):
        """``task(begin, end, *arguments)`` for parts of [0, count) that together are all of it, on all threads.

        ``task``: a serial kernel that returns nothing; its parts must not write to the same places.  Only under
        ``jit.parallel_call``, which makes the threads and says how many there are.  Raises MemoryError when a part
        fails: all that can go wrong in one is to find no room for its scratch.
        """
        if not isinstance(task, types.Dispatcher) or not isinstance(arguments, types.BaseTuple):
            return None
        called = typing.resolve_function_type(task, (types.intp, types.intp, *arguments.types), {})

        def generate(context, builder, signature, values):
            _, total, held = values
            intp = context.get_value_type(types.intp)
            job_type = ir.LiteralStructType((intp, intp, intp, intp, held.type))
            overload = task.dispatcher.overloads[tuple(called.args)]
            context.add_linking_libs((overload.library,))

            def field(block, job, number):
                return block.gep(job, [ir.IntType(32)(0), ir.IntType(32)(number)])

            # What each thread runs: it takes pieces until there are none.  Its type is that of a numpy inner loop.
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
            status, _ = context.call_internal_no_propagate(block, overload.fndesc, called, [begin, end, *unpacked])
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
            # One item of work a thread, over one array of no bytes; the job itself is the loop's own data.
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

    @intrinsic
    def taken(typing, counter):
        """The number in ``counter`` (1,) int64, which is raised by one: no two threads get the same."""

        def generate(context, builder, signature, arguments):
            data = context.make_array(counter)(context, builder, arguments[0]).data
            return builder.atomic_rmw("add", data, ir.Constant(ir.IntType(64), 1), "monotonic")

        return types.int64(counter), generate

else:

    def taken(counter): ...

    def share_out(task, count, arguments):
        """All of [0, count) at once."""
        task(0, count, *arguments)
