"""Codes of kept voxels, of which their samples are lit: normals, what arrives of each lamp, and factors of extinction.

What each depends on, so that a lamp that moves or an object that turns redoes no more than it must:

    surfaces  the kept voxels, and how far normals are smoothed
    normals   surfaces, how the volume lies in the world, what clips cut, which values the transfer function shows
    shadows   normals, the extinction, and where each lamp is
    codes     normals, shadows and factors
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ..classify.shown_nearby import mean_extinction, nearby_steps
from ..effects.shadows import Occluders
from ..runtime.buffer_pool import empty
from ..runtime.jit import read_only
from ..runtime.steps import announce, map_steps, time_steps
from ..scene import Scene
from ..shade.sample_light import NORMAL, ONE, SampleLight, sample_light
from ..shade.surface_normals import automatic_sigma, surface_steps
from ..shade.surface_points import faces_of, place_steps, shown_ranges
from .shadows import arriving_steps, casting, shadow_count
from .source import Work, array_key


def smoothness_of(scene: Scene) -> float:
    """Standard deviation, in mm, of the Gaussian of which normals are the gradient's."""
    asked = scene.transfer_function.shade.smoothness
    return automatic_sigma(scene.volume.spacing) if asked is None else asked


def light_of(scene: Scene, falling) -> SampleLight | None:
    """The light of a scene on samples; None where nothing shines."""
    if falling is None:
        return None
    return sample_light(falling, scene.volume.shape_xyz, casting(scene), scene.ambient_occlusion > 0.0)


def code_steps(scene: Scene, scalars, occluders: Occluders, work: Work, threads: int):
    """Generator of Progress: the codes of the voxels of a lit scene, and their key.

    Parameters
    ----------
    scalars : LitScalars
        The voxels that are kept, not lit yet.
    occluders : Occluders
        What casts shadows.

    Returns
    -------
    (m, channels) ndarray of int16
        ONE times the planes of ``light_of``.
    tuple
    """
    job, clock, matrix, parts = work.job, work.clock, scene.index_to_world, scalars.parts
    sigma, shaded = smoothness_of(scene), shadow_count(scene) > 0
    surfaces_key = scalars.key, sigma
    # The scene's own volume: labels hide what is shown, but normals are of the values as they are.
    volumes = scene.volume, *(part.volume for part in parts[1:])
    find = partial(_find_surfaces, volumes, parts, sigma, threads)
    steps = job.steps("surfaces", surfaces_key, find, _bytes_of_surfaces)
    surfaces = yield from announce(time_steps(steps, clock, "shade"), 0.1, 0.1, "Finding surfaces")
    cuts = tuple((clip.kind, clip.keep, clip.matrix_world.tobytes()) for clip in scene.clips)
    ranges = [shown_ranges(part.function.opacity) for part in parts]
    # The means of channels depend on how much each shows.
    weighted_by = (scalars.functions_key, scalars.length) if len(parts) > 1 else ()
    normals_key = surfaces_key, array_key(matrix), cuts, array_key(*ranges), shaded, weighted_by

    def place():
        faces, found = faces_of(scene.clips, matrix), []
        for part, volume, (surface, _) in zip(parts, volumes, surfaces, strict=True):
            given = surface, part.voxels, volume, part.function, matrix, faces
            steps = place_steps(*given, with_points=shaded, threads=threads)
            if len(parts) == 1:
                return Placed(*(yield from steps))
            found.append(steps)
        weights = (mean_extinction(part.transfer, nearby) for part, (_, nearby) in zip(parts, surfaces))
        return (yield from _mean_steps(found, weights))

    steps = time_steps(job.steps("normals", normals_key, place), clock, "shade")
    placed = yield from announce(steps, 0.1, 0.1, "Finding surfaces")
    if not shaded:
        return placed.codes, normals_key
    steps = arriving_steps(scene, occluders, job, clock, placed.offsets, normals_key)
    lamps, sky, key = yield from announce(steps, 0.1, 0.1, "Casting shadows")
    planes = lamps if sky is None else [*lamps, sky]
    key = normals_key, key
    with clock.stage("shade"):
        return job.get("codes", (key, "rows"), lambda: _joined(placed.codes, planes)), key


class Placed:
    """Codes of the normals of voxels, (m, 3) int16, and how far beside each shadows begin; see ``place_steps``."""

    def __init__(self, codes: np.ndarray, offsets: np.ndarray | None):
        self.codes, self.offsets = codes, offsets

    @property
    def nbytes(self) -> int:
        return self.codes.nbytes + (0 if self.offsets is None else self.offsets.nbytes)


def _find_surfaces(volumes, parts, sigma: float, threads: int):
    """Generator of fractions: of each of several channels its Surfaces, and the values around each voxel (2, m); of a
    single one the latter are None."""
    found, rows = [], (parts[0].voxels.row_start, parts[0].voxels.column)
    for number, (volume, part) in enumerate(zip(volumes, parts, strict=True)):

        def along(done, number=number):
            return (number + done) / len(parts)

        surfaces = yield from map_steps(surface_steps(volume, *rows, sigma, threads=threads), along)
        nearby = None
        if len(parts) > 1:
            nearby = yield from map_steps(nearby_steps(volume, part.voxels, part.infinite), lambda _: along(1.0))
        found.append((surfaces, nearby))
    return found


def _bytes_of_surfaces(found) -> int:
    return sum(surfaces.nbytes + (0 if nearby is None else nearby.nbytes) for surfaces, nearby in found)


def _mean_steps(placed, weights):
    """Generator of fractions: the means of what channels place, weighted; those of the first where nothing weighs.

    ``placed``: of each channel a ``place_steps``.  ``weights``: (m,) float32 each.
    """
    total, sums, first = np.float32(0.0), None, None
    for number, (steps, weight) in enumerate(zip(placed, weights)):
        found = yield from map_steps(steps, lambda done, number=number: (number + done) / len(placed))
        first = found if first is None else first
        sums = [None if one is None else np.zeros(one.shape, np.float32) for one in found] if sums is None else sums
        for to, one in zip(sums, found):
            if one is not None:
                to += weight[:, None] * one
        total = total + weight
    shows, means = total > 0.0, []
    for own, to in zip(first, sums):
        if own is None:
            means.append(None)
            continue
        np.divide(to, total[:, None], out=to, where=shows[:, None])
        means.append(read_only(np.where(shows[:, None], np.rint(to), own).astype(np.int16)))
    return Placed(*means)


def with_factor(codes: np.ndarray | None, factor: np.ndarray) -> np.ndarray:
    """Codes with one more channel, the last: ``factor`` (m,) in [0, 1], which multiplies each voxel's extinction."""
    channels = 0 if codes is None else codes.shape[1]
    found = empty((len(factor), channels + 1), np.int16)
    if codes is not None:
        found[:, :channels] = codes
    found[:, channels] = np.rint(factor * ONE)
    return found


def _joined(normals: np.ndarray, arriving: list[np.ndarray]) -> np.ndarray:
    """Codes of normals (m, 3) and, halved to 15 bits, of what arrives (m,) each."""
    found = empty((len(normals), NORMAL + len(arriving)), np.int16)
    found[:, :NORMAL] = normals
    for plane, share in enumerate(arriving):
        found[:, NORMAL + plane] = share >> 1
    return found
