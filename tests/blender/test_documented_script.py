"""The scripts of the pages run as they stand there, and make what they name."""

import re
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

PAGES = Path(__file__).resolve().parents[2] / "docs/how-to"


def scripts_of(page, **there):
    """The scripts of a page, with other files for those in /data."""
    text = (PAGES / page).read_text(encoding="utf-8")
    text = text.replace("= 960, 640", "= 24, 16").replace('f"/data/{path.name}.png"', "f'{path}.png'")
    for name, path in there.items():
        assert len(re.findall(rf'"/data/{name}[."]', text)) == 1
        text = re.sub(rf'"/data/{name}(\.\w+)?"', lambda _, path=path: repr(str(path)), text)
    return [compile(one, page, "exec") for one in re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)]


def test_the_documented_scripts_run(tmp_path, core, bridge, capsys):
    pytest.importorskip("pydicom")
    phantoms = import_module("tests.read.dicom_phantoms")
    phantoms.write_classic(tmp_path / "scan", phantoms.geometry("a", (1, 0, 0), (0, 1, 0), [2.0 * i for i in range(6)]))
    (tmp_path / "bone.json").write_text('{"opacity": [[0, 0.0], [500, 0.9]], "color": [[0, 1.0, 1.0, 1.0]]}')
    first, further, of_array, every = scripts_of(
        "script-blender.md", FLAIR=tmp_path / "scan", scan=tmp_path / "render.png", bone=tmp_path / "bone.json",
        segmentations=tmp_path / "masks", array=tmp_path / "array.nrrd", scans=tmp_path / "scans",
    )  # fmt: skip
    scenes.use_cycles((32, 32))
    bpy.context.scene.world = bpy.data.worlds.new("World")  # as in a new file
    if bpy.app.version < (5, 0):
        bpy.context.scene.world.use_nodes = True
    names = {}
    exec(first, names)
    scene = bpy.context.scene
    settings, camera = scene.rle_splat, scene.camera
    assert settings.quality == "fine" and settings.use_composite and settings.last_report
    assert scenes.image_pixels(settings.composite_image)[..., 3].max() > 0.1
    (scan,) = (one for one in scene.objects if one.rle_splat.is_volume)
    middle = world_to_camera_view(scene, camera, Vector(bridge("volumes.box").world_corners(scan).mean(axis=0)))
    assert abs(middle.x - 0.5) < 0.1 and abs(middle.y - 0.5) < 0.1 and middle.z > 0.0
    assert {"RA", "LP"} <= {one.name for one in scene.objects}
    assert (tmp_path / "render.png").is_file()

    volume = core("read.formats").read_volume(tmp_path / "scan")
    (tmp_path / "masks").mkdir()
    for name, half in (("lower", np.s_[:3]), ("upper", np.s_[3:])):
        voxels = np.zeros(volume.voxels.shape, np.uint8)
        voxels[half] = 1
        mask = replace(volume, voxels=voxels, value_unit=None)
        core("read.formats").write_volume(mask, tmp_path / "masks" / f"{name}.nii.gz")
    exec(further, names)
    assert all(row.use_color for row in scan.rle_splat.labels) and settings.clip_objects.objects
    red, green, *_ = names["pixels"].reshape(-1, 4).max(axis=0)
    assert red > 2.0 * green > 0.0
    exec(of_array, names)
    assert bpy.context.object.rle_splat.is_volume and (tmp_path / "array.nrrd").is_file()

    (tmp_path / "scans").mkdir()
    (tmp_path / "scans" / "a-broken.nrrd").write_text("no scan")
    for name in ("a.nrrd", "b.nrrd"):
        core("read.formats").write_volume(volume, tmp_path / "scans" / name)
    exec(every, names)
    assert {path.name for path in (tmp_path / "scans").glob("*.png")} == {"a.nrrd.png", "b.nrrd.png"}
    assert "a-broken.nrrd: " in capsys.readouterr().out
    assert [one.name for one in bpy.data.objects if one.rle_splat.is_volume] == ["b"]


def test_the_camera_path_of_a_scene_shows_it_on_the_command_line(tmp_path, core, monkeypatch, capsys):
    owner = scenes.cube_scene(tmp_path, name="scan")
    owner.location, owner.rotation_euler = (0.2, -0.3, 0.1), (0.0, 0.2, 0.0)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 3, 4
    for frame, across in ((3, 2.0), (4, 5.0)):
        scene.camera.location.x = across
        scene.camera.keyframe_insert("location", frame=frame)
    monkeypatch.setattr(sys, "argv", ["blender", "--", str(tmp_path)])
    exec(*scripts_of("render-many-frames.md"), {})
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
