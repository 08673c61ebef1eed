"""The road itself: the stages of the paper in order, what each cost, and what is kept between frames.

    classify -> shade -> run length encoding -> sheet-buffer splatting -> warp
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np

from ..effects.analyse import EffectSet, analyse, called_for
from ..effects.camera_clip import is_cut
from ..effects.clips import NOTHING_LEFT, cuts_of
from ..effects.exposure import exposure_steps, exposures
from ..effects.far_layer import layers_to_splat, leave_out_like, mix_layers, take_like
from ..effects.mesh_occlusion import BEHIND, mesh_layers
from ..effects.mixing import BY_PRE, classified_by_pre, is_mixed
from ..effects.ray_values import mode_quality, mode_remarks, sheet_rule
from ..encode.scalars import ScalarVolume
from ..encode.store import StoredVolume
from ..encode.tables import TABLES, RunLengthVolume
from ..runtime.jit import NUMBA_PROBLEM, PLAIN_NUMBA, compiled, nothing_compiled_yet, noting_kernels, thread_count
from ..runtime.steps import Clock, Progress, portion, timed
from ..scene import NO_DEPTH, Quality, Rendering, RleSplatError, Scene
from ..splat.scratch import scratch_bytes
from ..splat.splat import LOADING
from ..view.base_plane import BasePlane, base_plane
from ..view.clip_limits import clip_limits, what_is_left
from ..view.eye import IndexView, index_view
from ..view.footprints import FOOTPRINTS
from ..view.principal_axis import axis_shares, candidate_pyramids
from ..view.ray_limits import box_depths, ray_limits, within_box
from ..volume.axes import AXES, AXIS_NAMES
from ..warp.warp import TAPS, warp, warp_reach
from .medium import Medium, classified_scene, medium_steps
from .memory_estimate import picture_bytes, refuse_too_large
from .pooled_medium import PooledVolume, pooled_medium_steps, pooled_scene
from .scalar_medium import scalar_medium_steps
from .single_rays import NO_PIXELS, steep_steps, traces_steep_pixels, with_neighbours
from .stage_cache import StageCache

LOADING_KERNELS = "Preparing kernels, which takes a while the first time"
COMPILING = "; compiling kernels, the first time only"

ONE_VOXEL_THICK = (
    "The volume is one voxel thick, and post-classified matter fills the space between voxel centres: nothing is "
    "shown; choose the classification pre."
)
ALL_TRANSPARENT = "The transfer function makes every voxel transparent, so the picture is empty."
EMPTY_REMARKS = (ONE_VOXEL_THICK, ALL_TRANSPARENT, NOTHING_LEFT)  # those that say why a picture is empty


def render(scene: Scene, quality: Quality | None = None, progress=None, cache: StageCache | None = None) -> Rendering:
    """The picture of a scene.

    ``progress``: called with a Progress now and then; an exception it raises stops the work.  ``cache``: a store
    that lets the next frame redo only what changed.  Raises RleSplatError with one sentence when the scene cannot
    be rendered.
    """
    steps = render_steps(scene, quality or Quality(), cache)
    while True:
        try:
            step = next(steps)
        except StopIteration as finished:
            return finished.value
        if progress is not None:
            progress(step)


def render_steps(scene: Scene, quality: Quality, cache: StageCache | None = None, *, refuse_empty_view: bool = True):
    """Generator form of ``render``: yields Progress, returns the Rendering.  Closing it cancels the work.

    Raises RleSplatError, caused by the MemoryError, when memory runs out half-way; ``cache`` is as it was before.
    ``refuse_empty_view``: raise when the camera sees nothing of the volume; else the picture is transparent, as
    an animation needs it.
    """
    kernels: set[str] = set()
    first_ever = compiled(quality.backend) and nothing_compiled_yet()
    steps = _road_steps(scene, quality, cache, refuse_empty_view)
    while True:
        try:
            with noting_kernels(kernels):
                step = next(steps)
        except StopIteration as finished:
            rendering = finished.value
            return replace(rendering, report={**rendering.report, "kernels": sorted(kernels)})
        except MemoryError as problem:
            told = f" ({problem})" if str(problem) else ""
            raise RleSplatError(
                f"Memory ran out half-way through the picture{told}; free some, or make the picture, the sheet density "
                "or the volume smaller."
            ) from problem
        yield replace(step, message=step.message + COMPILING) if first_ever and _has_work_ahead(step) else step


def _has_work_ahead(step: Progress) -> bool:
    """Whether what a step says is under way, and does not speak of kernels itself."""
    return step.fraction < 1.0 and step.message != LOADING_KERNELS


def _road_steps(scene: Scene, quality: Quality, cache: StageCache | None, refuse_empty_view: bool):
    """``render_steps`` but for the kernels that run, which are noted from outside."""
    quality = replace(quality, backend="numba" if compiled(quality.backend) else "numpy")
    if quality.classification == "post" and isinstance(scene.volume, StoredVolume):
        quality = quality.classified("pre")  # its voxels are classified already: a remark says so
    effects = analyse(scene, quality)
    left = called_for(scene, effects)
    if is_mixed(left):
        quality = classified_by_pre(quality)
        effects = analyse(scene, quality)
        left = called_for(scene, effects)
    scene = left
    pictures = exposures(scene)
    if cache is None:  # the pictures of a blur have most stages in common
        cache = StageCache(0) if len(pictures) == 1 else StageCache()
    refuse = refuse_empty_view and not scene.motion  # what moves may come into view

    def sharp_steps(one):
        return _sharp_steps(one, quality, cache, effects, refuse)

    if len(pictures) > 1:
        return (yield from exposure_steps(scene, pictures, sharp_steps))
    return (yield from sharp_steps(scene))


def _sharp_steps(scene: Scene, quality: Quality, cache: StageCache, effects: EffectSet, refuse_empty_view: bool):
    """``render_steps`` of a scene without a lens and a shutter, and without the effects that are off."""
    clock = Clock()
    asked, quality, wanted = quality, mode_quality(scene, quality), scene
    traced = traces_steep_pixels(scene, quality)
    if traced:
        scene = with_neighbours(scene)
    shape_xyz, scene = scene.volume.shape_xyz, classified_scene(scene, quality)
    view, fades = _look(scene, quality, refuse_empty_view)
    if quality.minification == "pool":
        scene = pooled_scene(scene, _planes_of(fades))
        view, fades = _look(scene, quality, refuse_empty_view)
    fades = [fade.window(scene, quality) for fade in fades]
    planes = _planes_of(fades)

    cuts = cuts_of(scene, quality)
    limited = is_cut(scene, view, quality) or scene.triangles is not None or quality.classification == "refined"
    limited |= cuts is not None
    left, top, right, bottom = scene.region
    scratch = max((scratch_bytes(plane, scene.volume.shape_xyz, quality, limited) for plane in planes), default=0)
    meshes = scene.triangles is not None and len(scene.triangles) > 0
    picture = picture_bytes(
        planes, right - left, bottom - top, quality, limited=limited, meshes=meshes, scratch=scratch, traced=traced
    )
    cache.make_room(picture)
    refuse_too_large(picture, right - left, bottom - top)

    job, axes = cache.job(), tuple(dict.fromkeys(plane.axis for plane in planes))
    make_medium = scalar_medium_steps if quality.classification == "post" else medium_steps
    make_medium = pooled_medium_steps if isinstance(scene.volume, PooledVolume) else make_medium
    medium = yield from make_medium(scene, quality, job, clock, len(axes), picture)
    encodings: dict[int, RunLengthVolume | ScalarVolume] = {}
    for axis in axes:
        encodings[axis] = yield from portion(medium.encode_steps(axis), 0.1, 0.2, "Encoding")
    held = dict(scene.volume.axes) if isinstance(scene.volume, StoredVolume) else encodings

    layers = None
    if effects["mesh occlusion"].on:
        with clock.stage("occlusion"):
            layers = mesh_layers(scene, view, quality, planes)
        if layers is None:
            effects = effects.found_off("mesh occlusion", BEHIND)
    rgba = depth = None
    for n, fade in enumerate(fades):
        told = 0.2 + 0.75 * n / len(fades), 0.75 / len(fades)
        stage = (encodings, medium, layers, cuts, clock, told)
        found = yield from _splat_and_warp(scene, quality, view, fade.planes, *stage)
        rgba, depth = fade.mixed(rgba, depth, *found)
    rays = NO_PIXELS
    if traced:
        steps = timed(steep_steps(scene, wanted.region, view, medium, quality, rgba, depth), clock, "rays")
        rgba, depth, rays = yield from portion(steps, 0.95, 0.99, "Following single rays")

    report = {
        "image": _image_report(wanted),
        "volume": _volume_report(shape_xyz, medium),
        "stages_ms": clock.report(),
        "memory_bytes": _memory_report(held),
        "memory_estimate_bytes": None if medium.estimate is None else medium.estimate.report(),
        "plan": _plan_report(scene, quality, fades),
        "rays": dict(rays),
        "effects": effects.report(clock),
        "error": {
            "tolerance": None, "predicted": None, "measured": None, "truth": truth_of(quality), "probes": 0,
        },
        "threads": thread_count(quality.threads) if quality.backend == "numba" else 1,
        "remarks": [*_remarks(scene, quality, medium, view), *mode_remarks(scene, asked)],
    }
    if cuts is not None and medium.visible_voxels and not rgba[..., 3].any():
        report["remarks"].append(NOTHING_LEFT)
    job.keep()
    yield Progress(1.0, "Done")
    return Rendering(rgba, depth, report)


# --- the stages -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Fade:
    """Base planes that show all of the picture together, and their share of it: 1 but where principal axes fade."""

    planes: list[BasePlane]
    share: float = 1.0

    def window(self, scene: Scene, quality: Quality) -> Fade:
        """The parts that the wanted pixels need."""
        if scene.crop is None:
            return self
        windows = [plane.window(scene.crop, warp_reach(quality)) for plane in self.planes]
        return replace(self, planes=[window for window in windows if window is not None])

    def mixed(self, rgba, depth, found, found_depth):
        """The picture and its depth with this part of them, ``found``; None and None before the first, whose depths
        count."""
        if self.share == 1.0:
            return found, found_depth
        found *= np.float32(self.share)
        return (found, found_depth) if rgba is None else (np.add(rgba, found, out=rgba), depth)


def _planes_of(fades: list[Fade]) -> list[BasePlane]:
    return [plane for fade in fades for plane in fade.planes]


def _look(scene: Scene, quality: Quality, refuse_empty_view: bool) -> tuple[IndexView, list[Fade]]:
    """The view, and the base planes that its rays belong to."""
    view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    boxed = quality.classification == "post"
    footprint = FOOTPRINTS[quality.kernel]
    nearest, furthest = box_depths(view, scene.volume.shape_xyz, 0.0 if boxed else footprint.radius)
    rule = sheet_rule(scene, quality)

    def planes_of(*pyramids):
        if not (furthest > scene.camera.clip_start and nearest < scene.camera.clip_end):
            return []
        knobs = (rule, quality.sheet_density, footprint, boxed, warp_reach(quality))
        planes = [base_plane(view, scene.volume.shape_xyz, *pyramid, *knobs) for pyramid in pyramids]
        return [plane for plane in planes if plane is not None]

    if view.is_parallel:
        held = scene.volume.axes if isinstance(scene.volume, StoredVolume) else AXES
        (first, *others) = axis_shares(view, quality.axis_fade)
        shares = [first, *(other for other in others if other[0] in held)]
        fades = [Fade(planes_of(pyramid), share) for *pyramid, share in shares]
        shown = sum(fade.share for fade in fades if fade.planes)
        fades = [replace(fade, share=fade.share / shown) for fade in fades if fade.planes] or [Fade([])]
    else:
        fades = [Fade(planes_of(*candidate_pyramids(view)))]
    if not fades[0].planes and refuse_empty_view:
        raise RleSplatError(
            "The camera does not see the volume; point it at the volume, or move the volume between its clip distances."
        )
    return view, fades


def _splat_and_warp(scene, quality, view, planes, encodings, medium: Medium, layers, cuts, clock: Clock, told):
    """Generator: splats every base plane, what lies behind silhouettes of meshes too, and warps; returns rgba and
    depth.  ``told``: how much is done before, and by it."""
    camera_cuts = is_cut(scene, view, quality)
    boxed = quality.classification == "refined"
    most_color = max(medium.most_color(encodings.values()), *(scene.mist.color if scene.mist else (0.0,)))
    looks = [(None, scene.region, list(enumerate(planes)))]
    if layers is not None:
        looks = layers_to_splat(layers, scene.region, planes, warp_reach(quality))
    parts, done = max(sum(len(of_look) for _, _, of_look in looks), 1), 0
    rgba = depth = None
    near = {}  # of each base plane before silhouettes: itself, where its rays end, its image
    for layer, region, of_look in looks:
        images = []
        for n, plane in of_look:
            limits = like = None
            if camera_cuts or layers is not None:
                with clock.stage("clipping" if layers is None else "occlusion"):
                    limits = ray_limits(
                        plane, scene.camera.clip_start, scene.camera.clip_end, layer,
                        (0, 0) if layers is None else layers.first_pixel,
                        backend=quality.backend, threads=quality.threads,
                    )
            if boxed:
                limits = within_box(plane, scene.volume.shape_xyz, limits)
            ends, whole = limits, plane
            if n in near:
                with clock.stage("occlusion"):
                    like = leave_out_like(plane, limits, *near[n][:2])
            if cuts is not None:
                with clock.stage("clip objects"):
                    limits = clip_limits(plane, cuts, limits, quality.backend, quality.threads)
                    left = (plane, limits) if like is not None else what_is_left(
                        plane, limits, warp_reach(quality) + TAPS
                    )
                if left is None:
                    near[n], done = (whole, ends, None), done + 1
                    continue
                plane, limits = left
            steps = medium.splat_steps(encodings[plane.axis], plane, limits)
            stage, message, part = "splat", "Splatting", 0.0
            while True:
                try:
                    with clock.stage(stage):
                        step = next(steps)
                except StopIteration as finished:
                    images.append(finished.value)
                    break
                loading = step is LOADING
                stage, message = ("kernels", LOADING_KERNELS) if loading else ("splat", "Splatting")
                part = part if loading else step
                yield Progress(told[0] + told[1] * (done + part) / parts, message)
            done += 1
            if like is None:
                near[n] = whole, ends, images[-1]
            else:
                with clock.stage("occlusion"):
                    take_like(images[-1], near[n][2], like)
        with clock.stage("warp"):
            found = warp(images, view, region, quality, most_color)
            found = found if medium.picture is None else medium.picture(*found)
            if rgba is None:
                rgba, depth = found
            else:
                mix_layers(layers, scene.region, region, rgba, depth, *found)
    if camera_cuts or layers is not None or cuts is not None:
        depth = _within_clip(depth, scene.camera)
    return rgba, depth


def _within_clip(depth: np.ndarray, camera) -> np.ndarray:
    """A pixel's depth is that of the nearest sheet pixel's ray, which meets the clip planes elsewhere: held to them."""
    largest = float(np.finfo(np.float32).max)
    held = np.clip(depth, min(camera.clip_start, largest), min(camera.clip_end, largest))
    return np.where(depth == np.float32(NO_DEPTH), depth, held)


# --- the report -----------------------------------------------------------------------------------------------


def _image_report(scene: Scene) -> dict:
    left, top, right, bottom = scene.region
    size = {"width": right - left, "height": bottom - top}
    if scene.crop is None:
        return size
    return {**size, "full_width": scene.width, "full_height": scene.height, "crop": list(scene.crop)}


def truth_of(quality: Quality) -> str:
    """The truth that a picture's errors are against: of the classified medium for pre, else of the scalar's."""
    return "T1" if quality.classification == "pre" else "T2"


def _volume_report(shape_xyz, medium: Medium) -> dict:
    """``shape_xyz``: of the volume itself; the voxels that are visible are those of the grid that is classified."""
    total = int(np.prod([int(n) for n in medium.shape_xyz]))
    return {
        "shape_xyz": [int(n) for n in shape_xyz],
        "visible_voxels": medium.visible_voxels,
        "visible_fraction": medium.visible_voxels / total,
        "nan_voxels": medium.nan_voxels,
    }


def _memory_report(held: dict[int, RunLengthVolume | ScalarVolume]) -> dict:
    tables = (*TABLES, "scanline_data_pointers")
    return {
        **{name: sum(encoded.table_bytes[name] for encoded in held.values()) for name in tables},
        "total": sum(encoded.nbytes for encoded in held.values()),
        "axes_held": [AXIS_NAMES[axis] for axis in sorted(held)],
    }


def _plan_report(scene: Scene, quality: Quality, fades: list[Fade]) -> dict:
    knobs = asdict(quality)
    knobs["quality"] = knobs.pop("name")
    knobs["pooled"] = 2**scene.volume.level if isinstance(scene.volume, PooledVolume) else 1
    knobs["base_planes"] = [
        {
            "principal_axis": ("+" if plane.sign > 0 else "-") + AXIS_NAMES[plane.axis],
            "sheets": len(plane.sheets), "width": plane.width, "height": plane.height, "share": fade.share,
        }
        for fade in fades for plane in fade.planes
    ]
    return knobs


def _remarks(scene: Scene, quality: Quality, medium: Medium, view: IndexView) -> list[str]:
    remarks = list(scene.volume.remarks)
    if is_mixed(scene):
        remarks.append(BY_PRE)
    if isinstance(scene.volume, StoredVolume) and quality.classification == "pre":
        remarks.append("A .rle file holds voxels that are classified already, so they are splatted as they are: pre.")
    if quality.classification == "post" and min(scene.volume.shape_xyz) == 1:
        remarks.append(ONE_VOXEL_THICK)
    elif medium.visible_voxels == 0:
        remarks.append(ALL_TRANSPARENT)
    furthest = box_depths(view, scene.volume.shape_xyz)[1]
    if furthest >= NO_DEPTH:
        remarks.append(
            f"The volume reaches {furthest:.3g} world units from the camera, and depths of {NO_DEPTH:g} or more stand "
            "for none; give the scene a smaller scale where depths are wanted."
        )
    if medium.nan_voxels:
        remarks.append(f"{medium.nan_voxels} voxels are not numbers (NaN) and were left transparent.")
    if quality.backend == "numpy":
        reason = f" ({NUMBA_PROBLEM})" if NUMBA_PROBLEM else ""
        remarks.append(f"Rendered without compiled kernels{reason}: slow, but the same picture.")
    elif PLAIN_NUMBA:
        remarks.append(
            f"{PLAIN_NUMBA}: kernels run on one thread and are not kept on disk, so each session compiles them again."
        )
    return remarks
