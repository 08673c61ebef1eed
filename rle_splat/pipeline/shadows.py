"""The stage of shadows: one result for each light, so that a light that moves is swept alone."""

from dataclasses import asdict, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ..effects.shadows import (
    Occluders,
    light_passes,
    node_light_steps,
    pool_occluders_steps,
    scattered_light_steps,
    sky_passes,
    traced_light_steps,
    unblocked_steps,
    voxel_light_steps,
)
from ..runtime.steps import Clock, map_steps
from ..scene import Light, Quality, Scene
from ..shade.light_rays import brick_steps
from ..shade.light_sweep import FULL
from ..shade.lighting import Shadows
from .stage_cache import Job

SHADOW_EFFECTS = ("shadows", "ambient occlusion", "indirect light")  # their names in the table of effects
UNSEEN_BY_SHADOWS = ("color", "energy", "casts_shadow", "matrix_world")
TRACED = -1  # in place of voxels from node to node: light is traced beside each voxel
COARSE = 0.5  # sheet pixels per image pixel, up to which nodes of light are two voxels apart: as a draft has


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


def node_side(quality: Quality) -> int:
    """Voxels from node to node of the grids of light of a post-classified picture; TRACED for none."""
    if quality.exact_light:
        return TRACED
    return 2 if 0.0 < quality.sheet_density <= COARSE else 1


class Arriving(NamedTuple):
    """What arrives of a light: ``codes``, FULL times the share, where it is traced ONE times it; ``strength`` of what
    is blocked counts; ``key``; ``left``: FULL times what meshes leave of it at each voxel, None where ``codes`` have
    that."""

    codes: np.ndarray
    strength: float
    key: tuple
    left: np.ndarray | None = None


def traced_steps(scene: Scene, occluders: Occluders, points, points_key, job: Job, clock: Clock):
    """Generator of fractions done: as ``arriving_steps``, traced beside each voxel.

    ``points``: from a light of the scene, or None, to the Points where light is traced; ``points_key``: what all of
    them depend on.
    """
    found = []

    def trace(light, scattered=False):
        def make():
            extinction = yield from map_steps(occluders.find_extinction(), lambda _: 0.0)
            return (yield from brick_steps(occluders.voxels, extinction, threads=occluders.threads))

        bricks = yield from job.steps("bricks", occluders.medium_key, make)
        where = points(None if scattered else light)
        return (yield from traced_light_steps(light, occluders, bricks, where, scattered))

    for scattered in (False, True)[: 1 + (scene.indirect_light > 0.0)]:
        for number in casting(scene):
            light = scene.lights[number]
            key = (occluders.key, TRACED, points_key, _light_key(light), scattered)
            steps = job.steps("shadows", key, partial(trace, light, scattered))
            with clock.stage("shadows"):
                found.append(Arriving((yield from steps), 1.0, key))
    yield from _add_ambient_steps(found, scene, (occluders.key, TRACED, points_key), partial(trace, None), job, clock)
    return found


def arriving_steps(scene: Scene, occluders: Occluders, job: Job, clock: Clock, side: int, points, points_key):
    """Generator of fractions done: what arrives of a scene's lights.

    ``side``: 0 for the light at voxels; else voxels from node to node of the grids of light, and ``points`` and
    ``points_key`` as of ``traced_steps``.

    Returns
    -------
    list of Arriving
        For each light of ``casting``, then, with indirect light at nodes, U of each, and for ambient light, if there
        is ambient occlusion.
    """
    find_steps = node_light_steps if side else voxel_light_steps
    scattered = side > 0 and scene.indirect_light > 0.0
    find_lamp_steps = scattered_light_steps if scattered else find_steps
    medium = occluders.without_meshes if side else occluders  # of lamps: what meshes leave is looked up apart

    def blocking_steps():
        """Generator: what blocks the light of lamps, at the grid's own resolution."""
        if side < 2:
            return medium
        key = (medium.key, side, occluders.threads)
        return (yield from job.steps("pooled", key, lambda: pool_occluders_steps(medium, side), _bytes_of))

    def lamp_steps(light: Light):
        blocking = yield from blocking_steps()
        return (yield from find_lamp_steps(*light_passes(light, blocking, nodes=side > 0, sharp=side > 1), blocking))

    def left_steps(light: Light):
        passes, weights = light_passes(light, occluders, nodes=True, sharp=side > 1)
        return (yield from unblocked_steps(passes, weights, occluders, points(light)))

    def ambient_steps():
        blocking = yield from blocking_steps()
        blocking = replace(blocking, triangles=occluders.triangles)
        return (yield from find_steps(*sky_passes(blocking, nodes=side > 0), blocking))

    found, further = [], []
    for number in casting(scene):
        light = scene.lights[number]
        key = (medium.key, side, _light_key(light), scattered)
        steps = job.steps("shadows", key, lambda light=light: lamp_steps(light))
        with clock.stage("shadows"):
            codes, left = (yield from steps), None
        if side and occluders.has_meshes:
            left_key = (occluders.key, side, points_key, _light_key(light))
            steps = job.steps("mesh shadows", left_key, lambda light=light: left_steps(light))
            with clock.stage("shadows"):
                left = yield from steps
            key = (*key, left_key) if len(left) else key
        if scattered:
            codes, beside = codes
            further.append(Arriving(beside, 1.0, (*key, "further"), left))
        found.append(Arriving(codes, 1.0, key, left))
    found += further
    yield from _add_ambient_steps(found, scene, (occluders.key, side), ambient_steps, job, clock)
    return found


def _add_ambient_steps(found: list[Arriving], scene: Scene, key, find_steps, job: Job, clock: Clock):
    """Generator of fractions done: add ambient light, if there is ambient occlusion."""
    if scene.ambient_occlusion > 0.0:
        steps = job.steps("ambient occlusion", key, find_steps)
        with clock.stage("ambient occlusion"):
            codes = yield from steps
        found.append(Arriving(codes, scene.ambient_occlusion, (*key, scene.ambient_occlusion)))


def shadow_steps(scene: Scene, occluders: Occluders, job: Job, clock: Clock):
    """Generator of fractions done: the Shadows of a scene's lights, a headlight behind them, and their key."""
    found = yield from arriving_steps(scene, occluders, job, clock, 0, None, ())
    row_of = np.full(len(scene.lights) + scene.headlight + 1, -1, np.int64)
    row_of[casting(scene)] = np.arange(len(casting(scene)))
    if scene.ambient_occlusion > 0.0:
        row_of[-1] = len(found) - 1
    codes = [
        one.codes
        if one.strength == 1.0
        else np.rint(FULL - one.strength * (FULL - one.codes.astype(np.float32))).astype(np.uint16)
        for one in found
    ]
    return Shadows(np.stack(codes), row_of), (tuple(casting(scene)), tuple(one.key for one in found))


def _bytes_of(occluders: Occluders) -> int:
    """Of pooled voxels and their tables along one axis."""
    return 2 * occluders.voxels.nbytes


def _light_key(light: Light) -> tuple:
    """Names where a light is and how large, all that its shadows depend on."""
    named = {name: value for name, value in asdict(light).items() if name not in UNSEEN_BY_SHADOWS}
    return (light.matrix_world.tobytes(), *named.values())
