"""A block of BLOCK pixels of a sheet's scanline in vector registers: footprints added, sheet composited.

Blocks are planar: BLOCK numbers of red, then green, blue and the fourth channel, which is extinction (or opacity) in
a sheet and transmittance in the row behind it.

The row is float32, or float64 behind so many sheets that float32's rounding would add up (``accumulator``): with a
float64 ``state`` and ``before``, numba compiles the same formulas once more, when they are first needed.
"""

from __future__ import annotations

import math

import numpy as np

from ..runtime.llvm import intrinsic, ir, types
from ..runtime.vectors import DOUBLE, FLOAT, INTEGER, Vector, count_lanes, place, transpose4

BLOCK = 16  # pixels handled together; a multiple of every SIMD width in use
RED, GREEN, BLUE, TRANSMITTANCE = 0, BLOCK, 2 * BLOCK, 3 * BLOCK  # planes of a block

# Every sheet rounds the transmittance: so many of float32's roundings, 2**-24 each, are a quarter of a level.
MOST_SHEETS_IN_SINGLE = 1 << 14

LOG2E = 1.0 / math.log(2.0)
# 2**r - 1 on [-1/2, 1/2]: Taylor terms ln(2)**n / n!, relative error below float32's rounding; below float64's.
EXPONENTIAL = [float(np.float32(math.log(2.0) ** n / math.factorial(n))) for n in range(1, 8)]
EXPONENTIAL_IN_DOUBLE = [math.log(2.0) ** n / math.factorial(n) for n in range(1, 15)]
TINY = float(np.float32(1e-37))  # keeps 0/0 out of color = associated color / extinction
MOST = 126.0  # exponent at which a sheet is opaque and 2**-n is still a normal number


def accumulator(sheets: int):
    """The numbers that color and transmittance are kept in behind so many sheets (algorithm.md 3.4, A1)."""
    return np.float64 if sheets > MOST_SHEETS_IN_SINGLE else np.float32


def kind_of(array_type):
    """LLVM's type of an array's numbers."""
    return DOUBLE if array_type.dtype == types.float64 else FLOAT


def row_planes(context, builder, array_type, array, at):
    """Loads the four planes of the block at number ``at``."""
    places = [
        place(context, builder, array_type, array, builder.add(at, ir.Constant(at.type, plane)))
        for plane in (RED, GREEN, BLUE, TRANSMITTANCE)
    ]
    return [Vector.load(builder, plane, BLOCK, kind_of(array_type)) for plane in places]


def _transmitted(tau2):
    """2**-tau2 as a product (power, 1 + p): p without cancellation, power exact."""
    kind = tau2.value.type.element
    terms = EXPONENTIAL if kind == FLOAT else EXPONENTIAL_IN_DOUBLE
    whole = (tau2 + 0.5).truncated()
    rest = whole.as_float(kind) - tau2
    p = rest * terms[-1]
    for term in terms[-2::-1]:
        p = (p + term) * rest
    zero = Vector(tau2.builder, ir.Constant(whole.value.type, [0] * whole.count))
    negated = Vector(tau2.builder, tau2.builder.sub(zero.value, whole.value))
    return negated.power_of_two(kind), p


def _placer(is_padded: bool):
    @intrinsic
    def place_samples(typing, cells, fractions, to, start, scale, top):
        """Where the samples of one block lie on a scanline: the left voxel, and the fraction to the right one.

        ``start``: of the first sample in sheet pixels from voxel 0, ``scale`` sheet pixels a voxel, both float64;
        divided by it as ``footprints.voxel_at`` is.  ``top``: the last valid coordinate, float64, in voxels.  Out:
        ``cells`` int32, the voxel's number, and ``fractions`` float32, from number ``to`` on.  If the scanline
        ``is_padded``, its index 0 is voxel -1, which ``top`` counts too, and ``cells`` are those of the first of four
        floats.
        """

        def generate(context, builder, signature, arguments):
            cells, fractions, to, start, scale, top = arguments
            start, scale, top = (Vector.spread(builder, number, BLOCK) for number in (start, scale, top))
            pixels = Vector(builder, ir.Constant(ir.VectorType(DOUBLE, BLOCK), [float(i) for i in range(BLOCK)]))
            x = (start + pixels) / scale
            x = (x + 1.0 if is_padded else x).most(0.0).least(top)
            cell = x.truncated()
            (x - cell.as_float(DOUBLE)).as_single().store(place(context, builder, signature.args[1], fractions, to))
            if is_padded:
                cell = Vector(builder, builder.shl(cell.value, cell.like(2)))
            cell.store(place(context, builder, signature.args[0], cells, to))
            return context.get_dummy_value()

        numbers = (types.float64,) * 3
        return types.void(cells, fractions, types.intp, *numbers), generate

    return place_samples


place_tent, place_inside = _placer(True), _placer(False)


@intrinsic
def resample_tent(typing, line, cells, fractions, first, sheet, at):
    """The tent footprint along a scanline: a block of sheet pixels, each between two voxels.

    ``line``: flat float32, four channels a voxel.  ``cells`` and ``fractions``, from number ``first`` on: index of
    the left voxel's first float, int32, and float32 fraction to the right one.  Out: ``sheet`` from ``at`` on.
    """

    def generate(context, builder, signature, arguments):
        line, cells, fractions, first, sheet, at = arguments
        line_type, cells_type, fractions_type, _, sheet_type, _ = signature.args

        def number(n):
            return ir.Constant(at.type, n)

        for group in range(0, BLOCK, 4):
            mixed = []
            for i in range(group, group + 4):
                which = builder.add(first, number(i))
                cell = builder.sext(builder.load(place(context, builder, cells_type, cells, which)), at.type)
                fraction = builder.load(place(context, builder, fractions_type, fractions, which))
                left = Vector.load(builder, place(context, builder, line_type, line, cell), 4)
                after = place(context, builder, line_type, line, builder.add(cell, number(4)))
                right = Vector.load(builder, after, 4)
                mixed.append(left + (right - left) * Vector.spread(builder, fraction, 4))
            for plane, lanes in zip((RED, GREEN, BLUE, TRANSMITTANCE), transpose4(mixed), strict=True):
                lanes.store(place(context, builder, sheet_type, sheet, builder.add(at, number(plane + group))))
        return context.get_dummy_value()

    arguments = (line, cells, fractions, types.intp, sheet, types.intp)
    return types.void(*arguments), generate


@intrinsic
def is_voxel_by_voxel(typing, cells, first):
    """Whether each sample of a block lies a whole voxel behind the one before, as at one sheet pixel a voxel."""

    def generate(context, builder, signature, arguments):
        cells, first = arguments
        pointer = place(context, builder, signature.args[0], cells, first)
        found = Vector.load(builder, pointer, BLOCK, INTEGER).value
        steps = ir.Constant(found.type, [4 * i for i in range(BLOCK)])
        expected = builder.add(Vector.spread(builder, builder.load(pointer), BLOCK).value, steps)
        other = builder.bitcast(builder.icmp_signed("!=", found, expected), ir.IntType(BLOCK))
        return builder.icmp_unsigned("==", other, ir.Constant(other.type, 0))

    return types.boolean(cells, types.intp), generate


@intrinsic
def resample_voxel_by_voxel(typing, line, cells, fractions, first, sheet, at):
    """``resample_tent`` where ``is_voxel_by_voxel``: the same numbers, four pixels at once."""

    def generate(context, builder, signature, arguments):
        line, cells, fractions, first, sheet, at = arguments
        line_type, cells_type, fractions_type, _, sheet_type, _ = signature.args
        cell = builder.sext(builder.load(place(context, builder, cells_type, cells, first)), at.type)
        fraction = Vector.load(builder, place(context, builder, fractions_type, fractions, first), BLOCK)
        mixed = []
        for group in range(0, BLOCK, 4):
            left, right = (
                Vector.load(
                    builder,
                    place(context, builder, line_type, line, builder.add(cell, ir.Constant(at.type, 4 * voxel))),
                    BLOCK,
                )
                for voxel in (group, group + 1)
            )
            lanes = [group + lane // 4 for lane in range(BLOCK)]
            mixed.append(left + (right - left) * fraction.shuffle(fraction.value, lanes))
        for plane, lanes in zip((RED, GREEN, BLUE, TRANSMITTANCE), transpose4(mixed), strict=True):
            # Pixel 4 * group + i is now number 4 * i + group.
            lanes = lanes.shuffle(lanes.value, [4 * (i % 4) + i // 4 for i in range(BLOCK)])
            lanes.store(place(context, builder, sheet_type, sheet, builder.add(at, ir.Constant(at.type, plane))))
        return context.get_dummy_value()

    arguments = (line, cells, fractions, types.intp, sheet, types.intp)
    return types.void(*arguments), generate


def slab(samples, length, one):
    """What a homogeneous slab absorbs and lets pass, and what its color is weighted by: extinction."""
    power, p = _transmitted((samples * length * LOG2E).least(MOST))
    return one - power - power * p, power + power * p, samples


def _added(samples, length, one):
    """The same of opacities as the paper adds them, clamped; whatever the length."""
    return samples.least(1.0), one - samples.least(1.0), samples


def composited(context, builder, absorb, colors, samples, length, least, state_type, state, row, before_type, before):
    """One block of ``colors`` and ``samples`` of extinction (or opacity), planes of ``length``, over the row.

    ``absorb``: one of the two above.  See ``composite_extinction``, whose value it is that is returned.
    What is float32 is widened first where ``state`` and ``before`` are float64.
    """
    kind = kind_of(state_type)
    *so_far, transmittance = row_planes(context, builder, state_type, state, row)
    transmittance.store(place(context, builder, before_type, before, ir.Constant(row.type, 0)))
    least = Vector.spread(builder, least, BLOCK).widened(kind)
    colors, samples, length = [c.widened(kind) for c in colors], samples.widened(kind), length.widened(kind)
    absorbed, passed, divisor = absorb(samples, length, Vector(builder, length.like(1.0)))
    gain = absorbed / divisor.most(TINY)
    so_far, transmittance = laid_over(gain, passed, absorbed, so_far, transmittance, colors, least)
    store_row(context, builder, (*so_far, transmittance), state_type, state, row)
    return counted(builder, transmittance, least)


def laid_over(gain, passed, absorbed, so_far, transmittance, colors, least):
    """The colors ``so_far`` and transmittance of a block, and a sheet behind them: what they are with it.

    ``gain``: what the sheet absorbs, over its extinction (or opacity).  The others: see ``composited``.
    """
    alive = transmittance.at_least(least)
    through = transmittance * passed
    # 1 - tau of thin sheets would add up, each rounded alike, so it is not formed in float64.
    if transmittance.value.type.element == DOUBLE:
        through = through.where(absorbed.at_least(0.5), transmittance - transmittance * absorbed)
    weight = transmittance.where(alive, 0.0) * gain
    return [c + weight * q for c, q in zip(so_far, colors, strict=True)], through.where(alive, transmittance)


def store_row(context, builder, planes, state_type, state, row):
    """Puts four planes where ``row_planes`` finds them."""
    for plane, lanes in zip((RED, GREEN, BLUE, TRANSMITTANCE), planes, strict=True):
        lanes.store(place(context, builder, state_type, state, builder.add(row, ir.Constant(row.type, plane))))


def counted(builder, transmittance, least):
    """What ``composite_extinction`` returns of a block's transmittance."""
    left = count_lanes(builder, transmittance.at_least(least), BLOCK)
    bright = count_lanes(builder, transmittance.at_least(0.5), BLOCK)
    return builder.add(left, builder.shl(bright, ir.Constant(bright.type, 8)))


def _compositor(absorb):
    @intrinsic
    def composite(typing, sheet, at, below, down, depth, deep, thickness, least, state, row, before):
        """One block of one sheet over the row.

        ``sheet``: associated color and extinction of the scanlines at ``at`` and ``below``, ``down`` the fraction
        (float32) towards the latter.  ``depth[deep:]``: float32 world length of the rays per voxel of ``thickness``.
        ``least``: transmittance at which a pixel is opaque.  ``state[row:]``: the block so far; ``before`` (BLOCK,)
        is where its transmittance ahead of this sheet goes; both float32 or both float64.
        Returns how many pixels are not yet opaque, plus 256 times how many have at least half their light left.
        """

        def generate(context, builder, signature, arguments):
            sheet, at, below, down, depth, deep, thickness, least, state, row, before = arguments
            sheet_type, depth_type, state_type, before_type = (signature.args[n] for n in (0, 4, 8, 10))
            upper = row_planes(context, builder, sheet_type, sheet, at)
            lower = row_planes(context, builder, sheet_type, sheet, below)
            down = Vector.spread(builder, down, BLOCK)
            *colors, samples = (a + (b - a) * down for a, b in zip(upper, lower, strict=True))
            length = Vector.load(builder, place(context, builder, depth_type, depth, deep), BLOCK)
            length = length * Vector.spread(builder, thickness, BLOCK)
            return composited(
                context, builder, absorb, colors, samples, length, least, state_type, state, row, before_type, before
            )

        number, places = types.float32, (types.intp, types.intp)
        given = sheet, *places, number, depth, types.intp, number, number, state, types.intp, before
        return types.int64(*given), generate

    return composite


# The exact solution of a homogeneous slab of extinction (algorithm.md 1.6),
#     C += T * (1 - exp(-tau)) * Q / tau ;  T *= exp(-tau),
# in which 1 - exp is formed without cancellation, as (1 - 2**-n) - 2**-n * (2**r - 1); and opacities as the paper adds
# them, whose sum over the footprints is clamped to one, whatever the length of the rays.
composite_extinction, composite_added = _compositor(slab), _compositor(_added)


@intrinsic
def planar(typing, samples, sheet, at):
    """A block of samples, four channels a pixel, to planes of ``sheet`` from ``at`` on."""

    def generate(context, builder, signature, arguments):
        samples, sheet, at = arguments
        samples_type, sheet_type, _ = signature.args
        for group in range(0, BLOCK, 4):
            pixels = [
                Vector.load(
                    builder,
                    place(context, builder, samples_type, samples, ir.Constant(at.type, 4 * (group + i))),
                    4,
                )
                for i in range(4)
            ]
            for plane, lanes in zip((RED, GREEN, BLUE, TRANSMITTANCE), transpose4(pixels), strict=True):
                to = builder.add(at, ir.Constant(at.type, plane + group))
                lanes.store(place(context, builder, sheet_type, sheet, to))
        return context.get_dummy_value()

    return types.void(samples, sheet, types.intp), generate


@intrinsic
def interleaved(typing, state, row, pixels, to):
    """The block ``state[row:]`` to four channels a pixel in ``pixels``, without gaps, from float number
    ``to`` on; how many pixels there is anything in."""

    def generate(context, builder, signature, arguments):
        state, row, pixels, to = arguments
        state_type, _, pixels_type, _ = signature.args
        planes = row_planes(context, builder, state_type, state, row)
        if kind_of(state_type) == DOUBLE:
            planes = [plane.as_single() for plane in planes]
        for group in range(0, BLOCK, 4):
            columns = [plane.shuffle(plane.value, range(group, group + 4)) for plane in planes]
            for i, pixel in enumerate(transpose4(columns)):
                at = builder.add(to, ir.Constant(to.type, 4 * (group + i)))
                pixel.store(place(context, builder, pixels_type, pixels, at))
        some = None
        for plane, nothing in zip(planes, (0.0, 0.0, 0.0, 1.0), strict=True):
            differs = builder.fcmp_unordered("!=", plane.value, plane.like(nothing))
            some = differs if some is None else builder.or_(some, differs)
        return count_lanes(builder, some, BLOCK)

    return types.int64(state, types.intp, pixels, types.intp), generate
