"""The stage of shadows: one result for each light, so that a light that moves is swept alone."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np

from ..effects.shadows import Occluders, light_steps, scattered_steps, sky_steps
from ..runtime.steps import Clock, time_steps
from ..scene import Light, Scene
from ..shade.light_sweep import FULL
from ..shade.lighting import Shadows
from .stage_cache import Job

SHADOW_EFFECTS = ("shadows", "ambient occlusion", "indirect light")  # their names in the table of effects
UNSEEN_BY_SHADOWS = ("color", "energy", "casts_shadow", "matrix_world")


def casting(scene: Scene) -> list[int]:
    """Numbers of the lights that cast shadows in the volume."""
    if not scene.volume_shadows:
        return []
    return [n for n, light in enumerate(scene.lights) if light.casts_shadow and light.energy > 0.0]


def shadow_count(scene: Scene) -> int:
    """How many shares of lights, of ambient light among them, are stored for each voxel."""
    return len(casting(scene)) * (1 + (scene.indirect_light > 0.0)) + (scene.ambient_occlusion > 0.0)


def without_shadows(scene: Scene) -> Scene:
    """The scene without SHADOW_EFFECTS, whether it asks for them or they are forced on or off."""
    effects = {name: on for name, on in scene.effects.items() if name not in SHADOW_EFFECTS}
    return replace(scene, volume_shadows=False, ambient_occlusion=0.0, indirect_light=0.0, effects=effects)


def arriving_steps(scene: Scene, occluders: Occluders, job: Job, clock: Clock, offsets=None, offsets_key=()):
    """Generator of fractions done: what arrives of a scene's lights.

    ``offsets``: as ``effects.shadows.light_steps`` takes them, which ``offsets_key`` names.

    Returns
    -------
    lamps : list of (m,) ndarray of uint16
        FULL times the share that arrives, for each light of ``casting``; then, with indirect light, its share.
    sky : (m,) ndarray of uint16 or None
        The same of ambient light; None without ambient occlusion.
    key : tuple
        Of all of it.
    """
    lamps, keys, sky = [], [], None
    scattered = scene.indirect_light > 0.0
    find_steps = scattered_steps if scattered else light_steps
    for number in casting(scene):
        light = scene.lights[number]
        key = (occluders.key, offsets_key, _light_key(light), scattered)
        steps = job.steps("shadows", key, lambda light=light: find_steps(light, occluders, offsets))
        lamps.append((yield from time_steps(steps, clock, "shadows")))
        keys.append((number, key))
    if scattered:
        lamps = [share for shares in zip(*lamps) for share in shares]
    if scene.ambient_occlusion > 0.0:
        key = (occluders.key, offsets_key)
        steps = job.steps("ambient occlusion", key, lambda: sky_steps(occluders, offsets))
        left = yield from time_steps(steps, clock, "ambient occlusion")
        sky = np.rint(FULL - scene.ambient_occlusion * (FULL - left.astype(np.float32))).astype(np.uint16)
        keys.append((scene.ambient_occlusion, key))
    return lamps, sky, tuple(keys)


def shadow_steps(scene: Scene, occluders: Occluders, job: Job, clock: Clock):
    """Generator of fractions done: the Shadows of a scene's lights, a headlight behind them, and their key."""
    lamps, sky, key = yield from arriving_steps(scene, occluders, job, clock)
    row_of = np.full(len(scene.lights) + scene.headlight + 1, -1, np.int64)
    row_of[casting(scene)] = np.arange(len(lamps))
    if sky is not None:
        row_of[-1] = len(lamps)
        lamps = [*lamps, sky]
    return Shadows(np.stack(lamps), row_of), key


def _light_key(light: Light) -> tuple:
    """Names where a light is and how large, all that its shadows depend on."""
    named = {name: value for name, value in asdict(light).items() if name not in UNSEEN_BY_SHADOWS}
    return (light.matrix_world.tobytes(), *named.values())
