"""The gallery's scenes for others open with what they need but the scan, and show it once it is chosen."""

import os
import shutil
from pathlib import Path

import bpy
import pytest

from tests.blender import scenes

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("RLE_SPLAT_DATA") or ROOT / "../shared/data")
SCANS = {  # scene -> a scan that is not named as in the scene, and segments of the scene that are shown
    "heart": ("cta_aorta_labels/cta_heart_aorta_120x126x164_int16.nii.gz",
              {"Heart", "aorta_false_lumen"}),
    "skull": ("dicom_ct_skull_phantom_512x512x140/I100", {"Body"}),
}  # fmt: skip

pytestmark = pytest.mark.skipif(bpy.app.version < (5, 0), reason="saved by Blender 5.0")


@pytest.fixture(params=SCANS)
def opened(request, addon, tmp_path):
    """The name of a scene that is open, far from the scan."""
    name = request.param
    for path in (ROOT / "docs" / "scenes").glob(f"{name}*"):
        shutil.copyfile(path, tmp_path / path.name)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / f"{name}.blend"))
    return name


def test_a_scene_has_all_but_its_scan(opened, tmp_path):
    scene = bpy.context.scene
    (volume,) = (one for one in scene.objects if one.rle_splat.is_volume)
    assert {row.label_name for row in volume.rle_splat.labels if row.show} == SCANS[opened][1]
    assert scene.camera and scene.rle_splat.use_composite and scene.rle_splat.clip_objects.objects
    assert any(one.type == "LIGHT" for one in scene.objects)
    for path in (volume.rle_splat.filepath, volume.rle_splat.label_file):
        assert Path(path).parent == tmp_path  # beside the scene, wherever it was made
    assert "click Relocate" in scene.rle_splat.message


def test_a_scene_finds_its_scan(opened, tmp_path):
    scan = DATA / SCANS[opened][0]
    if not scan.exists():
        pytest.skip(f"needs {SCANS[opened][0]} in ../shared/data or $RLE_SPLAT_DATA")
    scene = bpy.context.scene
    bpy.context.view_layer.objects.active = next(one for one in scene.objects if one.rle_splat.is_volume)
    assert bpy.ops.rle_splat.relocate_volume(filepath=str(scan), use_dialog=False) == {"FINISHED"}
    scene.rle_splat.quality, scene.rle_splat.antialias, scene.render.resolution_percentage = "draft", False, 4
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    assert scenes.image_pixels(scene.rle_splat.image)[..., 3].mean() > 0.1 and scene.rle_splat.message == ""
