"""What a picture will take of memory stands in the panel before it is made, and what does not fit is refused."""

import json
import re

import bpy
import numpy as np
import pytest

from tests.blender import scenes
from tests.blender.test_panels import draw_all, texts

UNITS = {"bytes": 1, "KiB": 1 << 10, "MiB": 1 << 20, "GiB": 1 << 30}


@pytest.fixture
def volume(tmp_path):
    """A ball that fills a fifth of 48 voxels cubed, under a function that shows the ball alone."""
    at = np.indices((48, 48, 48)) - 23.5
    owner = scenes.import_raw(tmp_path, np.where((at**2).sum(axis=0) < 17.5**2, 180, 20).astype(np.uint8))
    scenes.give_transfer(owner, ((0.0, 0.0), (100.0, 0.0), (150.0, 0.3), (255.0, 0.3)), (0.9, 0.5, 0.2))
    scenes.use_cycles((32, 32))
    scenes.add_camera((23.5, 23.5, 150.0))
    return owner


def said(monkeypatch) -> str:
    """What the panels say, without the breaks of their lines."""
    return " ".join(texts(draw_all(monkeypatch)).split())


def translate(monkeypatch):
    """(bytes, share of the voxels) as the panel has them."""
    found = re.search(r"about ([\d.]+) (\w+)(?: \(.*\))?\. ([\d.]+)% of the voxels", said(monkeypatch))
    return float(found[1]) * UNITS[found[2]], float(found[3]) / 100.0


def told_beside(monkeypatch, what):
    """Bytes as the panel has them in parentheses, with exact pixels or among meshes."""
    found = re.search(rf"[(,] ?([\d.]+) (\w+) {what}[,)]", said(monkeypatch))
    return float(found[1]) * UNITS[found[2]]


@pytest.mark.parametrize("side", (32, 400))
@pytest.mark.parametrize("classification, name", (("pre", "standard"), ("post", "standard"), ("post", "strict")))
def test_the_panel_tells_what_the_picture_then_takes(volume, bridge, core, monkeypatch, classification, name, side):
    """Of post a picture says how many voxels it keeps, which are more than the visible ones; of strict it has some of
    its pixels by exact pixels, which small pictures take most for."""
    scenes.use_cycles((side, side))
    bpy.context.scene.camera.location.z = 105.0  # it fills the frame, as the panel reckons
    settings = bpy.context.scene.rle_splat
    settings.classification, settings.quality = classification, name
    bridge("volumes.volumes").forget_all()  # no voxels in memory: the panel must not read them
    needed, share = translate(monkeypatch)
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    plain, quality = scenes.read_scene(volume)
    rendering = core("runtime.steps").drain(bridge("scene.render_scene").steps(plain, quality))
    assert quality.classification == classification and (quality.rays > 0.0) == (name == "strict")
    if quality.rays == 0.0 < rendering.report["plan"]["rays"]:
        needed = told_beside(monkeypatch, "with exact pixels")
    kept = rendering.report["volume"]["visible_fraction"]
    assert share == pytest.approx(kept, abs=0.001) if classification == "pre" else share < kept < 2.0 * share
    assert needed == pytest.approx(rendering.report["memory_estimate_bytes"]["needed"], rel=0.3)


def test_the_panel_tells_what_meshes_take(volume, bridge, core, monkeypatch):
    """A backdrop has them, a picture of the volume alone has not; the volume is reckoned to fill the frame."""
    scenes.use_cycles((400, 400))
    bpy.context.scene.camera.location.z = 105.0
    alone, _ = translate(monkeypatch)
    assert "among meshes" not in said(monkeypatch)
    bpy.ops.mesh.primitive_cube_add(size=10.0, location=(23.5, 23.5, 23.5))
    assert translate(monkeypatch)[0] == alone
    among = told_beside(monkeypatch, "among meshes")
    bpy.context.scene.rle_splat.quality = "draft"  # whose plan for this volume has no exact pixels
    drafted = translate(monkeypatch)[0], told_beside(monkeypatch, "among meshes")
    for with_meshes, needed in zip((False, True), drafted):
        plain, quality = scenes.read_scene(volume, with_meshes=with_meshes)
        report = core("runtime.steps").drain(bridge("scene.render_scene").steps(plain, quality)).report
        assert needed == pytest.approx(report["memory_estimate_bytes"]["needed"], rel=0.3)
    assert among > 1.3 * alone
    bpy.context.scene.rle_splat.meshes_occlude = False
    assert "among meshes" not in said(monkeypatch)


def test_it_follows_the_record_the_picture_and_the_transfer_function(volume, monkeypatch):
    settings = bpy.context.scene.rle_splat
    settings.classification = "pre"
    scenes.use_cycles((400, 400))  # more than packing the records takes, which is as much as they save
    first, share = translate(monkeypatch)
    settings.record = "8"
    assert translate(monkeypatch)[0] < first
    settings.record = "16"
    bpy.context.scene.render.resolution_x = 2000
    assert translate(monkeypatch)[0] > 2.0 * first
    volume.rle_splat.opacity_scale = 0.0
    assert translate(monkeypatch)[1] == 0.0 < share


def test_a_volume_of_a_former_version_has_no_such_line(volume, monkeypatch):
    kept = json.loads(volume.rle_splat.histogram)
    volume.rle_splat.histogram = json.dumps({name: kept[name] for name in ("edges", "counts")})
    assert "of the voxels" not in said(monkeypatch)


@pytest.mark.parametrize("operator", ("render_image", "preview_in_camera_view"))
@pytest.mark.parametrize("classification", ("pre", "post"))
def test_too_little_memory_is_refused_before_the_work(volume, core, operator, classification, monkeypatch):
    bpy.context.scene.rle_splat.classification = classification
    bpy.context.scene.rle_splat.quality = "draft"  # whose plan for this volume has no exact pixels
    free = int(0.9 * translate(monkeypatch)[0])
    for module in ("pipeline.memory_estimate", "pipeline.stage_cache", "runtime.memory"):
        monkeypatch.setattr(core(module), "available_bytes", lambda: free)
    images = len(bpy.data.images)
    with pytest.raises(RuntimeError, match=r"are free; to need less, .*write a coarser file") as refusal:
        getattr(bpy.ops.rle_splat, operator)()
    assert "Traceback" not in str(refusal.value) and len(bpy.data.images) == images
    assert classification == "pre" or "records" not in str(refusal.value)  # of which post has none
