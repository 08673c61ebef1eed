"""Light that is computed from coded normals, for groups of voxels of a scanline in vector registers.

As ``voxel_groups``, for ``shade.normal_light.Lamps`` in place of codes of light: what a group has in two slices is
computed by the formula of ``shading.shade``, and mixed.  A voxel has the same bits in whichever group it is.
"""

from __future__ import annotations

from ..runtime.llvm import cgutils, intrinsic, ir, types
from ..runtime.vectors import DOUBLE, FLOAT, Vector, place
from ..shade.normal_light import (
    EVERYWHERE,
    FAINT,
    GLOSS,
    HALFWAY,
    MATT,
    ONE,
    PART_BITS,
    RAY,
    TOWARDS,
    TWO_SIDED,
)
from .voxel_groups import FEW, MANY

PER_CODE = 1.0 / float(ONE)


class _Group:
    """What is written for ``count`` voxels; ``given``: name -> (numba's type, value) of the arguments."""

    def __init__(self, context, builder, count: int, given: dict):
        self.context, self.builder, self.count, self.given = context, builder, count, given
        self.kind = ir.VectorType(FLOAT, count)
        self.intp = given["to"][1].type

    def at(self, name: str, index):
        """Pointer to a number of an array, counted flat."""
        array_type, array = self.given[name]
        index = ir.Constant(self.intp, index) if isinstance(index, int) else index
        return place(self.context, self.builder, array_type, array, index)

    def spread(self, name: str, index) -> Vector:
        """A float32 of an array in all lanes."""
        return Vector.spread(self.builder, self.builder.load(self.at(name, index)), self.count)

    def length(self, name: str, axis: int):
        """Length of an array along an axis."""
        array_type, array = self.given[name]
        held = self.context.make_array(array_type)(self.context, self.builder, array)
        return cgutils.unpack_tuple(self.builder, held.shape)[axis]

    def kept(self, first) -> _Kept:
        """A variable of ``count`` lanes, with a first value."""
        variable = _Kept(self.builder, cgutils.alloca_once(self.builder, self.kind))
        variable.set(first if isinstance(first, Vector) else Vector(self.builder, ir.Constant(self.kind, first)))
        return variable

    def dot(self, one, other) -> Vector:
        """The product of two vectors of space, each three of lanes."""
        (a, b, c), (x, y, z) = one, other
        return a.fused(x, b.fused(y, c * z))

    def length_of(self, square: Vector, least: float) -> Vector:
        """The root of a square, to be divided by: ``least`` at least.

        The bound comes last.  LLVM makes one estimate of a root that is divided by at once, and another one for
        each number of lanes.
        """
        return square.most(0.0).root().most(least)

    def normal(self, voxel):
        """The three components of the normals of voxels from number ``voxel`` on; and which have none, a mask."""
        components, any_bits = [], None
        for component in range(3):
            first = self.builder.mul(self.length("normals", 1), ir.Constant(self.intp, component))
            pointer = self.at("normals", self.builder.add(first, voxel))
            codes = self.builder.load(
                self.builder.bitcast(pointer, ir.VectorType(pointer.type.pointee, self.count).as_pointer())
            )
            codes.align = 2
            any_bits = codes if any_bits is None else self.builder.or_(any_bits, codes)
            components.append(Vector(self.builder, self.builder.sitofp(codes, self.kind)))
        none = self.builder.icmp_signed("==", any_bits, ir.Constant(any_bits.type, [0] * self.count))
        # Codes are within 2^-14 of length one: a step of Newton's takes them to 2^-28 of it.
        square = self.dot(components, components)
        scale = square.fused(-0.5 * PER_CODE**3, Vector(self.builder, self.like(1.5 * PER_CODE)))
        return [component * scale for component in components], none

    def to_eye(self, depth):
        """Unit vectors from voxels of the slice number ``depth`` to the eye."""
        builder, parts = self.builder, []
        lanes = Vector(builder, ir.Constant(self.kind, [float(lane) for lane in range(self.count)]))
        lanes += Vector.spread(builder, builder.sitofp(self.given["to"][1], FLOAT), self.count)
        y, z = (builder.sitofp(number, DOUBLE) for number in (self.given["scanline"][1], depth))
        for row in range(3):
            step, *others, away = (builder.load(self.at("from_line", 4 * row + column)) for column in range(4))
            for number, along in zip((y, z), others):
                away = builder.fadd(away, builder.fmul(number, along))
            first, step = (
                Vector.spread(builder, builder.fptrunc(number, FLOAT), self.count) for number in (away, step)
            )
            parts.append(lanes.fused(step, first))
        scale = Vector(builder, self.like(1.0)) / self.length_of(self.dot(parts, parts), 1e-18)
        return [part * scale for part in parts]

    def like(self, number: float):
        return ir.Constant(self.kind, [number] * self.count)

    def raised(self, cosine: Vector) -> Vector:
        """A cosine to the power of the shininess, bit by bit of it."""
        builder = self.builder
        power, factor = self.kept([1.0] * self.count), self.kept(cosine)
        whole, parts = (self.given[name][1] for name in ("whole", "parts"))

        def take(bits, number):
            """Multiply by the factor where a bit is set."""
            bit = builder.trunc(builder.lshr(bits, number), ir.IntType(1))
            more = power.get() * factor.get()
            power.set(Vector(builder, builder.select(bit, more.value, power.get().value)))

        with builder.if_then(builder.icmp_signed("!=", parts, ir.Constant(parts.type, 0)), likely=False):
            with cgutils.for_range(builder, ir.Constant(parts.type, PART_BITS)) as loop:
                factor.set(factor.get().root())
                take(parts, builder.sub(ir.Constant(parts.type, PART_BITS - 1), loop.index))
            factor.set(cosine)
        zeros = builder.ctlz(whole, ir.Constant(ir.IntType(1), 0))
        with cgutils.for_range(builder, builder.sub(ir.Constant(whole.type, 64), zeros)) as loop:
            take(whole, loop.index)
            factor.set(factor.get() * factor.get())
        return power.get()


class _Kept:
    """A variable of lanes."""

    def __init__(self, builder, pointer):
        self.builder, self.pointer = builder, pointer

    def get(self) -> Vector:
        return Vector(self.builder, self.builder.load(self.pointer))

    def set(self, vector: Vector) -> None:
        self.builder.store(vector.value, self.pointer)


def _add_ray(group: _Group, ray, normal, to_eye, matt, gloss):
    """Add light number ``ray`` to the sums of light and of highlight, lists of variables."""
    builder = group.builder
    first = builder.mul(ray, ir.Constant(group.intp, RAY))

    def spread(column: int, count: int):
        places = (builder.add(first, ir.Constant(group.intp, column + n)) for n in range(count))
        return [group.spread("rays", at) for at in places]

    towards = spread(TOWARDS, 3)
    facing = group.dot(normal, towards)
    two_sided = group.spread("surface", TWO_SIDED)
    strength = (facing * -1.0).most(facing * two_sided)
    for total, color in zip(matt, spread(MATT, len(matt))):
        total.set(strength.fused(color, total.get()))
    if not gloss:
        return
    cosine = group.kept([0.0] * group.count)
    with builder.if_else(group.given["is_near"][1]) as (near, far):
        with near:
            eye = [part.get() for part in to_eye]
            square = group.dot(towards, eye).fused(2.0, Vector(builder, group.like(2.0)))
            cosine.set((facing + group.dot(normal, eye)) / group.length_of(square, 1e-6))
        with far:
            cosine.set(group.dot(normal, spread(HALFWAY, 3)))
    lit = builder.or_(
        builder.fcmp_ordered("<", facing.value, group.like(0.0)),
        builder.fcmp_ordered(">", two_sided.value, group.like(0.0)),
    )
    faint = group.spread("surface", FAINT)
    power = group.raised(cosine.get().size().least(1.0).most(faint).where(lit, faint))
    for total, color in zip(gloss, spread(GLOSS, len(gloss))):
        total.set(power.fused(color, total.get()))


def _put_slice(group: _Group, voxel, depth, counts):
    """The light of voxels from number ``voxel`` on, of slice number ``depth``: a vector for each plane."""
    builder = group.builder
    normal, none = group.normal(voxel)
    matt = [group.kept(group.spread("surface", EVERYWHERE + n)) for n in range(counts[0])]
    gloss = [group.kept([0.0] * group.count) for _ in range(counts[1])]
    to_eye = [group.kept([0.0] * group.count) for _ in range(3 if gloss else 0)]
    if gloss:
        with builder.if_then(group.given["is_near"][1]):
            for variable, part in zip(to_eye, group.to_eye(depth)):
                variable.set(part)
    with cgutils.for_range(builder, group.length("rays", 0)) as loop:
        _add_ray(group, loop.index, normal, to_eye, matt, gloss)
    plain = [1.0] * counts[0] + [0.0] * counts[1]
    return [
        Vector(builder, group.like(number)).where(none, total.get())
        for number, total in zip(plain, (*matt, *gloss))
    ]


def _mixer_of_lamps(count: int):
    @intrinsic
    def mix(typing, line, stride, to, near, far, weight, far_weight, pair, lamps, scanline, depth, matt, gloss):
        """Light of voxels ``near``, of slice number ``depth``, and ``far``, of the next slice, and of the next
        voxels each, mixed, to the planes of ``line`` that follow the first: see ``voxel_groups``.

        ``to``: voxel of the scanline.
        """
        names = "line stride to near far weight far_weight pair lamps scanline depth".split()
        counts = len(matt.types), len(gloss.types)

        def generate(context, builder, signature, arguments):
            given = dict(zip(names, zip(signature.args, arguments)))
            held = zip(lamps.types, cgutils.unpack_tuple(builder, given["lamps"][1]))
            given.update(zip(lamps.fields, held))
            group = _Group(context, builder, count, given)
            stride, to, near, far, weight, far_weight, pair, scanline_depth = (
                given[name][1] for name in "stride to near far weight far_weight pair depth".split()
            )
            weight, far_weight = (Vector.spread(builder, number, count) for number in (weight, far_weight))
            mixed = [group.kept([0.0] * count) for _ in range(sum(counts))]
            one, slices = ir.Constant(group.intp, 1), builder.zext(pair, group.intp)
            with cgutils.for_range(builder, builder.add(one, slices)) as loop:
                is_far = builder.icmp_signed("==", loop.index, one)
                voxel = builder.select(is_far, far, near)
                found = _put_slice(group, voxel, builder.add(scanline_depth, loop.index), counts)
                for variable, light in zip(mixed, found):
                    both = variable.get().mixed(weight, light, far_weight)
                    variable.set(Vector(builder, builder.select(is_far, both.value, light.value)))
            for number, variable in enumerate(mixed):
                plane = builder.mul(stride, ir.Constant(group.intp, number + 1))
                variable.get().store(group.at("line", builder.add(plane, to)))
            return context.get_dummy_value()

        places, numbers = (types.intp,) * 2, (types.float32,) * 2
        return types.void(line, *places, *places, *numbers, types.boolean, lamps, *places, matt, gloss), generate

    return mix


mix_many_lamps, mix_few_lamps, mix_one_lamp = (_mixer_of_lamps(count) for count in (MANY, FEW, 1))
