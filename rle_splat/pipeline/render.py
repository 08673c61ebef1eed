"""The pipeline: the stages of the paper, in order, for one picture.

    classify -> shade -> run-length encode -> splat into the sheet buffer -> warp

``render`` is the public verb and ``render_steps`` its generator form.  What the volume is and how it is classified is
decided once, by ``choose_source``; effects attach by the interfaces of ``effects.analyze`` and ``effects.ray_effects``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..effects.exposure import exposure_steps, exposures
from ..effects.ray_effects import RayEffects
from ..runtime.jit import NotingKernels, compiled, nothing_compiled_yet
from ..runtime.steps import Clock, Progress, drain, forward, mapped, portion, timed, within
from ..scene import Quality, Rendering, RleSplatError, Scene
from ..splat.splat import LOADING
from ..volume.mapped_files import whole_steps
from ..warp.warp import warp_steps
from .choose_source import Settled, choose_source, settled
from .memory_estimate import picture_bytes, refuse_too_large
from .preset_plan import with_plan
from .report import report_of
from .single_rays import NO_PIXELS, steep_steps, traces_steep_pixels, with_neighbors
from .source import Medium, Source, Work
from .stage_cache import StageCache
from .views import Fade, View, view_of

LOADING_KERNELS = "Preparing kernels, which takes a while the first time"
COMPILING = "; compiling kernels, the first time only"


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
    return drain(render_steps(scene, quality or Quality(), cache), progress)


def render_steps(scene: Scene, quality: Quality, cache: StageCache | None = None, *, refuse_empty_view: bool = True):
    """Generator form of ``render``: yields Progress, returns the Rendering; closing it cancels the work.

    ``refuse_empty_view``: raise when the camera sees nothing of the volume; else the picture is transparent, as an
    animation needs it.  Raises RleSplatError, caused by the MemoryError, when memory runs out half-way; ``cache`` is
    as it was before.
    """
    steps = whole_steps(_exposed_steps(scene, quality, cache, refuse_empty_view), scene)
    rendering, kernels = yield from told_steps(steps, quality)
    return replace(rendering, report={**rendering.report, "kernels": kernels})


def told_steps(steps, quality: Quality):
    """Generator of Progress, told in words for a person: what ``steps`` returns, and the names of its kernels.

    Raises RleSplatError, caused by the MemoryError, when memory runs out half-way.
    """
    kernels: set[str] = set()
    first_ever = compiled(quality.backend) and nothing_compiled_yet()
    steps = within(steps, lambda: NotingKernels(kernels))
    if first_ever:
        steps = mapped(steps, _told_of_compiling)
    try:
        made = yield from forward(steps)  # of several axes or base planes each begins anew
    except MemoryError as problem:
        reason = f" ({problem})" if str(problem) else ""
        raise RleSplatError(
            f"Memory ran out half-way through the picture{reason}; free some, or make the picture, the sheet density "
            "or the volume smaller."
        ) from problem
    return made, sorted(kernels)


def _told_of_compiling(step: Progress) -> Progress:
    """A step of the first picture ever, which compiles kernels; the last step and kernels' own say enough."""
    if step.fraction >= 1.0 or step.message == LOADING_KERNELS:
        return step
    return step._replace(message=step.message + COMPILING)


def _exposed_steps(scene: Scene, quality: Quality, cache: StageCache | None, refuse_empty_view: bool):
    """``render_steps``, the kernels aside: the mean of the sharp pictures that the scene's exposure takes."""
    clocks = [Clock()]  # of the first picture, which the door belongs to
    with clocks[0].running():
        door = settled(scene, quality)
        pictures = exposures(door.scene)
        if cache is None:  # the pictures of a blur have most stages in common
            cache = StageCache(0) if len(pictures) == 1 else StageCache()
        with clocks[0].stage("plan"):
            door = with_plan(door, cache)
    refuse = refuse_empty_view and not door.scene.motion  # what moves may come into view

    def sharp_steps(sharp: Scene):
        clock = clocks.pop() if clocks else Clock()
        steps = _sharp_steps(door if sharp is door.scene else replace(door, scene=sharp), cache, refuse, clock)
        return within(steps, clock.running)

    return exposure_steps(door.scene, pictures, sharp_steps)


def _sharp_steps(door: Settled, cache: StageCache, refuse_empty_view: bool, clock: Clock):
    """Generator: the stages of one sharp picture, in the paper's order; returns its Rendering."""
    drawing = begun(door, cache, refuse_empty_view, clock)
    medium, tables = yield from encoded_steps(drawing)

    def splat(plane, intervals):
        return medium.splat_steps(tables[plane.axis], plane, intervals)

    return (yield from drawn_steps(drawing, medium, tables, splat))


@dataclass(frozen=True, eq=False)
class Drawing:
    """A sharp picture that is being made.

    Attributes
    ----------
    door : Settled
    source : Source
    view : View
    rays : RayEffects
    work : Work
    is_traced : bool
        Whether steep pixels are integrated by single rays.
    """

    door: Settled
    source: Source
    view: View
    rays: RayEffects
    work: Work
    is_traced: bool


def begun(door: Settled, cache: StageCache, refuse_empty_view: bool, clock: Clock) -> Drawing:
    """The Drawing of a scene, with its source and its view."""
    source = choose_source(door.scene, door.quality)
    traced = traces_steep_pixels(source)
    source = with_neighbors(source) if traced else source
    view = view_of(source, refuse_empty_view)
    rays = RayEffects(source.scene, view.index_view, door.quality, door.effects, clock)
    return Drawing(door, source, view, rays, _begin_work(source, view, rays, traced, cache, clock), traced)


def encoded_steps(drawing: Drawing):
    """Generator of Progress: classify, shade and encode; returns the Medium, and principal axis -> its tables."""
    medium = yield from drawing.source.medium_steps(drawing.work)
    tables = {}
    for axis in drawing.view.axes:
        tables[axis] = yield from portion(medium.encode_steps(axis), 0.1, 0.2, "Encoding")
    return medium, tables


def drawn_steps(drawing: Drawing, medium: Medium, tables: dict, splat):
    """Generator of Progress: splat and warp; returns the Rendering.

    ``splat(plane, intervals)``: generator of fractions done; returns the IntermediateImage of a base plane.
    """
    door, source, view, rays = drawing.door, drawing.source, drawing.view, drawing.rays
    clock, most_color = drawing.work.clock, medium.most_color(tables.values())
    rays.inspect(view.planes)
    picture = None
    for n, fade in enumerate(view.fades):
        span = 0.2 + 0.75 * n / len(view.fades), 0.75 / len(view.fades)
        found = yield from _fade_steps(drawing, medium, most_color, fade, splat, span)
        picture = fade.mixed(picture, found)
    # Follow single rays where sheets and warp err most.
    traced_pixels = NO_PIXELS
    if drawing.is_traced:
        steps = steep_steps(source.scene, door.scene.region, view.index_view, medium, door.quality, *picture)
        steps = portion(timed(steps, clock, "rays"), 0.95, 0.99, "Following single rays")
        *picture, traced_pixels = yield from steps
    with clock.stage("report"):
        remarks = (*door.remarks, *rays.remarks(picture, medium.visible_voxels > 0))
        report = report_of(door.scene, source, view, medium, tables, rays.effects, traced_pixels, clock, remarks)
        report["plan"] |= door.plan
    drawing.work.job.keep()
    report["stages_ms"] = clock.report()
    yield Progress(1.0, "Done")
    return Rendering(*picture, report)


def _begin_work(source: Source, view: View, rays: RayEffects, traced: bool, cache: StageCache, clock: Clock) -> Work:
    """The work for a picture, or a RleSplatError where its pixels alone need more memory than there is."""
    left, top, right, bottom = source.scene.region
    scratch = max((source.splat_bytes(plane, rays.shorten_rays) for plane in view.planes), default=0)
    needed = picture_bytes(
        view.planes, right - left, bottom - top, source.quality, shortened=rays.shorten_rays,
        meshes=source.scene.hides_volume, scratch=scratch, traced=traced,
    )  # fmt: skip
    if not cache.has_plenty(needed):
        cache.make_room(needed)
        refuse_too_large(needed, right - left, bottom - top)
    return Work(cache.job(), clock, len(view.axes), needed)


def _fade_steps(drawing: Drawing, medium: Medium, most_color: float, fade: Fade, splat, span):
    """Generator of Progress: splat the base planes of a part of the view and warp them; returns (rgba, depth).

    ``splat``: see ``drawn_steps``.  ``span``: how much of the work is done before, and how much this is.
    """
    rays, clock = drawing.rays, drawing.work.clock
    passes = rays.passes(fade.planes)
    parts, done = max(sum(len(one.planes) for one in passes), 1), 0
    picture = None
    for ray_pass in passes:
        images = []
        for number, whole in ray_pass.planes:
            left = rays.intervals(ray_pass, number, whole)
            if left is not None:
                begin = span[0] + span[1] * done / parts
                image = yield from splatted_steps(splat(*left), clock, begin, span[1] / parts)
                images.append(rays.drawn(ray_pass, number, image))
            done += 1
        index_view, quality = drawing.view.index_view, drawing.source.quality
        steps = warp_steps(images, index_view, ray_pass.region, quality, most_color)
        at = span[0] + span[1] * done / parts
        found = yield from portion(timed(steps, clock, "warp"), at, at, "Warping")
        with clock.stage("warp"):
            found = medium.picture(*found) if medium.picture else found
            picture = rays.mixed(ray_pass, picture, found)
    rgba, depth = picture
    return rgba, rays.within_clip(depth)


def splatted_steps(steps, clock: Clock, begin: float, share: float):
    """Generator of Progress from ``begin`` on: the splat of one base plane; returns the IntermediateImage.

    Loading the kernel, or compiling it the first time ever, is told and timed apart.
    """
    stage, done = "splat", 0.0

    def told(step) -> Progress:
        nonlocal stage, done
        stage, message = ("kernels", LOADING_KERNELS) if step is LOADING else ("splat", "Splatting")
        done = done if step is LOADING else step
        return Progress(begin + share * done, message)

    return (yield from mapped(within(steps, lambda: clock.stage(stage)), told))
