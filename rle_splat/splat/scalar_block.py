"""A block of BLOCK pixels of a sheet of the scalar in vector registers: sampled, classified by a table, composited.

A slab is classified by the value at its sheet, or by the mean of the transfer function over all values between two
sheets (pre-integration: Engel, Kraus and Ertl 2001; the mean, from sums of the table, leaves out only how the slab
shades itself).
"""

from __future__ import annotations

from ..runtime.llvm import intrinsic, ir, types
from ..runtime.vectors import FLOAT, INTEGER, Vector, count_lanes, place, transpose4
from ..shade.sample_light import NORMAL
from .pixel_block import BLOCK, composited, slab

# Entries of the lookup table between two sheets up to which the middle one stands for their mean.  Differences of its
# sums are as good as float32 sums of all entries are, so that few of them would lose in rounding what they gain.
SPAN = 32.0
ROW_BITS = 4  # a row of a lookup table is 2**ROW_BITS bytes, four float32: what is kept of an entry is where it begins


def _join(parts):
    """Four vectors of four lanes, one after the other."""
    a, b, c, d = parts
    first, second = a.shuffle(b.value, range(8)), c.shuffle(d.value, range(8))
    return first.shuffle(second.value, range(16))


def _resampler(planes):
    @intrinsic
    def resample(typing, line, base, stride, cells, fractions, first, sheet, at):
        """So many planes of voxels along a scanline, linearly: a block of sheet pixels of each.

        ``line[base:]``: the voxels, planes of ``stride`` numbers.  ``cells`` and ``fractions``, from number ``first``
        on: of ``pixel_block.place_inside``.  Out: ``sheet`` from ``at`` on.  Both voxels are multiplied by their
        shares, so that a voxel which is not kept leaves no trace where its share is zero.
        """

        def generate(context, builder, signature, arguments):
            line, base, stride, cells, fractions, first, sheet, at = arguments
            line_type, _, _, cells_type, fractions_type, _, sheet_type, _ = signature.args

            def number(n):
                return ir.Constant(at.type, n)

            def voxel(i):
                cell = builder.load(place(context, builder, cells_type, cells, builder.add(first, number(i))))
                return builder.add(builder.sext(cell, at.type), base)

            voxels = [voxel(i) for i in range(BLOCK)]
            share = Vector.load(builder, place(context, builder, fractions_type, fractions, first), BLOCK)
            rest = Vector(builder, share.like(1.0)) - share
            for plane in range(planes):
                shift = builder.mul(stride, number(plane))

                def pair(i, shift=shift):
                    cell = builder.add(voxels[i], shift)
                    return Vector.load(builder, place(context, builder, line_type, line, cell), 2)

                # Two pairs of every four, and the other two: so no lane has to cross from one four to another.
                low, high = (
                    _join([pair(i + n).shuffle(pair(i + n + 1).value, range(4)) for i in range(0, BLOCK, 4)])
                    for n in (0, 2)
                )
                lefts = [i + n for i in range(0, BLOCK, 4) for n in (0, 2, BLOCK, BLOCK + 2)]
                left, right = (low.shuffle(high.value, [lane + side for lane in lefts]) for side in (0, 1))
                to = builder.add(at, number(plane * BLOCK))
                left.mixed(rest, right, share).store(place(context, builder, sheet_type, sheet, to))
            return context.get_dummy_value()

        arguments = (line, types.intp, types.intp, cells, fractions, types.intp, sheet, types.intp)
        return types.void(*arguments), generate

    return resample


resample_plane, resample_lit_planes = _resampler(1), _resampler(1 + NORMAL)


def mix_blocks(context, builder, sheet_type, sheet, upper, lower, down, plane):
    """One plane of two scanlines' blocks, mixed; both multiplied by their shares (see ``_resampler``)."""
    above, below = (
        Vector.load(
            builder,
            place(context, builder, sheet_type, sheet, builder.add(at, ir.Constant(at.type, plane * BLOCK))),
            BLOCK,
        )
        for at in (upper, lower)
    )
    return above.mixed(Vector(builder, down.like(1.0)) - down, below, down)


def scalars_of_ends(context, builder, signature, arguments):
    """The scalar of a block of one sheet and of the sheet before, the first eight ``arguments`` of ``look_between``."""
    ends = []
    for first in (0, 4):
        sheet, upper, lower, down = arguments[first : first + 4]
        down = Vector.spread(builder, down, BLOCK)
        ends.append(mix_blocks(context, builder, signature.args[first], sheet, upper, lower, down, 0))
    return ends


def put_block(context, builder, array_type, array, number, value, first=None):
    """Put a block's numbers into a scratch array, as its block ``number``, from its number ``first`` on."""
    at = ir.Constant(ir.IntType(64), number * BLOCK)
    at = at if first is None else builder.add(first, at)
    value.store(place(context, builder, array_type, array, at))


def put_entries(context, builder, array_type, array, number, entry, first=None):
    """As ``put_block``: where in a table of four float32 columns the rows of these numbers begin, in bytes."""
    shifted = builder.shl(entry.value, entry.like(ROW_BITS))
    put_block(context, builder, array_type, array, number, Vector(builder, shifted), first)


def entry_of(value, origin, rate, most):
    """The table entry (int32 lanes) of stored values, the first or the last for what lies outside."""
    return ((value - origin) * rate).most(0.0).least(most).truncated()


@intrinsic
def look_up(typing, sheet, upper, lower, down, low, high, origin, rate, last, entries, shares):
    """The table entries of one block of samples of the scalar; how many samples lie in [``low``, ``high``].

    ``sheet``: blocks of the scanlines at ``upper`` and ``lower``, ``down`` the fraction towards the latter.
    ``origin``, ``rate`` and ``last``: stored value where the first entry begins, entries per stored value, number
    of the transparent entry, which samples outside get.  Out: ``entries`` (BLOCK,) int32; ``shares`` as
    ``look_between`` has them, for a slab of one sheet.
    """

    def generate(context, builder, signature, arguments):
        sheet, upper, lower, down, low, high, origin, rate, last, entries, shares = arguments
        down = Vector.spread(builder, down, BLOCK)
        value = mix_blocks(context, builder, signature.args[0], sheet, upper, lower, down, 0)
        low, high, origin, rate = (Vector.spread(builder, n, BLOCK) for n in (low, high, origin, rate))
        inside = builder.and_(value.at_least(low), high.at_least(value))
        final = Vector.spread(builder, last, BLOCK)
        most = Vector(builder, builder.sub(final.value, final.like(1))).as_float()
        entry = entry_of(value, origin, rate, most).where(inside, final)
        put_entries(context, builder, signature.args[9], entries, 0, entry)
        one = Vector(builder, value.like(1.0))
        for number in range(2):
            put_block(context, builder, signature.args[10], shares, number, one)
        return count_lanes(builder, inside, BLOCK)

    numbers = (types.float32,) * 5
    return types.int64(sheet, types.intp, types.intp, *numbers, types.int32, entries, shares), generate


def _between(builder, here, there, numbers, final, base=None):
    """Entries, ends of spans, shares, which slabs show anything, and of which the mean is to be taken; see
    ``look_between``.  ``final``: the transparent entry; ``base``: of the first entry, 0 without."""
    least, low, high, nearest, furthest, origin, rate = numbers
    is_here, is_there = here.at_least(least), there.at_least(least)
    one = Vector(builder, here.like(1.0))
    half = Vector(builder, here.like(0.5))
    zero = Vector(builder, here.like(0.0))
    both, some = builder.and_(is_here, is_there), builder.or_(is_here, is_there)
    counts = one.where(both, half)
    light = half.where(both, one.where(is_here, zero))
    first, second = there.where(is_there, here), here.where(is_here, there)
    first, second = (value.most(nearest).least(furthest) for value in (first, second))
    smallest, largest = first.least(second), first.most(second)
    shown = builder.and_(builder.and_(largest.at_least(low), high.at_least(smallest)), some)
    most = Vector(builder, builder.sub(final.value, final.like(1))).as_float()
    middle = (smallest + largest) * 0.5
    inside = builder.and_(builder.and_(middle.at_least(low), high.at_least(middle)), some)
    entry = entry_of(middle, origin, rate, most).where(inside, final)
    width = (largest - smallest) * rate
    wide = builder.and_(width.at_least(SPAN), shown)
    whole = final.as_float()
    ends = [(((end - origin) * rate) + 0.5).most(0.0).least(whole).truncated() for end in (smallest, largest)]
    if base is not None:
        entry, *ends = (Vector(builder, builder.add(each.value, base.value)) for each in (entry, *ends))
    return entry, ends, (counts, light, (one / width.most(1.0)).where(wide, 0.0)), shown, wide


def _put_between(context, builder, kinds, arrays, found):
    """Put what ``_between`` has found into ``entries``, ``spans`` and ``shares``; what ``look_between`` returns."""
    (entries_type, spans_type, shares_type), (entries, spans, shares) = kinds, arrays
    entry, ends, parts, shown, wide = found
    put_entries(context, builder, entries_type, entries, 0, entry)
    for number, end in enumerate(ends):
        put_entries(context, builder, spans_type, spans, number, end)
    for number, share in enumerate(parts):
        put_block(context, builder, shares_type, shares, number, share)
    taken = count_lanes(builder, wide, BLOCK)
    return builder.add(count_lanes(builder, shown, BLOCK), builder.shl(taken, ir.Constant(taken.type, 8)))


@intrinsic
def look_between(
    typing, sheet, upper, lower, down, before, upper_before, lower_before, down_before, least, low, high,
    nearest, furthest, origin, rate, last, entries, spans, shares,
):  # fmt: skip
    """The table entries of one block of slabs between two sheets, the scalar linear in between.

    As ``look_up``; ``before``: the sheet before, likewise.  ``least``: what is below is no sample.  A slab of which
    one end is none counts half, and has the value of the other.  ``nearest``, ``furthest``: stand for what lies
    beyond.
    Out: ``entries`` (BLOCK,) of the middle; ``spans`` (2, BLOCK) int32, entries from which and up to which the mean
    is to be taken; ``shares`` (3, BLOCK) float32: of the slab that counts; of this sheet's light in it; and one
    over the entries between, where they are more than SPAN, else 0.
    Returns how many slabs show anything, plus 256 times of how many of those the mean is to be taken.
    """

    def generate(context, builder, signature, arguments):
        *numbers, final = (Vector.spread(builder, n, BLOCK) for n in arguments[8:16])
        found = _between(builder, *scalars_of_ends(context, builder, signature, arguments), numbers, final)
        return _put_between(context, builder, signature.args[16:], arguments[16:], found)

    numbers, places = (types.float32,), (types.intp, types.intp)
    returned = types.int64(
        sheet, *places, *numbers, before, *places, *numbers, *(numbers * 7), types.int32, entries, spans, shares
    )
    return returned, generate


@intrinsic
def look_between_each(
    typing, sheet, upper, lower, down, before, upper_before, lower_before, down_before, looks, rows, entries, spans,
    shares,
):  # fmt: skip
    """As ``look_between``, where each pixel has a table of its own within a common one.

    ``looks``: (7, BLOCK) float32: origin, rate, least, low, high, nearest, furthest.  ``rows``: (2, BLOCK) int32: the
    transparent entry of each pixel's table, and where its first one is in the common one.
    """

    def generate(context, builder, signature, arguments):
        looks, rows = arguments[8:10]
        origin, rate, *others = (block_of(context, builder, signature.args[8], looks, n) for n in range(7))
        final, base = (block_of(context, builder, signature.args[9], rows, n, INTEGER) for n in range(2))
        ends = scalars_of_ends(context, builder, signature, arguments)
        found = _between(builder, *ends, (*others, origin, rate), final, base)
        return _put_between(context, builder, signature.args[10:], arguments[10:], found)

    places, number = (types.intp, types.intp), types.float32
    return types.int64(sheet, *places, number, before, *places, number, looks, rows, entries, spans, shares), generate


def block_of(context, builder, array_type, array, number, kind=FLOAT):
    """Block ``number`` of a flat array."""
    at = ir.Constant(ir.IntType(64), number * BLOCK)
    return Vector.load(builder, place(context, builder, array_type, array, at), BLOCK, kind)


def rows_of(context, builder, table_type, table, indices_type, indices, number, first=None):
    """Four planes: the rows of a table of four columns that begin so many bytes on as block ``number`` of
    ``indices`` says."""
    whole = place(context, builder, table_type, table, ir.Constant(ir.IntType(64), 0))
    in_bytes = builder.bitcast(whole, ir.IntType(8).as_pointer())

    def row(i):
        at = ir.Constant(ir.IntType(64), number * BLOCK + i)
        at = at if first is None else builder.add(first, at)
        start = builder.load(place(context, builder, indices_type, indices, at))
        start = builder.gep(in_bytes, [builder.sext(start, at.type)])
        return Vector.load(builder, builder.bitcast(start, whole.type), 4)

    # Every fourth row in one vector, so that transposing them needs no lane to cross from group to group.
    return transpose4([_join([row(i) for i in range(first, BLOCK, 4)]) for first in range(4)])


@intrinsic
def classify_values(typing, table, entries, sampled):
    """``sampled`` (4, BLOCK): extinction * RGB, extinction of the table's ``entries`` (BLOCK,)."""

    def generate(context, builder, signature, arguments):
        table, entries, sampled = arguments
        for number, plane in enumerate(rows_of(context, builder, *_both(signature, 0, table, 1, entries), 0)):
            put_block(context, builder, signature.args[2], sampled, number, plane)
        return context.get_dummy_value()

    return types.void(table, entries, sampled), generate


@intrinsic
def classify_spans(typing, sums, spans, shares, sampled):
    """Puts the mean over a span of entries into ``sampled`` where there is one; see ``look_between``."""

    def generate(context, builder, signature, arguments):
        sums, spans, shares, sampled = arguments
        from_, to = (rows_of(context, builder, *_both(signature, 0, sums, 1, spans), number) for number in range(2))
        third = ir.Constant(ir.IntType(64), 2 * BLOCK)
        over = Vector.load(builder, place(context, builder, signature.args[2], shares, third), BLOCK)
        wide = over.at_least(1e-30)
        for number, (first, second) in enumerate(zip(from_, to, strict=True)):
            at = place(context, builder, signature.args[3], sampled, ir.Constant(ir.IntType(64), number * BLOCK))
            so_far = Vector.load(builder, at, BLOCK)
            ((second - first) * over).most(0.0).where(wide, so_far).store(at)
        return context.get_dummy_value()

    return types.void(sums, spans, shares, sampled), generate


def _both(signature, first, first_value, second, second_value):
    return signature.args[first], first_value, signature.args[second], second_value


@intrinsic
def composite_classified(typing, sampled, shares, depth, deep, thickness, least, state, row, transmitted):
    """One block of slabs, classified and lit, composited over the row.

    ``sampled``: of ``classify_values``; ``shares``: of ``look_between``.  The others, and what is returned: see
    ``pixel_block.composite_extinction``.
    """

    def generate(context, builder, signature, arguments):
        sampled, shares, depth, deep, thickness, least, state, row, transmitted = arguments
        sampled_type, shares_type, depth_type = (signature.args[n] for n in (0, 1, 2))
        state_type, transmitted_type = (signature.args[n] for n in (6, 8))

        def block(array_type, array, number):
            at = place(context, builder, array_type, array, ir.Constant(ir.IntType(64), number * BLOCK))
            return Vector.load(builder, at, BLOCK)

        *colors, samples = (block(sampled_type, sampled, number) for number in range(4))
        length = Vector.load(builder, place(context, builder, depth_type, depth, deep), BLOCK)
        length = length * Vector.spread(builder, thickness, BLOCK) * block(shares_type, shares, 0)
        return composited(
            context, builder, slab, colors, samples, length, least, state_type, state, row, transmitted_type,
            transmitted,
        )  # fmt: skip

    number = types.float32
    returned = types.int64(
        sampled, shares, depth, types.intp, number, number, state, types.intp, transmitted,
    )  # fmt: skip
    return returned, generate
