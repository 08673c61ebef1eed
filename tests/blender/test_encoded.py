"""`.rle` files and folders in Blender: imported, shown and rendered like any volume; what they cannot do is said."""

import os
import shutil
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

KINDS = ("file", "pre", "post")
SIDE = 12  # voxels
NOBODY = 65534  # a user without rights


def ball():
    z, y, x = np.mgrid[:SIDE, :SIDE, :SIDE] - (SIDE - 1) / 2
    return np.clip(250.0 * (1.1 - np.sqrt(x**2 + y**2 + 1.5 * z**2) * 2.0 / SIDE), 0, 255).astype(np.uint8)


@pytest.fixture
def scan(tmp_path):
    """The scan that is encoded, unshaded, in a scene with a camera; kernels are not compiled."""
    owner = scenes.import_raw(tmp_path, ball(), (1.0, 2.0, 1.0), "ball")
    scenes.give_transfer(owner, ((0.0, 0.0), (60.0, 0.0), (255.0, 0.4)), (0.9, 0.5, 0.2))
    scenes.add_camera((5.5, 11.0, 60.0), type="ORTHO", ortho_scale=30.0)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 32, 24
    settings = scene.rle_splat
    settings.quality = "custom"
    settings.classification, settings.rays, settings.depth_rule = "post", 0.0, "preintegrated"
    return owner


@pytest.fixture
def encode(scan, bridge, core, tmp_path):
    """``encode(kind)``: the scan as a `.rle` file or folder; its path."""

    def made(kind):
        plain, quality = scenes.read_scene(scan)
        quality = core("scene").Quality(classification="post" if kind == "post" else "pre")
        path = tmp_path / f"{kind}.rle"
        if kind == "file":
            core("encode.store").write_encoded(core("pipeline.encode_scene").encode(plain, quality), path)
        else:
            core("pipeline.encode_folder").encode_folder(plain, path, quality)
        return path

    return made


def imported(path, **options):
    assert bpy.ops.rle_splat.import_volume(filepath=str(path), **options) == {"FINISHED"}
    return bpy.context.view_layer.objects.active


def picture_of(owner):
    for other in bpy.context.selected_objects:
        other.select_set(False)
    owner.select_set(True)
    bpy.context.view_layer.objects.active = owner
    return scenes.picture()


@pytest.mark.parametrize("kind", KINDS)
def test_it_looks_like_the_scan(scan, encode, kind):
    settings = bpy.context.scene.rle_splat
    if kind != "post":
        settings.classification = "pre"
        settings.depth_rule = "midpoint-1"
    expected = picture_of(scan)
    owner = imported(encode(kind))
    assert owner.rle_splat.is_volume and owner.name.startswith(kind)
    np.testing.assert_array_equal(owner.rle_splat.found_spacing, (1.0, 2.0, 1.0))
    assert "Voxels: 12 × 12 × 12" in owner.rle_splat.facts
    np.testing.assert_allclose(picture_of(owner), expected, atol=1e-6)
    assert expected[..., 3].max() > 0.5


def test_the_header_and_import_folder_mean_the_folder(encode):
    path = encode("pre")
    by_header = imported(path / "header.json")
    assert bpy.ops.rle_splat.import_dicom_series(directory=str(path)) == {"FINISHED"}
    by_folder = bpy.context.view_layer.objects.active
    assert by_header.rle_splat.data_key == by_folder.rle_splat.data_key != ""
    assert by_folder.rle_splat.facts.startswith("File: pre.rle\nEncoded: pre-classified\n")


def test_dropped_files_and_folders_are_taken():
    handler = next(cls for cls in bpy.types.FileHandler.__subclasses__() if cls.__name__ == "RLE_SPLAT_FH_volume")
    assert ".rle" in handler.bl_file_extensions.split(";")


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_pinned_composited_and_survives_a_reload(scan, encode, kind, tmp_path):
    owner = imported(encode(kind))
    bpy.data.objects.remove(scan)
    name, camera = owner.name, bpy.context.scene.camera.name
    first = picture_of(owner)
    assert bpy.ops.rle_splat.preview_in_camera_view() == {"FINISHED"}
    np.testing.assert_array_equal(scenes.backdrop_of(bpy.data.objects[camera]), first)
    scenes.use_cycles((32, 24))
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    scenes.save_and_reload(tmp_path / "scene.blend")
    owner = bpy.data.objects[name]
    assert scenes.stored(tmp_path / "scene.blend", "objects", name).rle_splat.filepath.startswith("//")
    rendered = scenes.rendered(tmp_path / "out.exr")
    assert bpy.context.scene.rle_splat.message == ""
    np.testing.assert_allclose(rendered, first, atol=1e-5)
    np.testing.assert_array_equal(picture_of(owner), first)


def test_undo_brings_it_back(encode):
    bpy.ops.ed.undo_push(message="before")
    name = imported(encode("post")).name
    before = picture_of(bpy.data.objects[name])
    bpy.ops.ed.undo_push(message="imported")
    bpy.data.objects.remove(bpy.data.objects[name])
    bpy.ops.ed.undo_push(message="removed")
    bpy.ops.ed.undo()
    np.testing.assert_array_equal(picture_of(bpy.data.objects[name]), before)


@pytest.mark.parametrize("kind", ["file", "pre"])
def test_it_is_reloaded_and_relocated(encode, kind, tmp_path):
    path = encode(kind)
    owner = imported(path)
    before, moved = picture_of(owner), tmp_path / "moved.rle"
    assert bpy.ops.rle_splat.reload_volume(use_dialog=False) == {"FINISHED"}
    if os.name != "nt":
        path.rename(moved)
    else:  # which lets nobody move a mapped file
        (shutil.copytree if path.is_dir() else shutil.copy)(path, moved)
    chosen = moved if kind == "file" else moved / "header.json"
    assert bpy.ops.rle_splat.relocate_volume(filepath=str(chosen), use_dialog=False) == {"FINISHED"}
    np.testing.assert_array_equal(picture_of(owner), before)


@pytest.mark.parametrize("kind", KINDS)
def test_a_viewport_refines_it_to_the_picture(encode, kind, bridge, core):
    """Of the stand-in for a viewport that test_live_viewport.py has, the contents are Blender's own."""
    owner = imported(encode(kind))
    frames, depsgraph = bridge("live.frames"), bpy.context.evaluated_depsgraph_get()
    plain, quality = bridge("scene.render_scene").read_scene(owner, depsgraph, with_meshes=False)
    pictures = {}
    for coarseness in (0, 3, None):
        knobs = quality if coarseness is None else bridge("pictures.drafts").draft_of(quality)
        steps = frames.fitting_steps(plain, knobs, core("pipeline.stage_cache").StageCache(), coarseness or 0)
        pictures[coarseness], _ = core("runtime.steps").drain(steps)
    np.testing.assert_allclose(pictures[None].rgba, picture_of(owner), atol=1e-6)
    for draft in (0, 3):
        assert np.abs(pictures[draft].rgba - pictures[None].rgba).max() < 0.3
    digest = core("runtime.array_hash").hash_plain
    again = bridge("scene.render_scene").read_scene(owner, depsgraph, with_meshes=False)[0]
    assert digest(again) == digest(plain)
    assert digest(replace(plain, width=31)) != digest(plain)


def test_a_viewport_drafts_a_large_folder_in_larger_voxels(encode, bridge, core, monkeypatch):
    monkeypatch.setattr(core("pipeline.encode_folder"), "COARSE_VOXELS", SIDE**3 // 4)
    owner = imported(encode("post"))
    frames = bridge("live.frames")
    plain, _ = scenes.read_scene(owner)
    draft, times = frames.in_larger_voxels(plain)
    assert times == 1 and draft.volume.shape_xyz == (SIDE // 2,) * 3
    odd = replace(draft.volume, shape_xyz=(SIDE // 2 + 1,) * 3)  # of SIDE + 1 voxels
    assert frames.in_larger_voxels(replace(plain, volume=replace(plain.volume, coarse=odd)))[1] == 1
    assert draft.transfer_function.opacity_unit_distance == 1.0
    shown = core("view.box_order").box_of
    np.testing.assert_allclose(
        shown(draft.index_to_world, draft.volume.shape_xyz, 0.5), shown(plain.index_to_world, (SIDE,) * 3, 0.5)
    )
    assert frames.in_larger_voxels(draft) == (draft, 0)


NEEDS_VALUES = {
    "apply_preset": dict(preset="ct-bone"), "load_transfer_function": dict(filepath="any.json"), "window_level": dict(),
    "keyframe_transfer_function": dict(), "add_slice": dict(), "extract_surface": dict(), "add_channels": dict(),
    "import_channel": dict(filepath="any.raw"),
    "measure_accuracy": dict(), "shadow_pass": dict(), "bake_volume": dict(filepath="any.vdb"),
    "save_figure": dict(filepath="any.svg"),
}  # fmt: skip


def test_what_needs_values_is_grayed_and_says_why(encode, refused):
    imported(encode("pre"))
    for name, options in NEEDS_VALUES.items():
        operator = getattr(bpy.ops.rle_splat, name)
        assert not operator.poll(), name
        refused(operator, "holds classified voxels and no values (.rle)", **options)
    refused(bpy.ops.rle_splat.add_cutting_object, "choose Whole Volume", kind="BOX", fit="VISIBLE")
    assert bpy.ops.rle_splat.add_cutting_object(kind="BOX") == {"FINISHED"}


@pytest.mark.parametrize("setting", [{"mode": "mip"}, {"max_error": 2.0}])
def test_a_setting_that_needs_values_is_a_sentence(encode, refused, setting):
    imported(encode("pre"))
    for name, value in setting.items():
        setattr(bpy.context.scene.rle_splat, name, value)
    refused(bpy.ops.rle_splat.render_image, "volume")


def test_lights_shadows_and_qualities_of_a_scene_do_not_matter(encode):
    owner, settings = imported(encode("pre")), bpy.context.scene.rle_splat
    settings.depth_rule = "midpoint-1"
    expected = picture_of(owner)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN")))
    settings.lighting, settings.use_shadows, settings.ambient_occlusion = "SCENE", True, 1.0
    np.testing.assert_array_equal(picture_of(owner), expected)
    for quality in ("draft", "standard", "strict", "paper"):
        settings.quality = quality
        assert np.abs(picture_of(owner) - expected).max() < 0.3
    settings.quality, settings.classification = "fine", "pre"
    assert np.abs(picture_of(owner) - expected).max() < 0.3


def test_options_are_refused(encode, refused):
    refused(bpy.ops.rle_splat.import_volume, "does not apply", filepath=str(encode("pre")), spacing=(1.0, 1.0, 1.0))


def flip(path):
    content = bytearray(path.read_bytes())
    content[7] ^= 255
    path.write_bytes(content)


BROKEN = {
    "cut": (lambda path: (path / "rows.records").write_bytes(b"1"), "damaged: rows.records has"),
    "changed": (lambda path: flip(path / "rows.records"), "the checksum of rows.records does not fit"),
    "missing": (lambda path: (path / "rows.runs").unlink(), "rows.runs is missing"),
    "header": (lambda path: (path / "header.json").write_text("0"), "its header is not complete"),
    "no header": (lambda path: (path / "header.json").unlink(), "cannot read"),
    "gone": (shutil.rmtree, "click Relocate"),
}


@pytest.mark.skipif(os.name == "nt", reason="Windows lets nobody change a mapped file")
@pytest.mark.parametrize("how", BROKEN)
def test_a_folder_that_breaks_while_it_is_shown(encode, refused, bridge, how):
    path = encode("pre")
    picture_of(imported(path))
    damage, words = BROKEN[how]
    damage(path)
    bridge("volumes.file_changes").forget()  # otherwise a change is noticed within a second
    refused(bpy.ops.rle_splat.render_image, words)


@pytest.fixture
def without_rights():
    """``without_rights(path)``: a context in which nobody may read what is at ``path``, the superuser neither."""
    if not hasattr(os, "geteuid"):
        pytest.skip("Windows has other rights")

    @contextmanager
    def closed(path):
        before, user = path.stat().st_mode, os.geteuid()
        path.chmod(0)
        if user == 0:
            os.seteuid(NOBODY)
        try:
            yield
        finally:
            os.seteuid(user)
            path.chmod(before)

    return closed


@pytest.mark.parametrize("name", ["", "header.json", "rows.counts"])
def test_a_folder_without_rights(encode, refused, without_rights, name):
    with TemporaryDirectory() as place:  # pytest's own folders are closed to all others
        os.chmod(place, 0o755)
        if not all(folder.stat().st_mode & 1 for folder in Path(place).parents):
            pytest.skip("the folder of temporary files is closed to all others")
        path = Path(shutil.copytree(encode("pre"), Path(place, "pre.rle")))
        if name.startswith("rows"):
            imported(path)
        with without_rights(path / name):
            if name.startswith("rows"):
                refused(bpy.ops.rle_splat.render_image, "Permission denied; check its permissions")
            else:
                refused(bpy.ops.rle_splat.import_volume, "Permission denied", filepath=str(path))
        assert picture_of(imported(path))[..., 3].max() > 0.5


def test_a_file_that_is_cut(encode, refused):
    path = encode("file")
    path.write_bytes(path.read_bytes()[:-100])
    refused(bpy.ops.rle_splat.import_volume, "not a complete .rle file", filepath=str(path))


def test_an_unfinished_folder(encode, refused, tmp_path):
    path = encode("pre")
    unfinished = tmp_path / ".pre.rle.unfinished"
    path.rename(unfinished)
    (unfinished / "header.json").rename(unfinished / "journal")
    refused(bpy.ops.rle_splat.import_dicom_series, "its encoding was interrupted", directory=str(unfinished))
