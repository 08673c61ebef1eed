"""A picture in sections: parts of its sheets, drawn apart and composited with the operator ``over`` before the warp.

Volumes that are too large for one machine are drawn so. A section's rays begin and end at its sheets; what it draws is
color and transmittance of every sheet pixel, which the sections before it cover. The warp comes last, since it mixes
sheet pixels. The command line calls the sections slabs (``--slabs``).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..effects.exposure import list_exposures
from ..runtime.steps import Clock, Progress, drain
from ..scene import Quality, Rendering, RleSplatError, Scene
from ..scene.changed import change
from ..splat.intermediate_image import IntermediateImage
from ..view.base_plane import BasePlane
from .choose_source import choose_source
from .medium import Medium
from .picture import Picture, begin_picture
from .preset_plan import choose_plan
from .render import splat_and_warp_steps
from .report import make_report
from .single_rays import NO_PIXELS
from .stage_cache import StageCache
from .watch_steps import watch_splat_steps, watch_steps

ALONG_Z = 2


@dataclass(frozen=True, eq=False)
class SectionImages:
    """What a section, or several that follow one another, look like on the base planes of a picture.

    Attributes
    ----------
    pixels : tuple of ndarray or None
        Of each base plane in the order that they are drawn, (H, W, 4) float32, premultiplied scene-linear color and
        transmittance; None where nothing is drawn.
    most_color : float
        Largest channel of any unassociated color.
    kernels : frozenset of str
        Names of the kernels that took part.
    stages_ms : dict
        Milliseconds of each stage.
    """

    pixels: tuple
    most_color: float
    kernels: frozenset
    stages_ms: dict


def section_steps(scene: Scene, quality: Quality, number: int, count: int):
    """Generator of Progress: draw one of ``count`` sections; returns its SectionImages.

    Parameters
    ----------
    number, count : int
        Sections are numbered from front to back, on each base plane of the picture.

    Raises
    ------
    RleSplatError
        Where the picture cannot be drawn in sections.
    """
    picture = _begin(scene, quality)
    steps, clock = _section_steps(picture, number, count), picture.work.clock
    (pixels, most_color), kernels = yield from watch_steps(steps, scene, clock)
    return SectionImages(pixels, most_color, frozenset(kernels), clock.report())


def composite_steps(scene: Scene, quality: Quality, sections: SectionImages):
    """Generator of Progress: warp what the sections look like together; returns the Rendering, which has no depths.

    Parameters
    ----------
    sections : SectionImages
        Of all sections.
    """
    picture = _begin(scene, quality)
    rendering, kernels = yield from watch_steps(_composite_steps(picture, sections), scene, picture.work.clock)
    report = dict(rendering.report)
    del report["memory_bytes"]  # here are no tables
    times = _sum(report["stages_ms"], sections.stages_ms)
    return replace(rendering, report={**report, "kernels": sorted({*kernels, *sections.kernels}), "stages_ms": times})


def over(front: SectionImages, back: SectionImages) -> SectionImages:
    """Composite sections that lie behind one another."""
    pixels = tuple(_over(*pair) for pair in zip(front.pixels, back.pixels, strict=True))
    times = _sum(front.stages_ms, back.stages_ms)
    return SectionImages(pixels, max(front.most_color, back.most_color), front.kernels | back.kernels, times)


def _check(scene: Scene) -> None:
    """RleSplatError for a scene whose picture is not made in sections."""
    if scene.volume.holds_values or scene.volume.mapped is None:
        raise RleSplatError(
            "Slabs are parts of a folder of tables; encode the volume with rle-splat encode --folder, and render that."
        )
    if len(list_exposures(scene)) > 1:
        raise RleSplatError(
            "Depth of field, motion blur and anti-aliasing mix many pictures, and slabs make one; leave them out, or "
            "remove --slabs."
        )


def _begin(scene: Scene, quality: Quality) -> Picture:
    _check(scene)
    cache = StageCache(0)
    return begin_picture(choose_plan(choose_source(scene, quality), cache), cache, False, Clock())


def _section_steps(picture: Picture, number: int, count: int):
    """Generator of Progress: returns the pixels of a section, and the largest color."""
    planes = {plane: plane.section(number, count) for plane in picture.view.planes}
    picture = _read_only(picture, [plane for plane in planes.values() if plane is not None])
    medium = yield from picture.source.medium_steps(picture.work)
    tables = yield from medium.encode_steps(picture.view.axes)
    effects, clock, pixels = picture.ray_effects, picture.work.clock, []
    drain(effects.leave_out_idle_steps(picture.view.planes))
    for fade in picture.view.fades:
        for ray_pass in effects.passes(fade.planes):
            for plane_number, whole in ray_pass.planes:
                left = effects.intervals(ray_pass, plane_number, whole)
                if left is None:
                    continue
                plane, intervals = left
                section = plane.section(number, count)
                if section is None:
                    pixels.append(None)
                    continue
                steps = medium.splat_steps(tables[plane.axis], section, intervals)
                image = yield from watch_splat_steps(steps, clock, 0.2, 0.8)
                pixels.append(None if image.find_filled_part(0) is None else image.pixels)
    return tuple(pixels), medium.most_color(tables.values())


def _read_only(picture: Picture, planes: list[BasePlane]) -> Picture:
    """The picture with a source that reads no more of a folder than some base planes show."""
    source = picture.source
    reads = [_slices_read(plane) for plane in planes if plane.axis == ALONG_Z]
    first, last = (min(first for first, _ in reads), max(last for _, last in reads)) if reads else (0, 0)
    volume = source.scene.volume.of_planes(first, last)
    return replace(picture, source=replace(source, scene=change(source.scene, volume=volume)))


def _slices_read(plane: BasePlane) -> tuple[int, int]:
    """The first slice that the footprints of a plane's sheets reach, and the end of these slices."""
    first = plane.sheets.first_slice
    return int(first.min()), int(first.max()) + plane.sheets.slice_weights.shape[1]


def _composite_steps(picture: Picture, sections: SectionImages):
    """Generator of Progress: the Rendering of base planes whose pixels are there."""
    medium = yield from picture.source.medium_steps(picture.work)
    medium = CompositedSections(medium.voxels, medium.quality, medium.mist, sections.most_color, iter(sections.pixels))
    made = yield from splat_and_warp_steps(picture, medium, {})
    report = make_report(picture, medium, {}, made, NO_PIXELS)
    picture.work.job.keep()
    yield Progress(1.0, "Done")
    return Rendering(*made, report)


@dataclass(frozen=True, eq=False)
class CompositedSections(Medium):
    """A medium that is splatted already.

    Attributes
    ----------
    brightest : float
        Largest channel of any unassociated color.
    pixels : iterator of ndarray or None
        Of each base plane, in the order that they are drawn.
    """

    brightest: float
    pixels: Iterator

    def splat_steps(self, tables, plane, intervals):
        yield from ()
        return _image_of(plane, next(self.pixels))

    def most_color(self, tables) -> float:
        return self.brightest


def _image_of(plane: BasePlane, pixels: np.ndarray | None) -> IntermediateImage:
    """The intermediate image of pixels, or a transparent one; the transmittance nowhere falls below one half."""
    image = IntermediateImage.blank(plane)
    image.pixels[:] = (0.0, 0.0, 0.0, 1.0) if pixels is None else pixels
    image.half_depth[:] = np.inf
    image.note_filled()
    return image


def _over(front: np.ndarray | None, back: np.ndarray | None) -> np.ndarray | None:
    if front is None or back is None:
        return back if front is None else front
    pixels = front[..., 3:] * back
    pixels[..., :3] += front[..., :3]
    return pixels


def _sum(some: dict, others: dict) -> dict:
    """The sums of numbers of the same names."""
    return {name: taken + others[name] for name, taken in some.items()}
