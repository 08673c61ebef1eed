"""The road of a picture: the stages of the paper, in order.

    source -> plan -> view -> classify -> shade -> encode -> splat -> warp -> rays -> report

The paper (Zhang, Sun and Sun, "Accelerate Volume Splatting by Using Run Length Encoding", 2003) classifies and shades
the voxels of a scan, encodes the visible ones by their run lengths, and splats them sheet by sheet, front to back.

Here a sheet is parallel to the slices of the volume, on a *base plane* in voxel indices, and a *warp* makes the picture
of it (algorithm.md 1.3).  Before the paper's steps, the *source* says what the volume is, and the *plan* how finely it
is drawn.  After them, *rays* integrate single pixels again where sheets and warp err most.  What is classified and lit
is a *medium*: voxels with extinction and color, as in the paper, or voxels with their scalar, which is classified where
a sheet interpolates it.

Each stage is a generator of Progress, so that whoever asks for the picture can show how far it is, and can cancel it by
closing the generator.  Each is timed by a Clock, and what it makes is kept in a StageCache under all that it was made
from: a frame makes anew only what changed.
"""

from __future__ import annotations

from dataclasses import replace

from ..effects.exposure import exposure_steps, list_exposures
from ..runtime.steps import Clock, Progress, drain, portion, time_steps, within
from ..scene import Quality, Rendering, Scene
from ..warp.warp import warp_steps
from .choose_source import choose_source
from .medium import Medium
from .picture import Picture, begin_picture
from .preset_plan import choose_plan
from .report import make_report
from .single_rays import NO_PIXELS, steep_steps, traces_steep_pixels
from .source import Source
from .stage_cache import StageCache
from .views import Fade
from .watch_steps import watch_splat_steps, watch_steps


def render(scene: Scene, quality: Quality | None = None, progress=None, cache: StageCache | None = None) -> Rendering:
    """Render a scene.

    Parameters
    ----------
    scene : Scene
    quality : Quality, optional
        Left out, the quality "standard".
    progress : callable, optional
        Called with a Progress now and then; an exception that it raises stops the work.
    cache : StageCache, optional
        Results of stages, kept so that the next frame redoes only what changed.

    Returns
    -------
    Rendering
        The picture, scene-linear and premultiplied, its depth and its report.

    Raises
    ------
    RleSplatError
        With one sentence, where the scene cannot be rendered.
    """
    steps = render_steps(scene, quality or Quality(), cache)
    return drain(steps, progress)


def render_steps(scene: Scene, quality: Quality, cache: StageCache | None = None, *, refuse_empty_view: bool = True):
    """Generator form of ``render``: yields Progress, returns the Rendering; closing it cancels the work.

    ``refuse_empty_view``: raise when the camera sees nothing of the volume; else the picture is transparent, as an
    animation needs it.  Raises RleSplatError, caused by the MemoryError, when memory runs out half-way; ``cache`` is
    as it was before.
    """
    steps = _expose_steps(scene, quality, cache, refuse_empty_view)
    rendering, kernels = yield from watch_steps(steps, scene, quality)
    return replace(rendering, report={**rendering.report, "kernels": kernels})


def _expose_steps(scene: Scene, quality: Quality, cache: StageCache | None, refuse_empty_view: bool):
    """Generator of Progress: choose source and plan, and render the mean of the scene's sharp pictures.

    There is one sharp picture, unless depth of field or motion blurs the scene.
    """
    clock = Clock()
    kept = StageCache(0) if cache is None else cache
    with clock.running():
        # Source: what the volume is (a scan, a scan with labels or channels, or stored tables), whether its voxels are
        # classified before they are interpolated, as in the paper, or afterwards, and which effects the scene has.
        source = choose_source(scene, quality)
        # Plan: how many sheets a voxel has, by which filters they are resampled, and where single rays replace them.
        # A preset of quality takes the cheapest plan that is expected to keep its error.
        with clock.stage("plan"):
            source = choose_plan(source, kept)
        pictures = list_exposures(source.scene)
        if cache is None and len(pictures) > 1:  # the pictures of a blur have most stages in common
            kept = StageCache()
    refuse = refuse_empty_view and not source.scene.motion  # what moves may come into view

    def sharp_steps(sharp: Scene):
        nonlocal clock
        own, clock = clock or Clock(), None  # that of the first picture has counted the choices, too
        steps = _sharp_steps(replace(source, scene=sharp), kept, refuse, own)
        return within(steps, own.running)

    return exposure_steps(source.scene, pictures, sharp_steps)


def _sharp_steps(source: Source, cache: StageCache, refuse_empty_view: bool, clock: Clock):
    """Generator of Progress: the stages of one sharp picture, in the paper's order; returns its Rendering."""
    # View: the principal axis that the camera looks along, the base plane and where its sheets lie.  It comes first,
    # since voxels are encoded along that axis, and since the picture's pixels may need more memory than there is.
    picture = begin_picture(source, cache, refuse_empty_view, clock)
    # Classify: which voxels the transfer function shows, and by how much they absorb and in which color.
    voxels = yield from picture.source.classify_steps(picture.work)
    # Shade: normals from the gradient, and the light that reaches each voxel.
    medium = yield from picture.source.shade_steps(voxels, picture.work)
    # Encode: the paper's tables of runs, pointers and voxel records, along each principal axis of the view.
    tables = yield from encode_steps(picture, medium)
    # Splat, sheet by sheet on to the base planes, and warp these to the picture.
    rgba, depth = yield from splat_and_warp_steps(picture, medium, tables)
    # Rays: pixels where neighbors differ most are integrated again, one by one.
    rgba, depth, traced = yield from ray_steps(picture, medium, rgba, depth)
    # Report: what was made, how, and in which time.
    report = make_report(picture, medium, tables, (rgba, depth), traced)
    yield Progress(1.0, "Done")
    return Rendering(rgba, depth, report)


def encode_steps(picture: Picture, medium: Medium):
    """Generator of Progress: encode the medium along the principal axes of a picture; returns axis -> tables."""
    tables = {}
    for axis in picture.view.axes:
        tables[axis] = yield from portion(medium.encode_steps(axis), 0.1, 0.2, "Encoding")
    return tables


def splat_and_warp_steps(picture: Picture, medium: Medium, tables: dict):
    """Generator of Progress: splat and warp each part of the view; returns (rgba, depth).

    There is one part, unless the camera turns from one principal axis to another: then both fade into each other.
    """
    rays, fades = picture.rays, picture.view.fades  # rays: the effects that end rays, such as clip distances
    rays.inspect(picture.view.planes)
    mixed = None
    for n, fade in enumerate(fades):
        span = 0.2 + 0.75 * n / len(fades), 0.75 / len(fades)
        mixed = fade.mixed(mixed, (yield from _fade_steps(picture, medium, tables, fade, span)))
    return mixed


def _fade_steps(picture: Picture, medium: Medium, tables: dict, fade: Fade, span):
    """Generator of Progress: splat the base planes of a part of the view and warp them; returns (rgba, depth).

    Effects that end rays inside the volume (clip distances, meshes, clip objects) may take several passes over them.
    ``span``: how much of the work is done before, and how much this is.
    """
    rays, clock, most_color = picture.rays, picture.work.clock, medium.most_color(tables.values())
    passes = rays.passes(fade.planes)
    parts, done = max(sum(len(one.planes) for one in passes), 1), 0
    mixed = None
    for ray_pass in passes:
        images = []
        for number, whole in ray_pass.planes:
            left = rays.intervals(ray_pass, number, whole)
            if left is not None:
                plane, intervals = left
                steps = medium.splat_steps(tables.get(plane.axis), plane, intervals)
                image = yield from watch_splat_steps(steps, clock, span[0] + span[1] * done / parts, span[1] / parts)
                images.append(rays.drawn(ray_pass, number, image))
            done += 1
        steps = warp_steps(images, picture.view.index_view, ray_pass.region, picture.source.quality, most_color)
        at = span[0] + span[1] * done / parts
        found = yield from portion(time_steps(steps, clock, "warp"), at, at, "Warping")
        with clock.stage("warp"):
            mixed = rays.mixed(ray_pass, mixed, medium.finish(*found))
    rgba, depth = mixed
    return rgba, rays.within_clip(depth)


def ray_steps(picture: Picture, medium: Medium, rgba, depth):
    """Generator of Progress: integrate steep pixels by single rays; returns rgba, depth and the report's ``rays``."""
    if not traces_steep_pixels(picture.source):
        return rgba, depth, NO_PIXELS
    steps = steep_steps(picture.source, picture.wanted.region, picture.view.index_view, medium, rgba, depth)
    return (yield from portion(time_steps(steps, picture.work.clock, "rays"), 0.95, 0.99, "Following single rays"))
