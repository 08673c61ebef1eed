"""Light on the samples of one block by the formula of ``shade.sample_light``, from what is interpolated of the voxels.

The classified colors of a block are multiplied by the light on them in place, before they are composited.  Between two
sheets m, T, U and O are those of the middle, by its absorption, of what the transfer function shows of the slab.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import inner_loop
from ..runtime.llvm import cgutils, intrinsic, ir, types
from ..runtime.vector_math import inverse, inverse_root, power
from ..runtime.vectors import FLOAT, Vector, count_lanes, place
from ..shade.environment import LINEAR, PRODUCTS, TERMS
from ..shade.lights import AREA, AXIS, CONE, EDGE, KIND, NEAREST, POSITION, SPOT, SUN
from ..shade.sample_light import ALMOST_NONE, RAMP, ROUNDING, SPREAD, TRUSTED, TURNED
from .pixel_block import BLOCK
from .sample_lamps import AMBIENT, EVERYWHERE, GLOSS, HELD, LAMP, MATT, NO_PLANE, SHININESS
from .scalar_block import block_of, mix_blocks, put_block, rows_of, scalars_of_ends

AT_FIRST = np.float32(0.5)  # of the least weight, which a pixel begins with: its first sample soon has its own light
NONE_YET = np.float32(-1.0)  # the first number of a block's light, where it has none
ALMOST_OPPOSITE = 1e-6  # squared length of a half-way vector that counts as none
USUAL, SPAN_BEGIN, SPAN_END = 1, 3, 4  # blocks of ``scratch.BlockScratch.shares``
TINY = 1e-30  # cosines of highlights are at least that, and squared distances to be divided by


class _Lit:
    """What is written for one block of a SampleLamps, numba's type and value of it."""

    def __init__(self, context, builder, lamps_type, value):
        self.context, self.builder = context, builder
        self.given = dict(zip(lamps_type.fields, zip(lamps_type.types, cgutils.unpack_tuple(builder, value))))
        self.intp = ir.IntType(64)
        self.kind = ir.VectorType(FLOAT, BLOCK)

    def value(self, name):
        return self.given[name][1]

    def whole(self, number):
        return ir.Constant(self.intp, number)

    def at(self, name, index):
        array_type, array = self.given[name]
        return place(self.context, self.builder, array_type, array, self._index(index))

    def _index(self, index):
        return self.whole(index) if isinstance(index, int) else index

    def spread(self, name, index, count=None):
        """A number of an array in all lanes; or, as a list, so many from there on."""
        index = self._index(index)
        places = [self.at(name, self.builder.add(index, self.whole(n))) for n in range(count or 1)]
        found = [Vector.spread(self.builder, self.builder.load(one), BLOCK) for one in places]
        return found[0] if count is None else found

    def spread_single(self, number) -> Vector:
        """A float64 in all lanes of float32."""
        return Vector.spread(self.builder, self.builder.fptrunc(number, FLOAT), BLOCK)

    def length(self, name):
        array_type, array = self.given[name]
        held = self.context.make_array(array_type)(self.context, self.builder, array)
        return cgutils.unpack_tuple(self.builder, held.shape)[0]

    def constant(self, number) -> Vector:
        return Vector(self.builder, ir.Constant(self.kind, [float(number)] * BLOCK))

    def variable(self, first: Vector):
        pointer = cgutils.alloca_once(self.builder, self.kind)
        self.put(first, pointer)
        return pointer

    def put(self, vector: Vector, pointer):
        self.builder.store(vector.value, pointer)

    def get(self, pointer) -> Vector:
        return Vector(self.builder, self.builder.load(pointer))

    def dot(self, one, other) -> Vector:
        (a, b, c), (x, y, z) = one, other
        return a.fused(x, b.fused(y, c * z))

    def holds(self, name):
        """A condition: a bool of the SampleLamps."""
        return self.builder.trunc(self.value(name), ir.IntType(1))

    def differs(self, number, from_):
        return self.builder.icmp_signed("!=", number, self.whole(from_))


def _smoothstep(t: Vector) -> Vector:
    """3 t^2 - 2 t^3 of a number, limited to [0, 1]."""
    t = t.most(0.0).least(1.0)
    return t * t * t.fused(-2.0, Vector(t.builder, t.like(3.0)))


def _to_eye(lit: _Lit, pixel, row):
    """Unit vectors to the eye of pixels from number ``pixel`` of row ``row`` on."""
    along, across = Vector.load(lit.builder, lit.at("slope_u", pixel), BLOCK), lit.spread("slope_v", row)
    by_column, by_row, ahead = (lit.spread("ahead", first, 3) for first in (0, 3, 6))
    found = [along.fused(u, across.fused(v, w)) for u, v, w in zip(by_column, by_row, ahead)]
    scale = inverse_root(lit.dot(found, found).most(TINY))
    return [part * scale for part in found]


def _points(lit: _Lit, pixel, row, position):
    """Where these pixels' samples are, world units from the middle of the volume; ``position``: voxels along the
    viewing direction, float64."""
    builder = lit.builder
    away = builder.fsub(builder.fmul(position, lit.value("sign")), lit.value("middle"))
    away = lit.spread_single(away)
    x = away.fused(
        Vector.load(builder, lit.at("slope_u", pixel), BLOCK), Vector.load(builder, lit.at("base_u", pixel), BLOCK)
    )
    y = away.fused(lit.spread("slope_v", row), lit.spread("base_v", row))
    by_x, by_y, by_z = (lit.spread("to_world", first, 3) for first in (0, 3, 6))
    return [x.fused(u, y.fused(v, away * w)) for u, v, w in zip(by_x, by_y, by_z)]


def _turned(lit: _Lit, normal, eye):
    """Normals, turned to the eye if surfaces are two-sided."""
    variables = [lit.variable(part) for part in normal]
    with lit.builder.if_then(lit.holds("turns")):
        away = (lit.dot(normal, eye) * -1.0).most(0.0)
        turn = _smoothstep(away * (1.0 / TURNED))
        kept, added = turn.fused(-2.0, lit.constant(1.0)), away - away * turn
        for variable, part, to_eye in zip(variables, normal, eye):
            lit.put(part.fused(kept, added * to_eye), variable)
    return [lit.get(variable) for variable in variables]


def _from_all_sides(lit: _Lit, normal, trust: Vector, plane):
    """Variables of the light from all directions, RGB, on samples that trust their normals."""
    builder = lit.builder
    totals = [lit.variable(everywhere) for everywhere in lit.spread("surface", EVERYWHERE, 3)]
    with builder.if_then(lit.differs(lit.length("sky"), 0)):
        products = [normal[axis] for (axis,) in LINEAR] + [normal[i] * normal[j] for i, j in PRODUCTS]
        ambient = lit.spread("surface", AMBIENT)
        for channel, total in enumerate(totals):
            everywhere = lit.get(total)
            change = everywhere
            for product, term in zip(products, lit.spread("sky", channel * TERMS, TERMS), strict=True):
                change = product.fused(term, change)
            lit.put(trust.fused(change.most(ambient) - everywhere, everywhere), total)
    opened = lit.value("open_plane")
    with builder.if_then(lit.differs(opened, NO_PLANE)):
        share = plane(opened)
        for total in totals:
            lit.put(lit.get(total) * share, total)
    return totals


def _towards(lit: _Lit, first, find_points, arrives):
    """Unit vectors to the lamp whose row begins at number ``first``; ``arrives``, a variable, is multiplied by its
    falloff.  As ``shade.reference.find_light``."""
    builder = lit.builder

    def spread(column, count=None):
        return lit.spread("lamps", builder.add(first, lit.whole(column)), count)

    axis = spread(AXIS, 3)
    towards = [lit.variable(part * -1.0) for part in axis]
    kind = builder.load(lit.at("lamps", builder.add(first, lit.whole(KIND))))

    def is_a(number, condition="=="):
        return builder.fcmp_ordered(condition, kind, ir.Constant(FLOAT, float(number)))

    with builder.if_then(is_a(SUN, "!=")):
        way = [lamp - point for lamp, point in zip(spread(POSITION, 3), find_points())]
        square = lit.dot(way, way)
        scale = inverse_root(square.most(TINY))
        way = [part * scale for part in way]
        for variable, part in zip(towards, way):
            lit.put(part, variable)
        off_axis = lit.dot(way, axis) * -1.0
        lit.put(lit.get(arrives) / square.most(spread(NEAREST)), arrives)
        with builder.if_then(is_a(AREA)):
            lit.put(lit.get(arrives) * off_axis.most(0.0), arrives)
        with builder.if_then(is_a(SPOT)):
            lit.put(lit.get(arrives) * _smoothstep((off_axis - spread(CONE)) * spread(EDGE)), arrives)
    return [lit.get(variable) for variable in towards]


def _light(lit: _Lit, normal, eye, find_points, plane):
    """RGB of the light on samples, and of their highlights, six variables.

    ``normal``: m, interpolated.  ``find_points()``: world points.  ``plane(number)``: a plane, interpolated.
    """
    builder = lit.builder
    square = lit.dot(normal, normal).most(ALMOST_NONE**2)
    per_size = inverse_root(square)
    trust = _smoothstep(square * per_size * (1.0 / TRUSTED))
    normal = _turned(lit, [part * per_size for part in normal], eye)
    matt = _from_all_sides(lit, normal, trust, plane)
    gloss = [lit.variable(lit.constant(0.0)) for _ in range(3)]
    with cgutils.for_range(builder, lit.length("shares")) as loop:
        first = builder.mul(loop.index, lit.whole(LAMP))
        arrives = lit.variable(lit.constant(1.0))
        share, scattered = (builder.load(lit.at(name, loop.index)) for name in ("shares", "scattered"))
        is_scattered = lit.differs(scattered, NO_PLANE)
        with builder.if_then(builder.and_(lit.differs(share, NO_PLANE), builder.not_(is_scattered))):
            lit.put(plane(share), arrives)
        towards = _towards(lit, first, find_points, arrives)
        facing = lit.dot(normal, towards)
        rounded = (facing + ROUNDING).most(0.0).least(2.0 * ROUNDING)
        wrap = (rounded * rounded).fused(0.25 / ROUNDING, (facing - ROUNDING).most(0.0))
        by_angle = trust.fused(wrap - lit.constant(1.0), lit.constant(1.0))
        strength = lit.variable(by_angle * lit.get(arrives))
        with builder.if_then(is_scattered):
            whole, amount = lit.get(arrives), Vector.spread(builder, lit.value("indirect"), BLOCK)
            lit.put(whole * plane(share), arrives)
            direct = by_angle * lit.get(arrives)
            around = _spread(lit, facing, wrap, trust) * whole * plane(scattered)
            lit.put(amount.fused(around - direct, direct), strength)
        strength, arrives = lit.get(strength), lit.get(arrives)
        for total, color in zip(matt, lit.spread("lamps", builder.add(first, lit.whole(MATT)), 3)):
            lit.put(strength.fused(color, lit.get(total)), total)
        with builder.if_then(lit.holds("is_glossy")):
            cosine = _half_way(lit, normal, towards, facing, eye)
            shine = power(cosine.most(TINY).least(1.0), lit.spread("surface", SHININESS))
            shine = shine * _smoothstep(facing * (1.0 / RAMP)) * trust * arrives
            for total, color in zip(gloss, lit.spread("lamps", builder.add(first, lit.whole(GLOSS)), 3)):
                lit.put(shine.fused(color, lit.get(total)), total)
    return [*matt, *gloss]


def _spread(lit: _Lit, facing: Vector, wrap: Vector, trust: Vector) -> Vector:
    """What indirect light counts by its direction."""
    away = (facing * -1.0).most(0.0)
    found = away.fused(away, wrap * (1.0 + SPREAD) / (wrap + SPREAD))
    return trust.fused(found - lit.constant(1.0), lit.constant(1.0))


def _half_way(lit: _Lit, normal, towards, facing: Vector, eye) -> Vector:
    """Cosines between normals and the directions half-way between lamp and eye."""
    seen, straight = lit.dot(normal, eye), lit.dot(towards, eye)
    square = straight.fused(2.0, lit.constant(2.0)).most(ALMOST_OPPOSITE)
    return (facing + seen) * inverse_root(square)


def _span_shown(here: Vector, there: Vector, low, high) -> tuple[Vector, Vector]:
    """Where in a slab between two sheets what is shown of it begins and ends, 0 to 1.

    ``here``, ``there``: values of the sheet and of the one before.
    """
    builder = here.builder
    one, rises = Vector(builder, here.like(1.0)), here.at_least(there)
    least = here.least(there)
    # Where one has no value they are so far apart that the inverse would be a denormal number, which is slow.
    per_value = inverse((here.most(there) - least).most(TINY).least(1.0 / TINY))
    first, last = (((end - least) * per_value).most(0.0).least(1.0) for end in (low, high))
    return first.where(rises, one - last), last.where(rises, one - first)


def _share_here(span, depth: Vector, usual: Vector) -> Vector:
    """What a sheet's normals count in a slab between two sheets: how far on is the middle of what is shown of it.

    ``span``: of ``_span_shown``.  ``depth``: optical depth of the slab.  ``usual``: the share where it is not known
    better, 0 or 1 where one of the two has no value.
    """
    builder, (first, last) = depth.builder, span
    # 1 / (2 + depth / 2) is nearly 1 / depth - 1 / (exp(depth) - 1), where light is absorbed evenly.
    middle = first + (last - first) * inverse(depth.fused(0.5, Vector(builder, depth.like(2.0))))
    both = builder.and_(usual.at_least(0.25), Vector(builder, usual.like(0.75)).at_least(usual))
    return middle.where(both, usual)


def _scanline_shares(down: Vector, share: Vector | None = None):
    """The shares of two scanlines, the nearer one's first; ``share``: of their sheet."""
    nearer = Vector(down.builder, down.like(1.0)) - down
    return (nearer, down) if share is None else (nearer * share, down * share)


def _put_span(context, builder, signature, arguments, shown):
    """Put ``_span_shown`` of the ends ``shown`` of values into the last of ``arguments``, shares."""
    here, there = scalars_of_ends(context, builder, signature, arguments)
    for number, end in zip((SPAN_BEGIN, SPAN_END), _span_shown(here, there, *shown), strict=True):
        put_block(context, builder, signature.args[-1], arguments[-1], number, end)


@intrinsic
def find_span(
    typing, sheet, upper, lower, down, before, upper_before, lower_before, down_before, low, high, shares
):  # fmt: skip
    """``_span_shown`` of a block of slabs, to the blocks SPAN_BEGIN and SPAN_END of ``shares``; see
    ``scalar_block.look_between``."""

    def generate(context, builder, signature, arguments):
        shown = (Vector.spread(builder, number, BLOCK) for number in arguments[8:10])
        _put_span(context, builder, signature, arguments, shown)
        return context.get_dummy_value()

    places, number = (types.intp, types.intp), types.float32
    return types.void(sheet, *places, number, before, *places, number, number, number, shares), generate


@intrinsic
def find_span_each(
    typing, sheet, upper, lower, down, before, upper_before, lower_before, down_before, looks, shares
):  # fmt: skip
    """As ``find_span``, where each pixel has a table of its own; ``looks``: see ``scalar_block.look_between_each``."""

    def generate(context, builder, signature, arguments):
        shown = (block_of(context, builder, signature.args[8], arguments[8], number) for number in (3, 4))
        _put_span(context, builder, signature, arguments, shown)
        return context.get_dummy_value()

    places, number = (types.intp, types.intp), types.float32
    return types.void(sheet, *places, number, before, *places, number, looks, shares), generate


def _lighter(between: bool, spans_known: bool = False):
    @intrinsic
    def light_block(
        typing, sampled, first, sheet, upper, lower, down, before, upper_before, lower_before, down_before, shares,
        low, high, length, deep, thickness, state, transmittance, held, at, lamps, pixel, row, position,
    ):  # fmt: skip
        """Multiply classified colors ``sampled`` (4, BLOCK), flat, from number ``first`` on, by the light on them, and
        add highlights.

        Light is evaluated anew once the samples of a pixel that the last one was used for weigh ``lamps.least``: in
        haze it need not be at every sheet, nor in front of a surface or behind it.  A sample weighs its optical depth,
        between two sheets times the transmittance ahead of it.

        ``sheet``, ``before``: as ``scalar_block.look_between``, which has found ``shares``; these hold what is shown of
        the slab too, if ``spans_known``.  ``low``, ``high``: ends of
        the stored values that are shown.  ``length``, ``deep``, ``thickness``: see ``scalar_block.
        composite_classified``.  ``state[transmittance:]``: transmittance ahead of the block.  ``held[at:]``: the
        block's planes of ``scratch.Rows.light``.  ``lamps``: SampleLamps; ``pixel``, ``row``: of the block's first
        pixel; ``position``: voxels along the viewing direction, float64.
        """

        def generate(context, builder, signature, arguments):
            sampled, first, sheet, upper, lower, down, before, upper_before, lower_before, down_before = arguments[:10]
            shares, low, high, length, deep, thickness, state, transmittance, held, at, given, pixel, row, position = (
                arguments[10:]
            )
            sampled_type, sheet_type, before_type, shares_type, state_type, held_type = (
                signature.args[n] for n in (0, 2, 6, 10, 16, 18)
            )
            lit = _Lit(context, builder, lamps, given)

            def own(n):
                """Where plane ``n`` of the block's own light is."""
                return place(context, builder, held_type, held, builder.add(at, lit.whole(n * BLOCK)))

            places = [
                place(context, builder, sampled_type, sampled, builder.add(first, lit.whole(n * BLOCK)))
                for n in range(4)
            ]
            extinction = Vector.load(builder, places[3], BLOCK)
            long = Vector.load(builder, place(context, builder, signature.args[13], length, deep), BLOCK)
            depth = extinction * long * Vector.spread(builder, thickness, BLOCK)
            kind = context.get_data_type(state_type.dtype)
            left = Vector.load(builder, place(context, builder, state_type, state, transmittance), BLOCK, kind)
            left = left if kind == FLOAT else left.as_single()
            seen = left.at_least(Vector.spread(builder, lit.value("opaque"), BLOCK))
            weight = depth.least(1.0).where(seen, 0.0)
            if between:  # else without it: a group of sheets has it but once, and one after the other light the same
                weight = weight * left
            owed = Vector.load(builder, own(0), BLOCK) + weight
            due = owed.at_least(Vector.spread(builder, lit.value("least"), BLOCK))
            owed.store(own(0))
            with builder.if_then(builder.icmp_unsigned("!=", count_lanes(builder, due, BLOCK), lit.whole(0))):
                down, down_before = (Vector.spread(builder, one, BLOCK) for one in (down, down_before))
                parts = [(sheet_type, sheet, upper, lower)]
                if between:
                    usual, *span = (
                        Vector.load(builder, place(context, builder, shares_type, shares, lit.whole(n * BLOCK)), BLOCK)
                        for n in (USUAL, SPAN_BEGIN, SPAN_END)[: 3 if spans_known else 1]
                    )
                    span = span or _span_shown(
                        mix_blocks(context, builder, sheet_type, sheet, upper, lower, down, 0),
                        mix_blocks(context, builder, before_type, before, upper_before, lower_before, down_before, 0),
                        *(Vector.spread(builder, end, BLOCK) for end in (low, high)),
                    )
                    here = _share_here(span, depth, usual)
                    parts.append((before_type, before, upper_before, lower_before))
                    weights = (*_scanline_shares(down, here), *_scanline_shares(down_before, lit.constant(1.0) - here))
                else:
                    weights = _scanline_shares(down)

                def plane(which):
                    """Plane ``which`` (an LLVM value) of the sheets, mixed."""
                    offset, total = builder.mul(which, lit.whole(BLOCK)), None
                    lines = ((kind, array, one) for kind, array, *both in parts for one in both)
                    for weight, (array_type, array, line) in zip(weights, lines, strict=True):
                        line = place(context, builder, array_type, array, builder.add(line, offset))
                        line = Vector.load(builder, line, BLOCK)
                        total = line * weight if total is None else line.fused(weight, total)
                    return total

                normal = [plane(lit.whole(1 + n)) for n in range(3)]
                found = _light(lit, normal, _to_eye(lit, pixel, row), lambda: _points(lit, pixel, row, position), plane)
                # Lane by lane, so that no pixel's light depends on which others are in its block.
                lit.constant(0.0).where(due, owed).store(own(0))
                for n, light in enumerate(found):
                    lit.get(light).where(due, Vector.load(builder, own(1 + n), BLOCK)).store(own(1 + n))
            for channel in range(3):
                color = Vector.load(builder, places[channel], BLOCK)
                (color * Vector.load(builder, own(1 + channel), BLOCK)).store(places[channel])
            with builder.if_then(lit.holds("is_glossy")):
                for channel in range(3):
                    color = Vector.load(builder, places[channel], BLOCK)
                    shine = Vector.load(builder, own(4 + channel), BLOCK)
                    extinction.fused(shine, color).store(places[channel])
            return context.get_dummy_value()

        places, number = (types.intp, types.intp), types.float32
        return types.void(
            sampled, types.intp, sheet, *places, number, before, *places, number, shares, number, number, length,
            types.intp, number, state, types.intp, held, types.intp, lamps, *places, types.float64,
        ), generate  # fmt: skip

    return light_block


light_own, light_between, light_mixed = _lighter(False), _lighter(True), _lighter(True, True)


@inner_loop
def clear_light(lamps, light):
    """Note that no block of ``scratch.Rows.light`` has any light yet; nothing without ``lamps``."""
    if lamps is not None:
        light[:: HELD * BLOCK] = NONE_YET


@inner_loop
def begin_light(lamps, light, at):
    """Give the block at number ``at`` of ``scratch.Rows.light`` that on a cloud without near lamps, for what weighs
    little, unless it has light."""
    if light[at] == NONE_YET:
        light[at : at + BLOCK] = AT_FIRST * lamps.least
        for channel in range(3):
            shine = lamps.surface[EVERYWHERE + channel]
            for lamp in range(lamps.shares.size):
                if lamps.lamps[LAMP * lamp + KIND] == SUN:
                    shine += lamps.lamps[LAMP * lamp + MATT + channel]
            to = at + BLOCK * (1 + channel)
            light[to : to + BLOCK] = shine
        light[at + BLOCK * 4 : at + BLOCK * HELD] = np.float32(0.0)


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
