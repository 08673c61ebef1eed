"""Shading of visible voxels by Blinn-Phong, one- or two-sided (paper, section 2.1; algorithm.md 4.2).

There are two steps. Normals do not depend on the view and can be cached between frames. Shaded colors are written
directly into voxel records, for any range of voxels, so that no list of all shaded colors is needed.
"""

from __future__ import annotations

import numpy as np

from ..classify.classification import EXTINCTION, OPACITY, RED, ClassifiedVolume
from ..classify.limits import BRIGHTEST
from ..classify.placing import RecordPositions, find_targets
from ..runtime.jit import compiled, inner_loop, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from ..scene import RleSplatError
from . import reference
from .chunk_light import DB, DG, DR, LANES, SB, SCRATCH, SG, SHARE, SR, add_near, add_rays, clear_light
from .lighting import Lighting
from .lights import KIND, NEAREST, RGB, SUN

# Model -> column of the optical properties that weights the color.
DENSITY = {"extinction": EXTINCTION, "opacity": OPACITY, None: None}
_ZERO = np.float32(0.0)
# Rows of properties by their type: kernels take an array of each, so that one serves all, and the others are empty.
_NO_ROWS = {kind: read_only(np.empty(0, kind)) for kind in ("uint8", "uint16")}


def components(normals: np.ndarray) -> np.ndarray:
    """(3, n) of (n, 3) normals, for kernels, and without a copy: ``normals`` keeps one component after another."""
    return read_only(np.ascontiguousarray(normals.T))


def shaded_colors(classified, normals, falling: Lighting | None, *, threads: int = 0) -> np.ndarray:
    """Shaded colors of visible voxels.

    For a color c, the shaded color is c * (ambient + sum diffuse |n.l| I) + sum specular |n.h|^shininess I, summed over
    lights with the irradiance scale I (RGB, see ``lights.py``); see Shade for surfaces with one side. A voxel without
    normal keeps c, and all voxels do if there is no shading or no light. Shadows reduce the ambient term and each I; a
    voxel without normal is reduced by the share of all light that arrives.

    Parameters
    ----------
    classified : ClassifiedVolume
    normals : (m, 3) ndarray of float32 or None
        As of ``unit_normals``; None without ``falling``.
    falling : Lighting or None
        None leaves the voxels their own colors.
    threads : int
        0 for one per core.

    Returns
    -------
    (m, 3) ndarray of float32
        Unassociated scene-linear colors.
    """
    if falling is None:
        return classified.color
    records = np.empty((classified.visible_voxels, 4), dtype=np.float32)
    everywhere = RecordPositions.in_order(classified.voxels, 0, classified.shape_xyz[2])
    light_records(classified, normals, falling, None, everywhere, records, threads=threads)
    return read_only(np.ascontiguousarray(records[:, :3]))


def color_bound(classified: ClassifiedVolume, falling: Lighting | None) -> float | None:
    """Upper bound, close to the maximum, of any channel of the shaded colors.

    None if there are lights that are not parallel; then only shading gives a bound.
    """
    most = float(classified.properties[:, RED:].max(initial=0.0))
    if falling is None:
        return most
    if (falling.rows[:, KIND] != SUN).any():
        return None
    diffuse, specular = falling.material[1:3]
    ambient = falling.most_everywhere.max()
    strongest = float(falling.rows[:, RGB:NEAREST].sum(axis=0).max())
    return min(max(most, most * (ambient + diffuse * strongest) + specular * strongest), BRIGHTEST)


def light_records(
    classified: ClassifiedVolume, normals, falling: Lighting | None, model: str | None, positions: RecordPositions,
    records, *, threads: int = 0,
) -> float:  # fmt: skip
    """Shade voxels and write their records; RleSplatError if a color is above BRIGHTEST.

    Parameters
    ----------
    normals : (m, 3) ndarray of float32 or None
        None without ``falling``.
    model : {"extinction", "opacity", None}
        A record is (density * RGB, density). The density is the extinction or the opacity, or 1 for None.
    positions : RecordPositions
        The voxels, and the positions of their records.
    records : (n, 4) ndarray of float32
        Output.
    threads : int
        0 for one per core.

    Returns
    -------
    float
        Largest channel of any color.
    """
    most = np.zeros(max(len(positions.data_starts), 1), np.float32)
    properties, density = classified.properties, DENSITY[model]
    if density is None:
        properties, density = properties.copy(), EXTINCTION
        properties[:, density] = 1.0
    row_of, seen = classified.row_of, (read_only(properties), density)
    if not compiled():
        reference.write_records(positions, row_of, *seen, normals, falling, records, most)
    else:
        given = {} if row_of is None else {row_of.dtype.name: read_only(row_of)}
        rows = tuple(given.get(kind, nothing) for kind, nothing in _NO_ROWS.items())
        light = (None, None, None, None)
        if falling is not None:
            near = falling.near
            light = (components(normals), falling.material, None if near else falling.rays(), near)
        with parallel_call(threads):
            _write_records(positions.arguments, rows, *seen, *light, records, most)
    return refuse_too_bright(float(most.max()))


def refuse_too_bright(brightest: float) -> float:
    """Return ``brightest``, a color or a light; raise a RleSplatError if it is above BRIGHTEST or NaN."""
    if not brightest <= BRIGHTEST:
        raise RleSplatError(
            f"Under these lights the volume is brighter than {BRIGHTEST:g}, where white is 1; make the lights "
            "weaker or move them away."
        )
    return brightest


# --- kernels: the loop over planes, in chunks of voxels --------------------------------------------------------


@kernel
def _write_records(positions, row_of, properties, density_column, normals, material, rays, near, records, most):
    """Kernel of ``light_records``.

    ``positions``: RecordPositions.arguments. ``row_of``: (m,) rows of ``properties`` (n, 5) as uint8 and as uint16, of
    which at least one is empty; both are if voxel i has row i.
    ``normals`` (3, m) and ``material``: None without light. Either ``rays`` (``Lighting.rays``) or ``near``
    (``Lighting.near``) is None, so that unused code is not compiled.
    """
    arguments = (positions, row_of, properties, density_column, normals, material, rays, near, records, most)
    share_out(_write_planes, positions[5].shape[0], arguments)


@inner_loop
def _write_chunk(row_of, at, properties, density_column, normals, s, targets, records):
    """Write the records of the voxels from ``at`` on, one for each of ``targets``; returns the largest channel.

    ``row_of``: as one array, or None.  ``s``: light, of ``clear_light``.
    """
    brightest = _ZERO
    for i in range(targets.size):
        entry = at + i if row_of is None else np.int64(row_of[at + i])
        red, green, blue = properties[entry, RED], properties[entry, RED + 1], properties[entry, RED + 2]
        if normals is not None:
            if normals[0, at + i] != _ZERO or normals[1, at + i] != _ZERO or normals[2, at + i] != _ZERO:
                red = red * s[DR + i] + s[SR + i]
                green = green * s[DG + i] + s[SG + i]
                blue = blue * s[DB + i] + s[SB + i]
            else:
                red *= s[SHARE + i]
                green *= s[SHARE + i]
                blue *= s[SHARE + i]
        density = properties[entry, density_column]
        to = targets[i]
        records[to, 0] = density * red
        records[to, 1] = density * green
        records[to, 2] = density * blue
        records[to, 3] = density
        brightest = max(brightest, max(red, max(green, blue)))
    return brightest


@kernel(inner=True)
def _write_planes(
    begin, end, positions, row_of, properties, density_column, normals, material, rays, near, records, most
):
    """``_write_records`` for planes [begin, end), in chunks of LANES voxels.

    Every step of the formula is a loop over one chunk, so that it becomes wide SIMD. Chunks are passed as slices, so
    the compiler knows that no index is negative.
    """
    n_y, first_plane, row_start, column, across, data_starts = positions
    cursors = np.empty(data_starts.shape[1], np.int64)
    targets, (narrow, wide) = np.empty(LANES, np.uint64), row_of
    s = np.empty(0 if normals is None else SCRATCH, np.float32)
    for plane in range(begin, end):
        for key in range(cursors.size):
            cursors[key] = data_starts[plane, key]
        first_row = (first_plane + plane) * n_y
        row = first_row
        at, last = row_start[first_row], row_start[first_row + n_y]
        brightest = _ZERO
        while at < last:
            stop = min(at + LANES, last)
            begun = row
            row = find_targets(across, first_row, row, row_start, column, at, stop - at, cursors, targets)
            if normals is not None:
                clear_light(material, normals[:, at:stop], stop - at, s)
            if rays is not None:
                add_rays(rays, normals[:, at:stop], material, stop - at, s)
            if near is not None:
                add_near(near, normals[:, at:stop], material, n_y, begun, row_start, column, at, stop - at, s)
            given = at, properties, density_column, normals, s, targets[: stop - at], records
            if narrow.size > 0:
                brightest = max(brightest, _write_chunk(narrow, *given))
            elif wide.size > 0:
                brightest = max(brightest, _write_chunk(wide, *given))
            else:
                brightest = max(brightest, _write_chunk(None, *given))
            at = stop
        most[plane] = brightest
