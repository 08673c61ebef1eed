"""Proves the panel's Maximum Error: it reaches the planner, and the report says what was predicted and measured."""

import json

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")


@pytest.fixture
def settings(tmp_path):
    """Of a scene with a soft ball of one color before a camera."""
    z, y, x = np.ogrid[:14, :14, :14]
    radius = np.sqrt((x - 6.5) ** 2 + (y - 6.5) ** 2 + (z - 6.5) ** 2)
    owner = scenes.import_raw(tmp_path, np.clip(255.0 - 40.0 * radius, 0, 255).astype(np.uint8), name="ball")
    scenes.give_transfer(owner, ((0.0, 0.0), (255.0, 0.4)), (0.9, 0.5, 0.2))
    scenes.add_camera((6.5, 6.5, 30.0), type="ORTHO", ortho_scale=16.0)
    bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = 40, 32
    return bpy.context.scene.rle_splat


def test_a_picture_to_a_tolerance_says_so(settings):
    settings.max_error = 2.0
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    error = json.loads(settings.last_report_json)["error"]
    assert error["tolerance"] == 2.0 and error["kept"] and error["measured"] <= 2.0 and error["probes"] > 500
    assert f"{error['sentence']}; the reference is the exact integral" in settings.last_report
    assert scenes.image_pixels(settings.image)[..., 3].max() > 0.2


def test_zero_leaves_it_to_the_quality(settings):
    assert settings.max_error == 0.0
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    report = json.loads(settings.last_report_json)
    assert report["error"]["tolerance"] is None and report["plan"]["quality"] == settings.quality
    assert "The error of this picture is not measured" in settings.last_report


def test_a_quality_without_a_truth_is_refused_in_a_sentence(settings):
    settings.max_error, settings.quality = 1.0, "paper"
    with pytest.raises(RuntimeError, match="A tolerance cannot be met with model 'opacity'"):
        bpy.ops.rle_splat.render_image()
