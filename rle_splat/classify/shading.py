"""Pre-shading of the non-transparent voxels: Blinn-Phong, two-sided (paper 2.1; algorithm.md 4.2).

Split in two: the normals do not depend on the view and may be kept between frames; the light that falls on them is
put straight into voxel records, any range of voxels at a time, so that no list of all shaded colours is needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..jit import compiled, kernel, parallel_call, prange, read_only
from ..volume.gradient import CHUNK, unit_normals
from .classification import EXTINCTION, OPACITY, RED, ClassifiedVolume
from .lights import AREA, AXIS, CONE, EDGE, KIND, NEAREST, POSITION, RGB, SPOT, SUN, light_rows

SHARPEST = 1e9  # a larger shininess is a highlight of no width; the whole part must also fit an integer
DENSITY = {"extinction": EXTINCTION, "opacity": OPACITY, None: -1}  # column of the looks that weights a colour

# Voxels shaded together: their scratch stays in the first cache, and loops are long enough.
LANES = 256
# Planes of the float32 scratch: normal; unit vectors to the light and to the eye; cosine, its power and the light's
# falloff; light gathered by the matt colour and by the highlight.
NX, NY, NZ, LX, LY, LZ, VX, VY, VZ, COS, POWER, FALLOFF, DR, DG, DB, SR, SG, SB = (
    LANES * plane for plane in range(18)
)
SCRATCH = 18 * LANES
PX, PY, PZ = (LANES * plane for plane in range(3))  # planes of the float64 scratch: world position
PLACES = 3 * LANES
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_FAINT = np.float32(1e-18)  # the product of two such is still a normal number


@dataclass(frozen=True, eq=False)
class Lighting:
    """What falls on the voxels of a volume.

    ``matrix``: (4, 4) index to world.  ``material``: (4,) ambient, diffuse, specular, shininess.  ``rows``: the lights,
    see ``light_rows``.  ``eye``: (4,) homogeneous world eye, its last component 0 for parallel rays.
    """

    matrix: np.ndarray
    material: np.ndarray
    rows: np.ndarray
    eye: np.ndarray

    @property
    def needs_places(self) -> bool:
        """Whether it matters where a voxel is: not for parallel light seen along parallel rays."""
        sees_highlights = self.material[2] > 0.0 and self.eye[3] != 0.0
        return bool(sees_highlights or (self.rows[:, KIND] != SUN).any())


def is_shaded(shading, lights, headlight_direction=None) -> bool:
    """Whether normals are needed at all: the transfer function shades and something shines."""
    return bool(shading) and (len(lights) > 0 or headlight_direction is not None)


def follows_view(shading, lights, headlight_direction=None) -> bool:
    """Whether the shaded colours change when the camera moves: a highlight or a headlight."""
    if not is_shaded(shading, lights, headlight_direction):
        return False
    return shading.specular > 0.0 or headlight_direction is not None


def lighting(index_to_world, shading, lights=(), *, headlight_direction=None, eye=None) -> Lighting | None:
    """The Lighting of a Shade and scene.Light objects, or None when nothing shades or nothing shines.

    ``headlight_direction``: (3,) the way the camera looks, world, or None.  ``eye``: (4,) homogeneous world eye; its
    last component is 0 for parallel rays and the rest then points from the scene to the eye.  Only highlights need it.
    """
    if not is_shaded(shading, lights, headlight_direction):
        return None
    matrix = np.ascontiguousarray(index_to_world, dtype=np.float64)
    eye = np.zeros(4) if eye is None else np.asarray(eye, dtype=np.float64) * (-1.0 if eye[3] < 0.0 else 1.0)
    shininess = min(shading.shininess, SHARPEST)
    material = np.array([shading.ambient, shading.diffuse, shading.specular, shininess], dtype=np.float64)
    return Lighting(read_only(matrix), material, light_rows(lights, headlight_direction, matrix), eye)


def normals(classified, volume, index_to_world, *, backend: str = "auto", threads: int = 0) -> np.ndarray:
    """(m, 3) float32 unit world normals of the visible voxels, (0, 0, 0) where the gradient is below the noise.

    ``classified``: a ClassifiedVolume, or its VisibleVoxels.
    """
    return unit_normals(
        volume, classified.row_start, classified.column, index_to_world, backend=backend, threads=threads
    )


def shade(
    classified, normals, index_to_world, shading, lights=(), *,
    headlight_direction=None, eye=None, backend: str = "auto", threads: int = 0,
) -> np.ndarray:
    """(m, 3) float32 shaded, unassociated, scene-linear colours of the visible voxels.

    c * (ambient + sum diffuse |n.l| I) + sum specular |n.h|^shininess I over the lights, I an RGB scale (see
    ``lights.py``); c itself where there is no normal, and everywhere when nothing shades or nothing shines.

    ``normals``: (m, 3) of ``normals()``, None when ``is_shaded`` is False.  ``shading``: a Shade, or None.
    The others: see ``lighting``.
    """
    falling = lighting(index_to_world, shading, lights, headlight_direction=headlight_direction, eye=eye)
    return shaded_colors(classified, normals, falling, backend=backend, threads=threads)


def shaded_colors(
    classified, normals, falling: Lighting | None, *, backend: str = "auto", threads: int = 0
) -> np.ndarray:
    """(m, 3) float32 colours of the visible voxels under ``falling``; their own without it."""
    if falling is None:
        return classified.color
    records = np.empty((classified.visible_voxels, 4), dtype=np.float32)
    light_records(
        classified, normals, falling, None, 0, classified.visible_voxels, records, backend=backend, threads=threads
    )
    return read_only(np.ascontiguousarray(records[:, :3]))


def color_bound(classified: ClassifiedVolume, falling: Lighting | None) -> float | None:
    """A bound, never far off, of any channel of the shaded colours; None where lights stand among the voxels, so that
    only shading them tells."""
    most = float(classified.looks[:, RED:].max(initial=0.0))
    if falling is None:
        return most
    if (falling.rows[:, KIND] != SUN).any():
        return None
    ambient, diffuse, specular, _ = falling.material
    strongest = float(falling.rows[:, RGB:NEAREST].sum(axis=0).max())
    return max(most, most * (ambient + diffuse * strongest) + specular * strongest)


def light_records(
    classified: ClassifiedVolume, normals, falling: Lighting | None, model: str | None, first: int, last: int, records,
    *, backend: str = "auto", threads: int = 0,
) -> float:
    """Write the records of voxels [first, last) into ``records`` (n, 4) float32; the largest channel of any colour.

    A record is (density * RGB, density): by ``model`` the density is the extinction or the opacity, None makes it 1.
    ``normals``: (m, 3) float32, None without ``falling``.
    """
    look_of, looks = read_only(classified.look_of), classified.looks
    most = np.zeros(max(-(-(last - first) // LANES), 1), np.float32)
    use_kernels = compiled(backend)
    if falling is None:
        arguments = (look_of, looks, DENSITY[model], first, last, records, most)
        run = _plain_records if use_kernels else _plain_records_numpy
    else:
        voxels = classified.voxels
        arguments = (
            voxels.shape_xyz[1], voxels.row_start, voxels.column, look_of, looks, DENSITY[model], read_only(normals),
            falling.matrix, falling.material, falling.rows, falling.eye, falling.needs_places, first, last, records,
            most,
        )
        run = _lit_records if use_kernels else _lit_records_numpy
    if use_kernels:
        with parallel_call(threads):
            run(*arguments)
    else:
        run(*arguments)
    return float(most.max())


@kernel(inline="always")
def _write_record(records, i, looks, look, density_column, red, green, blue):
    """One record and its largest colour channel."""
    density = looks[look, density_column] if density_column >= 0 else _ONE
    records[i, 0] = density * red
    records[i, 1] = density * green
    records[i, 2] = density * blue
    records[i, 3] = density
    return max(red, max(green, blue))


@kernel(parallel=True)
def _plain_records(look_of, looks, density_column, first, last, records, most):
    """Unshaded records; ``look_of``: (m,) index into ``looks`` (n, 5), or (0,) where it is the voxel's own number."""
    for chunk in prange(most.size):
        begin = first + chunk * LANES
        brightest = _ZERO
        for i in range(begin, min(begin + LANES, last)):
            look = np.int64(look_of[i]) if look_of.size > 0 else i
            brightest = max(brightest, _write_record(
                records, i - first, looks, look, density_column, looks[look, RED], looks[look, RED + 1],
                looks[look, RED + 2],
            ))
        most[chunk] = brightest


def _plain_records_numpy(look_of, looks, density_column, first, last, records, most):
    """Twin of ``_plain_records``."""
    seen = looks[look_of[first:last]] if look_of.size else looks[first:last]
    _write_numpy(seen[:, RED:], seen, density_column, records)
    most[0] = seen[:, RED:].max(initial=0.0)


def _write_numpy(colors, seen, density_column, records):
    records[:, 3] = seen[:, density_column] if density_column >= 0 else 1.0
    records[:, :3] = records[:, 3:] * colors


@kernel(inline="always")
def _scale_of(x, y, z):
    """One over the length of a vector, 0 for the zero vector."""
    length = np.sqrt(x * x + y * y + z * z)
    return 1.0 / length if length > 0.0 else 0.0


@kernel
def _place_voxels(n_y, row_start, column, matrix, begin, count, places):
    """World positions of ``count`` voxels from number ``begin`` on."""
    row = np.searchsorted(row_start, begin, side="right") - 1
    i = 0
    while i < count:
        z, y = row // n_y, row % n_y
        stop = min(row_start[row + 1] - begin, count)
        ox = matrix[0, 1] * y + matrix[0, 2] * z + matrix[0, 3]
        oy = matrix[1, 1] * y + matrix[1, 2] * z + matrix[1, 3]
        oz = matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3]
        for j in range(i, stop):
            x = np.float64(column[begin + j])
            places[PX + j] = matrix[0, 0] * x + ox
            places[PY + j] = matrix[1, 0] * x + oy
            places[PZ + j] = matrix[2, 0] * x + oz
        i = max(i, stop)
        row += 1


@kernel
def _view_voxels(eye, needs_places, count, places, s):
    """Unit vectors to the eye into VX, VY, VZ."""
    scale = _scale_of(eye[0], eye[1], eye[2])
    ex, ey, ez = np.float32(eye[0] * scale), np.float32(eye[1] * scale), np.float32(eye[2] * scale)
    for i in range(count):
        s[VX + i] = ex
        s[VY + i] = ey
        s[VZ + i] = ez
    if needs_places and eye[3] != 0.0:
        for i in range(count):
            x = eye[0] - eye[3] * places[PX + i]
            y = eye[1] - eye[3] * places[PY + i]
            z = eye[2] - eye[3] * places[PZ + i]
            scale = _scale_of(x, y, z)
            s[VX + i] = x * scale
            s[VY + i] = y * scale
            s[VZ + i] = z * scale


@kernel
def _towards(light, count, places, s):
    """Unit vectors to a light (a row of ``light_rows``) into LX, LY, LZ, and its FALLOFF."""
    ax, ay, az = light[AXIS], light[AXIS + 1], light[AXIS + 2]
    sx, sy, sz = np.float32(-ax), np.float32(-ay), np.float32(-az)
    for i in range(count):
        s[LX + i] = sx
        s[LY + i] = sy
        s[LZ + i] = sz
        s[FALLOFF + i] = _ONE
    kind = light[KIND]
    if kind == SUN:
        return
    for i in range(count):
        x, y = light[POSITION] - places[PX + i], light[POSITION + 1] - places[PY + i]
        z = light[POSITION + 2] - places[PZ + i]
        falloff = 1.0 / max(x * x + y * y + z * z, light[NEAREST])
        scale = _scale_of(x, y, z)
        x, y, z = x * scale, y * scale, z * scale
        off_axis = -(x * ax + y * ay + z * az)
        if kind == AREA:
            falloff *= max(off_axis, 0.0)
        elif kind == SPOT:
            t = min(max((off_axis - light[CONE]) / light[EDGE], 0.0), 1.0)
            falloff *= t * t * (3.0 - 2.0 * t)
        s[LX + i] = x
        s[LY + i] = y
        s[LZ + i] = z
        s[FALLOFF + i] = falloff


@kernel
def _power(whole, rest, count, s):
    """POWER = COS ** (whole + rest), COS 0 or more; the whole part, mostly all there is, by squarings.

    What is too faint to see becomes 0 at once: denormal numbers would take a hundred times as long.
    """
    for i in range(count):
        s[POWER + i] = _ONE
    if rest != _ZERO:
        for i in range(count):
            s[POWER + i] = s[COS + i] ** rest
    while whole > 0:
        if whole & 1:
            for i in range(count):
                power = s[POWER + i] * s[COS + i]
                s[POWER + i] = power if power > _FAINT else _ZERO
        whole >>= 1
        if whole > 0:
            for i in range(count):
                square = s[COS + i] * s[COS + i]
                s[COS + i] = square if square > _FAINT else _ZERO


@kernel
def _add_light(light, diffuse, specular, whole, rest, count, s):
    """What one light adds to the matt colour and to the highlight of every voxel of a chunk."""
    red, green, blue = np.float32(light[RGB]), np.float32(light[RGB + 1]), np.float32(light[RGB + 2])
    for i in range(count):
        facing = s[NX + i] * s[LX + i] + s[NY + i] * s[LY + i] + s[NZ + i] * s[LZ + i]
        matt = diffuse * abs(facing) * s[FALLOFF + i]
        s[DR + i] += matt * red
        s[DG + i] += matt * green
        s[DB + i] += matt * blue
    if specular == _ZERO:
        return
    for i in range(count):
        hx, hy, hz = s[LX + i] + s[VX + i], s[LY + i] + s[VY + i], s[LZ + i] + s[VZ + i]
        facing = s[NX + i] * hx + s[NY + i] * hy + s[NZ + i] * hz
        length = np.sqrt(hx * hx + hy * hy + hz * hz)
        s[COS + i] = abs(facing) / length if length > _ZERO else _ZERO
    _power(whole, rest, count, s)
    for i in range(count):
        gloss = specular * s[POWER + i] * s[FALLOFF + i]
        s[SR + i] += gloss * red
        s[SG + i] += gloss * green
        s[SB + i] += gloss * blue


@kernel
def _gather_light(normals, lights, eye, ambient, diffuse, specular, whole, rest, needs_places, places, s):
    """What falls on the voxels of one chunk, (n, 3) ``normals``, at ``places``."""
    count = len(normals)
    for i in range(count):
        s[NX + i] = normals[i, 0]
        s[NY + i] = normals[i, 1]
        s[NZ + i] = normals[i, 2]
        s[DR + i] = s[DG + i] = s[DB + i] = ambient
        s[SR + i] = s[SG + i] = s[SB + i] = _ZERO
    if specular > _ZERO:
        _view_voxels(eye, needs_places, count, places, s)
    for k in range(lights.shape[0]):
        _towards(lights[k], count, places, s)
        _add_light(lights[k], diffuse, specular, whole, rest, count, s)


@kernel
def _write_lit(look_of, looks, first_look, density_column, s, records):
    """The records of one chunk, (n, 4); its largest colour channel.  ``first_look``: look of voxel 0 when each voxel
    has its own, that is, when ``look_of`` is empty."""
    brightest = _ZERO
    for i in range(len(records)):
        look = np.int64(look_of[i]) if look_of.size > 0 else first_look + i
        red, green, blue = looks[look, RED], looks[look, RED + 1], looks[look, RED + 2]
        if s[NX + i] != _ZERO or s[NY + i] != _ZERO or s[NZ + i] != _ZERO:
            red = red * s[DR + i] + s[SR + i]
            green = green * s[DG + i] + s[SG + i]
            blue = blue * s[DB + i] + s[SB + i]
        brightest = max(brightest, _write_record(records, i, looks, look, density_column, red, green, blue))
    return brightest


@kernel(parallel=True)
def _lit_records(
    n_y, row_start, column, look_of, looks, density_column, normals, matrix, material, lights, eye, needs_places, first,
    last, records, most,
):
    """Shaded records in chunks of LANES voxels, every step of the formula a loop over one chunk, so that it becomes
    wide SIMD.  (Chunks are handed on as slices: counted from zero, the compiler knows that no index is negative.)
    ``look_of``: as in ``_plain_records``; the others: see Lighting."""
    ambient, diffuse, specular = np.float32(material[0]), np.float32(material[1]), np.float32(material[2])
    whole = np.int64(material[3])
    rest = np.float32(material[3] - whole)
    for chunk in prange(most.size):
        begin = first + chunk * LANES
        end = max(min(begin + LANES, last), begin)
        s = np.empty(SCRATCH, np.float32)
        places = np.empty(PLACES if needs_places else 0, np.float64)
        if needs_places and end > begin:
            _place_voxels(n_y, row_start, column, matrix, begin, end - begin, places)
        _gather_light(
            normals[begin:end], lights, eye, ambient, diffuse, specular, whole, rest, needs_places, places, s
        )
        most[chunk] = _write_lit(
            look_of[begin:end], looks, begin, density_column, s, records[begin - first : end - first]
        )


def _lit_records_numpy(
    n_y, row_start, column, look_of, looks, density_column, normals, matrix, material, lights, eye, _needs_places,
    first, last, records, most,
):
    """Twin of ``_lit_records``, in chunks of voxels."""
    ambient, diffuse, specular, shininess = material
    for begin in range(first, last, CHUNK):
        part = slice(begin, min(begin + CHUNK, last))
        row = np.searchsorted(row_start, np.arange(part.start, part.stop), side="right") - 1
        index = np.stack((column[part].astype(np.float64), row % n_y, row // n_y), axis=1)
        points = index @ matrix[:3, :3].T + matrix[:3, 3]
        n = normals[part].astype(np.float64)
        view = _unit_numpy(eye[:3] - eye[3] * points)
        matt = np.full((len(points), 3), ambient)
        gloss = np.zeros((len(points), 3))
        for light in lights:
            towards, falloff = _towards_numpy(light, points)
            strength = falloff[:, None] * light[RGB:NEAREST]
            matt += diffuse * np.abs((n * towards).sum(axis=1))[:, None] * strength
            if specular > 0.0:
                half = _unit_numpy(towards + view)
                gloss += specular * np.abs((n * half).sum(axis=1))[:, None] ** shininess * strength
        seen = looks[look_of[part]] if look_of.size else looks[part]
        lit = np.where(n.any(axis=1)[:, None], seen[:, RED:] * matt + gloss, seen[:, RED:]).astype(np.float32)
        _write_numpy(lit, seen, density_column, records[part.start - first : part.stop - first])
        most[0] = max(most[0], lit.max(initial=0.0))


def _unit_numpy(vectors) -> np.ndarray:
    lengths = np.sqrt((vectors**2).sum(axis=1))[:, None]
    return vectors * np.divide(1.0, lengths, out=np.zeros_like(lengths), where=lengths > 0.0)


def _towards_numpy(light, points):
    """Twin of ``_towards`` for (m, 3) points: (m, 3) unit vectors and (m,) falloff."""
    if light[KIND] == SUN:
        return np.broadcast_to(-light[AXIS:RGB], points.shape), np.ones(len(points))
    way = light[POSITION:AXIS] - points
    falloff = 1.0 / np.maximum((way**2).sum(axis=1), light[NEAREST])
    towards = _unit_numpy(way)
    off_axis = -(towards @ light[AXIS:RGB])
    if light[KIND] == AREA:
        falloff *= np.maximum(off_axis, 0.0)
    elif light[KIND] == SPOT:
        t = np.clip((off_axis - light[CONE]) / light[EDGE], 0.0, 1.0)
        falloff *= t * t * (3.0 - 2.0 * t)
    return towards, falloff
