"""Bake to Cycles Volume: the Volume object that it adds looks in Cycles as the volume does here."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from tests.blender import scenes
from tests.blender.scenes import add_camera, add_white_floor, import_raw, load_color, picture_of, rendered, use_cycles

pytestmark = pytest.mark.usefixtures("by_numpy")

SIZE = 24
BALL = scenes.ball(13, 35.0)
COLOR = (0.8, 0.3, 0.1)


@pytest.fixture
def ball(addon, tmp_path):
    """A soft ball, lit by a sun, from above."""
    scene = use_cycles((SIZE, SIZE), samples=12)
    scene.cycles.filter_width = 0.01
    scene.cycles.volume_step_rate = 0.2
    owner = import_raw(tmp_path, BALL)
    load_color(tmp_path, COLOR, alpha=0.15)
    scene.rle_splat.quality, scene.rle_splat.classification = "fine", "pre"
    add_camera((6.0, 6.0, 40.0), type="ORTHO", ortho_scale=18.0)
    return owner


def bake(tmp_path, **options):
    path = tmp_path / "baked.vdb"
    assert bpy.ops.rle_splat.bake_volume(filepath=str(path), **options) == {"FINISHED"}
    one = bpy.context.view_layer.objects.active
    assert one.type == "VOLUME" and path.is_file()
    return one


@pytest.mark.parametrize(
    "matrix",
    [Matrix(), Matrix(((0.9, 0.25, 0.0, 0.5), (0.0, 1.1, 0.0, -0.5), (0.1, 0.0, 1.3, 0.0), (0.0, 0.0, 0.0, 1.0)))],
    ids=["plain", "sheared"],
)
def test_the_baked_volume_looks_in_cycles_as_here(grids_in_cycles, ball, tmp_path, matrix):
    """By the mean, as Cycles is noisy; a sheared and unevenly scaled object too."""
    parent = bpy.data.objects.new("parent", None)
    bpy.context.scene.collection.objects.link(parent)
    ball.parent, ball.matrix_parent_inverse = parent, matrix
    bpy.context.view_layer.update()
    _, ours = picture_of()
    bake(tmp_path)
    theirs = rendered(tmp_path / "theirs.exr")
    assert ours[..., 3].max() > 0.5
    error = 255.0 * (theirs - ours)
    print(f"RMSE {np.sqrt((error**2).mean()):.2f}, bias {error.mean(axis=(0, 1))} levels")
    assert np.sqrt((error**2).mean()) < 3.0 and abs(error[..., 3].mean()) < 0.5
    assert np.abs(error[..., :3].mean(axis=(0, 1))).max() < 0.3


def test_the_resolution_can_be_chosen_and_light_left_to_cycles(grids_in_cycles, ball, tmp_path):
    one = bake(tmp_path, side=7, look="CYCLES")
    one.data.grids.load()
    density = one.data.grids["density"]
    assert [column.length for column in density.matrix_object.to_3x3().col] == pytest.approx([2.0] * 3)
    kinds = {node.type for node in one.data.materials[0].node_tree.nodes}
    assert "PRINCIPLED_VOLUME" in kinds and "EMISSION" not in kinds
    assert rendered(tmp_path / "dark.exr")[..., :3].max() == 0.0, "no light shines on it"
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    bpy.context.scene.collection.objects.link(sun)
    sun.data.energy = 10.0
    lit = rendered(tmp_path / "lit.exr")[8:16, 8:16, :3].mean(axis=(0, 1))
    assert lit / lit[0] == pytest.approx(np.array(COLOR) / COLOR[0], abs=0.05)


def test_what_would_be_shown_twice_is_said(ball, tmp_path, capfd):
    add_white_floor(9.0)
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    bake(tmp_path)
    assert "twice" in capfd.readouterr().out


def test_bad_files_are_refused_in_a_sentence(ball, tmp_path, refused):
    refused(bpy.ops.rle_splat.bake_volume, "give the file", filepath="")
    blocked = tmp_path / "blocked"
    blocked.write_text("a file where a folder is wanted")
    refused(bpy.ops.rle_splat.bake_volume, "cannot write", filepath=str(blocked / "baked.vdb"))
