"""Motion blur: poses read from keyframes are Blender's own, nothing else is touched by reading them, and images,
a render and the list of effects agree on what is blurred and why not."""

import math

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

FRAME = 4


@pytest.fixture
def blot(tmp_path):
    """A soft blot of a medium about the world's origin, through a camera 4 units before it; Motion Blur is on."""
    found = scenes.blot_scene(tmp_path)
    scene = scenes.use_cycles((48, 48))
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 0.8
    scene.frame_set(FRAME)
    return found


def key(owner, path, *values, first=1, step=3, index=-1):
    """Keyframes of ``values`` on ``owner``, by Blender's own interpolation."""
    for number, value in enumerate(values):
        if index >= 0:
            getattr(owner, path)[index] = value
        else:
            setattr(owner, path, value)
        owner.keyframe_insert(path, index=index, frame=first + number * step)
    bpy.context.scene.frame_set(FRAME)


def empty(name="Empty", **settings):
    found = bpy.data.objects.new(name, None)
    for property_name, value in settings.items():
        setattr(found, property_name, value)
    bpy.context.scene.collection.objects.link(found)
    return found


def read(bridge, volume_object):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return bridge("scene.motion").read_motion(depsgraph, volume_object)


def blenders_own(volume_object, opens, closes, stretch=1.0):
    """((camera, volume) matrices at five times), as Blender has them after setting the frame."""
    scene, found = bpy.context.scene, []
    for time in np.linspace(opens, closes, 5):
        scene.frame_set(math.floor(time), subframe=time - math.floor(time))
        found.append((np.array(scene.camera.matrix_world.normalized()), np.array(volume_object.matrix_world)))
    scene.frame_set(FRAME)
    return found


def check_poses(bridge, volume_object, opens=FRAME - 0.4, closes=FRAME + 0.4):
    poses, reason = read(bridge, volume_object)
    assert reason == "" and len(poses) == 5
    for pose, (camera, placed) in zip(poses, blenders_own(volume_object, opens, closes), strict=True):
        np.testing.assert_allclose(pose.camera_matrix, camera, atol=2e-6)
        np.testing.assert_allclose(pose.volume_matrix, placed, atol=2e-6)
    first, last = poses[0], poses[-1]
    assert np.abs(first.camera_matrix - last.camera_matrix).max() + np.abs(
        first.volume_matrix - last.volume_matrix).max() > 0.01  # fmt: skip
    return poses


@pytest.mark.parametrize("mode", ["XYZ", "ZYX", "YXZ", "QUATERNION", "AXIS_ANGLE"])
def test_location_rotation_scale_and_their_deltas(blot, bridge, mode):
    blot.rotation_mode = mode
    blot.delta_location, blot.delta_scale = (0.1, -0.2, 0.3), (1.5, 0.75, 1.25)
    key(blot, "location", (-0.2, 0.0, 0.1), (0.3, -0.1, 0.0), (0.2, 0.4, -0.5))
    key(blot, "scale", (1.0, 2.0, 0.5), (0.5, 1.0, 2.0), (1.5, 1.5, 0.25))
    if mode == "QUATERNION":
        blot.delta_rotation_quaternion = (0.9, 0.1, -0.2, 0.4)
        key(blot, "rotation_quaternion", (1.0, 0.2, 0.0, 0.1), (0.5, 0.1, 0.7, 0.0), (0.2, -0.5, 0.0, 1.0))
    elif mode == "AXIS_ANGLE":
        key(blot, "rotation_axis_angle", (0.2, 1.0, 0.0, 0.5), (1.5, 0.5, 1.0, 0.0), (2.5, 0.0, 0.0, 3.0))
    else:
        blot.delta_rotation_euler = (0.3, -0.2, 0.7)
        key(blot, "rotation_euler", (0.1, 0.2, 0.3), (1.0, -0.6, 0.9), (2.0, 1.0, -1.0))
        key(blot, "delta_scale", 1.0, 1.5, 3.0, index=1)
    check_poses(bridge, blot)


def test_a_turntable_of_parents_with_inverses(blot, bridge):
    """The camera hangs on an Empty that turns, which hangs on another that rises, both moved before parenting."""
    lift, table = empty("lift", location=(0.5, 0.2, 0.1), scale=(1.0, 2.0, 1.0)), empty("table", location=(0.0, 1.0, 0))
    bpy.context.view_layer.update()
    for child, parent in ((table, lift), (bpy.context.scene.camera, table)):
        child.parent, child.matrix_parent_inverse = parent, parent.matrix_world.inverted()
        bpy.context.view_layer.update()
    key(table, "rotation_euler", 0.0, 1.0, 3.0, index=2)
    key(lift, "location", 0.0, 0.25, -0.5, index=2)
    check_poses(bridge, blot)


@pytest.mark.parametrize("axes", [("TRACK_NEGATIVE_Z", "UP_Y"), ("TRACK_X", "UP_Z"), ("TRACK_NEGATIVE_Y", "UP_X")])
@pytest.mark.parametrize("roll", [False, True])
def test_a_camera_that_tracks_a_moving_target(blot, bridge, axes, roll):
    target = empty("target", rotation_euler=(0.3, 0.8, 0.0))
    camera = bpy.context.scene.camera
    track = camera.constraints.new("TRACK_TO")
    track.target, (track.track_axis, track.up_axis), track.use_target_z = target, axes, roll
    camera.scale = (2.0, 0.5, 1.5)
    key(camera, "location", (0.0, 1.0, 4.0), (1.0, 2.0, 3.5), (2.0, 0.0, 4.5))
    key(target, "location", (0.0, 0.1, 0.0), (0.3, -0.3, 0.1), (0.5, 0.5, 0.5))
    check_poses(bridge, blot)


@pytest.mark.parametrize("position, opens", [("START", 0.0), ("CENTER", -0.4), ("END", -0.8)])
def test_when_the_shutter_opens(blot, bridge, position, opens):
    bpy.context.scene.render.motion_blur_position = position
    key(blot, "location", -0.5, 0.1, 0.9, index=0)
    check_poses(bridge, blot, FRAME + opens, FRAME + opens + 0.8)


def test_a_stretched_timeline_and_a_frame_between_frames(blot, bridge):
    scene = bpy.context.scene
    key(blot, "location", -0.5, 0.1, 0.9, 0.2, index=0)
    scene.render.frame_map_old, scene.render.frame_map_new = 100, 75
    scene.frame_set(FRAME, subframe=0.25)
    poses, reason = read(bridge, blot)
    assert reason == ""
    own = blenders_own(blot, FRAME + 0.25 - 0.4, FRAME + 0.25 + 0.4)
    for pose, (_camera, placed) in zip(poses, own, strict=True):
        np.testing.assert_allclose(pose.volume_matrix, placed, atol=2e-6)


def test_what_an_f_curve_has_beside_keyframes(blot, bridge):
    """Modifiers count, and curves of muted groups; muted curves and muted drivers do not."""
    key(blot, "location", (-0.5, 0.1, 0.0), (0.4, 0.2, 0.3), (0.1, 0.3, 0.5))
    key(blot, "rotation_euler", 0.0, 1.0, 3.0, index=2)
    (bag,) = blot.animation_data.action.layers[0].strips[0].channelbags
    curves = {(curve.data_path, curve.array_index): curve for curve in bag.fcurves}
    waves = curves["location", 0].modifiers.new("FNGENERATOR")
    waves.amplitude, waves.use_additive = 0.5, True
    curves["location", 1].mute = True
    curves["rotation_euler", 2].group = muted = bag.groups.new("muted")
    muted.mute = True
    # Of a property that has keyframes too, Blender itself (5.0, 5.2) leaves the value of the frame before once in 3000
    # evaluations: a muted driver and an F-curve on one property are evaluated in no order.
    blot.driver_add("delta_location", 2).mute = True
    bpy.context.scene.frame_set(FRAME)
    check_poses(bridge, blot)


def test_a_still_camera_may_have_any_constraint(blot, bridge):
    """What never moves is where it is seen, whatever holds it there."""
    camera = bpy.context.scene.camera
    camera.parent = empty("stand", location=(0.25, 0.0, 0.0))
    copied = camera.constraints.new("COPY_LOCATION")
    copied.target, copied.influence = empty("post", location=(0.0, 0.5, 5.0)), 0.5
    key(blot, "location", -0.5, 0.1, 0.9, index=0)
    check_poses(bridge, blot)


class Handlers:
    """What another add-on may do: it counts, and it moves an object of its own with every frame."""

    KINDS = ("frame_change_pre", "frame_change_post", "depsgraph_update_pre", "depsgraph_update_post")

    def __init__(self, moved):
        self.calls, self.moved = [], moved

    def __enter__(self):
        self.functions = [(kind, self.handler(kind)) for kind in self.KINDS]
        for kind, function in self.functions:
            getattr(bpy.app.handlers, kind).append(function)
        return self

    def __exit__(self, *_):
        for kind, function in self.functions:
            getattr(bpy.app.handlers, kind).remove(function)

    def handler(self, kind):
        def call(scene, *_):
            self.calls.append(kind)
            if kind == "frame_change_post":
                self.moved.location.x = scene.frame_float

        return call


def test_B57_reading_poses_fires_no_handler_and_moves_nothing(blot, bridge):
    key(blot, "location", -0.5, 0.1, 0.9, index=0)
    moved = empty("moved by a handler")
    scene = bpy.context.scene
    with Handlers(moved) as handlers:
        scene.frame_set(FRAME)
        assert moved.location.x == FRAME and handlers.calls
        moved.location.x, blot.scale.y = 17.0, 1.25  # unkeyed
        depsgraph = bpy.context.evaluated_depsgraph_get()
        handlers.calls.clear()
        plain, _quality = bridge("scene.render_scene").read_scene(blot, depsgraph, with_meshes=False)
        assert len(plain.motion) == 5 and handlers.calls == []
        assert bpy.ops.rle_splat.list_effects() == {"FINISHED"}
        assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    assert not {"frame_change_pre", "frame_change_post"} & set(handlers.calls)
    assert moved.location.x == 17.0 and blot.scale.y == 1.25
    assert scene.frame_current == FRAME and len(bpy.data.scenes) == 1


def alpha(image):
    return scenes.image_pixels(image)[..., 3]


def width(weights):
    """The variance of where the weights are along the rows, in pixels."""
    position, share = np.arange(weights.shape[1]), weights.sum(axis=0) / weights.sum()
    return float(share @ position**2 - (share @ position) ** 2)


def picture(volume_object):
    bpy.context.view_layer.objects.active = volume_object
    return scenes.picture()


def test_B55_a_render_is_blurred_as_render_image_is_and_as_cycles_blurs_a_mesh(blot, tmp_path):
    """The same way on the picture, of a small bright mesh beside the volume, both on one Empty that moves."""
    scene = bpy.context.scene
    carriage = empty("carriage")
    blot.parent = carriage
    half = 0.1
    corners = [(x, y - 0.6, 0.0) for x, y in ((-half, -half), (half, -half), (half, half), (-half, half))]
    scenes.add_mesh(corners, [(0, 1, 2, 3)], (1.0,) * 3).parent = carriage
    key(carriage, "location", -0.5, 0.5, first=FRAME - 1, step=2, index=0)
    for curve in carriage.animation_data.action.layers[0].strips[0].channelbags[0].fcurves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    scene.frame_set(FRAME)
    scene.cycles.samples = 64
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    grown = {}
    for blurred in (False, True):
        scene.render.use_motion_blur = blurred
        whole = scenes.rendered(tmp_path / "frame.exr")[..., 3]
        of_render, of_image = scenes.image_pixels(scene.rle_splat.composite_image), picture(blot)
        np.testing.assert_array_equal(of_render, of_image)
        assert scene.rle_splat.effect_rows["motion blur"].on == blurred
        for name, weights in (("mesh", whole[30:40]), ("volume", of_render[..., 3])):
            grown[name, blurred] = width(weights)
    length = 0.5 * 0.8 / 4.0 * 48.0 * 50.0 / 36.0  # pixels: half a unit a frame, 0.8 of a frame, 4 units away
    for name in ("mesh", "volume"):
        assert math.sqrt(12.0 * (grown[name, True] - grown[name, False])) == pytest.approx(length, rel=0.05), name


def row(scene):
    assert bpy.ops.rle_splat.list_effects() == {"FINISHED"}
    return scene.rle_splat.effect_rows["motion blur"]


def off_because(scene):
    found = row(scene)
    assert not found.on
    return found.reason


def test_the_list_says_why_nothing_is_blurred(blot):
    scene, layer = bpy.context.scene, bpy.context.view_layer
    assert off_because(scene) == "no keyframe moves the camera or the volume while the shutter is open"
    key(blot, "location", -0.5, 0.1, 0.9, index=0)
    assert row(scene).on
    blot.location.x += 0.5
    assert off_because(scene) == "the volume is not where its keyframes place it; insert a keyframe"
    scene.frame_set(FRAME)
    layer.use_motion_blur = False
    assert off_because(scene) == "Motion Blur is off in the view layer"
    layer.use_motion_blur, scene.render.use_motion_blur = True, False
    assert off_because(scene) == "Motion Blur is off in the render settings"


def drive(one):
    one.driver_add("location", 0).driver.expression = "frame * 0.1"


def push_down(one):
    key(one, "location", -0.5, 0.1, 0.9, index=0)
    action = one.animation_data.action
    one.animation_data.nla_tracks.new().strips.new("strip", 1, action)
    one.animation_data.action = None


def follow_path(one):
    curve = bpy.data.curves.new("path", "CURVE")
    spline = curve.splines.new("POLY")
    spline.points.add(1)
    spline.points[1].co = (0.0, 0.0, 1.0, 1.0)
    path = bpy.data.objects.new("path", curve)
    bpy.context.scene.collection.objects.link(path)
    one.constraints.new("FOLLOW_PATH").target = path


def hang_on_bone(one):
    rig = bpy.data.objects.new("rig", bpy.data.armatures.new("rig"))
    bpy.context.scene.collection.objects.link(rig)
    one.parent, one.parent_type, one.parent_bone = rig, "BONE", "Bone"


def half_tracked(one):
    track = one.constraints.new("TRACK_TO")
    track.target, track.influence = empty("target"), 0.5
    key(track.target, "location", 0.0, 0.5, 0.9, index=0)


@pytest.mark.parametrize(
    "place, words",
    [
        (drive, "a driver"),
        (push_down, "NLA strips"),
        (follow_path, "the constraint Follow Path"),
        (hang_on_bone, "the bone that is its parent"),
        (half_tracked, "the constraint Track To"),
    ],
)
@pytest.mark.parametrize("of_a_parent", [False, True])
def test_what_keyframes_do_not_say_is_sharp_and_said_in_render_and_image_alike(
    blot, tmp_path, place, words, of_a_parent
):
    scene = bpy.context.scene
    camera = scene.camera
    if of_a_parent:
        camera.parent = empty("parent")
    key(blot, "location", -0.13, -0.12, -0.11, index=0)
    place(camera.parent if of_a_parent else camera)
    scene.frame_set(FRAME)
    reason = f"the camera depends on {words}, and only keyframes are read between frames; bake its motion to them"
    assert off_because(scene) == reason
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    scenes.rendered(tmp_path / "frame.exr")
    assert scene.rle_splat.effect_rows["motion blur"].reason == reason


def test_forcing_it_on_says_the_reason(blot, refused):
    bpy.context.scene.rle_splat.effect_overrides.motion_blur = "on"
    drive(blot)
    bpy.context.scene.frame_set(FRAME)
    refused(bpy.ops.rle_splat.render_image, "the volume depends on a driver")
