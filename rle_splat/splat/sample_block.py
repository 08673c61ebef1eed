"""Light on the samples of one block, evaluated from the mixed normal of each sample (prototype).

The classified colors of a block are multiplied by the light on them in place, before they are composited.

    N  mixed normal, w = smooth step of |N|, n = N / |N|, e the direction to the eye
    n  as it is where n.e >= 0; where n.e < -TURNED it is -n; between, from n without its part along e to -n
    S  = ambient + sum over lamps of [diffuse * wrap(n.l) + specular * ramp(n.l) * (n.h)^shininess] * T
    C  = ambient + sum over lamps of diffuse * T
    light = w S + (1 - w) C

Between two sheets N and T are those of the middle, by its absorption, of what the transfer function shows of the slab.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import inner_loop
from ..runtime.llvm import cgutils, intrinsic, ir, types
from ..runtime.vector_math import inverse, inverse_root, power
from ..runtime.vectors import FLOAT, Vector, count_lanes, place
from ..shade.normal_light import GLOSS, HALFWAY, MATT, RAY, TOWARDS
from .pixel_block import BLOCK
from .scalar_block import mix_blocks, put_block, rows_of

ROUNDING = 0.0872  # sine of 5 degrees: wrap is a maximum rounded over it
RAMP = 0.2  # cosine at which a highlight is whole
SOLID = 0.6  # length of the mixed normal from which a sample is all surface
TURNED = 0.4  # -n.e from which a normal is turned to the eye: seen surfaces that lean away a little are not inside out
ALMOST = np.float32(0.9)  # of the least weight: what is not the very first to be seen is lit by its own light
FAINT_COSINE = 0.25  # cosines of highlights are at least that: their powers are then no denormal numbers


class _Lit:
    """What is written for one block; ``given``: name -> (numba's type, value)."""

    def __init__(self, context, builder, lamps, value):
        self.context, self.builder = context, builder
        held = zip(lamps.types, cgutils.unpack_tuple(builder, value))
        self.given = dict(zip(lamps.fields, held))
        self.intp = ir.IntType(64)
        self.kind = ir.VectorType(FLOAT, BLOCK)

    def at(self, name, index):
        array_type, array = self.given[name]
        index = ir.Constant(self.intp, index) if isinstance(index, int) else index
        return place(self.context, self.builder, array_type, array, index)

    def spread(self, name, index) -> Vector:
        return Vector.spread(self.builder, self.builder.load(self.at(name, index)), BLOCK)

    def constant(self, number) -> Vector:
        return Vector(self.builder, ir.Constant(self.kind, [float(number)] * BLOCK))

    def variable(self, first: Vector):
        pointer = cgutils.alloca_once(self.builder, self.kind)
        self.builder.store(first.value, pointer)
        return pointer

    def get(self, pointer) -> Vector:
        return Vector(self.builder, self.builder.load(pointer))

    def dot(self, one, other) -> Vector:
        (a, b, c), (x, y, z) = one, other
        return a.fused(x, b.fused(y, c * z))

    def eye(self, pixel, row):
        """Unit vectors to the eye of pixels from number ``pixel`` of row ``row`` on."""
        builder = self.builder
        parts = [self.variable(self.spread("eye", n)) for n in range(3)]
        with builder.if_then(self.given["is_near"][1]):
            across = self.spread("rows", row)
            along = Vector.load(builder, self.at("columns", pixel), BLOCK)
            found = []
            for n in range(3):
                by_column, by_row, ahead = (self.spread("to_eye", 3 * slope + n) for slope in range(3))
                found.append(along.fused(by_column, across.fused(by_row, ahead)))
            scale = inverse_root(self.dot(found, found).most(1e-18))
            for variable, part in zip(parts, found):
                builder.store((part * scale).value, variable)
        return [self.get(variable) for variable in parts]


def smooth(t: Vector) -> Vector:
    """The smooth step of a number, limited to [0, 1]."""
    t = t.most(0.0).least(1.0)
    return t * t * t.fused(-2.0, Vector(t.builder, t.like(3.0)))


def _light(lit: _Lit, normal, eye, counts, plane):
    """Vectors of light, and of highlights, on samples of mixed ``normal``; ``plane(number)``: transmittance."""
    builder = lit.builder
    square = lit.dot(normal, normal).most(1e-12)
    inverse_size = inverse_root(square)
    share = smooth(square * inverse_size * (1.0 / SOLID))
    n = [part * inverse_size for part in normal]
    away = (lit.dot(n, eye) * -1.0).most(0.0)
    back = smooth(away * (1.0 / TURNED))
    along, leaning = back.fused(-2.0, lit.constant(1.0)), away - away * back
    n = [part.fused(along, leaning * to_eye) for part, to_eye in zip(n, eye)]
    matt = [lit.variable(lit.spread("surface", channel)) for channel in range(counts[0])]
    gloss = [lit.variable(lit.constant(0.0)) for _ in range(counts[1])]
    rays_type, rays = lit.given["rays"]
    shininess = Vector.spread(builder, lit.given["shininess"][1], BLOCK)
    count = cgutils.unpack_tuple(builder, lit.context.make_array(rays_type)(lit.context, builder, rays).shape)[0]
    casting = lit.given["casting"][1]
    with cgutils.for_range(builder, count) as loop:
        first = builder.mul(loop.index, ir.Constant(lit.intp, RAY))

        def spread(column, number):
            return [lit.spread("rays", builder.add(first, ir.Constant(lit.intp, column + n))) for n in range(number)]

        towards = spread(TOWARDS, 3)
        cosine = lit.dot(n, towards)
        rounded = (cosine + ROUNDING).most(0.0).least(2.0 * ROUNDING)
        wrap = (rounded * rounded).fused(0.25 / ROUNDING, (cosine - ROUNDING).most(0.0))
        reached = lit.variable(lit.constant(1.0))
        with builder.if_then(builder.icmp_signed("<", loop.index, casting)):
            builder.store(plane(loop.index).value, reached)
        reached = lit.get(reached)
        strength = share.fused(wrap - lit.constant(1.0), lit.constant(1.0)) * reached
        for total, color in zip(matt, spread(MATT, len(matt))):
            builder.store(strength.fused(color, lit.get(total)).value, total)
        if gloss:
            half = lit.variable(lit.constant(0.0))
            with builder.if_else(lit.given["is_near"][1]) as (near, far):
                with near:
                    square = lit.dot(towards, eye).fused(2.0, lit.constant(2.0)).most(1e-6)
                    builder.store(((cosine + lit.dot(n, eye)) * inverse_root(square)).value, half)
                with far:
                    builder.store(lit.dot(n, spread(HALFWAY, 3)).value, half)
            shine = power(lit.get(half).most(FAINT_COSINE).least(1.0), shininess)
            shine = shine * smooth(cosine * (1.0 / RAMP)) * share * reached
            for total, color in zip(gloss, spread(GLOSS, len(gloss))):
                builder.store(shine.fused(color, lit.get(total)).value, total)
    return [lit.get(total) for total in matt], [lit.get(total) for total in gloss]


def _share_here(here: Vector, there: Vector, low, high, depth: Vector, usual: Vector) -> Vector:
    """What a sheet's normals count in a slab between two sheets: how far on is the middle of what is shown of it.

    ``here``, ``there``: values of the sheet and of the one before.  ``depth``: optical depth of the slab.  ``usual``:
    the share where it is not known better, 0 or 1 where one of the two has no value.
    """
    builder = here.builder
    one, rises = Vector(builder, here.like(1.0)), here.at_least(there)
    least = here.least(there)
    per_value = inverse((here.most(there) - least).most(1e-30))
    first, last = (((end - least) * per_value).most(0.0).least(1.0) for end in (low, high))
    first, last = first.where(rises, one - last), last.where(rises, one - first)
    # 1 / (2 + depth / 2) is nearly 1 / depth - 1 / (exp(depth) - 1), where light is absorbed evenly.
    middle = first + (last - first) * inverse(depth.fused(0.5, Vector(builder, here.like(2.0))))
    both = builder.and_(usual.at_least(0.25), Vector(builder, usual.like(0.75)).at_least(usual))
    return middle.where(both, usual)


def _scanline_shares(down: Vector, share: Vector | None = None):
    """The shares of two scanlines, the nearer one's first; ``share``: of their sheet."""
    nearer = Vector(down.builder, down.like(1.0)) - down
    return (nearer, down) if share is None else (nearer * share, down * share)


def _lighter(between: bool):
    @intrinsic
    def light_block(
        typing, sampled, first, sheet, upper, lower, down, before, upper_before, lower_before, down_before, shares,
        low, high, length, deep, thickness, state, transmittance, held, at, lamps, pixel, row,
    ):  # fmt: skip
        """Multiply classified colors ``sampled`` (4, BLOCK), flat, from number ``first`` on, by the light on them.

        Light is evaluated anew once the samples of a pixel that the last one was used for weigh ``lamps.least``: in
        haze it need not be at every sheet, nor in front of a surface.

        ``sheet``, ``before`` and ``shares``, ``length``, ``deep`` and ``thickness``: see
        ``scalar_block.composite_classified``.  ``low``, ``high``: ends of the stored values that are shown.
        ``state[transmittance:]``: transmittance ahead of the block.  ``held[at:]``: the block's planes of
        ``scratch.Rows.light``.  ``lamps``: SampleLamps; ``pixel``, ``row``: of the block's first pixel.
        """
        fields = dict(zip(lamps.fields, lamps.types))
        counts = len(fields["matt"]), len(fields["gloss"])

        def generate(context, builder, signature, arguments):
            sampled, first, sheet, upper, lower, down, before, upper_before, lower_before, down_before = arguments[:10]
            shares, low, high, length, deep, thickness, state, transmittance, held, at, given, pixel, row = (
                arguments[10:]
            )
            sampled_type, sheet_type, before_type, shares_type, state_type, held_type = (
                signature.args[n] for n in (0, 2, 6, 10, 16, 18)
            )
            lit = _Lit(context, builder, lamps, given)

            def number(n):
                return ir.Constant(lit.intp, n)

            def own(n):
                """Where plane ``n`` of the block's own light is."""
                return place(context, builder, held_type, held, builder.add(at, number(n * BLOCK)))

            places = [
                place(context, builder, sampled_type, sampled, builder.add(first, number(n * BLOCK))) for n in range(4)
            ]
            extinction = Vector.load(builder, places[3], BLOCK)
            long = Vector.load(builder, place(context, builder, signature.args[13], length, deep), BLOCK)
            depth = extinction * long * Vector.spread(builder, thickness, BLOCK)
            kind = context.get_data_type(state_type.dtype)
            left = Vector.load(builder, place(context, builder, state_type, state, transmittance), BLOCK, kind)
            left = left if kind == FLOAT else left.as_single()
            owed = depth.least(1.0).fused(left, Vector.load(builder, own(0), BLOCK))
            due = owed.at_least(Vector.spread(builder, lit.given["least"][1], BLOCK))
            owed.store(own(0))
            with builder.if_then(builder.icmp_unsigned("!=", count_lanes(builder, due, BLOCK), number(0))):
                down, down_before = (Vector.spread(builder, one, BLOCK) for one in (down, down_before))
                parts = [(sheet_type, sheet, upper, lower)]
                if between:
                    usual = Vector.load(builder, place(context, builder, shares_type, shares, number(BLOCK)), BLOCK)
                    here = _share_here(
                        mix_blocks(context, builder, sheet_type, sheet, upper, lower, down, 0),
                        mix_blocks(context, builder, before_type, before, upper_before, lower_before, down_before, 0),
                        *(Vector.spread(builder, end, BLOCK) for end in (low, high)), depth, usual,
                    )
                    parts.append((before_type, before, upper_before, lower_before))
                    weights = (*_scanline_shares(down, here), *_scanline_shares(down_before, lit.constant(1.0) - here))
                else:
                    weights = _scanline_shares(down)

                def plane(which):
                    """Plane ``which`` (an LLVM value) of the sheets, mixed."""
                    offset, total = builder.mul(which, number(BLOCK)), None
                    lines = ((kind, array, one) for kind, array, *both in parts for one in both)
                    for weight, (array_type, array, line) in zip(weights, lines, strict=True):
                        line = place(context, builder, array_type, array, builder.add(line, offset))
                        line = Vector.load(builder, line, BLOCK)
                        total = line * weight if total is None else line.fused(weight, total)
                    return total

                normal = [plane(number(n)) for n in (1, 2, 3)]
                found = _light(
                    lit, normal, lit.eye(pixel, row), counts, lambda ray: plane(builder.add(ray, number(4)))
                )
                lit.constant(0.0).store(own(0))
                for n, light in enumerate((*found[0], *found[1])):
                    light.store(own(1 + n))
            matt, gloss = (
                [Vector.load(builder, own(n), BLOCK) for n in range(begin, begin + count)]
                for begin, count in ((1, counts[0]), (1 + counts[0], counts[1]))
            )
            for channel in range(3):
                color = Vector.load(builder, places[channel], BLOCK) * matt[channel % counts[0]]
                if gloss:
                    color = extinction.fused(gloss[channel % counts[1]], color)
                color.store(places[channel])
            return context.get_dummy_value()

        places, number = (types.intp, types.intp), types.float32
        return types.void(
            sampled, types.intp, sheet, *places, number, before, *places, number, shares, number, number, length,
            types.intp, number, state, types.intp, held, types.intp, lamps, *places,
        ), generate

    return light_block


light_own, light_between = _lighter(False), _lighter(True)


@inner_loop
def clear_light(lamps, light):
    """Begin ``scratch.Rows.light``: light on a cloud, which counts for what weighs little; nothing without lamps."""
    if lamps is not None:
        planes = 1 + len(lamps.matt) + len(lamps.gloss)
        for block in range(light.size // (planes * BLOCK)):
            first = planes * BLOCK * block
            light[first : first + BLOCK] = ALMOST * lamps.least
            for channel in range(len(lamps.matt)):
                shine = lamps.surface[channel]
                for ray in range(lamps.rays.shape[0]):
                    shine += lamps.rays[ray, MATT + channel]
                to = first + BLOCK * (1 + channel)
                light[to : to + BLOCK] = shine
            to = first + BLOCK * (1 + len(lamps.matt))
            light[to : to + BLOCK * len(lamps.gloss)] = np.float32(0.0)


@intrinsic
def classify_member(typing, table, entries, waiting, member, sampled):
    """Classified samples of one sheet of a group, as ``scalar_block.classify_values``, to block ``member`` of
    ``sampled`` (GROUP, 4, BLOCK), flat; ``entries``: of ``look_up_group``, ``waiting`` its number."""

    def generate(context, builder, signature, arguments):
        table, entries, first, member, sampled = arguments
        rows = rows_of(context, builder, signature.args[0], table, signature.args[1], entries, 0, first)
        to = builder.mul(member, ir.Constant(member.type, 4 * BLOCK))
        for number, row in enumerate(rows):
            put_block(context, builder, signature.args[4], sampled, number, row, to)
        return context.get_dummy_value()

    return types.void(table, entries, types.intp, types.intp, sampled), generate
