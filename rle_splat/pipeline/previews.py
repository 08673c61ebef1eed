"""Pictures that arrive coarse to fine, each with a bound on its error, before the picture itself.

After Laur and Hanrahan's progressive refinement (see ``laur_hanrahan.py``): the levels of a pyramid of averages, each
encoded on its own grid and splatted by our own renderer.  Averages of extinction keep the optical depth, so the first
preview is as bright and as dense as the last; and what their nodes store of their error, carried along the rays,
bounds the error of every pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..encode.encode import brightest_steps, encode
from ..encode.nodes import NODE_BYTES, Nodes, node_errors, node_steps
from ..encode.pooling import classified_nodes, node_lists, node_to_voxel, nodes_shape
from ..encode.stored import StoredVolume
from ..runtime.jit import compiled, thread_count
from ..runtime.memory import available_bytes
from ..runtime.steps import Clock, Progress, mapped, portion
from ..scene import Quality, Rendering, RleSplatError, Scene
from ..view.base_plane import BasePlane, base_plane
from ..view.eye import index_view
from ..view.footprints import FOOTPRINTS
from ..view.principal_axis import candidate_pyramids
from ..volume.mapped_files import whole_steps
from .choose_source import choose_source
from .memory_estimate import SPARE
from .render import render_steps
from .scan_source import LitVolume, scan_source
from .source import Source, Work
from .stage_cache import Job, StageCache

# A picture that takes less is there before a preview would be of use; milliseconds.
WORTH_WAITING = 150.0
# Nor may previews together take more than this share of it, unless it is the first of them.
LARGEST_SHARE = 0.25
# What pictures take, milliseconds on one core, measured on scans at 512 x 512 and 1024 x 1024: the picture itself for
# each sheet pixel and, while its voxels are not encoded, each visible voxel; a preview for each pixel and base plane.
PER_PIXEL_SHEET, PER_VOXEL, PER_PREVIEW_PIXEL = 5e-7, 5e-5, 6e-5
NUMPY_FACTOR = 50.0  # how much longer all of it takes without compiled kernels
# The finest preview has at most so many nodes, 80 MB while they are made and 24 MB kept; the coarsest has so many along
# its longest side: fewer show nothing.
MOST_NODES, LEAST_SIDE = 1 << 20, 32
# A preview's own knobs: its nodes are many pixels wide, so that half of the sheet's pixels tell them apart.
KNOBS = dict(
    classification="pre", depth_rule="slice", sheet_density=0.5, kernel="tent", minification="off", warp_filter="cubic",
    termination=1 / 256, record=16, axis_fade=0.0, rays=0.0,
)
SMALLEST_SHARE = 1e-4  # of its error that a node absorbs at least: only what absorbs at all is encoded


@dataclass(frozen=True, eq=False)
class Preview:
    """A picture of nodes of 2^``level`` voxels a side; level 0 is the picture itself.

    ``error``: (H, W) float32, for each pixel a bound of the difference of any channel from the picture itself,
    scene-linear and premultiplied; it holds for the media, and leaves out what the renderer adds at its quality.
    None where the picture is not of classified voxels, which nodes are averages of: nothing is known of it then.
    """

    rendering: Rendering
    level: int
    error: np.ndarray | None

    @property
    def mean_error(self) -> float | None:
        """A bound of the mean over the pixels of their largest channel's error, where there is one."""
        return None if self.error is None else float(self.error.mean(dtype=np.float64))

    def describe(self) -> str:
        """In words for a person."""
        if self.level == 0:
            return "the picture itself"
        text = f"preview of {2**self.level} voxels a side"
        return text if self.error is None else f"{text}, mean error at most {100.0 * self.mean_error:.0f} %"


@dataclass(frozen=True, eq=False)
class Level:
    """A level ready to be drawn.  ``means``: (nz, ny, nx, 4) float32, see Nodes.  ``errors``: see ``node_errors``."""

    level: int
    means: np.ndarray
    errors: np.ndarray
    brightest: float

    @property
    def nbytes(self) -> int:
        return self.means.nbytes + self.errors.nbytes


def previews(scene: Scene, quality: Quality | None = None, cache: StageCache | None = None):
    """Generator: Previews of a scene, coarse to fine; the last is the picture that ``render`` makes.

    ``cache``: a stage cache shared with other pictures, so that a new view of the same volume does not average it
    again.  Volumes that are a few nodes wide, `.rle` files and the opacity model have no previews.
    """
    finished: list[Rendering] = []

    def noted_steps():
        finished.append((yield from progressive_steps(scene, quality or Quality(), cache, every=True)))

    yield from (step for step in noted_steps() if isinstance(step, Preview))
    (rendering,) = finished
    yield Preview(rendering, 0, np.zeros(rendering.depth.shape, np.float32))


def progressive_steps(
    scene: Scene, quality: Quality, cache: StageCache | None = None, *, refuse_empty_view: bool = True,
    every: bool = False,
):  # fmt: skip
    """``render_steps`` that also yields Previews, where the picture is likely to take WORTH_WAITING.

    ``every``: show all of them, however little the picture takes.  The Rendering it returns is the same to the bit.
    """
    cache = cache if cache is not None else StageCache()
    source = choose_source(scene, quality)
    door, shown = source, source.scene
    levels = preview_levels(shown.volume.shape_xyz)
    possible = levels and cache.keeps and source.preview_stages and quality.model == "extinction"
    planes = seen_planes(shown, shown.index_to_world, shown.volume.shape_xyz, door.quality) if possible else []
    if planes:
        made = dict(cache.made)
        job = cache.job()
        lit = yield from whole_steps(_lit_steps(source, door, job, len({plane.axis for plane in planes})), scene)
        job.keep()
        fresh = any(cache.made.get(stage) != made.get(stage) for stage in source.preview_stages)
        count = 0 if lit is None else len(levels)
        if count and not every:
            count = how_many(planes, shown, door.quality, fresh * lit.classified.visible_voxels)
        if count and fits(shown.volume.shape_xyz, levels):
            yield from _preview_steps(source, door, lit, levels, count, cache)
    return (yield from render_steps(scene, quality, cache, refuse_empty_view=refuse_empty_view))


def preview_levels(shape_xyz) -> tuple[int, ...]:
    """The levels worth showing of a volume, finest first: see MOST_NODES and LEAST_SIDE."""
    levels, level = [], 1
    while max(nodes_shape(shape_xyz, level)) >= LEAST_SIDE:
        if np.prod(nodes_shape(shape_xyz, level), dtype=np.int64) <= MOST_NODES:
            levels.append(level)
        level += 1
    return tuple(levels)


def how_many(planes: list[BasePlane], scene: Scene, quality: Quality, fresh_voxels: int) -> int:
    """How many previews a picture is worth: none where it is soon there, else at least one.

    ``planes``: its base planes.  ``fresh_voxels``: how many visible voxels were not encoded before.
    """
    left, top, right, bottom = scene.region
    pixels = (right - left) * (bottom - top)
    pixel_sheets = sum(len(plane.sheets) * plane.width * plane.height for plane in planes)
    cropped = pixels / (scene.width * scene.height)  # the planes are those of the whole frame
    picture = PER_PIXEL_SHEET * pixel_sheets * cropped + PER_VOXEL * fresh_voxels
    preview = PER_PREVIEW_PIXEL * pixels * len(planes)
    speed = thread_count(quality.threads) if compiled(quality.backend) else 1.0 / NUMPY_FACTOR
    if picture < WORTH_WAITING * speed:
        return 0
    return max(int(LARGEST_SHARE * picture / preview), 1)


def fits(shape_xyz, levels) -> bool:
    """Whether there is memory to spare for the nodes of ``levels``; without it there are no previews."""
    return NODE_BYTES * np.prod(nodes_shape(shape_xyz, levels[0]), dtype=float) < SPARE * available_bytes()


def seen_planes(scene: Scene, index_to_world, shape_xyz, quality: Quality) -> list[BasePlane]:
    """The base planes that a picture, not cropped, of a grid in the place of the volume is splatted on to."""
    view = index_view(scene.camera, index_to_world, scene.width, scene.height)
    knobs = (quality.depth_rule, quality.sheet_density, FOOTPRINTS[quality.kernel])
    planes = [base_plane(view, shape_xyz, *pyramid, *knobs) for pyramid in candidate_pyramids(view)]
    return [plane for plane in planes if plane is not None]


# --- the previews ---------------------------------------------------------------------------------------------


def _lit_steps(source: Source, door: Source, job: Job, axes: int):
    """Generator: the LitVolume that nodes are averages of; None where its tables do not fit in memory, but those of
    scalar sheets may."""
    try:
        return (yield from scan_source(door.scene, door.quality).medium_steps(Work(job, Clock(), axes))).voxels
    except RleSplatError:
        if source.scalar_sheets:
            return None
        raise


def _preview_steps(source: Source, door: Source, lit: LitVolume, levels, count: int, cache: StageCache):
    """Generator of Progress and, coarsest first, Previews of the ``count`` finest of the levels."""
    job, scene = cache.job(), door.scene
    steps = job.steps(
        "pyramid", (lit.key, levels), lambda: _pyramid_steps(lit, levels, door.quality),
        lambda pyramid: sum(level.nbytes for level in pyramid),
    )
    pyramid = yield from portion(steps, 0.1, 0.1, "Averaging voxels")
    job.keep()
    quality = replace(door.quality, **KNOBS)
    of_errors = replace(quality, warp_filter="bilinear")  # a filter with negative lobes could take from a bound
    for level in reversed(pyramid[:count]):
        nodes = _scene_of(scene, lit, level.level, level.means, 0, quality)
        rendering = yield from _drawn(nodes, quality)
        if not source.bounds_previews:
            yield Preview(rendering, level.level, None)
            continue
        beyond = np.pad(level.means[..., 3], 1)
        absorbs = np.maximum(beyond, np.float32(SMALLEST_SHARE) * level.errors)
        records = np.stack((level.errors, level.errors, level.errors, absorbs), axis=3)
        # Meshes only shorten the rays along which errors add up.
        unmeshed = replace(scene, triangles=None, ray_ends=None)
        misstated = yield from _drawn(_scene_of(unmeshed, lit, level.level, records, 1, of_errors), of_errors)
        yield Preview(rendering, level.level, _error_of(rendering.rgba, misstated.rgba[..., 0], level.brightest))


def _pyramid_steps(lit: LitVolume, levels, quality: Quality):
    """Generator: yields the fraction done; returns the Levels, finest first."""
    voxels = lit.classified.voxels
    write = lit.write_records("extinction")
    brightest = lit.color_bound
    if brightest is None:
        brightest = yield from brightest_steps(voxels, write)
    nodes = yield from node_steps(voxels, write, levels[0], brightest, quality.backend)
    pyramid = [_level_of(nodes, quality)]
    for _ in levels[1:]:
        yield 1.0
        nodes = nodes.coarser()
        pyramid.append(_level_of(nodes, quality))
    return pyramid


def _level_of(nodes: Nodes, quality: Quality) -> Level:
    return Level(nodes.level, nodes.means, node_errors(nodes, quality.backend), nodes.brightest)


def _drawn(scene: Scene, quality: Quality):
    """Generator: the steps of a picture that nobody waits for; returns its Rendering."""
    steps = render_steps(scene, quality, refuse_empty_view=False)
    return mapped(steps, lambda step: Progress(0.1, f"Previewing: {step.message}"))


def _error_of(rgba: np.ndarray, misstated: np.ndarray, brightest: float) -> np.ndarray:
    """(H, W) float32: a bound of any channel's error.

    Of two media along one ray, C_f - C_g = integral of T_g ((Q_f - Q_g) - (s_f - s_g) B_f) dt, where B_f is the color
    that f has behind, between nothing and the brightest.  So no channel differs by more than the integral of T_g
    times the largest difference of Q, or of what Q lacks to the brightest, or of s: ``misstated``.  Nor by more
    than there is room for beside the channel's own value.
    """
    red, green, blue, alpha = np.moveaxis(rgba, 2, 0)
    room = np.maximum(alpha, 1.0 - alpha)
    for channel in (red, green, blue):  # quicker than a maximum over so short an axis
        np.maximum(room, np.maximum(channel, np.float32(brightest) - channel), out=room)
    return np.minimum(misstated, room)


def _scene_of(scene: Scene, lit: LitVolume, level: int, records: np.ndarray, margin: int, quality: Quality) -> Scene:
    """The scene with nodes in place of its voxels; ``records``: (nz, ny, nx, 4), ``margin`` nodes of them outside."""
    classified, colors = classified_nodes([node_lists(records)], records.shape[2::-1], lit.classified)
    to_voxels = node_to_voxel(level)
    to_voxels[:3, 3] -= margin * 2**level
    planes = seen_planes(scene, scene.index_to_world @ to_voxels, classified.shape_xyz, quality)
    arguments = dict(backend=quality.backend, threads=quality.threads)
    axes = {
        axis: encode(classified, colors, axis, **arguments) for axis in sorted({plane.axis for plane in planes} or {0})
    }
    volume = StoredVolume.of(axes, scene.volume.affine @ to_voxels, scene.volume.unit, classified.unit_length)
    return replace(scene, volume=volume, lights=(), headlight=False, effects={})
