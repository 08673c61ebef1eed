"""The shadow pass: a picture of the share of light that shadows take away."""

from dataclasses import replace

import numpy as np

from ..effects.analyze import analyze_effects
from ..runtime.steps import rescale
from ..scene import NO_RAYS, Quality, RleSplatError, Scene
from .preset_plan import hold_plan
from .render import render_steps
from .shadows import shadow_count, without_shadows
from .stage_cache import StageCache

FAINTEST = 1e-6  # light of a pixel, red, green and blue together, below which its share counts as none


def shadow_pass_steps(scene: Scene, quality: Quality, cache: StageCache | None = None):
    """Generator of Progress: render a scene with and without its shadows; RleSplatError for a scene without shadows.

    Everything but light is made once for both pictures.  Both are made of sheets alone, because the light decides which
    pixels are steep enough for single rays.

    Returns
    -------
    Rendering
        The scene's picture.
    (H, W) float32
        The share of each pixel's light that shadows and ambient occlusion take away: 1 less the picture's light over
        that of the same picture without them, red, green and blue together; 0 where there is no light.
    """
    if not shadow_count(analyze_effects(scene, quality)[1]):
        raise RleSplatError("There is no shadow pass without shadows: turn on shadows or ambient occlusion.")
    cache = StageCache() if cache is None else cache
    unshaded = without_shadows(scene)
    rendering = shaded = yield from rescale(render_steps(scene, quality, cache=cache), 0.0, 0.5)
    quality = replace(hold_plan(quality, rendering.report["plan"]), rays=NO_RAYS)
    if rendering.report["rays"]["pixels"]:
        shaded = yield from rescale(render_steps(scene, quality, cache=cache), 0.5, 0.6)
    plain = yield from rescale(render_steps(unshaded, quality, cache=cache), 0.6, 1.0)
    light, whole = (made.rgba[..., :3].sum(axis=2) for made in (shaded, plain))
    share = np.divide(light, whole, out=np.ones_like(whole), where=whole > FAINTEST)
    return rendering, np.clip(1.0 - share, 0.0, 1.0)


def as_picture(share: np.ndarray, rgba: np.ndarray) -> np.ndarray:
    """(H, W, 4) float32 premultiplied grays of a shadow pass, with the alpha of the picture ``rgba``."""
    alpha = rgba[..., 3:]
    return np.concatenate((np.repeat(share[..., None], 3, axis=2) * alpha, alpha), axis=2)
