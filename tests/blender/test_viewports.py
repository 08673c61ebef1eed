"""What an import does to 3D viewports: a volume fits into the view, and what hides it is told."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Euler

from tests.blender import scenes

CUBE = np.full((4, 4, 4), 100, np.uint8)


@pytest.mark.parametrize("width, height", [(1280, 800), (600, 900), (500, 500)])
@pytest.mark.parametrize("lens", [35.0, 50.0, 85.0])
def test_a_sphere_touches_the_nearer_sides_of_the_view(bridge, width, height, lens):
    """By the projection of a viewport: a sensor of 72 mm along the longer side."""
    fit = bridge("scene.viewports").distance_to_fit
    nearer = min(width, height) / max(width, height)
    distance = fit(2.0, lens, nearer, False)
    assert 72.0 / lens * distance * nearer == pytest.approx(4.0)
    distance = fit(2.0, lens, nearer, True)
    tangent = 36.0 / lens * nearer
    # The plane through the eye and the shorter side touches the sphere: its distance from the center is the radius.
    assert distance * tangent / np.hypot(1.0, tangent) == pytest.approx(2.0)


def test_corners_are_those_of_the_box_in_the_world(addon, bridge, tmp_path):
    owner = scenes.import_raw(tmp_path, CUBE)
    owner.location = (1.0, 2.0, 3.0)
    owner.rotation_euler = (0.3, 0.2, 0.1)
    bpy.context.view_layer.update()
    scale = bpy.context.scene.rle_splat.scene_scale
    there = np.array(owner.matrix_world)
    true = 3.0 * scale * bridge("volumes.box").CORNERS @ there[:3, :3].T + there[:3, 3]
    np.testing.assert_allclose(bridge("volumes.box").world_corners(owner), true, atol=1e-6)
    owner.instance_collection.objects[0].data.clear_geometry()
    assert bridge("volumes.box").world_corners(owner).shape == (0, 3)


# LPS: +X is the patient's left, +Y the back, +Z the head.  What is right and up in the picture, as atlases show it.
SEEN = {
    "A": ((1, 0, 0), (0, 0, 1)), "P": ((-1, 0, 0), (0, 0, 1)), "L": ((0, 1, 0), (0, 0, 1)),
    "R": ((0, -1, 0), (0, 0, 1)), "I": ((1, 0, 0), (0, -1, 0)), "S": ((-1, 0, 0), (0, -1, 0)),
}  # fmt: skip


@pytest.mark.parametrize("side", SEEN)
def test_sides_of_a_patient_who_lies_anyhow(bridge, side):
    turn = np.array(Euler((0.4, -0.3, 1.1)).to_matrix())
    matrix = np.eye(4)
    matrix[:3, :3] = 0.001 * turn
    view = np.array(bridge("scene.viewports").rotation_from(side, matrix).to_matrix())
    right, up = SEEN[side]
    np.testing.assert_allclose(view[:, 0], turn @ right, atol=1e-6)
    np.testing.assert_allclose(view[:, 1], turn @ up, atol=1e-6)


@pytest.fixture
def viewport(addon):
    """The 3D viewport of the window that bpy opens a file with."""
    (area,) = (area for area in bpy.context.window.screen.areas if area.type == "VIEW_3D")
    return area


def test_a_volume_is_framed(viewport, bridge, tmp_path):
    owner = scenes.import_raw(tmp_path, CUBE)
    owner.location = (10.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    space, view = viewport.spaces.active, viewport.spaces.active.region_3d
    space.clip_start, space.clip_end = 1e3, 2e3
    view.view_perspective, before = "PERSP", view.view_rotation.copy()
    assert bpy.ops.rle_splat.frame_volume() == {"FINISHED"}
    corners = bridge("volumes.box").world_corners(owner)
    np.testing.assert_allclose(view.view_location, corners.mean(axis=0), atol=1e-5)
    radius = np.linalg.norm(corners - corners.mean(axis=0), axis=1).max()
    assert radius < view.view_distance < 10.0 * radius and view.view_rotation == before
    assert space.clip_start < 0.02 * radius and space.clip_end == 2e3

    view.view_perspective = "CAMERA"
    view.view_location = (0.0, 0.0, 0.0)
    bpy.ops.rle_splat.frame_volume()
    assert tuple(view.view_location) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("shape", [(40, 6, 6), (6, 40, 6), (6, 6, 40), (12, 12, 12)])
@pytest.mark.parametrize("side", ["A", "L", "S"])
@pytest.mark.parametrize("projection", ["PERSP", "ORTHO"])
def test_a_box_from_a_side_fills_the_view_and_no_more(viewport, bridge, tmp_path, shape, side, projection):
    scenes.import_raw(tmp_path, np.full(shape, 100, np.uint8))
    assert bpy.ops.rle_splat.reload_volume(orientation="LPS") == {"FINISHED"}
    owner, view, space = bpy.context.object, viewport.spaces.active.region_3d, viewport.spaces.active
    view.view_perspective = projection
    assert bpy.ops.rle_splat.frame_volume(side=side) == {"FINISHED"}
    corners = bridge("volumes.box").world_corners(owner) - np.array(view.view_location)
    right, up, back = (corners @ np.array(view.view_rotation.to_matrix())).T
    depth = view.view_distance - (back if projection == "PERSP" else 0.0)
    shares = np.abs((right, up)) / depth * space.lens / 36.0  # of half of the longer side: a sensor of 72 mm
    free = bridge("scene.viewports")._free_shares(viewport)
    assert max(shares[0].max() / free[0], shares[1].max() / free[1]) == pytest.approx(1.0 / 1.1, abs=0.05)


@pytest.mark.parametrize("sides", [(0.45, 0.45, 0.9), (0.9, 0.2, 0.2), (0.3, 0.3, 0.3)])
def test_a_four_up_view_shows_the_whole_box_from_its_sides(bridge, sides):
    """On an area in place of Blender's, which has no quad view in the background."""
    module, lens, (width, height) = bridge("scene.viewports"), 50.0, (1200, 900)
    turns = [module.rotation_from(side, np.eye(4)) for side in "IALA"]
    views = [SimpleNamespace(view_perspective="ORTHO", view_rotation=turn) for turn in turns]
    space = SimpleNamespace(lens=lens, region_quadviews=views, show_region_ui=False)
    area = SimpleNamespace(
        width=width, height=height, spaces=SimpleNamespace(active=space), tag_redraw=lambda: None
    )  # fmt: skip
    corners = (bridge("volumes.box").CORNERS - 0.5) * sides
    module.frame_quad(area, corners)
    for view in views:
        right, up, _ = np.abs((corners - view.view_location) @ np.array(view.view_rotation.to_matrix())).max(axis=0)
        seen = 36.0 / lens * view.view_distance  # half of the longer side of a region, a quarter of the area
        assert right <= seen and up <= seen * height / width
        assert max(right / seen, up / seen * width / height) > 0.85, "it is not small"


def test_what_is_visible_is_framed(viewport, bridge, tmp_path, monkeypatch):
    voxels = np.zeros((20, 20, 20), np.uint8)
    voxels[5:8, 9:12, 12:15] = 200
    owner, view = scenes.import_raw(tmp_path, voxels), viewport.spaces.active.region_3d
    view.view_perspective = "PERSP"
    whole, places = bridge("volumes.box").world_corners(owner).mean(axis=0), []
    for opacity, is_at_hand in ((((100.0, 0.0), (200.0, 1.0)), True), (((100.0, 0.0), (200.0, 1.0)), False),
                                (((0.0, 0.0), (255.0, 0.0)), True)):  # fmt: skip
        scenes.give_transfer(owner, opacity, (1.0, 1.0, 1.0))
        monkeypatch.setattr(bridge("volumes.loading"), "is_at_hand", lambda *_, found=is_at_hand: found)
        bpy.ops.rle_splat.frame_volume()
        places.append((*view.view_location, view.view_distance))
    there = np.array(owner.matrix_world)
    middle = there[:3, :3] @ (13.0, 10.0, 6.0) + there[:3, 3]
    np.testing.assert_allclose(places[0][:3], middle, atol=1e-4)
    assert places[0][3] < 0.4 * places[1][3] and places[1] == places[2]
    np.testing.assert_allclose(places[1][:3], whole, atol=1e-4)


def test_a_view_at_the_origin_of_a_volume_is_moved_back_and_no_other(viewport, bridge, tmp_path):
    """As Local View leaves it: at the corner of the volume, so near that a part of it is seen."""
    owner = scenes.import_raw(tmp_path, CUBE)
    owner.location = (10.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    corners, view = bridge("volumes.box").world_corners(owner), viewport.spaces.active.region_3d
    size = np.ptp(corners, axis=0).max()
    view.view_perspective = "PERSP"
    for place, distance, is_moved in (((10, 0, 0), 0.1, True), ((10, 0, 0), 2.0, False), ((11, 0, 0), 0.1, False)):
        view.view_location, view.view_distance = place, distance * size
        bridge("scene.viewports").frame_if_too_near(viewport, [(owner, corners)])
        apart = np.linalg.norm(np.array(view.view_location) - corners.mean(axis=0))
        assert (apart < 1e-4) == is_moved and (view.view_distance > size) == (is_moved or distance > 1.0)


def test_a_patient_is_seen_from_a_side(viewport, bridge, core, tmp_path, refused):
    owner = scenes.import_raw(tmp_path, CUBE)
    refused(bpy.ops.rle_splat.frame_volume, "does not say how the patient lies", side="A")
    owner.rle_splat.space = core("volume.volume").PATIENT
    view = viewport.spaces.active.region_3d
    view.view_perspective = "PERSP"
    assert bpy.ops.rle_splat.frame_volume(side="A") == {"FINISHED"}
    np.testing.assert_allclose(np.array(view.view_rotation.to_matrix())[:, 2], (0.0, -1.0, 0.0), atol=1e-6)
    owner.scale = (0.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    refused(bpy.ops.rle_splat.frame_volume, "has a scale of 0", side="A")


def test_what_cannot_be_framed_is_said(viewport, tmp_path, refused):
    owner = scenes.import_raw(tmp_path, CUBE)
    owner.instance_collection.objects[0].data.clear_geometry()
    (tmp_path / "cube.raw").unlink()
    refused(bpy.ops.rle_splat.frame_volume, "was changed or removed")
    viewport.type = "TEXT_EDITOR"
    refused(bpy.ops.rle_splat.frame_volume, "No 3D viewport is open")
    viewport.type = "VIEW_3D"


def test_a_mesh_around_the_volume_is_told(addon, bridge, tmp_path, capfd):
    bpy.ops.mesh.primitive_cube_add(size=200.0)
    cube = bpy.context.object
    cube.name = "Around"
    owner = scenes.import_raw(tmp_path, CUBE)
    viewports, layer = bridge("scene.viewports"), bpy.context.view_layer
    said = [line for line in capfd.readouterr().out.splitlines() if "Imported cube" in line]
    assert len(said) == 1 and "Around hides it" in said[0], "one message, of which a window shows all"
    corners = bridge("volumes.box").world_corners(owner)
    assert viewports.hiding_meshes(layer, corners) == ["Around"]

    def hides(**changes) -> bool:
        before = {name: getattr(cube, name) for name in changes}
        for name, value in changes.items():
            setattr(cube, name, value)
        layer.update()
        found = viewports.hiding_meshes(layer, corners)
        for name, value in before.items():
            setattr(cube, name, value)
        return found != []

    assert hides()
    assert not hides(display_type="WIRE")
    assert not hides(hide_viewport=True)
    assert not hides(location=(0.0, 0.0, 101.0))  # they cross
    assert not hides(scale=(0.0, 1.0, 1.0))


def test_a_mesh_between_the_eye_and_the_volume_hides_it(addon, bridge):
    """Wherever the eye is: before a wall, inside a thick one, within the same room; and for parallel rays."""
    viewports, layer = bridge("scene.viewports"), bpy.context.view_layer
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    bpy.ops.mesh.primitive_cube_add(size=2.0, location=(0.0, -8.0, 0.0), scale=(9.0, 1.0, 9.0))
    wall = bpy.context.object
    for eye, expected in (
        ((0.0, -20.0, 0.0, 1.0), [wall.name]), ((0.0, -8.0, 0.0, 1.0), [wall.name]), ((0.0, -5.0, 0.0, 1.0), []),
        ((0.0, -1.0, 0.0, 0.0), [wall.name]), ((0.0, 1.0, 0.0, 0.0), []), ((0.0, 20.0, 0.0, 1.0), []),
    ):  # fmt: skip
        assert viewports.hiding_meshes(layer, corners, eye) == expected, eye
    wall.scale, wall.location = (30.0, 30.0, 30.0), (0.0, 0.0, 0.0)
    layer.update()
    assert viewports.hiding_meshes(layer, corners, (0.0, -5.0, 0.0, 1.0)) == [], "a room"
    assert bpy.ops.rle_splat.hide_mesh(mesh=wall.name) == {"FINISHED"}
    assert not wall.visible_get() and wall.hide_render
    wall.hide_set(False)
    wall.location.x = 5.0
    wall.scale = 1.0, 30.0, 30.0
    layer.update()
    assert viewports.hiding_meshes(layer, corners, (20.0, 0.0, 0.0, 1.0)) == [wall.name]
    np.testing.assert_allclose(viewports.eye_of(np.linalg.inv([[1, 0, 0, 3], [0, 1, 0, 4], [0, 0, 1, 5], [0, 0, 0, 1]]),
                                                True), (3.0, 4.0, 5.0, 1.0))  # fmt: skip


def test_without_a_window_nothing_is_moved(addon, bridge):
    bridge("scene.viewports").frame(None, [np.zeros((8, 3)), np.ones((8, 3))])
    bridge("scene.viewports").open_tab(None)
