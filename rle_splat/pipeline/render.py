"""The road of a picture: the stages of the paper, in order.

    source -> plan -> view -> classify -> shade -> encode -> splat -> warp -> rays -> report

The paper (Zhang, Sun and Sun, "Accelerate Volume Splatting by Using Run Length Encoding", 2003) classifies and shades
the voxels of a scan, encodes the visible ones by their run lengths, and splats them sheet by sheet, front to back.

Here a sheet is parallel to the slices of the volume, on a *base plane* in voxel indices, and a *warp* makes the picture
of it.  Before the paper's steps, the *source* says what the volume is, and the *plan* how finely it is drawn.  After
them, *rays* integrate single pixels again where sheets and warp err most.  A *medium* is what is splatted: voxels with
extinction and color ("pre", as in the paper), or voxels with their scalar, which is classified where a sheet
interpolates it ("post", the default).

A stage that takes long is a generator of steps, so that whoever asks for the picture can show how far it is, and can
cancel it by closing the generator.  Each is timed by a Clock.  A StageCache keeps what the stages make, up to the
tables, under all that it was made from: a frame makes that anew which changed, and splats.
"""

from __future__ import annotations

from dataclasses import replace

from ..effects.exposure import exposure_steps, list_exposures
from ..runtime.steps import Clock, Progress, announce, drain
from ..scene import Quality, Rendering, Scene
from ..warp.warp import warp_steps
from .choose_source import choose_source
from .medium import Medium
from .picture import Picture, begin_picture
from .preset_plan import choose_plan
from .report import make_report
from .single_rays import retrace_steps
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
    animation needs it.  Raises RleSplatError, caused by the MemoryError, when memory runs out half-way; nothing
    half-made stays in ``cache``.
    """
    clock = Clock()
    steps = _average_steps(scene, quality, cache, refuse_empty_view, clock)
    rendering, kernels = yield from watch_steps(steps, scene, clock)
    return replace(rendering, report={**rendering.report, "kernels": kernels})


def _average_steps(scene: Scene, quality: Quality, cache: StageCache | None, refuse_empty_view: bool, clock: Clock):
    """Generator of Progress: choose source and plan, and render the mean of the scene's sharp pictures.

    There is one sharp picture, unless depth of field or motion blurs the scene.
    """
    # Source: what the volume is (a scan, a scan with labels or channels, or stored tables), whether its voxels are
    # classified before they are interpolated, as in the paper, or afterwards, and which effects the scene has.
    source = choose_source(scene, quality)
    scenes = list_exposures(source.scene)
    if cache is None:
        cache = StageCache() if len(scenes) > 1 else StageCache(0)  # sharp pictures have most stages in common
    # Plan: sheets per voxel, the pixels of a sheet, the filter of the warp, where opaque rays end, and where single
    # rays replace the sheets. A preset of quality takes the cheapest plan that is expected to keep its error.
    with clock.stage("plan"):
        source = choose_plan(source, cache)
    refuse = refuse_empty_view and not source.scene.motion  # what moves may come into view

    def sharp_steps(sharp: Scene):
        return _sharp_steps(replace(source, scene=sharp), cache, refuse, clock)

    return (yield from exposure_steps(source.scene, scenes, sharp_steps))


def _sharp_steps(source: Source, cache: StageCache, refuse_empty_view: bool, clock: Clock):
    """Generator of Progress: the stages of one sharp picture, in the paper's order; returns its Rendering."""
    # View: the principal axis that the camera looks along, the base plane and where its sheets lie.  It comes first,
    # since voxels are encoded along that axis, and since the picture's pixels may need more memory than there is.
    picture = begin_picture(source, cache, refuse_empty_view, clock)
    # Classify: which voxels the transfer function shows, and by how much they absorb and in which color; for "post",
    # which voxels can matter.
    voxels = yield from picture.source.classify_steps(picture.work)
    # Shade: normals from the gradient, and the light that reaches each voxel ("pre" multiplies both as it encodes).
    medium = yield from picture.source.shade_steps(voxels, picture.work)
    # Encode: the paper's tables of runs, pointers and voxel records, along each principal axis that the view needs.
    tables = yield from medium.encode_steps(picture.view.axes)
    # Splat on to the base planes, sheet by sheet, front to back, adding the footprints within a sheet, until pixels are
    # opaque; warp the base planes to the picture.
    rgba, depth = yield from splat_and_warp_steps(picture, medium, tables)
    # Rays: where the plan asks for it, the pixels that differ most from their neighbors are integrated one by one.  A
    # crop has been splatted with its neighbors then, and is cut out here.
    seen = picture.wanted.region, picture.view.index_view
    rgba, depth, traced = yield from retrace_steps(picture.source, *seen, medium, rgba, depth, clock)
    # Glass of the scene tints what is seen through it.
    rgba = picture.ray_effects.tint(rgba, depth, picture.wanted.region[:2])
    # Report: what was made, how, and in which time.  The stage cache takes what was made, now that all of it is.
    report = make_report(picture, medium, tables, (rgba, depth), traced)
    picture.work.job.keep()
    yield Progress(1.0, "Done")
    return Rendering(rgba, depth, report)


def splat_and_warp_steps(picture: Picture, medium: Medium, tables: dict):
    """Generator of Progress: splat and warp each part of the view; returns (rgba, depth).

    There is one part, unless a parallel view lies between two or three principal axes: then these are blended.
    """
    picture.ray_effects.leave_out_idle(picture.view.planes)  # such as a mesh that is behind the whole volume
    fades, blended = picture.view.fades, None
    for n, fade in enumerate(fades):
        begin, share = 0.2 + 0.75 * n / len(fades), 0.75 / len(fades)
        found = yield from _splat_fade_steps(picture, medium, tables, fade, begin, share)
        blended = fade.add_to(blended, found)
    return blended


def _splat_fade_steps(picture: Picture, medium: Medium, tables: dict, fade: Fade, begin: float, share: float):
    """Generator of Progress: splat the base planes of a part of the view and warp them; returns (rgba, depth).

    Rays may begin and end inside the volume (clip distances, meshes, clip objects): ``intervals`` says where.
    Silhouettes of meshes, behind which a pixel shows more of the volume, take a second pass; ``complete`` copies what
    both have in common, and ``mix`` puts them together.  ``begin``, ``share``: how much of the work is done before, and
    how much this is.
    """
    effects, clock, largest = picture.ray_effects, picture.work.clock, medium.most_color(tables.values())
    passes = effects.passes(fade.planes)
    count, done = max(sum(len(one.planes) for one in passes), 1), 0
    mixed = None
    for ray_pass in passes:
        images = []
        for number, plane in ray_pass.planes:
            shortened = effects.intervals(ray_pass, number, plane)
            if shortened is not None:
                plane, intervals = shortened
                steps = medium.splat_steps(tables.get(plane.axis), plane, intervals)
                image = yield from watch_splat_steps(steps, clock, begin + share * done / count, share / count)
                images.append(effects.complete(ray_pass, number, image))
            done += 1
        # ``largest``: what no color exceeds, for filters that overshoot.
        steps = warp_steps(images, picture.view.index_view, ray_pass.region, picture.source.quality, largest)
        at = begin + share * done / count
        with clock.stage("warp"):  # ``finish`` colors pictures of values (MIP and the like)
            found = yield from announce(steps, at, at, "Warping")
            mixed = effects.mix(ray_pass, mixed, medium.finish(*found))
    rgba, depth = mixed
    return rgba, effects.clamp_to_clip(depth)
