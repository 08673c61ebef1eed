"""A block of BLOCK pixels of a sheet of the scalar in vector registers: sampled, classified by a table, composited."""

from __future__ import annotations

from ..jit import numba
from .pixel_block import BLOCK

if numba is not None:
    from llvmlite import ir
    from numba.core import types
    from numba.extending import intrinsic

    from ..vectors import DOUBLE, Vector, count_lanes, place, transpose4
    from .pixel_block import composited, slab

    @intrinsic
    def place_inside(typing, cells, fractions, to, start, step, top):
        """Where the samples of one block lie on a scanline, none beyond its ends: see ``pixel_block.place_tent``.

        ``start``, ``step`` and ``top``, the last voxel: float64, in voxels.  Out: ``cells`` int32, the number of the
        left voxel, and ``fractions`` float32 to the right one, from number ``to`` on.
        """

        def generate(context, builder, signature, arguments):
            cells, fractions, to, start, step, top = arguments
            start, step, top = (Vector.spread(builder, number, BLOCK) for number in (start, step, top))
            pixels = Vector(builder, ir.Constant(ir.VectorType(DOUBLE, BLOCK), [float(i) for i in range(BLOCK)]))
            x = (start + pixels * step).most(0.0).least(top)
            cell = x.truncated()
            (x - cell.as_float(DOUBLE)).as_single().store(place(context, builder, signature.args[1], fractions, to))
            cell.store(place(context, builder, signature.args[0], cells, to))
            return context.get_dummy_value()

        numbers = (types.float64,) * 3
        return types.void(cells, fractions, types.intp, *numbers), generate

    @intrinsic
    def resample_plane(typing, line, base, cells, fractions, first, sheet, at):
        """One number a voxel along a scanline, linearly: a block of sheet pixels.

        ``line[base:]``: the voxels.  ``cells`` and ``fractions``, from number ``first`` on: of ``place_inside``.
        Out: ``sheet`` from ``at`` on.  Both voxels are multiplied by their shares, so that a voxel which is not kept
        leaves no trace where its share is zero.
        """

        def generate(context, builder, signature, arguments):
            line, base, cells, fractions, first, sheet, at = arguments
            line_type, _, cells_type, fractions_type, _, sheet_type, _ = signature.args

            def number(n):
                return ir.Constant(at.type, n)

            for group in range(0, BLOCK, 4):
                pairs = []
                for i in range(group, group + 4):
                    cell = builder.load(place(context, builder, cells_type, cells, builder.add(first, number(i))))
                    cell = builder.add(builder.sext(cell, at.type), base)
                    pairs.append(Vector.load(builder, place(context, builder, line_type, line, cell), 2))
                upper = pairs[0].shuffle(pairs[1].value, range(4))
                lower = pairs[2].shuffle(pairs[3].value, range(4))
                left, right = upper.shuffle(lower.value, (0, 2, 4, 6)), upper.shuffle(lower.value, (1, 3, 5, 7))
                which = builder.add(first, number(group))
                share = Vector.load(builder, place(context, builder, fractions_type, fractions, which), 4)
                one = Vector(builder, share.like(1.0))
                mixed = left * (one - share) + right * share
                mixed.store(place(context, builder, sheet_type, sheet, builder.add(at, number(group))))
            return context.get_dummy_value()

        arguments = (line, types.intp, cells, fractions, types.intp, sheet, types.intp)
        return types.void(*arguments), generate

    def _mixed(context, builder, sheet_type, sheet, upper, lower, down, plane):
        """One plane of two scanlines' blocks, mixed; both multiplied by their shares (see ``resample_plane``)."""
        above, below = (
            Vector.load(
                builder,
                place(context, builder, sheet_type, sheet, builder.add(at, ir.Constant(at.type, plane * BLOCK))), BLOCK,
            )
            for at in (upper, lower)
        )
        return above * (Vector(builder, down.like(1.0)) - down) + below * down

    @intrinsic
    def look_up(typing, sheet, upper, lower, down, low, high, origin, rate, last, entries):
        """The table entries of one block of samples of the scalar; how many samples lie in [``low``, ``high``].

        ``sheet``: blocks of the scanlines at ``upper`` and ``lower``, ``down`` the fraction towards the latter.
        ``origin``, ``rate`` and ``last``: stored value where the first entry begins, entries per stored value, number
        of the transparent entry, which samples outside get.  Out: ``entries`` (BLOCK,) int32.
        """

        def generate(context, builder, signature, arguments):
            sheet, upper, lower, down, low, high, origin, rate, last, entries = arguments
            down = Vector.spread(builder, down, BLOCK)
            value = _mixed(context, builder, signature.args[0], sheet, upper, lower, down, 0)
            low, high = (Vector.spread(builder, end, BLOCK) for end in (low, high))
            inside = builder.and_(value.at_least(low), high.at_least(value))
            final = Vector.spread(builder, last, BLOCK)
            most = Vector(builder, builder.sub(final.value, final.like(1))).as_float()
            scaled = (value - Vector.spread(builder, origin, BLOCK)) * Vector.spread(builder, rate, BLOCK)
            index = scaled.most(0.0).least(most).truncated().where(inside, final)
            index.store(place(context, builder, signature.args[9], entries, ir.Constant(upper.type, 0)))
            return count_lanes(builder, inside, BLOCK)

        numbers = (types.float32,) * 5
        return types.int64(sheet, types.intp, types.intp, *numbers, types.int32, entries), generate

    def _joined(parts):
        """Four vectors of four lanes, one after the other."""
        a, b, c, d = parts
        first, second = a.shuffle(b.value, range(8)), c.shuffle(d.value, range(8))
        return first.shuffle(second.value, range(16))

    @intrinsic
    def composite_classified(
        typing, table, entries, sheet, upper, lower, down, matt, gloss, depth, deep, thickness, least, state, row,
        before,
    ):
        """One block of samples, classified, lit and composited over the row as a homogeneous slab.

        ``table``: flat float32, (extinction * RGB, extinction) for each entry; ``entries``: of ``look_up``.  ``matt``
        and ``gloss``: tuples of the planes of ``sheet`` that the colour is multiplied by, and that are added to it:
        none, one or three each.  The others, and what is returned: see ``pixel_block.composite_extinction``.
        """
        counts = (len(matt.types), len(gloss.types))
        if any(count not in (0, 1, 3) for count in counts):
            return None

        def generate(context, builder, signature, arguments):
            table, entries, sheet, upper, lower, down, matt, gloss, depth, deep, thickness, least = arguments[:12]
            state, row, before = arguments[12:]
            table_type, entries_type, sheet_type = signature.args[:3]
            depth_type, state_type, before_type = (signature.args[n] for n in (8, 12, 14))
            groups = []
            for group in range(0, BLOCK, 4):
                looks = []
                for i in range(group, group + 4):
                    entry = builder.load(place(context, builder, entries_type, entries, ir.Constant(row.type, i)))
                    at = builder.shl(builder.sext(entry, row.type), ir.Constant(row.type, 2))
                    looks.append(Vector.load(builder, place(context, builder, table_type, table, at), 4))
                groups.append(transpose4(looks))
            *colors, samples = (_joined(parts) for parts in zip(*groups, strict=True))
            down = Vector.spread(builder, down, BLOCK)

            def light(planes, count, channel):
                """The plane of light for a colour's channel, mixed, whatever plane that is."""
                plane = builder.extract_value(planes, channel if count == 3 else 0)
                offset = builder.mul(plane, ir.Constant(plane.type, BLOCK))
                places = (builder.add(at, offset) for at in (upper, lower))
                return _mixed(context, builder, sheet_type, sheet, *places, down, 0)

            if counts[0]:
                shine = [light(matt, counts[0], channel) for channel in range(counts[0])]
                colors = [color * shine[channel % counts[0]] for channel, color in enumerate(colors)]
            if counts[1]:
                shine = [light(gloss, counts[1], channel) for channel in range(counts[1])]
                colors = [color + samples * shine[channel % counts[1]] for channel, color in enumerate(colors)]
            length = Vector.load(builder, place(context, builder, depth_type, depth, deep), BLOCK)
            length = length * Vector.spread(builder, thickness, BLOCK)
            return composited(
                context, builder, slab, colors, samples, length, least, state_type, state, row, before_type, before
            )

        places, numbers = (types.intp, types.intp), (types.float32, types.float32)
        returned = types.int64(
            table, entries, sheet, *places, types.float32, matt, gloss, depth, types.intp, *numbers, state, types.intp,
            before,
        )
        return returned, generate

else:  # never called: callers take the numpy twin

    def place_inside(cells, fractions, to, start, step, top): ...

    def resample_plane(line, base, cells, fractions, first, sheet, at): ...

    def look_up(sheet, upper, lower, down, low, high, origin, rate, last, entries): ...

    def composite_classified(
        table, entries, sheet, upper, lower, down, matt, gloss, depth, deep, thickness, least, state, row, before
    ): ...
