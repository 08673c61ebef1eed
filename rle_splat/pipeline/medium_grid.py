"""The medium of a scene, classified, cut and lit, as a grid for other renderers: extinction and color of each voxel.

It does not depend on the view: colors are those without highlights, which change with it.
"""

import math
from dataclasses import replace

import numpy as np

from ..classify.placing import RecordPositions
from ..effects.clip_cover import cover_steps
from ..encode.records import empty_records
from ..runtime.steps import Clock, Progress, announce, rescale
from ..scene import MODES, Camera, Quality, RleSplatError, Scene
from ..volume.reduced import factors_of
from .choose_source import choose_source
from .source import Work
from .stage_cache import StageCache

LEAST_SIDE, MOST_SIDE = 64, 128  # voxels along the longest side of a grid for shadows
# A voxel of such a grid is at most a quarter of a penumbra wide, where its shadow falls one longest side away.
VOXELS_A_PENUMBRA = 4.0
# Largest optical depth of a voxel.  It transmits 0.1 %; of more, a mean over voxels would show too much.
THICKEST = math.log(1000.0)
# Effects that change the medium or its light whatever the view; their overrides count.
OF_MEDIUM = (
    "gradient opacity", "shading", "lights", "headlight", "world light", "shadows", "ambient occlusion",
    "clip objects", "labels", "channels",
)  # fmt: skip
FROM_ANYWHERE = Camera(np.eye(4))


def for_any_view(scene: Scene) -> Scene:
    """The scene without all that belongs to a view: two scenes of one medium under one light differ in nothing.

    Returns
    -------
    Scene
        With its camera only if there is a headlight, which shines along the camera's axis.
    """
    function = scene.transfer_function
    if function is not None and function.shade is not None:
        function = replace(function, shade=replace(function.shade, specular=0.0))
    effects = {name: on for name, on in scene.effects.items() if name in OF_MEDIUM}
    is_shadowed = scene.volume_shadows or scene.ambient_occlusion > 0.0
    return replace(
        scene, transfer_function=function, camera=scene.camera if scene.headlight else FROM_ANYWHERE, width=1, height=1,
        ray_ends=None, triangles=scene.triangles if is_shadowed else None, crop=None, effects=effects,
        motion=(), mode=MODES[0], mist=None, reasons_off={},
    )  # fmt: skip


def softness(light, middle) -> float:
    """The angle in radians that a light takes in the sky of a point.

    Parameters
    ----------
    light : Light
    middle : (3,) ndarray
        The point, in the world.
    """
    if light.type == "SUN":
        return light.angle
    scale = np.linalg.norm(light.matrix_world[:3, :3], axis=0).max()
    width = max(light.size, light.size_y) * scale if light.type == "AREA" else 2.0 * light.radius
    distance = float(np.linalg.norm(light.matrix_world[:3, 3] - middle))
    return 2.0 * math.atan2(0.5 * width, distance)


def side_for(lights, middle) -> int:
    """Voxels along the longest side of a grid for shadows: fewer where all shadows are soft.

    Parameters
    ----------
    lights : iterable of Light
    middle : (3,) ndarray
        The middle of the volume in the world.

    Returns
    -------
    int
        From LEAST_SIDE to MOST_SIDE.
    """
    sharpest = min((softness(light, middle) for light in lights if light.casts_shadow), default=math.inf)
    wanted = VOXELS_A_PENUMBRA / max(sharpest, 1e-6)
    return round(min(max(wanted, LEAST_SIDE), MOST_SIDE))


def shadow_factors(scene: Scene, lights) -> tuple[int, int, int]:
    """How many voxels a grid for the shadows of some lights averages along x, y and z.

    Parameters
    ----------
    lights : iterable of Light

    Returns
    -------
    tuple of int
    """
    last = np.array(scene.volume.shape_xyz) - 1.0
    middle = (scene.index_to_world @ np.append(0.5 * last, 1.0))[:3]
    return factors_of(scene.volume, side_for(lights, middle))


def medium_steps(scene: Scene, quality: Quality, factors, add, cache: StageCache | None = None):
    """Generator of Progress: make the grid of a scene's medium; returns the number of visible voxels.

    A mean of extinctions keeps the optical depth of what is averaged.

    Parameters
    ----------
    factors : (fx, fy, fz)
        Voxels of the volume along each side of a voxel of the grid.
    add : callable
        ``add(plane, records)`` for each plane with visible voxels: its index along z, and (ny, nx, 4) float32,
        extinction times lit color and extinction, in 1 / world length.
    cache : StageCache, optional
        Shared with pictures, which have most stages in common.

    Raises
    ------
    RleSplatError
        If the volume is a .rle file, or there is not enough memory.
    """
    if not scene.volume.holds_values:
        raise RleSplatError("A .rle file holds no values to make a grid of; import the scan that it was made from.")
    cache = StageCache(0) if cache is None else cache
    wanted = Quality.preset("standard", classification="pre", threads=quality.threads)
    source = choose_source(for_any_view(scene), wanted)
    work = Work(cache.job(), Clock())
    lit = (yield from rescale(source.medium_steps(work), 0.0, 0.6)).voxels
    voxels, write = lit.classified.voxels, lit.write_records("extinction")
    matrix = source.scene.index_to_world
    kept = None
    if source.scene.clips:
        kept = yield from announce(cover_steps(source.scene.clips, voxels, matrix), 0.6, 0.6, "Filling the grid")
    thickest = np.float32(THICKEST / np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))
    nz = -(-voxels.shape_xyz[2] // factors[2])
    for plane in range(nz):
        yield Progress(0.6 + 0.4 * plane / nz, "Filling the grid")
        positions = RecordPositions.in_order(
            voxels, plane * factors[2], min((plane + 1) * factors[2], voxels.shape_xyz[2])
        )
        first, last = positions.span
        if last == first:
            continue
        records = empty_records(16, last - first)
        write(positions, records)
        shares = np.minimum(np.float32(1.0), thickest / np.maximum(records[:, 3], np.finfo(np.float32).tiny))
        if kept is not None:
            shares *= kept[first:last]
        add(plane, _sum_records(positions, records * shares[:, None], factors))
    work.job.keep()
    return len(voxels)


def _sum_records(positions: RecordPositions, records: np.ndarray, factors) -> np.ndarray:
    """(ny, nx, 4) float32: the means of the records (n, 4) of the voxels of some planes."""
    voxels, (fx, fy, fz) = positions.voxels, factors
    first, last = positions.span
    _, n_y, _ = voxels.shape_xyz
    nx, ny = (-(-n // factor) for n, factor in zip(voxels.shape_xyz, factors[:2]))
    rows = slice(positions.first_plane * n_y, (positions.first_plane + len(positions.data_starts)) * n_y)
    counts = np.diff(voxels.row_start[rows.start : rows.stop + 1])
    y = np.repeat(np.arange(len(counts)) % n_y // fy, counts)
    cell = y * nx + voxels.column[first:last].astype(np.int64) // fx
    sums = [np.bincount(cell, records[:, channel], ny * nx) for channel in range(4)]
    return (np.stack(sums, axis=-1) / (fx * fy * fz)).astype(np.float32).reshape(ny, nx, 4)
