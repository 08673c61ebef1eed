"""Groups of voxels of a scanline in vector registers: what two slices hold of them, mixed, as float32 planes.

Runs are short, a dozen voxels often, too short for what a loop's vectorizer makes of them.  So they are taken in groups
of a fixed size, of which the last may lie over the one before: a voxel has the same bits in whichever group it is.
"""

from __future__ import annotations

from ..runtime.llvm import intrinsic, ir, types
from ..runtime.vectors import FLOAT, INTEGER, Vector, pick, place
from ..shade.sample_light import NORMAL, ONE

MANY, FEW = 16, 4  # voxels of a group
PER_CODE = 1.0 / float(ONE)


def _load(builder, pointer, count):
    """``count`` lanes of whatever the pointer is of, from memory of any alignment."""
    kind = pointer.type.pointee
    value = builder.load(builder.bitcast(pointer, ir.VectorType(kind, count).as_pointer()))
    value.align = 1
    return value


def _of_code(builder, value, dtype):
    """What lanes of codes stand for; floating-point numbers are values as they are."""
    found = Vector(builder, _as_single(builder, value, dtype))
    return found if isinstance(dtype, types.Float) else found * PER_CODE


def _as_single(builder, value, dtype):
    """Lanes of numbers of numba's type ``dtype`` as float32."""
    single = ir.VectorType(FLOAT, value.type.count)
    if isinstance(dtype, types.Float):
        return value if dtype.bitwidth == 32 else builder.fptrunc(value, single)
    return (builder.sitofp if dtype.signed else builder.uitofp)(value, single)


def _mixed(builder, near, far, weight, far_weight, pair):
    """``weight`` of one and ``far_weight`` of the other where they are a pair, else the near one as it is."""
    count = near.type.count
    weight, far_weight = (Vector.spread(builder, number, count) for number in (weight, far_weight))
    both = Vector(builder, near).mixed(weight, Vector(builder, far), far_weight)
    return Vector(builder, builder.select(pair, both.value, near))


def _mixer_of_scalars(count):
    @intrinsic
    def mix(typing, line, to, scalars, near, far, weight, far_weight, pair):
        """Scalars from numbers ``near`` and ``far`` on, mixed, to ``line`` from ``to`` on."""
        if scalars.layout != "C":
            return None

        def generate(context, builder, signature, arguments):
            line, to, scalars, near, far, weight, far_weight, pair = arguments
            line_type, _, scalars_type = signature.args[:3]
            near, far = (
                _as_single(
                    builder,
                    _load(builder, place(context, builder, scalars_type, scalars, at), count),
                    scalars_type.dtype,
                )
                for at in (near, far)
            )
            mixed = _mixed(builder, near, far, weight, far_weight, pair)
            mixed.store(place(context, builder, line_type, line, to))
            return context.get_dummy_value()

        numbers = (types.float32, types.float32, types.boolean)
        return types.void(line, types.intp, scalars, types.intp, types.intp, *numbers), generate

    return mix


def _columns(builder, pointer, count, channels):
    """``channels`` vectors of int16 from as many numbers a voxel, of ``count`` voxels from a pointer on."""
    rows = _load(builder, pointer, count * channels)
    return [pick(builder, rows, range(first, count * channels, channels)) for first in range(channels)]


def _column(builder, pointer, count, stride):
    """A vector of int16, numbers ``stride`` apart from a pointer on."""
    found = ir.Constant(ir.VectorType(pointer.type.pointee, count), ir.Undefined)
    for lane in range(count):
        found = builder.insert_element(found, builder.load(pointer), ir.Constant(INTEGER, lane))
        pointer = builder.gep(pointer, [stride])
    return found


def _mixer_of_codes(count, channels=None):
    @intrinsic
    def mix(typing, line, stride, to, codes, stored, channel, near, far, weight, far_weight, pair):
        """Codes of voxels ``near`` and ``far`` and of the next ones, mixed, to the planes of ``line`` that follow the
        first, ``stride`` numbers apart, from number ``to`` on.

        ``codes``: (m, ``stored``), of which all are taken if there are ``channels`` of them; else only number
        ``channel``.
        """
        if codes.layout != "C":
            return None

        def generate(context, builder, signature, arguments):
            line, stride, to, codes, stored, channel, near, far, weight, far_weight, pair = arguments
            line_type, codes_type = signature.args[0], signature.args[3]

            def columns(voxel):
                first = builder.add(builder.mul(voxel, stored), channel)
                pointer = place(context, builder, codes_type, codes, first)
                found = _columns(builder, pointer, count, channels) if channels else [
                    _column(builder, pointer, count, stored)
                ]  # fmt: skip
                return [_of_code(builder, one, codes_type.dtype) for one in found]

            def put(number, vector):
                plane = builder.add(channel, ir.Constant(to.type, number + 1))
                vector.store(place(context, builder, line_type, line, builder.add(builder.mul(stride, plane), to)))

            nearer = columns(near)
            with builder.if_else(pair) as (both, alone):
                with both:
                    shares = [Vector.spread(builder, share, count) for share in (weight, far_weight)]
                    for number, (one, other) in enumerate(zip(nearer, columns(far), strict=True)):
                        put(number, one.mixed(shares[0], other, shares[1]))
                with alone:
                    for number, one in enumerate(nearer):
                        put(number, one)
            return context.get_dummy_value()

        numbers = (types.float32, types.float32, types.boolean)
        return types.void(line, *(types.intp,) * 2, codes, *(types.intp,) * 4, *numbers), generate

    return mix


mix_many_scalars, mix_few_scalars, mix_one_scalar = (_mixer_of_scalars(count) for count in (MANY, FEW, 1))
# Of each size of group: number ``channel`` of the codes; and all of them, normals alone or one lamp's T as well.
MIX_CODES, MIX_NORMALS, MIX_SHADOWED = (
    [_mixer_of_codes(count, channels) for count in (MANY, FEW, 1)] for channels in (None, NORMAL, NORMAL + 1)
)
