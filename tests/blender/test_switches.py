"""One meaning for one switch: Meshes Hide Volume in every picture, what a Maximum Error takes away, and where a clip
object is added."""

import math
import re
import sys
from itertools import pairwise

import bpy
import numpy as np
import pytest

from tests.blender import scenes
from tests.blender.conftest import contents
from tests.blender.test_panels import draw_all, texts

pytestmark = pytest.mark.usefixtures("by_numpy")


@pytest.fixture
def volume(addon, tmp_path):
    """A ball seen from above, lit by a sun."""
    scene = scenes.use_cycles()
    found = scenes.ball_scene(tmp_path)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.rotation_euler.x = math.radians(50.0)
    scene.collection.objects.link(sun)
    return found


def add_lid():
    """A plane before the volume that hides all of it."""
    return scenes.add_mesh(
        [(-50, -50, 20), (50, -50, 20), (50, 50, 20), (-50, 50, 20)], [(0, 1, 2, 3)], (0.0, 0.0, 0.0)
    )


def test_B53_render_image_shows_what_a_render_and_the_list_of_effects_do(volume, tmp_path):
    settings = bpy.context.scene.rle_splat
    add_lid()
    bpy.ops.rle_splat.show_in_renders()
    alone = scenes.picture(use_meshes=False)
    assert alone[..., 3].max() > 0.1
    for occlude in (True, False):
        settings.meshes_occlude = occlude
        found = scenes.picture()
        assert bpy.ops.rle_splat.list_effects() == {"FINISHED"}
        assert settings.effect_rows["mesh occlusion"].on == occlude
        scenes.rendered(tmp_path / "frame.exr")
        np.testing.assert_array_equal(found, scenes.image_pixels(settings.composite_image))
        assert (found[..., 3].max() == 0.0) == occlude
        np.testing.assert_array_equal(scenes.picture(use_meshes=False), alone)
        assert scenes.picture(use_meshes=True)[..., 3].max() == 0.0
    np.testing.assert_array_equal(scenes.picture(), alone)  # what was given above is not remembered


def test_B54_the_shadow_pass_has_the_shadows_of_meshes_as_the_scene_says(volume, addon, monkeypatch):
    settings, shares = bpy.context.scene.rle_splat, []
    pictures = sys.modules[f"{addon.__name__}.bridge.pictures.pictures"]
    keep = pictures.keep_numbers
    monkeypatch.setattr(
        pictures, "keep_numbers",
        lambda scene, one, share, kind: (shares.append(share), keep(scene, one, share, kind))[1])  # fmt: skip
    scenes.add_mesh([(-9, -30, 14), (30, -30, 14), (30, 4, 14), (-9, 4, 14)], [(0, 1, 2, 3)])

    def share(**options):
        assert bpy.ops.rle_splat.shadow_pass(**options) == {"FINISHED"}
        return shares[-1]

    with_meshes, alone = share(use_meshes=True), share(use_meshes=False)
    assert np.abs(with_meshes - alone).max() > 0.1
    np.testing.assert_array_equal(share(), with_meshes)
    settings.meshes_occlude = False
    np.testing.assert_array_equal(share(), alone)


def test_what_is_measured_is_alone_and_the_tooltips_say_so(volume, addon, bridge, monkeypatch):
    add_lid()
    read, how = bridge("scene.render_scene").read_scene, []
    monkeypatch.setattr(
        bridge("scene.render_scene"), "read_scene",
        lambda *given, **options: (how.append(read(*given, **options)[0]), read(*given, **options))[1])  # fmt: skip
    assert bpy.ops.rle_splat.error_map(step=8) == {"FINISHED"}
    assert how[0].triangles is None
    for name in ("error_map", "measure_accuracy"):
        tooltip = getattr(bpy.ops.rle_splat, name).get_rna_type().description
        assert "alone: without meshes and motion blur, and without shadows if Interpolate is Colors" in tooltip


def test_B82_a_maximum_error_says_that_it_takes_shadows_away_and_hides_or_grays_what_it_decides(volume, monkeypatch):
    scene = bpy.context.scene
    settings = scene.rle_splat

    def drawn():
        log = draw_all(monkeypatch)
        said = re.findall(r"Pictures with a Maximum Error have no [^.]*\.", " ".join(texts(log).split("\n")))
        gray = {what[1] for before, what in pairwise(log) if before == ("enabled", False)}
        return said[0] if said else "", gray | planned - {what for kind, what in log if kind == "prop"}

    planned = {"depth_rule", "sheet_density", "warp_filter", "termination", "rays", "axis_fade"}
    settings.quality, settings.classification = "custom", "post"
    said, gray = drawn()
    assert not said and not gray & {*planned, "use_shadows", "ambient_occlusion", "quality"}
    settings.max_error = 4.0
    said, gray = drawn()
    assert not said and gray >= planned and not gray & {"use_shadows", "ambient_occlusion"}
    settings.classification = "pre"
    said, gray = drawn()
    assert said == "Pictures with a Maximum Error have no shadows."
    assert gray >= {*planned, "use_shadows", "ambient_occlusion"}
    assert not gray & {"threads", "classification"}
    settings.quality = "fine"
    assert "quality" in drawn()[1]
    settings.use_shadows = False
    assert not drawn()[0]
    settings.ambient_occlusion, settings.use_shadows, scene.render.use_motion_blur = 0.5, True, True
    assert drawn()[0] == "Pictures with a Maximum Error have no shadows and no ambient occlusion and no motion blur."
    volume.keyframe_insert("location", index=0, frame=scene.frame_current - 1)
    volume.location.x = 9.0
    volume.keyframe_insert("location", index=0, frame=scene.frame_current + 1)
    scene.frame_set(scene.frame_current)
    assert bpy.ops.rle_splat.list_effects() == {"FINISHED"}
    for name in ("shadows", "ambient occlusion", "motion blur"):
        row = settings.effect_rows[name]
        assert (row.on, row.reason) == (False, "it is not available with a maximum error")
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    settings.max_error = 0.0
    assert bpy.ops.rle_splat.list_effects() == {"FINISHED"}
    assert {"shadows", "ambient occlusion", "motion blur"} <= {row.name for row in settings.effect_rows if row.on}


@pytest.fixture
def clips(volume):
    """The scene's collection of clip objects, empty; the volume is active."""
    collection = bpy.data.collections.new("clips")
    bpy.context.scene.collection.children.link(collection)
    bpy.context.scene.rle_splat.clip_objects = collection
    return collection


def in_layer(collection):
    return bpy.context.view_layer.layer_collection.children[collection.name]


@pytest.mark.parametrize("kind", ["BOX", "PLANE"])
def test_B59_a_clip_is_not_added_where_it_could_not_be_seen(clips, refused, kind):
    in_layer(clips).exclude = True
    refused(bpy.ops.rle_splat.add_cutting_object, "excluded from the view layer", kind=kind)
    assert not clips.objects
    bpy.context.scene.collection.children.unlink(clips)
    refused(bpy.ops.rle_splat.add_cutting_object, "not in the scene", kind=kind)
    parent = bpy.data.collections.new("parent")
    bpy.context.scene.collection.children.link(parent)
    parent.children.link(clips)
    in_layer(parent).exclude = True
    refused(bpy.ops.rle_splat.add_cutting_object, "excluded from the view layer", kind=kind)
    in_layer(parent).exclude = False
    assert bpy.ops.rle_splat.add_cutting_object(kind=kind) == {"FINISHED"}
    assert bpy.context.view_layer.objects.active.name in clips.objects


@pytest.mark.parametrize("eye", [True, False])
def test_a_clip_in_a_hidden_collection_cuts_and_says_that_it_is_hidden(clips, capfd, eye):
    if eye:
        in_layer(clips).hide_viewport = True
    else:
        clips.hide_viewport = True
    before = contents()
    assert bpy.ops.rle_splat.add_cutting_object(kind="PLANE") == {"FINISHED"}
    assert "cuts the volume but is not visible, because its collection is hidden" in capfd.readouterr().out
    (added,) = clips.objects
    rectangle = {name: before[name] + 1 for name in ("meshes", "collections")}  # which the arrow instances
    assert contents() == {**before, **rectangle, "objects": before["objects"] + 2, "active": added}
    half = scenes.picture()
    clips.objects.unlink(added)
    assert 0.0 < half[..., 3].sum() != scenes.picture()[..., 3].sum()
