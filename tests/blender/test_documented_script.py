"""The scripts of the pages run as they stand there, and make what they name."""

import re
import sys
from importlib import import_module
from pathlib import Path

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

PAGES = Path(__file__).resolve().parents[2] / "docs/how-to"


def script_of(page):
    """The one script of a page."""
    text = (PAGES / page).read_text(encoding="utf-8")
    (script,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    return script


def test_the_documented_script_runs(tmp_path):
    pytest.importorskip("pydicom")
    phantoms = import_module("tests.read.dicom_phantoms")
    phantoms.write_classic(tmp_path / "scan", phantoms.geometry("a", (1, 0, 0), (0, 1, 0), [2.0 * i for i in range(6)]))
    script = script_of("script-blender.md")
    for name, there in (("/data/dicom", tmp_path / "scan"), ("/data/scan.png", tmp_path / "render.png")):
        assert script.count(f'"{name}"') == 1
        script = script.replace(f'"{name}"', repr(str(there)))
    scenes.use_cycles((32, 32))
    exec(compile(script, "script-blender.md", "exec"), {})
    scene = bpy.context.scene
    settings, camera = scene.rle_splat, scene.camera
    assert settings.quality == "fine" and settings.use_composite and settings.last_report
    assert scenes.image_pixels(settings.composite_image)[..., 3].max() > 0.1
    (scan,) = (one for one in scene.objects if one.rle_splat.is_volume)
    box = scan.instance_collection.objects[0]
    seen = [world_to_camera_view(scene, camera, scan.matrix_world @ box.matrix_world @ corner.co)
            for corner in box.data.vertices]  # fmt: skip
    assert all(0.0 < min(place.x, place.y) and max(place.x, place.y) < 1.0 < 1.0 + place.z for place in seen)
    assert {"R", "L"} <= {one.name for one in scene.objects}
    assert (tmp_path / "render.png").is_file()


def test_the_camera_path_of_a_scene_shows_it_on_the_command_line(tmp_path, core, monkeypatch, capsys):
    owner = scenes.cube_scene(tmp_path, name="scan")
    owner.location, owner.rotation_euler = (0.2, -0.3, 0.1), (0.0, 0.2, 0.0)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 3, 4
    for frame, across in ((3, 2.0), (4, 5.0)):
        scene.camera.location.x = across
        scene.camera.keyframe_insert("location", frame=frame)
    monkeypatch.setattr(sys, "argv", ["blender", "--", str(tmp_path)])
    exec(compile(script_of("render-many-frames.md"), "render-many-frames.md", "exec"), {})
    assert "scene scale: 1.0" in capsys.readouterr().out
    done = core("cli.main").main([
        "render", str(tmp_path / "scan.raw"), "--shape", "7", "7", "7", "--dtype", "uint8", "--size", "24",
        "-o", str(tmp_path / "a.npy"), "--camera-path", str(tmp_path / "cameras.json"),
        "--volume-matrix", str(tmp_path / "volume.json"), "--transfer-function", str(tmp_path / "one_color.json"),
    ])  # fmt: skip
    assert done == 0, capsys.readouterr().err
    for number, frame in ((1, 3), (2, 4)):
        scene.frame_set(frame)
        _, shown = scenes.picture_of()
        made = np.load(tmp_path / f"a_000{number}.npy")
        assert made[..., 3].max() > 0.3
        np.testing.assert_allclose(made, shown, rtol=0.0, atol=2e-6)
