"""Codes of kept voxels, of which their samples are lit: normals, what arrives of each lamp, and factors of extinction.

What each depends on, so that a lamp that moves or an object that turns redoes no more than it must:

    surfaces  the kept voxels, and how far normals are smoothed
    normals   surfaces, how the volume lies in the world, what clips cut, which values the transfer function shows
    shadows   the extinction, where each lamp is, and how far apart the nodes of its grid are
    codes     normals and shadows; where one lamp moved, only what arrives of it is written anew
"""

from __future__ import annotations

import numpy as np

from ..effects.shadows import Occluders
from ..runtime.buffer_pool import empty
from ..runtime.steps import announce, map_steps, time_steps
from ..scene import Scene
from ..shade.light_nodes import read_nodes_steps
from ..shade.sample_light import NORMAL, ONE, SampleLight, sample_light
from ..shade.surface_normals import automatic_sigma, surface_steps
from ..shade.surface_points import faces_of, place_steps, shown_ranges
from .shadows import Arriving, arriving_steps, casting, shadow_count
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


def code_steps(scene: Scene, voxels, voxels_key, occluders: Occluders, side: int, work: Work, threads: int):
    """Generator of Progress: the codes of the voxels of a lit scene, and their key.

    Parameters
    ----------
    voxels : VisibleVoxels
        Those that are kept, which ``voxels_key`` names.
    occluders : Occluders
        What casts shadows.
    side : int
        Voxels from node to node of the grids of light.

    Returns
    -------
    (m, channels) ndarray of int16
        ONE times the planes of ``light_of``.
    tuple
    """
    job, clock, volume, matrix = work.job, work.clock, scene.volume, scene.index_to_world
    rows, sigma = (voxels.row_start, voxels.column), smoothness_of(scene)
    surfaces_key = voxels_key, sigma
    steps = job.steps("surfaces", surfaces_key, lambda: surface_steps(volume, *rows, sigma, threads=threads))
    surfaces = yield from announce(time_steps(steps, clock, "shade"), 0.1, 0.1, "Finding surfaces")
    shaded = shadow_count(scene) > 0
    cuts = tuple((clip.kind, clip.keep, clip.matrix_world.tobytes()) for clip in scene.clips)
    ranges = shown_ranges(scene.transfer_function.opacity)
    normals_key = surfaces_key, array_key(matrix), cuts, array_key(ranges), shaded

    def place():
        faces = faces_of(scene.clips, matrix)
        function = scene.transfer_function
        given = surfaces, voxels, volume, function, matrix, faces
        return Placed(*(yield from place_steps(*given, with_points=shaded, threads=threads)))

    steps = time_steps(job.steps("normals", normals_key, place), clock, "shade")
    placed = yield from announce(steps, 0.1, 0.1, "Finding surfaces")
    if not shaded:
        return placed.codes, normals_key
    steps = arriving_steps(scene, occluders, job, clock, side)
    arriving = yield from announce(steps, 0.1, 0.1, "Casting shadows")
    key = normals_key, side, tuple(one.key for one in arriving)
    steps = job.steps("codes", (key, IN_ROWS), lambda: _join_steps(placed, voxels, key, arriving, job, threads))
    return (yield from announce(time_steps(steps, clock, "shade"), 0.1, 0.1, "Casting shadows")), key


def _join_steps(placed: Placed, voxels, key, arriving: list[Arriving], job: Job, threads: int):
    """Generator of fractions: codes of normals and of what arrives beside the voxels, (m, channels) int16.

    Channels that earlier codes have, before a lamp moved, are copied.
    """
    normals_key, side, keys = key

    def serves(held_key, _) -> bool:
        held, order = held_key
        return order == IN_ROWS and len(held) == 3 and held[:2] == (normals_key, side) and len(held[2]) == len(keys)

    codes = empty((len(voxels), NORMAL + len(keys)), np.int16)
    held_key = job.latest("codes", serves)
    known, anew = placed.codes, range(len(keys))
    if held_key is not None:
        known, held = job.get("codes", held_key, None), held_key[0][2]
        anew = [plane for plane in anew if held[plane] != keys[plane]]
    for n, plane in enumerate(anew):
        one = arriving[plane]
        steps = read_nodes_steps(
            one.codes, side, one.strength, voxels, placed.offsets, None if n else known, codes, NORMAL + plane,
            threads=threads,
        )  # fmt: skip
        yield from map_steps(steps, lambda fraction, n=n: (n + fraction) / len(anew))
    return codes


class Placed:
    """Codes of the normals of voxels, (m, 3) int16, and how far beside each shadows begin; see ``place_steps``."""

    def __init__(self, codes: np.ndarray, offsets: np.ndarray | None):
        self.codes, self.offsets = codes, offsets

    @property
    def nbytes(self) -> int:
        return self.codes.nbytes + (0 if self.offsets is None else self.offsets.nbytes)


def with_factor(codes: np.ndarray | None, factor: np.ndarray) -> np.ndarray:
    """Codes with one more channel, the last: ``factor`` (m,) in [0, 1], which multiplies each voxel's extinction."""
    channels = 0 if codes is None else codes.shape[1]
    found = empty((len(factor), channels + 1), np.int16)
    if codes is not None:
        found[:, :channels] = codes
    found[:, channels] = np.rint(factor * ONE)
    return found
