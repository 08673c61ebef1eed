"""What the panel and the camera's view say of a picture: that it no longer fits, what was left out, what changed."""

import bpy
import numpy as np
import pytest

from tests.blender import scenes
from tests.blender.test_panels import draw_all, texts

pytestmark = pytest.mark.usefixtures("by_numpy")

OUT_OF_DATE = "out of date"


@pytest.fixture
def owner(addon, tmp_path):
    return scenes.cube_scene(tmp_path)


@pytest.fixture
def said(monkeypatch):
    """``said()``: the lines of text in all panels."""
    return lambda: texts(draw_all(monkeypatch)).lower().splitlines()


def is_marked(lines) -> bool:
    return OUT_OF_DATE in " ".join(lines)  # which a narrow panel breaks


def edit_location(owner):
    owner.location.x += 1.0


def edit_quality(owner):
    bpy.context.scene.rle_splat.quality = "fine"


def edit_camera(owner):
    bpy.context.scene.camera.location.x += 1.0


def edit_window(owner):
    owner.rle_splat.window_center += 10.0


def edit_size(owner):
    bpy.context.scene.render.resolution_x = 20


def add_plane(owner):
    bpy.ops.rle_splat.add_cutting_object(kind="PLANE")
    scenes.activate(owner)


@pytest.mark.parametrize(
    "edit", [scenes.lower_curve, edit_location, edit_quality, edit_camera, edit_window, edit_size, add_plane]
)
@pytest.mark.parametrize("make", ["render_image", "preview_in_camera_view"])
def test_B80_an_edit_marks_the_picture(owner, said, make, edit):
    getattr(bpy.ops.rle_splat, make)()
    scenes.update()
    assert not is_marked(said())
    edit(owner)
    scenes.update()
    assert is_marked(said())
    getattr(bpy.ops.rle_splat, make)()
    assert not is_marked(said())


def test_B77_undo_after_preset_and_backdrop(owner, said):
    """The picture fits what the settings are now, or it is said that it does not."""
    name = owner.name
    bpy.ops.rle_splat.preview_in_camera_view()
    bpy.ops.ed.undo_push(message="backdrop")
    bpy.ops.rle_splat.apply_preset("EXEC_DEFAULT", True, preset="faint")
    bpy.ops.rle_splat.preview_in_camera_view("EXEC_DEFAULT", True)
    bpy.ops.ed.undo()
    if bpy.data.objects[name].rle_splat.transfer_name != "one color":
        bpy.ops.ed.undo()  # while pictures are steps of their own
    assert bpy.data.objects[name].rle_splat.transfer_name == "one color"
    scenes.update()
    marked = is_marked(said())
    camera = bpy.context.scene.camera
    shown = scenes.backdrop_of(camera) if scenes.backdrops(camera) else None
    fits = shown is None or np.allclose(shown, scenes.set_anew(camera), atol=1e-6)
    assert marked != fits  # neither silent nor a false alarm


def test_B81_behind_or_in_front(owner):
    settings = bpy.context.scene.rle_splat
    bpy.ops.rle_splat.preview_in_camera_view(place="BACK")
    entry = bpy.context.scene.camera.data.background_images[0]
    for place in ("FRONT", "BACK"):
        settings.backdrop_depth = place
        scenes.update()
        assert entry.display_depth == place


def test_B85_a_backdrop_that_no_view_shows(owner, capfd):
    """The only view of this window looks from its own point."""
    areas = [area for area in bpy.context.screen.areas if area.type == "VIEW_3D"]
    assert areas and all(area.spaces.active.region_3d.view_perspective != "CAMERA" for area in areas)
    bpy.ops.rle_splat.preview_in_camera_view()
    assert "no 3d viewport looks through" in capfd.readouterr().out.lower()
