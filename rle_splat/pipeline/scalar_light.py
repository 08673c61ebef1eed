"""Codes of kept voxels, of which their samples are lit: normals, what arrives of each lamp, and factors of extinction.

What each depends on, so that a lamp that moves or an object that turns redoes no more than it must:

    surfaces  the kept voxels, and how far normals are smoothed
    normals   surfaces, how the volume lies in the world, what clips cut, which values the transfer function shows
    shadows   the extinction, where each lamp is, and how far apart the nodes of its grid are
    codes     normals and shadows; where one lamp moved, only what arrives of it is written anew
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ..classify.shown_nearby import mean_extinction, nearby_steps
from ..effects.shadows import CODED_AT_ONCE, Occluders
from ..runtime.buffer_pool import empty
from ..runtime.jit import read_only
from ..runtime.steps import announce, map_steps
from ..scene import Scene
from ..shade.light_nodes import read_nodes_steps
from ..shade.sample_light import NORMAL, ONE, SampleLight, sample_light
from ..shade.surface_normals import automatic_sigma, surface_steps
from ..shade.surface_points import faces_of, place_steps, points_for, shown_ranges
from .shadows import TRACED, Arriving, arriving_steps, casting, shadow_count, traced_steps
from .source import Work, array_key
from .stage_cache import Job

IN_ROWS = "rows"  # the order of the voxels themselves


def smoothness_of(scene: Scene) -> float:
    """Standard deviation, in mm, of the Gaussian of which normals are the gradient's."""
    asked = scene.transfer_function.shade.smoothness
    return automatic_sigma(scene.volume.spacing) if asked is None else asked


def light_of(scene: Scene, falling) -> SampleLight | None:
    """The light of a scene on samples; None where nothing shines."""
    if falling is None:
        return None
    opened = scene.ambient_occlusion > 0.0
    return sample_light(falling, scene.volume.shape_xyz, casting(scene), opened, scene.indirect_light)


def code_steps(scene: Scene, scalars, occluders: Occluders, side: int, work: Work, threads: int):
    """Generator of Progress: the codes of the voxels of a lit scene, and their key.

    Parameters
    ----------
    scalars : LitScalars
        The voxels that are kept, not lit yet.
    occluders : Occluders
        What casts shadows.
    side : int
        Voxels from node to node of the grids of light; TRACED where light is traced beside each voxel.

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
    with clock.stage("shade"):
        surfaces = yield from announce(steps, 0.1, 0.1, "Finding surfaces")
    cuts = tuple((clip.kind, clip.keep, clip.matrix_world.tobytes()) for clip in scene.clips)
    ranges = [shown_ranges(part.function.opacity) for part in parts]
    # The means of channels, and the sides of labels, depend on how much each shows.
    weighted_by = (scalars.functions_key, scalars.length) if len(parts) > 1 or scalars.labels else ()
    normals_key = surfaces_key, array_key(matrix), cuts, array_key(*ranges), shaded, weighted_by

    def place():
        faces, found, labels = faces_of(scene.clips, matrix), [], scalars.labels
        for part, volume, (surface, _) in zip(parts, volumes, surfaces, strict=True):
            if labels is not None and not found:
                own = labels.extinction(part.voxels, scene.volume.voxels.dtype, part.infinite)
                given = surface, part.voxels, volume, matrix, faces, own
                steps = labels.place_steps(*given, with_points=shaded, threads=threads)
            else:
                given = surface, part.voxels, volume, part.function, matrix, faces
                steps = place_steps(*given, with_points=shaded, threads=threads)
            if len(parts) == 1:
                return Placed(*(yield from steps))
            found.append(steps)
        return (yield from _mean_steps(found, map(weigh, range(len(parts)))))

    def weigh(number):
        """How much a channel shows around each voxel, (m,) float32."""
        part, (_, nearby) = parts[number], surfaces[number]
        if scalars.labels is not None and number == 0:
            return scalars.labels.mean_extinction(part.voxels, nearby)
        return mean_extinction(part.transfer, nearby)

    with clock.stage("shade"):
        placed = yield from announce(job.steps("normals", normals_key, place), 0.1, 0.1, "Finding surfaces")
    if not shaded:
        return placed.codes, normals_key
    if side == TRACED:
        steps = traced_steps(scene, occluders, placed.points(matrix), normals_key, job, clock)
    else:
        steps = arriving_steps(scene, occluders, job, clock, side, placed.points(matrix), normals_key)
    arriving = yield from announce(steps, 0.1, 0.1, "Casting shadows")
    key = normals_key, side, tuple(one.key for one in arriving)
    given = placed, scene, scalars.voxels, key, arriving, job, threads
    steps = job.steps("codes", (key, IN_ROWS), lambda: _join_steps(*given))
    with clock.stage("shade"):
        return (yield from announce(steps, 0.1, 0.1, "Casting shadows")), key


def _join_steps(placed: Placed, scene: Scene, voxels, key, arriving: list[Arriving], job: Job, threads: int):
    """Generator of fractions: codes of normals and of what arrives beside the voxels, (m, channels) int16.

    Channels that earlier codes have, before a lamp moved, are copied.
    """
    normals_key, side, keys = key

    def serves(held_key, _) -> bool:
        held, order = held_key
        return order == IN_ROWS and len(held) == 3 and held[:2] == (normals_key, side) and len(held[2]) == len(keys)

    codes = empty((len(voxels), NORMAL + len(keys)), np.int16)
    held_key = job.latest("codes", serves)
    known, anew, points = placed.codes, range(len(keys)), placed.points(scene.index_to_world)
    lights = [scene.lights[number] for number in casting(scene)] + [None] * len(keys)  # U and O: off the surface
    if held_key is not None:
        known, held = job.get("codes", held_key, None), held_key[0][2]
        anew = [plane for plane in anew if held[plane] != keys[plane]]
    for n, plane in enumerate(anew):
        one = arriving[plane]
        if side == TRACED:
            for first in range(0, len(codes), CODED_AT_ONCE):
                yield n / len(anew)
                part = slice(first, first + CODED_AT_ONCE)
                if n == 0:
                    codes[part, : known.shape[1]] = known[part]
                codes[part, NORMAL + plane] = _weaken(one.codes[part], one.strength)
            continue
        steps = read_nodes_steps(
            one.codes, side, one.strength, voxels, points(lights[plane]), None if n else known, codes, NORMAL + plane,
            left=one.left, threads=threads,
        )  # fmt: skip
        yield from map_steps(steps, lambda fraction, n=n: (n + fraction) / len(anew))
    return codes


def _weaken(codes, strength: float) -> np.ndarray:
    """(n,) int16 of light of which only a part of what is blocked counts."""
    return codes if strength == 1.0 else np.rint(ONE - np.float32(strength) * (ONE - codes)).astype(np.int16)


class Placed:
    """Codes of the normals of voxels, (m, 3) int16, and how far beside each shadows begin; see ``place_steps``."""

    def __init__(self, codes: np.ndarray, offsets: np.ndarray | None):
        self.codes, self.offsets = codes, offsets

    def points(self, index_to_world):
        """A function from a Light, or None, to where it is read beside the voxels."""
        return lambda light: points_for(light, self.codes, self.offsets, index_to_world)

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
