"""Edits of a scene and of the plan of its picture, for hypothesis to choose from: one kind each, most of them of one
number alone, as a user turns one knob.

An edit takes ``draw``, hypothesis' own, and a Shot; it returns the Shot after it.  Scenes are such that most edits can
be seen: a few voxels that fill the picture, none of them too thin, under lights about as bright as the sun.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
from hypothesis import strategies as st

from rle_splat.classify.transfer_function import HIGHLIGHTS, GradientOpacity, Shade, TransferFunction
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
    REFINEMENTS,
    WARP_FILTERS,
    Channel,
    Clip,
    Labels,
    Light,
    Mist,
    Pose,
    Quality,
    Scene,
)
from rle_splat.scene.clip import CLIP_SIDES
from rle_splat.volume.volume import Volume
from tests.stability.effect_strategies import GIVEN, pose_near, reach_of, with_meshes
from tests.stability.strategies import (
    FIELDS,
    SEEDS,
    affines,
    cameras,
    field_of,
    rotation,
    stored,
    value_range,
)

WIDTH, HEIGHT, MOST_VOXELS = 24, 20, 12
BLUR = 2.5  # pixels, at most: a wider one takes more pictures than a search has time for
# Integers have a table of values, floats have none, and doubles are kept as singles. Each stored type of scalar needs
# its own variants of the sheet loop compiled. So int16, which has the stages of uint8, is left to the other searches.
DTYPES = ("uint8", "float32", "float64")
# Evenly spread, where hypothesis' own floats are mostly ends: of black nothing is to be seen.
UNIT = st.sampled_from([number / 10 for number in range(11)])
COLORS = st.tuples(*[st.sampled_from((0.2, 0.4, 0.6, 0.8, 1.0))] * 3)
DEPTH_RULES = (*NAMED_DEPTH_RULES, "midpoint-1", "midpoint-3")
SCALAR_DEPTH_RULES = (*DEPTH_RULES, "preintegrated", "preintegrated-2")


@dataclass(frozen=True, eq=False)
class Shot:
    """A scene and the quality of its picture."""

    scene: Scene
    quality: Quality

    def with_scene(self, **changes) -> Shot:
        return replace(self, scene=replace(self.scene, **changes))

    def with_quality(self, **changes) -> Shot:
        return replace(self, quality=replace(self.quality, **changes))

    def with_function(self, **changes) -> Shot:
        return self.with_scene(transfer_function=replace(self.scene.transfer_function, **changes))

    def with_camera(self, **changes) -> Shot:
        return self.with_scene(camera=replace(self.scene.camera, **changes))


# --- what a search begins with --------------------------------------------------------------------------------


def drawn_volume(draw, shape, affine) -> Volume:
    """Any field in one of DTYPES; NaN and infinities among floats at times."""
    random = np.random.default_rng(draw(SEEDS))
    voxels = stored(field_of(draw(st.sampled_from(FIELDS)), shape, random), draw(st.sampled_from(DTYPES)))
    if voxels.dtype.kind == "f" and draw(st.integers(0, 3)) == 0:
        voxels[random.random(shape) < 0.05] = draw(st.sampled_from((np.nan, np.inf, -np.inf)))
    slope, intercept = draw(st.sampled_from(((1.0, 0.0), (-2.5, 0.125), (0.37, -11.0))))
    return Volume(voxels, affine, slope=slope, intercept=intercept)


def drawn_function(draw, volume: Volume) -> TransferFunction:
    """Opacities and colors over the values that there are, thick enough to be seen; shaded more often than not."""
    low, high = value_range(volume)

    def at(share):
        return low + share * (high - low)

    most, first = draw(st.sampled_from((0.2, 0.6, 1.0))), 0.6 * draw(UNIT)
    opacity = draw(st.sampled_from((
        ((at(first), 0.0), (at(1.0), most)),
        ((at(first), 0.0), (at(first), most)),
        ((at(first - 0.1), 0.0), (at(first), most), (at(first + 0.2), 0.0), (at(1.0), 0.5 * most)),
    )))  # fmt: skip
    shade = draw(st.sampled_from((Shade(), Shade(0.2, 0.8, 0.0), Shade(0.1, 0.6, 0.5, 5.0), None)))
    colors = (at(0.0), *draw(COLORS)), (at(1.0), *draw(COLORS))
    gradients = drawn_gradients(draw, volume) if draw(st.booleans()) else None
    return TransferFunction("drawn", None, opacity, colors, drawn_distance(draw, volume), shade, gradients)


def drawn_distance(draw, volume: Volume) -> float | None:
    """A length that opacities may refer to: of a few voxels; None for what the volume's spacing makes of it."""
    return None if draw(st.integers(0, 3)) == 0 else (1.0 + 2.0 * draw(UNIT)) * float(volume.spacing.min())


def drawn_gradients(draw, volume: Volume) -> GradientOpacity:
    low, high = value_range(volume)
    steepest = 0.5 * (high - low) / float(volume.spacing.min())
    return GradientOpacity(*sorted((0.3 * steepest * draw(UNIT), steepest * draw(UNIT))))


def drawn_light(draw, scene: Scene) -> Light:
    """About as bright on the volume as it is white, from beside it."""
    random = np.random.default_rng(draw(SEEDS))
    middle, reach = reach_of(scene)
    kind, away = draw(st.sampled_from(LIGHT_TYPES)), 1.5 * reach
    pose = np.eye(4)
    pose[:3, :3] = rotation(random)
    pose[:3, 3] = middle + away * pose[:3, 2]  # it shines along its -Z
    energy = math.pi if kind == "SUN" else 4.0 * math.pi**2 * away**2
    return Light(
        kind, draw(COLORS), energy, pose, radius=0.1 * reach, angle=0.1, size=0.5 * reach, size_y=0.3 * reach,
        casts_shadow=draw(st.integers(0, 3)) > 0,
    )  # fmt: skip


@st.composite
def shots(draw, kind: str) -> Shot:
    """A scene with lights at times, seen by any camera.  ``kind``: a classification, or the minification pool."""
    pooled = kind == "pool"
    shape = draw(st.tuples(*[st.integers(MOST_VOXELS - 2 if pooled else 4, MOST_VOXELS)] * 3))
    volume = drawn_volume(draw, shape, draw(affines(2.0, 0.3)))
    tf = drawn_function(draw, volume)
    camera = drawn_camera(draw, volume.affine, volume.shape_xyz)
    scene = Scene(volume, tf, camera, WIDTH, HEIGHT, headlight=draw(st.booleans()))
    lights = tuple(drawn_light(draw, scene) for _ in range(draw(st.sampled_from((0, 1, 1, 2)))))
    hidden = draw(st.sampled_from((0.0, 0.0, 0.7)))
    scene = replace(scene, lights=lights, volume_shadows=draw(st.booleans()), ambient_occlusion=hidden)
    name = draw(st.sampled_from(("draft", "standard", "fine")))
    shot = Shot(scene, Quality.preset(name, "pre" if pooled else kind, threads=1))
    # Several voxels to a sheet pixel: far off, and few sheet pixels.
    return further_off(shot.with_quality(minification=kind, sheet_density=0.5), 4.0) if pooled else shot


def drawn_camera(draw, index_to_world, shape_xyz):
    clipped = st.sampled_from((None, None, None, "start", "end"))
    return draw(cameras(index_to_world, shape_xyz, widest=100.0, shift=0.2, framed=True, clipped=clipped))


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
    """Another one; one of its ends alone; or none."""
    ends = shot.scene.transfer_function.gradient_opacity
    drawn = drawn_gradients(draw, shot.scene.volume)
    kind = draw(st.sampled_from(("other", "low", "low", "high", "high", "none")))
    if kind == "none":
        drawn = None
    elif ends is not None and kind == "low":
        drawn = GradientOpacity(draw(UNIT) * ends.high, ends.high)
    elif ends is not None and kind == "high":
        drawn = GradientOpacity(ends.low, ends.low + drawn.high)
    return shot.with_function(gradient_opacity=drawn)


SHADES = {
    "ambient": UNIT, "diffuse": UNIT, "specular": st.sampled_from((0.0, 0.3, 0.8)),
    "shininess": st.sampled_from((1.0, 5.0, 30.0)), "highlight": st.sampled_from(HIGHLIGHTS),
    "two_sided": st.booleans(),
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


def further_off(shot: Shot, times: float) -> Shot:
    """The volume so many times smaller in the picture: of voxels smaller than pixels, some are pooled."""
    camera = shot.scene.camera
    return shot.with_camera(lens=camera.lens / times, ortho_scale=camera.ortho_scale * times)


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
    """The shot blurred by no more than BLUR, and by kernels: the numpy versions take too long for several pictures."""
    blur = widest_blur(shot.scene)
    if blur > BLUR:
        shot = shot.with_camera(aperture_radius=shot.scene.camera.aperture_radius * BLUR / blur)
    if distance_moved(shot.scene) > BLUR:
        shot = shot.with_scene(motion=())
    return shot.with_quality(backend="auto") if is_blurred(shot) else shot


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
    """Another one, or another refinement; what the new one does not have goes back to what it has."""
    quality = shot.quality
    wanted = draw(st.sampled_from(("post", *CLASSIFICATIONS)))
    if wanted == "post":
        quality = replace(quality, **POST_ONLY)
    elif wanted == "refined":
        quality = replace(quality, minification="off", refinement=draw(st.sampled_from(REFINEMENTS)))
    if wanted != "post" and quality.depth_rule.startswith("preintegrated"):
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
        pooled = shot.quality.model == "extinction"
        knobs["minification"] = st.sampled_from(MINIFICATIONS if pooled else ("off", "widen"))
    return replace(shot, quality=one_changed(draw, shot.quality, knobs))


def records_of_voxels(draw, shot: Shot) -> Shot:
    """Other records of classified voxels: how many bytes they take, or the other model."""
    if shot.quality.classification == "post":
        return shot
    if shot.quality.minification == "pool" or draw(st.booleans()):
        return shot.with_quality(record=draw(st.sampled_from(RECORDS)))
    (other,) = (model for model in MODELS if model != shot.quality.model)
    return shot.with_quality(model=other)


def machine(draw, shot: Shot) -> Shot:
    """One thread or two; kernels or their reference implementations."""
    if draw(st.booleans()):
        return shot.with_quality(threads=3 - shot.quality.threads)
    return shot.with_quality(backend="auto" if shot.quality.backend == "numpy" else "numpy")


def without_extras(draw, shot: Shot) -> Shot:
    """A plain scene again: much of what effects do hides what others do."""
    plain = dict(labels=None, channels=(), mode="composite", mist=None, motion=(), crop=None, effects={}, clips=())
    drawn = draw(st.booleans())
    lit = shot.with_scene(**plain, triangles=None, volume_shadows=drawn, ambient_occlusion=0.0)
    return lit.with_camera(aperture_radius=0.0)


EDITS = (
    heights_of_opacity, window, colors_of_values, opacity_distance, gradient_opacity, shading, voxels,
    meaning_of_voxels, matrix_of_volume, orbit, knob_of_camera, picture, blur, lights, headlight, volume_shadows, world,
    ambient_occlusion, mist, clips, meshes, labels, channels, mode, forced_effects, classification, preset,
    knob_of_plan, records_of_voxels, machine, without_extras,
)  # fmt: skip


def taken_over(draw, shot: Shot, other: Shot) -> Shot:
    """One part of another shot in place of one's own: they share it from now on."""
    parts = [field.name for field in fields(Scene)]
    name = draw(st.sampled_from([*parts, "quality"]))
    if name == "quality":
        return replace(shot, quality=other.quality)
    return shot.with_scene(**{name: getattr(other.scene, name)})
