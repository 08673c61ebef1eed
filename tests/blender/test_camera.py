"""The camera is Blender's own: its projection number by number, and what Cycles shows at a place is where we splat."""

import itertools
import math

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy", "classified_first")

SIZES = ((64, 48), (48, 64))
ASPECTS = ((1.0, 1.0), (2.0, 1.0), (1.0, 1.5))
SHIFTS = ((0.0, 0.0), (0.1, -0.25))


def place_parent(camera, scale, rotation=(0.3, 0.2, 0.1)):
    parent = bpy.data.objects.new("parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.scale, parent.rotation_euler = scale, rotation
    camera.parent = parent
    return parent


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (2.0, 0.5, 3.0), (-1.0, 1.0, 1.0)])
@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
def test_projection_is_blenders(bridge, core, kind, fit, scale):
    camera = scenes.add_camera(
        (1.0, -2.0, 9.0), (0.2, 0.1, 0.4), type=kind, sensor_fit=fit, lens=37.3, sensor_width=31.0,
        sensor_height=21.0, ortho_scale=7.1)  # fmt: skip
    place_parent(camera, scale)
    render = bpy.context.scene.render
    points = np.random.default_rng(1).uniform(-1.5, 1.5, (40, 3))
    for size, aspect, shift, percentage in itertools.product(SIZES, ASPECTS, SHIFTS, (100, 50, 33)):
        render.resolution_x, render.resolution_y, render.resolution_percentage = *size, percentage
        render.pixel_aspect_x, render.pixel_aspect_y = aspect
        camera.data.shift_x, camera.data.shift_y = shift
        depsgraph = bpy.context.evaluated_depsgraph_get()
        plain, width, height = bridge("scene.camera").read_camera(depsgraph)
        assert (width, height) == (size[0] * percentage // 100, size[1] * percentage // 100)

        homogeneous = np.c_[points, np.ones(len(points))]
        ours = homogeneous @ core("view.projection").world_to_pixel(plain, width, height).T
        ours = ours[:, :2] / ours[:, 2:]
        matrix = camera.calc_matrix_camera(
            depsgraph, x=width, y=height, scale_x=render.pixel_aspect_x, scale_y=render.pixel_aspect_y
        )
        to_view = np.linalg.inv(np.array(camera.evaluated_get(depsgraph).matrix_world.normalized(), dtype=np.float64))
        theirs = homogeneous @ to_view.T @ np.array(matrix, dtype=np.float64).T
        theirs = theirs[:, :2] / theirs[:, 3:]
        theirs = np.c_[(theirs[:, 0] / 2 + 0.5) * width, height - (theirs[:, 1] / 2 + 0.5) * height]
        # Blender's matrix is float32: eight ulp of the largest pixel coordinate that occurs.
        largest = max(np.abs(theirs).max(), width, height)
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=8 * np.finfo(np.float32).eps * largest)


# Every camera of blender.md: name -> (camera settings, render settings, scale of the camera's parent).
CAMERAS = {
    "landscape": ({}, {}, None),
    "portrait": ({}, {"resolution_x": 72, "resolution_y": 96}, None),
    "shift": ({"shift_x": 0.12, "shift_y": -0.08}, {}, None),
    "fit vertical": ({"sensor_fit": "VERTICAL", "shift_x": 0.05}, {}, None),
    "fit horizontal portrait": (
        {"sensor_fit": "HORIZONTAL", "shift_y": 0.07}, {"resolution_x": 72, "resolution_y": 96}, None),
    "orthographic": ({"type": "ORTHO"}, {}, None),
    "orthographic shift portrait": (
        {"type": "ORTHO", "shift_x": 0.1, "shift_y": 0.05}, {"resolution_x": 72, "resolution_y": 96}, None),
    "orthographic vertical": ({"type": "ORTHO", "sensor_fit": "VERTICAL"}, {}, None),
    "pixel aspect 2:1": ({}, {"pixel_aspect_x": 2.0}, None),
    "pixel aspect 1:1.5": ({"shift_y": 0.05}, {"pixel_aspect_y": 1.5}, None),
    "pixel aspect 1.5:1 orthographic": ({"type": "ORTHO"}, {"pixel_aspect_x": 1.5}, None),
    "half": ({}, {"resolution_x": 192, "resolution_y": 144, "resolution_percentage": 50}, None),
    "scaled parent": ({}, {}, (2.0, 0.5, 3.0)),
    "scaled parent orthographic": ({"type": "ORTHO"}, {}, (0.5, 0.5, 0.5)),
}  # fmt: skip


@pytest.mark.parametrize("name", CAMERAS)
def test_a_voxel_is_where_cycles_shows_a_sphere(tmp_path, name):
    """A tiny emissive sphere and one opaque voxel at the same place agree to 0.1 pixel."""
    camera_settings, render_settings, parent_scale = CAMERAS[name]
    place = np.array((0.37, -0.21, 0.13))
    scene = scenes.use_cycles((96, 72), samples=64)
    for key, value in render_settings.items():
        setattr(scene.render, key, value)
    camera = scenes.add_camera(type="PERSP", lens=50.0, ortho_scale=4.0)
    for key, value in camera_settings.items():
        setattr(camera.data, key, value)
    scale = np.array(parent_scale or (1.0, 1.0, 1.0))
    if parent_scale is not None:
        place_parent(camera, parent_scale, (0.0, 0.0, 0.0))
    # Through a parent with unequal scale the camera's axes are skewed; its view still goes through the middle.
    camera.matrix_basis = Matrix.Translation(np.array((2.2, -3.9, 2.7)) / scale) @ _look_at(
        np.array((-2.2, 3.9, -2.7)) / scale
    )

    voxels = np.zeros((5, 5, 5), np.uint8)
    voxels[2, 2, 2] = 255
    spacing = 0.07
    owner = scenes.import_raw(tmp_path, voxels, (spacing,) * 3)
    owner.location = place - 2.0 * spacing
    scenes.give_transfer(owner, ((0.0, 0.0), (255.0, 1.0)), (1.0, 1.0, 1.0))
    scene.rle_splat.quality = "fine"
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    ours = scenes.image_pixels(scene.rle_splat.image)[..., 3]
    volume_seen = scenes.centroid(ours)

    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.05, segments=32, ring_count=16, location=place)
    bpy.context.object.data.materials.append(scenes.emission((1.0, 1.0, 1.0)))
    sphere_seen = scenes.centroid(scenes.rendered(tmp_path / "sphere.exr")[..., 3])
    assert ours.max() > 0.1
    assert np.hypot(*(volume_seen - sphere_seen)) < 0.1


def _look_at(direction):
    """Rotation whose -Z is ``direction``, with +Z of the world up."""
    forward = np.array(direction) / np.linalg.norm(direction)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    rotation = np.eye(4)
    rotation[:3, :3] = np.stack((right, up, -forward), axis=1)
    return Matrix(rotation.tolist())


def test_lights_are_read_as_evaluated(bridge):
    def add(kind, **settings):
        data = bpy.data.lights.new(kind, kind)
        for key, value in settings.items():
            setattr(data, key, value)
        light = bpy.data.objects.new(kind, data)
        bpy.context.scene.collection.objects.link(light)
        return light

    add("SUN", energy=3.0, color=(1.0, 0.5, 0.25), angle=0.1)
    add("POINT", energy=10.0, exposure=1.0, shadow_soft_size=0.2)
    add("SPOT", energy=5.0, spot_size=0.6, spot_blend=0.3, use_shadow=False).location = (1.0, 2.0, 3.0)
    add("AREA", energy=7.0, shape="RECTANGLE", size=2.0, size_y=0.5)
    add("POINT", energy=99.0).hide_render = True
    add("POINT", energy=0.0)
    warm = add("SUN", energy=1.0)
    warm.data.use_temperature, warm.data.temperature = True, 3000.0

    lights = bridge("scene.lights").read_lights(bpy.context.evaluated_depsgraph_get())
    by_kind = {}
    for light in lights:
        by_kind.setdefault(light.type, []).append(light)
    assert len(lights) == 5
    suns = sorted(by_kind["SUN"], key=lambda light: -light.energy)
    assert suns[0].energy == 3.0 and suns[0].color == (1.0, 0.5, 0.25) and suns[0].angle == pytest.approx(0.1)
    assert suns[1].color[0] > suns[1].color[1] > suns[1].color[2]
    assert by_kind["POINT"][0].energy == 20.0 and by_kind["POINT"][0].radius == pytest.approx(0.2)
    spot = by_kind["SPOT"][0]
    assert spot.spot_size == pytest.approx(0.6) and not spot.casts_shadow
    np.testing.assert_allclose(spot.matrix_world[:3, 3], (1.0, 2.0, 3.0))
    area = by_kind["AREA"][0]
    assert (area.shape, area.size, area.size_y) == ("RECTANGLE", 2.0, 0.5)


@pytest.mark.parametrize("kind", ["POINT", "SPOT", "SUN", "AREA", "ELLIPSE"])
def test_a_light_that_is_not_normalized_is_as_bright_as_cycles_makes_it(bridge, tmp_path, kind):
    """ "Normalize" off scales a light by its area: the plain energy read has the same ratio as two renders."""
    scene = scenes.use_cycles((8, 8), samples=256)
    scenes.add_camera((0.0, 0.0, 20.0), type="ORTHO", ortho_scale=0.2)
    scenes.add_white_floor(1.0)
    data = bpy.data.lights.new("light", "AREA" if kind == "ELLIPSE" else kind)
    data.energy = 10.0
    settings = {
        "AREA": {"size": 0.6}, "ELLIPSE": {"shape": "ELLIPSE", "size": 0.6, "size_y": 0.3}, "SUN": {"angle": 0.4},
    }.get(kind, {"shadow_soft_size": 0.3})  # fmt: skip
    for key, value in settings.items():
        setattr(data, key, value)
    light = bpy.data.objects.new("light", data)
    light.location = (0.0, 0.0, 6.0)
    scene.collection.objects.link(light)
    brightness, energy = [], []
    for normalized in (True, False):
        data.normalize = normalized
        brightness.append(float(scenes.rendered(tmp_path / "lit.exr")[..., 1].mean()))
        energy.append(bridge("scene.lights").read_lights(bpy.context.evaluated_depsgraph_get())[0].energy)
    assert math.isclose(energy[1] / energy[0], brightness[1] / brightness[0], rel_tol=0.03)
