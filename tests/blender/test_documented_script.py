"""The script of docs/how-to/script-blender.md runs as it stands there, and makes the pictures that it names."""

import re
from pathlib import Path

import bpy
import numpy as np

from tests.blender import scenes

PAGE = Path(__file__).resolve().parents[2] / "docs/how-to/script-blender.md"


def test_the_documented_script_runs(tmp_path):
    (script,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert script.count('"/data/scan.raw.gz"') == script.count("(256, 256, 256)") == 1
    scan = tmp_path / "scan.raw"
    voxels = np.zeros((8, 8, 8), np.uint8)
    voxels[2:6, 2:6, 2:6] = 200
    scan.write_bytes(voxels.tobytes())
    script = script.replace('"/data/scan.raw.gz"', repr(str(scan))).replace("(256, 256, 256)", "(8, 8, 8)")
    scenes.use_cycles()
    scenes.add_camera((0.0035, 0.0035, 0.03), type="ORTHO", ortho_scale=0.012, clip_start=0.001)
    bpy.context.scene.render.filepath = str(tmp_path / "render.png")
    exec(compile(script, str(PAGE), "exec"), {})
    settings = bpy.context.scene.rle_splat
    assert settings.quality == "fine" and settings.use_composite and settings.last_report
    assert scenes.image_pixels(settings.image)[..., 3].max() > 0.1
    assert scenes.backdrops(bpy.context.scene.camera)
    assert (tmp_path / "render.png").is_file()
