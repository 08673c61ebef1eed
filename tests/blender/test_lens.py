"""Depth of field, motion blur and anti-aliasing as Blender's camera, render settings and animation say them."""

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")


@pytest.fixture
def blot(tmp_path):
    """A soft blot of a medium about the world's origin, drawn 48 pixels wide by a camera 4 units before it."""
    found = scenes.blot_scene(tmp_path)
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = 96
    return found


def plain_scene(bridge, volume_object, **options):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return bridge("scene.render_scene").read_scene(volume_object, depsgraph, with_meshes=False, **options)[0]


def picture(volume_object):
    bpy.context.view_layer.objects.active = volume_object
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    image = bpy.context.scene.rle_splat.image
    return np.array(image.pixels[:]).reshape(image.size[1], image.size[0], 4)[..., 3]


def widths(alpha):
    position = np.arange(alpha.shape[0])
    shares = alpha.sum(axis=0) / alpha.sum(), alpha.sum(axis=1) / alpha.sum()
    return [float(share @ position**2 - (share @ position) ** 2) for share in shares]


def test_the_aperture_is_that_of_the_f_number(blot, bridge):
    dof = bpy.context.scene.camera.data.dof
    assert plain_scene(bridge, blot).camera.aperture_radius == 0.0
    dof.use_dof, dof.aperture_fstop, dof.focus_distance = True, 0.25, 6.0
    dof.aperture_blades, dof.aperture_rotation, dof.aperture_ratio = 5, 0.5, 2.0
    camera = plain_scene(bridge, blot).camera
    assert camera.aperture_radius == pytest.approx(0.050 / 0.25 / 2.0, rel=1e-6)
    assert (camera.focus_distance, camera.aperture_blades, camera.aperture_ratio) == (6.0, 5, 2.0)
    assert camera.aperture_rotation == pytest.approx(0.5)


def test_an_orthographic_camera_has_the_aperture_of_a_lens_of_one_unit(blot, bridge):
    """Its radius is one over twice the f-number."""
    data = bpy.context.scene.camera.data
    data.type, data.ortho_scale = "ORTHO", 3.0
    data.dof.use_dof, data.dof.aperture_fstop, data.dof.focus_distance = True, 4.0, 6.0
    assert plain_scene(bridge, blot).camera.aperture_radius == pytest.approx(0.125)
    blurred = widths(picture(blot))
    data.dof.use_dof = False
    sharp = widths(picture(blot))
    diameter = 96.0 / 3.0 * 0.25 * 2.0 / 6.0  # pixels: 2R |z - f| / f, 96 of them for 3 units
    assert 4.0 * np.sqrt(np.subtract(blurred, sharp)) == pytest.approx(np.full(2, diameter), rel=0.06)


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("depth", [7.0, 14.0])
def test_cycles_blurs_a_bright_speck_as_far(addon, bridge, core, tmp_path, kind, depth):
    """The radius that a plain Camera has, in the formula that the splat's blur is held to, is Cycles' own."""
    half = 0.04
    corners = [(x, y, -depth) for x, y in ((-half, -half), (half, -half), (half, half), (-half, half))]
    scenes.add_mesh(corners, [(0, 1, 2, 3)], (1000.0,) * 3)
    data = scenes.add_camera((0.0, 0.0, 0.0), type=kind, lens=60.0, ortho_scale=6.0).data
    scenes.use_cycles((128, 128), samples=256)
    bpy.context.scene.cycles.use_adaptive_sampling = False
    sharp = widths(scenes.rendered(tmp_path / "sharp.exr")[..., 0])
    data.dof.use_dof, data.dof.aperture_fstop = True, 1.0 if kind == "ORTHO" else 0.05
    data.dof.focus_distance = 10.0
    blurred = widths(scenes.rendered(tmp_path / "blurred.exr")[..., 0])
    camera, width, height = bridge("scene.camera").read_camera(bpy.context.evaluated_depsgraph_get())
    expected = core("effects.lens").blur_pixels(camera, width, height, depth)
    assert expected > 5.0
    assert 4.0 * np.sqrt(np.subtract(blurred, sharp)) == pytest.approx(np.full(2, expected), rel=0.05)


def test_a_focus_object_is_measured_along_the_view(blot, bridge):
    target = bpy.data.objects.new("Focus", None)
    bpy.context.scene.collection.objects.link(target)
    target.location = (3.0, 1.0, -1.5)
    dof = bpy.context.scene.camera.data.dof
    dof.use_dof, dof.focus_object, dof.focus_distance = True, target, 1.0
    bpy.context.view_layer.update()
    assert plain_scene(bridge, blot).camera.focus_distance == pytest.approx(5.5, rel=1e-6)


def test_render_image_is_out_of_focus_by_the_thin_lens(blot):
    sharp = widths(picture(blot))
    dof = bpy.context.scene.camera.data.dof
    dof.use_dof, dof.aperture_fstop, dof.focus_distance = True, 0.25, 6.0
    blurred = widths(picture(blot))
    diameter = 96.0 * 50.0 / 36.0 * 0.2 * 2.0 / (4.0 * 6.0)  # pixels: S 2R |z - f| / (z f)
    assert 4.0 * np.sqrt(np.subtract(blurred, sharp)) == pytest.approx(np.full(2, diameter), rel=0.06)


def test_render_image_blurs_a_moving_volume_along_its_way(blot):
    scene = bpy.context.scene
    for frame, x in ((0, -0.5), (2, 0.5)):
        blot.location.x = x - 0.12
        blot.keyframe_insert("location", index=0, frame=frame)
    for layer_curve in curves_of(blot):
        for point in layer_curve.keyframe_points:
            point.interpolation = "LINEAR"
    scene.frame_set(1)
    sharp = widths(picture(blot))
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 0.5
    blot.scale.y = 1.25  # not keyed, and must not be lost
    bpy.context.view_layer.update()
    stretched_scenes = len(bpy.data.scenes)
    moved = widths(picture(blot))
    length = 0.25 / 4.0 * 96.0 * 50.0 / 36.0  # half a unit a frame, half a frame
    assert np.sqrt(12.0 * (moved[0] - sharp[0])) == pytest.approx(length, rel=0.05)
    assert moved[1] > 1.3 * sharp[1] and blot.scale.y == pytest.approx(1.25)
    assert scene.frame_current == 1 and len(bpy.data.scenes) == stretched_scenes == 1


def test_an_unkeyed_move_of_an_animated_object_survives(blot):
    scene = bpy.context.scene
    for frame, x in ((0, -0.5), (2, 0.5)):
        blot.location.x = x - 0.12
        blot.keyframe_insert("location", index=0, frame=frame)
    scene.frame_set(1)
    blot.location.x = 0.125
    scene.render.use_motion_blur = True
    picture(blot)
    assert blot.location.x == pytest.approx(0.125)


def test_what_does_not_move_has_no_poses(blot, bridge):
    bpy.context.scene.render.use_motion_blur = True
    assert plain_scene(bridge, blot).motion == ()


def curves_of(owner):
    action = owner.animation_data.action
    if hasattr(action, "fcurves"):
        return action.fcurves
    (bag,) = action.layers[0].strips[0].channelbags
    return bag.fcurves


def test_anti_aliasing_is_that_of_the_scene_without_a_maximum_error(blot, bridge):
    settings = bpy.context.scene.rle_splat
    assert not plain_scene(bridge, blot).antialias
    before = picture(blot)
    settings.antialias = True
    assert plain_scene(bridge, blot).antialias
    after = picture(blot)
    assert 0.0 < np.abs(after - before).max() < 0.2 and after.sum() == pytest.approx(before.sum(), rel=0.01)
    settings.max_error = 4.0
    assert not plain_scene(bridge, blot).antialias
