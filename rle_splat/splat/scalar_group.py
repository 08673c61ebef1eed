"""A block of BLOCK pixels through several sheets of the scalar at once, each with a slab of its own.

The result is the same bits as one sheet after the other (``scalar_block``).  A sheet depends on the one before only
through the transmittance, so the processor works on all sheets of the group at once; and the row behind them is read
and written once for all of them.
"""

from __future__ import annotations

from ..runtime.llvm import intrinsic, ir, types
from ..runtime.vectors import Vector, count_lanes, place
from .pixel_block import BLOCK, TINY, counted, kind_of, laid_over, row_planes, slab, store_row
from .scalar_block import entry_of, put_block, put_entries, rows_of

GROUP = 4  # sheets handled together: as many as the dearest preset has a voxel


def _whole(number):
    return ir.Constant(ir.IntType(64), number)


def _element(context, builder, array_type, array, number):
    return builder.load(place(context, builder, array_type, array, _whole(number)))


def _joined(blocks):
    """The lanes of all vectors in one, which LLVM takes apart again: so that it puts the same step for all of them
    side by side, and none waits for another."""
    first, *others = blocks
    for other in others:
        padded = other.shuffle(other.value, [min(lane, other.count - 1) for lane in range(first.count)])
        first = first.shuffle(padded.value, range(first.count + other.count))
    return first


def _part(joined, number):
    return joined.shuffle(joined.value, range(BLOCK * number, BLOCK * (number + 1)))


def _spread_each(context, builder, array_type, array):
    """As ``_joined``: each of an array's numbers in the lanes of a block."""
    numbers = (_element(context, builder, array_type, array, number) for number in range(GROUP))
    return _joined([Vector.spread(builder, number, BLOCK) for number in numbers])


def _samples(context, builder, sheet_type, sheet, places_type, places, waiting, down):
    """As ``_joined``: the scalar of all sheets, of two scanlines mixed."""
    sides = []
    for side in range(2):
        blocks = []
        for number in range(GROUP):
            which = builder.add(builder.mul(waiting, _whole(2 * GROUP)), _whole(2 * number + side))
            at = builder.load(place(context, builder, places_type, places, which))
            blocks.append(Vector.load(builder, place(context, builder, sheet_type, sheet, at), BLOCK))
        sides.append(_joined(blocks))
    above, below = sides
    return above.mixed(Vector(builder, down.like(1.0)) - down, below, down)


@intrinsic
def look_up_group(typing, sheet, places, waiting, downs, low, high, origin, rate, last, entries):
    """As ``scalar_block.look_up``, of GROUP sheets; how many samples of all lie in [``low``, ``high``].

    ``sheet``: all blocks of all sheets.  ``places`` (2 * GROUP,) int64: of each sheet where the blocks of its
    scanlines are; ``downs`` (GROUP,) float32.  Out: ``entries`` (GROUP, BLOCK) int32, flat.
    """

    def generate(context, builder, signature, arguments):
        sheet, places, waiting, downs, low, high, origin, rate, last, entries = arguments
        sheet_type, places_type, _, downs_type = signature.args[:4]
        lanes = GROUP * BLOCK
        final = Vector.spread(builder, last, lanes)
        most = Vector(builder, builder.sub(final.value, final.like(1))).as_float()
        low, high, origin, rate = (Vector.spread(builder, n, lanes) for n in (low, high, origin, rate))
        down = _spread_each(context, builder, downs_type, downs)
        value = _samples(context, builder, sheet_type, sheet, places_type, places, waiting, down)
        inside = builder.and_(value.at_least(low), high.at_least(value))
        entry = entry_of(value, origin, rate, most).where(inside, final)
        first = builder.mul(waiting, _whole(lanes))
        put_entries(context, builder, signature.args[9], entries, 0, entry, first)
        return count_lanes(builder, inside, lanes)

    numbers = (types.float32,) * 4
    return types.int64(sheet, places, types.intp, downs, *numbers, types.int32, entries), generate


@intrinsic
def composite_group(typing, table, entries, waiting, depth, deep, thickness, least, state, row, ahead):
    """GROUP slabs of a block composited over the row, one behind the other.

    ``table``, ``entries``: of ``look_up_group``; ``entries`` is None where ``table`` holds samples that are classified
    and lit, (GROUP, 4, BLOCK), flat.  ``thickness`` (GROUP,) float32.  Out: ``ahead`` (GROUP + 1, BLOCK), flat: the
    transmittance ahead of each slab, and behind the last one.  The others, and what is returned: see
    ``scalar_block.composite_classified``.
    """

    def generate(context, builder, signature, arguments):
        table, entries, waiting, depth, deep, thickness, least, state, row, ahead = arguments
        table_type, entries_type, _, depth_type, _, thickness_type, _, state_type, _, ahead_type = signature.args
        kind = kind_of(state_type)
        least = Vector.spread(builder, least, BLOCK).widened(kind)
        first = builder.mul(waiting, _whole(GROUP * BLOCK))

        def sampled(number):
            if not isinstance(entries_type, types.NoneType):
                return rows_of(context, builder, table_type, table, entries_type, entries, number, first)
            places = (_whole(BLOCK * (4 * number + plane)) for plane in range(4))
            return [Vector.load(builder, place(context, builder, table_type, table, at), BLOCK) for at in places]

        *colors, samples = (_joined(planes) for planes in zip(*map(sampled, range(GROUP)), strict=True))
        length = Vector.load(builder, place(context, builder, depth_type, depth, deep), BLOCK)
        length = _joined([length] * GROUP) * _spread_each(context, builder, thickness_type, thickness)
        colors, samples, length = [c.widened(kind) for c in colors], samples.widened(kind), length.widened(kind)
        absorbed, passed, divisor = slab(samples, length, Vector(builder, length.like(1.0)))
        gain = absorbed / divisor.most(TINY)
        *so_far, transmittance = row_planes(context, builder, state_type, state, row)
        for number in range(GROUP):
            put_block(context, builder, ahead_type, ahead, number, transmittance)
            parts = (_part(joined, number) for joined in (gain, passed, absorbed))
            behind = [_part(color, number) for color in colors]
            so_far, transmittance = laid_over(*parts, so_far, transmittance, behind, least)
        put_block(context, builder, ahead_type, ahead, GROUP, transmittance)
        store_row(context, builder, (*so_far, transmittance), state_type, state, row)
        return counted(builder, transmittance, least)

    returned = types.int64(
        table, entries, types.intp, depth, types.intp, thickness, types.float32, state, types.intp, ahead,
    )  # fmt: skip
    return returned, generate
