"""The scripts of the pages run as they stand there, and make what they name."""

import re
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

PAGES = Path(__file__).resolve().parents[2] / "docs/how-to"


def script_of(page):
    """The one script of a page."""
    text = (PAGES / page).read_text(encoding="utf-8")
    (script,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    return script


def test_the_documented_script_runs(tmp_path):
    script = script_of("script-blender.md")
    assert script.count('"/data/scan.raw.gz"') == script.count("(256, 256, 256)") == 1
    scan = tmp_path / "scan.raw"
    voxels = np.zeros((8, 8, 8), np.uint8)
    voxels[2:6, 2:6, 2:6] = 200
    scan.write_bytes(voxels.tobytes())
    script = script.replace('"/data/scan.raw.gz"', repr(str(scan))).replace("(256, 256, 256)", "(8, 8, 8)")
    scenes.use_cycles()
    scenes.add_camera((0.0035, 0.0035, 0.03), type="ORTHO", ortho_scale=0.012, clip_start=0.001)
    bpy.context.scene.render.filepath = str(tmp_path / "render.png")
    exec(compile(script, "script-blender.md", "exec"), {})
    settings = bpy.context.scene.rle_splat
    assert settings.quality == "fine" and settings.use_composite and settings.last_report
    assert scenes.image_pixels(settings.image)[..., 3].max() > 0.1
    assert scenes.backdrops(bpy.context.scene.camera)
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
