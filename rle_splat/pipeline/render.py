"""The road of a picture, stage by stage; those with a star are the paper's.

    source      what the volume is (a scan, with labels or channels, or stored tables), and which effects the scene has
    plan        how finely it is drawn
    view        the principal axis, and where the sheets lie: before the voxels, since they are encoded along that axis
    classify *  which voxels the transfer function shows
    shade *     their normals, and the light that reaches them
    encode *    runs, pointers and records of those voxels
    splat *     the sheets, front to back
    warp        sheets to pixels of the picture
    rays        pixels that differ most from their neighbors, integrated again one by one, where sheets and warp err
    report      what was made, how, and in which time

The paper (Zhang, Sun and Sun, "Accelerate Volume Splatting by Using Run Length Encoding", 2003) encodes a volume along
all three axes once, and splats on to sheets that are parallel to its slices.  Here, only the axes that a view needs are
encoded, which takes less memory.  The sheets lie on a *base plane* in voxel indices, where the scanlines of voxels and
of sheets are parallel for every camera, and a *warp* makes the picture of them.

Voxels are classified "pre", before they are interpolated, as in the paper: a record holds extinction and lit color.  Or
"post", the default, which costs more for each sample and keeps the edges of the transfer function: a record holds the
scalar, and codes of the normal and of the light that arrives; a sheet interpolates, classifies and lights them.  What
is splatted, of either kind, is a *medium*.

Channels of microscopy that are not lit have a picture each, which add up.  A blurred scene is the mean of several sharp
pictures.  A sharp picture is a sum of *fades*: one, unless a parallel view lies between principal axes.  A fade has
*passes*: one, unless meshes hide parts of pixels.  A pass has base planes: one, unless the rays of a perspective view
belong to several axes.  A base plane has sheets.

A stage that takes long is a generator of steps, so that whoever asks for the picture can show how far it is, and can
cancel it by closing the generator.  Each stage is timed, here or in its own module.  A StageCache keeps what the
stages up to the tables make, by what they were made from: the next frame makes only what depends on a change, and
splats.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import replace

from ..effects.exposure import exposure_steps, list_exposures
from ..effects.mixing import add_light_steps, split_light
from ..runtime.steps import Clock, Progress, announce, drain
from ..scene import Quality, QualityName, Rendering, Scene, as_quality
from ..volume.volume import key_steps
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

BEFORE, SPLATS = 0.2, 0.75  # parts of the work, as it is shown: before the splats; splats and warps


def render(
    scene: Scene,
    quality: Quality | QualityName | None = None,
    progress: Callable[[Progress], object] | None = None,
    *,
    cache: StageCache | None = None,
) -> Rendering:
    """Render a scene.

    Parameters
    ----------
    scene : Scene
        What the picture depends on.
    quality : Quality or str, optional
        The settings, or the name of a preset: "draft", "standard", "fine" or "strict". Left out, "standard".
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
    return drain(render_steps(scene, quality, cache=cache), progress)


def render_steps(
    scene: Scene,
    quality: Quality | QualityName | None = None,
    *,
    cache: StageCache | None = None,
    refuse_empty_view: bool = True,
) -> Generator[Progress, None, Rendering]:
    """Generator form of ``render``: yields Progress, returns the Rendering; closing it cancels the work.

    ``refuse_empty_view``: raise when the camera sees nothing of the volume; else the picture is transparent, as an
    animation needs it.  Raises RleSplatError, caused by the MemoryError, when memory runs out half-way; nothing
    half-made stays in ``cache``.
    """
    quality = as_quality(quality)
    clock = Clock()
    steps = add_light_steps(
        scene, split_light(scene), lambda one: _average_steps(one, quality, cache, refuse_empty_view, clock)
    )
    rendering, kernels = yield from watch_steps(steps, scene, clock)
    return replace(rendering, report={**rendering.report, "kernels": kernels})


def _average_steps(scene: Scene, quality: Quality, cache: StageCache | None, refuse_empty_view: bool, clock: Clock):
    """Generator of Progress: choose source and plan, and render the mean of the scene's sharp pictures.

    There is one sharp picture, unless depth of field or motion blurs the scene.
    """
    # Source: what the volume is, whether its voxels are classified before or after interpolation, and the effects.
    source = choose_source(scene, quality)
    scenes = list_exposures(source.scene)
    if cache is None:
        # Sharp pictures of one scene have most stages in common; one alone needs nothing to be kept.
        cache = StageCache() if len(scenes) > 1 else StageCache(0)
    if cache.keeps and scene.volume.holds_values:  # keys of results hold that of the voxels
        yield from announce(key_steps(scene.volume), 0.0, 0.0, "Looking through the voxels")
    # Plan: sheets per voxel, the pixels of a sheet, the filter of the warp, where opaque rays end, and how many pixels
    # are single rays. A preset takes the cheapest plan that is expected to keep its error. The source has it then.
    with clock.stage("plan"):
        source = choose_plan(source, cache)
    refuse = refuse_empty_view and not source.scene.motion  # what moves may come into view

    def sharp_steps(sharp: Scene):
        return _sharp_steps(replace(source, scene=sharp), cache, refuse, clock)

    return (yield from exposure_steps(source.scene, scenes, sharp_steps))


def _sharp_steps(source: Source, cache: StageCache, refuse_empty_view: bool, clock: Clock):
    """Generator of Progress: the stages of one sharp picture; returns its Rendering."""
    # View: the principal axis that the camera looks along, the base planes and where their sheets lie; RleSplatError
    # where the pixels alone need more memory than there is.  The picture's source may have more pixels than are wanted.
    picture = begin_picture(source, cache, refuse_empty_view, clock)
    # Classify: which voxels the transfer function shows, and by how much they absorb and in which color; for "post",
    # which voxels can matter.
    voxels = yield from picture.source.classify_steps(picture.work)
    # Shade: normals from the gradient, and the light that reaches each voxel.  "pre" multiplies it into the color as it
    # encodes, "post" in the splat.
    medium = yield from picture.source.shade_steps(voxels, picture.work)
    # Encode: the paper's tables of runs, pointers and voxel records, along each principal axis that the view needs.
    tables = yield from medium.encode_steps(picture.view.axes)
    # Splat on to the base planes, sheet by sheet, front to back, adding the footprints within a sheet, until pixels are
    # opaque; warp the base planes to the picture.
    rgba, depth = yield from splat_and_warp_steps(picture, medium, tables)
    # Rays: where the plan asks for it, the pixels that differ most from their neighbors are integrated one by one.  For
    # that, a crop has been splatted with its neighbors; the wanted pixels are cut out here.
    rgba, depth, traced = yield from retrace_steps(
        picture.source, picture.wanted.region, picture.view.index_view, medium, picture.ray_effects, rgba, depth, clock
    )
    # Glass of the scene tints what is seen through it.
    rgba = picture.ray_effects.tint(rgba, depth, picture.wanted.region[:2])
    # Report: what was made, how, and in which time.  The stage cache takes what was made, now that all of it is.
    report = make_report(picture, medium, tables, (rgba, depth), traced)
    picture.work.job.keep()
    yield Progress(1.0, "Done")
    return Rendering(rgba, depth, report)


def splat_and_warp_steps(picture: Picture, medium: Medium, tables: dict):
    """Generator of Progress: splat and warp each fade of the view and blend them; returns (rgba, depth)."""
    # Such as a mesh that is behind the whole volume.
    yield from announce(picture.ray_effects.leave_out_idle_steps(picture.view.planes), BEFORE, BEFORE, "Splatting")
    fades, blended = picture.view.fades, None
    for n, fade in enumerate(fades):
        begin, share = BEFORE + SPLATS * n / len(fades), SPLATS / len(fades)
        found = yield from _splat_fade_steps(picture, medium, tables, fade, begin, share)
        blended = fade.add_to(blended, found)
    return blended


def _splat_fade_steps(picture: Picture, medium: Medium, tables: dict, fade: Fade, begin: float, share: float):
    """Generator of Progress: splat the base planes of a fade and warp them; returns (rgba, depth).

    Rays may begin and end inside the volume (clip distances, meshes, clip objects): ``intervals`` says where.
    Silhouettes of meshes, behind which a pixel shows more of the volume, take a second pass; ``complete`` copies what
    both have in common, and ``mix`` puts them together.  A fade without base planes, which sees nothing, has one pass,
    whose picture is transparent.  ``begin``, ``share``: how much of the work is done before, and how much this is.
    """
    effects, clock = picture.ray_effects, picture.work.clock
    largest = medium.most_color(tables.values())  # of any color, for filters of the warp that overshoot
    passes = effects.passes(fade.planes)
    count, done = max(sum(len(one.planes) for one in passes), 1), 0
    mixed = None
    for ray_pass in passes:
        images = []
        for number, plane in ray_pass.planes:
            shortened = effects.intervals(ray_pass, number, plane)
            if shortened is not None:  # else no ray of this plane is left
                plane, intervals = shortened
                at = begin + share * done / count
                yield Progress(at, "Splatting")
                steps = medium.splat_steps(tables.get(plane.axis), plane, intervals)
                image = yield from watch_splat_steps(steps, clock, at, share / count)
                yield Progress(at + share / count, "Splatting")
                images.append(effects.complete(ray_pass, number, image))
            done += 1
        steps = warp_steps(images, picture.view.index_view, ray_pass.region, picture.source.quality, largest)
        at = begin + share * done / count
        with clock.stage("warp"):  # ``finish`` colors pictures of values (MIP and the like)
            found = yield from announce(steps, at, at, "Warping")
        yield Progress(at, "Warping")
        with clock.stage("warp"):
            mixed = effects.mix(ray_pass, mixed, medium.finish(*found))
    rgba, depth = mixed
    return rgba, effects.clamp_to_clip(depth)
