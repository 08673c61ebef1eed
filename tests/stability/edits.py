"""Edits of a scene and of the plan of its picture, for hypothesis to choose from: one kind each, most of them of one
number alone, as a user turns one knob.

An edit takes ``draw``, hypothesis' own, and a Shot (``shots``); it returns the Shot after it.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
from hypothesis import strategies as st

from rle_splat.classify.transfer_function import GradientOpacity, Shade
from rle_splat.effects.lens import widest_blur
from rle_splat.effects.motion import distance_moved
from rle_splat.scene import (
    CLASSIFICATIONS,
    CLIP_KINDS,
    FOOTPRINTS,
    LIGHT_TYPES,
    MINIFICATIONS,
    MIST_FALLOFFS,
    MODELS,
    MODES,
    NAMED_DEPTH_RULES,
    POST_ONLY,
    QUALITY_PRESETS,
    RECORDS,
    WARP_FILTERS,
    Channel,
    Clip,
    Labels,
    Mist,
    Pose,
    Quality,
    Scene,
)
from rle_splat.scene.clip import CLIP_SIDES
from rle_splat.volume.volume import Volume
from tests.stability.effect_strategies import GIVEN, pose_near, reach_of, with_meshes
from tests.stability.shots import (
    COLORS,
    DTYPES,
    HEIGHT,
    UNIT,
    WIDTH,
    Shot,
    drawn_camera,
    drawn_distance,
    drawn_function,
    drawn_gradients,
    drawn_light,
    drawn_volume,
    further_off,
)
from tests.stability.strategies import SEEDS, rotation, value_range

BLUR = 2.5  # pixels, at most: a wider one takes more pictures than a search has time for
DEPTH_RULES = (*NAMED_DEPTH_RULES, "midpoint-1", "midpoint-3")
SCALAR_DEPTH_RULES = (*DEPTH_RULES, "preintegrated", "preintegrated-2")


# --- the transfer function ------------------------------------------------------------------------------------


def heights_of_opacity(draw, shot: Shot) -> Shot:
    factor = draw(st.sampled_from((0.3, 0.8, 1.0, 1.5)))
    points = tuple((value, min(alpha * factor, 1.0)) for value, alpha in shot.scene.transfer_function.opacity)
    return shot.with_function(opacity=points)


def window(draw, shot: Shot) -> Shot:
    """The whole function moved and stretched a little, so that more or fewer voxels are shown."""
    function = shot.scene.transfer_function
    low, high = function.span
    width = (high - low) * draw(st.sampled_from((0.8, 1.0, 1.2)))
    center = 0.5 * (low + high) + (high - low) * draw(st.sampled_from((-0.3, -0.1, -0.05, 0.05, 0.1)))
    return shot.with_scene(transfer_function=function.windowed(center, width))


def colors_of_values(draw, shot: Shot) -> Shot:
    points = shot.scene.transfer_function.color
    changed = draw(st.integers(0, len(points) - 1))
    drawn = (points[changed][0], *draw(COLORS))
    return shot.with_function(color=(*points[:changed], drawn, *points[changed + 1 :]))


def opacity_distance(draw, shot: Shot) -> Shot:
    return shot.with_function(opacity_unit_distance=drawn_distance(draw, shot.scene.volume))


def gradient_opacity(draw, shot: Shot) -> Shot:
    """Another one; one of its ends or its curve alone; or none."""
    ends = shot.scene.transfer_function.gradient_opacity
    drawn = drawn_gradients(draw, shot.scene.volume)
    kind = draw(st.sampled_from(("other", "low", "low", "high", "high", "curve", "none")))
    if kind == "none":
        drawn = None
    elif ends is not None and kind == "low":
        drawn = GradientOpacity(draw(UNIT) * ends.high, ends.high)
    elif ends is not None and kind == "high":
        drawn = GradientOpacity(ends.low, ends.low + drawn.high)
    elif ends is not None and kind == "curve":
        drawn = replace(ends, curve=draw(st.lists(st.tuples(UNIT, UNIT), min_size=1, max_size=4)))
    return shot.with_function(gradient_opacity=drawn)


SHADES = {
    "ambient": UNIT, "diffuse": UNIT, "specular": st.sampled_from((0.0, 0.3, 0.8)),
    "shininess": st.sampled_from((1.0, 5.0, 30.0)), "two_sided": st.booleans(),
    "smoothness": st.sampled_from((None, 0.0, 1.0)),
}  # fmt: skip


def shading(draw, shot: Shot) -> Shot:
    shade = shot.scene.transfer_function.shade
    if shade is None or draw(st.integers(0, 6)) == 0:
        return shot.with_function(shade=Shade() if shade is None else None)
    return shot.with_function(shade=one_changed(draw, shade, SHADES))


def one_changed(draw, whole, choices: dict):
    """``whole`` with one of its fields drawn from ``choices``."""
    name = draw(st.sampled_from(sorted(choices)))
    return replace(whole, **{name: draw(choices[name])})


# --- the volume and where it is -------------------------------------------------------------------------------


def voxels(draw, shot: Shot) -> Shot:
    """A few voxels of the volume; or all of them in another stored type."""
    volume = shot.scene.volume
    changed = volume.voxels.copy()
    if draw(st.integers(0, 3)) == 0:
        changed = np.nan_to_num(changed.astype(np.float64)).clip(0.0, 255.0).astype(draw(st.sampled_from(DTYPES)))
    else:
        random = np.random.default_rng(draw(SEEDS))
        some = random.random(changed.shape) < draw(st.sampled_from((0.002, 0.2)))
        changed[some] = random.permutation(changed[some]) if draw(st.booleans()) else changed.flat[0]
    return shot.with_scene(volume=replace(volume, voxels=changed))


def stretched(draw) -> np.ndarray:
    """(4, 4): one axis longer or shorter, or none; all turned a little, or not; moved a little, or not."""
    matrix = np.eye(4)
    axis, factor = draw(st.integers(0, 2)), draw(st.sampled_from((0.8, 1.0, 1.25)))
    matrix[axis, axis] = factor
    angle = draw(st.sampled_from((0.0, 0.1, 0.5)))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(4)
    turn[[i, i, j, j], [i, j, i, j]] = math.cos(angle), -math.sin(angle), math.sin(angle), math.cos(angle)
    return turn @ matrix


def meaning_of_voxels(draw, shot: Shot) -> Shot:
    """What their numbers stand for, or where they lie."""
    volume, kind = shot.scene.volume, draw(st.sampled_from(("slope", "intercept", "affine")))
    if kind == "slope":
        return shot.with_scene(volume=replace(volume, slope=volume.slope * draw(st.sampled_from((0.8, 1.25)))))
    if kind == "affine":
        return shot.with_scene(volume=replace(volume, affine=volume.affine @ stretched(draw)))
    low, high = value_range(volume)
    return shot.with_scene(volume=replace(volume, intercept=volume.intercept + 0.1 * (high - low)))


def about(middle, linear) -> np.ndarray:
    """(4, 4): ``linear`` (4, 4) about a place of the world."""
    to, back = np.eye(4), np.eye(4)
    to[:3, 3], back[:3, 3] = -middle, middle
    return back @ linear @ to


def matrix_of_volume(draw, shot: Shot) -> Shot:
    """Turned or stretched about its middle, and moved by a tenth of its size; or the scene's scale."""
    if draw(st.integers(0, 3)) == 0:
        return shot.with_scene(scene_scale=shot.scene.scene_scale * draw(st.sampled_from((0.9, 1.1))))
    middle, reach = reach_of(shot.scene)
    matrix = about(middle, stretched(draw)) @ shot.scene.volume_matrix
    matrix[:3, 3] += draw(st.sampled_from((0.0, 0.2))) * reach * draw(UNIT)
    return shot.with_scene(volume_matrix=matrix)


# --- the camera and the picture -------------------------------------------------------------------------------

CAMERAS = {
    "sensor_fit": st.sampled_from(("AUTO", "HORIZONTAL", "VERTICAL")),
    "pixel_aspect": st.sampled_from(((1.0, 1.0), (1.0, 2.0))),
    "shift_x": st.sampled_from((-0.2, 0.0, 0.1)), "shift_y": st.sampled_from((-0.1, 0.0, 0.2)),
    "aperture_blades": st.sampled_from((0, 3, 5)), "aperture_rotation": UNIT,
}  # fmt: skip


def orbit(draw, shot: Shot) -> Shot:
    """The camera turned about the volume, so that other light is mirrored and other principal axes are nearest."""
    middle, _ = reach_of(shot.scene)
    turn = np.eye(4)
    turn[:3, :3] = rotation(np.random.default_rng(draw(SEEDS)))
    if draw(st.booleans()):
        angle = 0.6 * draw(UNIT) - 0.3
        turn[:2, :3] = (math.cos(angle), -math.sin(angle), 0.0), (math.sin(angle), math.cos(angle), 0.0)
        turn[2, :3] = 0.0, 0.0, 1.0
    return shot.with_camera(matrix_world=about(middle, turn) @ shot.scene.camera.matrix_world)


def knob_of_camera(draw, shot: Shot) -> Shot:
    """Another camera; or one knob of it."""
    camera, scene = shot.scene.camera, shot.scene
    kind = draw(st.sampled_from(("other", "further off", "nearer", "knob")))
    if kind == "other":
        return shot.with_scene(camera=drawn_camera(draw, scene.index_to_world, scene.volume.shape_xyz))
    if kind != "knob":
        return further_off(shot, 1.25 if kind == "nearer" else 0.8)
    return shot.with_scene(camera=one_changed(draw, camera, CAMERAS))


def picture(draw, shot: Shot) -> Shot:
    """Another size, a part of it alone, or the volume further off, so that voxels are smaller than pixels."""
    if draw(st.booleans()):
        return further_off(shot, draw(st.sampled_from((4.0, 0.25))))
    width, height = draw(st.sampled_from(((WIDTH, HEIGHT), (WIDTH - 5, HEIGHT), (HEIGHT, WIDTH))))
    crop = draw(st.sampled_from((None, None, (3, 2, 17, 15), (8, 0, 9, 20))))
    return shot.with_scene(width=width, height=height, crop=crop)


def blur(draw, shot: Shot) -> Shot:
    """A lens; or a shutter, with a volume or a camera that moves; or neither, where there was one."""
    if is_blurred(shot):
        return shot.with_scene(motion=()).with_camera(aperture_radius=0.0)
    if draw(st.booleans()):
        return replace(shot, scene=GIVEN["depth of field"](draw, shot.scene, None))
    _, reach = reach_of(shot.scene)
    moves, along = draw(st.sampled_from(("camera_matrix", "volume_matrix"))), draw(st.integers(0, 2))
    moved = Pose(shot.scene.camera.matrix_world, shot.scene.volume_matrix)
    matrix = getattr(moved, moves).copy()
    matrix[along, 3] += 0.1 * reach
    return shot.with_scene(motion=(moved, replace(moved, **{moves: matrix})))


def limited_blur(shot: Shot) -> Shot:
    """The shot blurred by no more than BLUR."""
    blur = widest_blur(shot.scene)
    if blur > BLUR:
        shot = shot.with_camera(aperture_radius=shot.scene.camera.aperture_radius * BLUR / blur)
    if distance_moved(shot.scene) > BLUR:
        shot = shot.with_scene(motion=())
    return shot


def is_blurred(shot: Shot) -> bool:
    return bool(shot.scene.motion) or shot.scene.camera.aperture_radius > 0.0


# --- light ----------------------------------------------------------------------------------------------------


def changed_one(draw, items: tuple, new, change, most: int = 2) -> tuple:
    """Some of several things: one more, one less, or one of them otherwise."""
    number = draw(st.integers(0, len(items) - 1)) if items else 0
    kind = draw(st.sampled_from(("more", "less", "other", "other", "other")))
    if not items or (kind == "more" and len(items) < most):
        return (*items, new())
    others = (items[:number], items[number + 1 :])
    return (*others[0], *others[1]) if kind == "less" else (*others[0], change(items[number]), *others[1])


def lights(draw, shot: Shot) -> Shot:
    """One more light, or one less, or one knob of one."""
    scene = shot.scene
    _, reach = reach_of(scene)
    moved = pose_near(scene, np.random.default_rng(draw(SEEDS)), 1.0 / reach)
    knobs = {
        "type": st.sampled_from(LIGHT_TYPES), "color": COLORS, "casts_shadow": st.booleans(),
        "radius": st.sampled_from((0.0, 0.3 * reach)), "angle": st.sampled_from((0.0, 0.4)),
        "size": st.sampled_from((0.2 * reach, reach)), "size_y": st.sampled_from((0.2 * reach, reach)),
        "shape": st.sampled_from(("SQUARE", "RECTANGLE", "DISK", "ELLIPSE")),
        "spot_size": st.sampled_from((0.3, 0.8, 1.5)), "spot_blend": UNIT,
    }  # fmt: skip

    def otherwise(light):
        kind = draw(st.sampled_from(("knob", "knob", "energy", "place", "direction")))
        if kind == "energy":
            return replace(light, energy=light.energy * draw(st.sampled_from((0.0, 0.5, 2.0))))
        if kind == "knob":
            return one_changed(draw, light, knobs)
        pose = light.matrix_world.copy()
        part = (slice(0, 3), 3) if kind == "place" else (slice(0, 3), slice(0, 3))
        pose[part] = moved[part]
        return replace(light, matrix_world=pose)

    return shot.with_scene(lights=changed_one(draw, scene.lights, lambda: drawn_light(draw, scene), otherwise))


def headlight(draw, shot: Shot) -> Shot:
    return shot.with_scene(headlight=not shot.scene.headlight)


def volume_shadows(draw, shot: Shot) -> Shot:
    return shot.with_scene(volume_shadows=not shot.scene.volume_shadows)


def world(draw, shot: Shot) -> Shot:
    return shot.with_scene(world=draw(st.sampled_from((None, (0.5, 0.5, 0.5), (0.7, 0.2, 0.4)))))


def ambient_occlusion(draw, shot: Shot) -> Shot:
    others = [strength for strength in (0.0, 0.4, 0.7, 1.0) if strength != shot.scene.ambient_occlusion]
    return shot.with_scene(ambient_occlusion=draw(st.sampled_from(others)))


def indirect_light(draw, shot: Shot) -> Shot:
    others = [amount for amount in (0.0, 0.5, 1.0) if amount != shot.scene.indirect_light]
    return shot.with_scene(indirect_light=draw(st.sampled_from(others)))


def mist(draw, shot: Shot) -> Shot:
    scene = shot.scene
    if scene.mist is not None and draw(st.booleans()):
        knobs = {"falloff": st.sampled_from(MIST_FALLOFFS), "color": COLORS}
        return shot.with_scene(mist=one_changed(draw, scene.mist, knobs))
    middle, reach = reach_of(scene)
    away = float(np.linalg.norm(scene.camera.matrix_world[:3, 3] - middle))
    drawn = Mist(max(away - reach * draw(UNIT), 0.0), reach * (0.5 + 2.0 * draw(UNIT)), color=draw(COLORS))
    return shot.with_scene(mist=draw(st.sampled_from((None, drawn))))


# --- what cuts and hides --------------------------------------------------------------------------------------


def clips(draw, shot: Shot) -> Shot:
    scene = shot.scene
    random = np.random.default_rng(draw(SEEDS))

    def drawn():
        kinds = draw(st.sampled_from(CLIP_KINDS)), draw(st.sampled_from(CLIP_SIDES))
        return Clip(kinds[0], pose_near(scene, random, 0.6), kinds[1])

    def otherwise(clip):
        knobs = {
            "kind": st.sampled_from(CLIP_KINDS), "keep": st.sampled_from(CLIP_SIDES),
            "matrix_world": st.just(pose_near(scene, random, 0.6)),
        }  # fmt: skip
        return one_changed(draw, clip, knobs)

    return shot.with_scene(clips=changed_one(draw, scene.clips, drawn, otherwise))


def meshes(draw, shot: Shot) -> Shot:
    """Triangles about the volume, one of their corners elsewhere, or none."""
    held = shot.scene.triangles
    if held is not None and draw(st.booleans()):
        moved = held.copy()
        moved[0, 0] += 0.3 * reach_of(shot.scene)[1]
        return shot.with_scene(triangles=draw(st.sampled_from((None, moved))))
    return replace(shot, scene=with_meshes(draw, shot.scene, np.random.default_rng(draw(SEEDS))))


# --- several volumes, several modes ---------------------------------------------------------------------------


def labels(draw, shot: Shot) -> Shot:
    """Other labels of some voxels, another function of a label, a label hidden, none of them, or no labels."""
    scene, held = shot.scene, shot.scene.labels
    kind = draw(st.sampled_from(("labels", "function", "function", "hidden", "function taken away", "none", "none")))
    if held is None or kind == "labels":
        random = np.random.default_rng(draw(SEEDS))
        numbers = random.integers(0, 3, scene.volume.voxels.shape).astype(draw(st.sampled_from(("uint8", "int32"))))
        functions = {1: drawn_function(draw, scene.volume), 2: None} if held is None else held.functions
        return shot.with_scene(labels=Labels(Volume(numbers, scene.volume.affine), functions))
    if kind == "none":
        return shot.with_scene(labels=None)
    number, functions = draw(st.integers(0, 2)), dict(held.functions)
    functions[number] = drawn_function(draw, scene.volume) if kind == "function" else None
    if kind == "function taken away":
        del functions[number]
    return shot.with_scene(labels=replace(held, functions=functions))


def channels(draw, shot: Shot) -> Shot:
    scene = shot.scene

    def drawn():
        volume = drawn_volume(draw, scene.volume.voxels.shape, scene.volume.affine)
        return Channel(volume, drawn_function(draw, volume))

    def otherwise(channel):
        part = draw(st.sampled_from(("volume", "transfer_function")))
        return replace(channel, **{part: getattr(drawn(), part)})

    return shot.with_scene(channels=changed_one(draw, scene.channels, drawn, otherwise, most=1))


def mode(draw, shot: Shot) -> Shot:
    return shot.with_scene(mode=draw(st.sampled_from((*4 * MODES[:1], *MODES))))


def forced_effects(draw, shot: Shot) -> Shot:
    """One effect turned off by hand, or left to the scene again, as is the function's name."""
    shot = shot.with_function(name=draw(st.sampled_from(("one", "two"))))
    name = draw(st.sampled_from(sorted(GIVEN)))
    forced = {other: on for other, on in shot.scene.effects.items() if other != name}
    return shot.with_scene(effects=forced if draw(st.booleans()) else {**forced, name: False})


# --- the plan -------------------------------------------------------------------------------------------------


def classification(draw, shot: Shot) -> Shot:
    """Another one; what the new one does not have goes back to what it has."""
    quality = shot.quality
    wanted = draw(st.sampled_from(("post", *CLASSIFICATIONS)))
    if wanted == "post":
        quality = replace(quality, **POST_ONLY)
    elif quality.depth_rule.startswith("preintegrated"):
        quality = quality.preset("draft", quality.classification, threads=quality.threads)
    return replace(shot, quality=quality.classified(wanted))


def preset(draw, shot: Shot) -> Shot:
    drawn = Quality.preset(draw(st.sampled_from(sorted(QUALITY_PRESETS))), shot.quality.classification)
    return replace(shot, quality=replace(drawn, threads=shot.quality.threads))


def knob_of_plan(draw, shot: Shot) -> Shot:
    """One knob at any of its values that the classification has."""
    post = shot.quality.classification == "post"
    knobs = {
        "depth_rule": st.sampled_from(SCALAR_DEPTH_RULES if post else DEPTH_RULES),
        "sheet_density": st.sampled_from((0.0, 0.5, 1.0, 1.5)), "warp_filter": st.sampled_from(WARP_FILTERS),
        "termination": st.sampled_from((0.0, 1 / 256)), "axis_fade": st.sampled_from((0.0, 2.0, 15.0)),
    }  # fmt: skip
    if post:
        knobs["rays"] = st.sampled_from((0.0, 0.05, 0.05))
    else:
        knobs |= {"kernel": st.sampled_from(FOOTPRINTS), "length_correction": st.booleans()}
    if shot.quality.classification == "pre":
        knobs["minification"] = st.sampled_from(MINIFICATIONS)
    return replace(shot, quality=one_changed(draw, shot.quality, knobs))


def records_of_voxels(draw, shot: Shot) -> Shot:
    """Other records of classified voxels: how many bytes they take, or the other model."""
    if shot.quality.classification == "post":
        return shot
    if draw(st.booleans()):
        return shot.with_quality(record=draw(st.sampled_from(RECORDS)))
    (other,) = (model for model in MODELS if model != shot.quality.model)
    return shot.with_quality(model=other)


def threads(draw, shot: Shot) -> Shot:
    """One thread or two."""
    return shot.with_quality(threads=3 - shot.quality.threads)


def without_extras(draw, shot: Shot) -> Shot:
    """A plain scene again: much of what effects do hides what others do."""
    plain = dict(labels=None, channels=(), mode="composite", mist=None, motion=(), crop=None, effects={}, clips=())
    drawn = draw(st.booleans())
    lit = shot.with_scene(**plain, triangles=None, volume_shadows=drawn, ambient_occlusion=0.0, indirect_light=0.0)
    return lit.with_camera(aperture_radius=0.0)


EDITS = (
    heights_of_opacity, window, colors_of_values, opacity_distance, gradient_opacity, shading, voxels,
    meaning_of_voxels, matrix_of_volume, orbit, knob_of_camera, picture, blur, lights, headlight, volume_shadows, world,
    ambient_occlusion, indirect_light, mist, clips, meshes, labels, channels, mode, forced_effects, classification,
    preset, knob_of_plan, records_of_voxels, threads, without_extras,
)  # fmt: skip


def taken_over(draw, shot: Shot, other: Shot) -> Shot:
    """One part of another shot in place of one's own: they share it from now on."""
    parts = [field.name for field in fields(Scene)]
    name = draw(st.sampled_from([*parts, "quality"]))
    if name == "quality":
        return replace(shot, quality=other.quality)
    return shot.with_scene(**{name: getattr(other.scene, name)})
