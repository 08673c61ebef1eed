"""A sharp picture that is being made: its source, its view, the effects on its rays, and the work on it."""

from __future__ import annotations

from dataclasses import dataclass

from ..effects.ray_effects import RayEffects
from ..runtime.steps import Clock
from ..scene import Scene
from .memory_estimate import refuse_too_large
from .single_rays import add_neighbors, traces_steep_pixels
from .source import Source, Work
from .stage_cache import StageCache
from .views import View, choose_view


@dataclass(frozen=True, eq=False)
class Picture:
    """A sharp picture that is being made.

    Attributes
    ----------
    wanted : Scene
        With the volume itself, and the crop that was asked for.
    source : Source
        With the voxels that are splatted and the pixels that are made, which may be more than the wanted ones.
    """

    wanted: Scene
    source: Source
    view: View
    ray_effects: RayEffects
    work: Work


def begin_picture(source: Source, cache: StageCache, refuse_empty_view: bool, clock: Clock) -> Picture:
    """Choose the view of a picture, and begin the work on it.

    Raises
    ------
    RleSplatError
        Where its pixels alone need more memory than there is; with ``refuse_empty_view``, where the camera sees nothing
        of the volume.
    """
    wanted = source.scene
    source = add_neighbors(source)
    view = choose_view(source, refuse_empty_view)
    rays = RayEffects(source.scene, view.index_view, source.quality, source.effects, clock)
    left, top, right, bottom = source.scene.region
    needed = source.picture_bytes(view.planes, shortened=rays.shorten_rays, traced=traces_steep_pixels(source))
    if not cache.has_plenty(needed):
        cache.make_room(needed)
        refuse_too_large(needed, right - left, bottom - top)
    volume = source.scene.volume
    frame = volume.key if cache.keeps and volume.holds_values and volume.frames > 1 else None
    return Picture(wanted, source, view, rays, Work(cache.job(frame), clock, len(view.axes), needed))
