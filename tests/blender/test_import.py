"""Importing: the object stands where the file says, holds what is needed to read the voxels again, and a file that
cannot be read changes nothing."""

import gzip
import json
from importlib import import_module
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

NO_NUMBER = "No voxel of the volume holds a finite number"  # the command line's words too, see tests/cli


def import_volume(**options):
    return bpy.ops.rle_splat.import_volume(**options)


def active():
    return bpy.context.view_layer.objects.active


def box_corners(owner) -> np.ndarray:
    """World corners of the drawn box, by walking the instances that Blender itself evaluates."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    for instance in depsgraph.object_instances:
        if instance.is_instance and instance.parent.original == owner:
            matrix = np.array(instance.matrix_world)
            vertices = np.array([v.co[:] for v in instance.object.data.vertices])
            return vertices @ matrix[:3, :3].T + matrix[:3, 3]
    raise AssertionError("the volume draws no box")


def extremes(points) -> tuple:
    return points.min(axis=0), points.max(axis=0)


@pytest.mark.parametrize("order, header", [("little", 0), ("big", 13)])
def test_raw_with_everything_given(tmp_path, bridge, order, header):
    voxels = np.random.default_rng(3).integers(-900, 3000, (5, 6, 7)).astype(np.int16)
    path = tmp_path / "scan.raw"
    path.write_bytes(b"h" * header + voxels.astype("<i2" if order == "little" else ">i2").tobytes())
    import_volume(
        filepath=str(path),
        shape=(7, 6, 5),
        dtype="int16",
        byte_order=order,
        header_bytes=header,
        spacing=(0.7, 0.7, 2.5),
        use_calibration=True,
        slope=2.0,
        intercept=-24.0,
        modality="CT",
        value_unit="HU",
    )
    owner = active()
    assert owner.type == "EMPTY" and owner.empty_display_type == "PLAIN_AXES" and owner.rle_splat.is_volume
    volume = bridge("volumes.volumes").load_volume(owner)
    np.testing.assert_array_equal(volume.voxels, voxels)
    # 0.7 as typed, not the float32 nearest to it: the command line gets the same affine
    np.testing.assert_array_equal(volume.affine, np.diag((0.7, 0.7, 2.5, 1.0)))
    assert (volume.slope, volume.intercept, volume.modality, volume.value_unit) == (2.0, -24.0, "CT", "HU")
    assert owner.rle_splat.value_low == 2.0 * voxels.min() - 24.0
    assert "7 × 6 × 5, int16" in owner.rle_splat.facts


def test_box_is_the_voxel_centers_in_metres_and_follows_the_object(volume_object):
    low, high = extremes(box_corners(volume_object))
    np.testing.assert_allclose(low, (0.0, 0.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(high, (0.006, 0.010, 0.012), rtol=1e-6)
    volume_object.location, volume_object.scale = (1.0, 2.0, 3.0), (-1.0, 1.0, 10.0)
    low, high = extremes(box_corners(volume_object))
    np.testing.assert_allclose(low, (1.0 - 0.006, 2.0, 3.0), rtol=1e-6)
    np.testing.assert_allclose(high, (1.0, 2.010, 3.12), rtol=1e-6)


def test_scene_scale_moves_the_box(volume_object):
    bpy.context.scene.rle_splat.scene_scale = 0.01
    np.testing.assert_allclose(extremes(box_corners(volume_object))[1], (0.06, 0.10, 0.12), rtol=1e-6)


def test_box_has_nothing_to_render(volume_object):
    for holder in volume_object.instance_collection.objects:
        assert holder.hide_render and not holder.data.polygons and len(holder.data.edges) == 12


def test_guesses_fill_what_is_left_out(tmp_path, bridge):
    voxels = np.add.outer(np.add.outer(np.arange(5) * 40, np.arange(6) * 5), np.arange(8)).astype(np.uint16)
    path = tmp_path / "head_8x6x5_uint16_be.raw.gz"
    path.write_bytes(gzip.compress(voxels.astype(">u2").tobytes()))
    import_volume(filepath=str(path))
    properties = active().rle_splat
    assert tuple(properties.shape) == (8, 6, 5)
    assert (properties.dtype, properties.byte_order, properties.header_bytes) == ("uint16", "big", 0)
    np.testing.assert_array_equal(bridge("volumes.volumes").load_volume(active()).voxels, voxels)


def test_several_files_at_once(tmp_path, capfd):
    """What is to be known of them is one message: of several a window shows the last alone."""
    for name in ("one_4x4x4_uint8.raw", "two_5x4x3_uint8.raw"):
        n = 64 if "one" in name else 60
        (tmp_path / name).write_bytes(bytes(range(n)))
    import_volume(directory=str(tmp_path), files=[{"name": "one_4x4x4_uint8.raw"}, {"name": "two_5x4x3_uint8.raw"}])
    shapes = sorted(tuple(o.rle_splat.shape) for o in bpy.data.objects if o.rle_splat.is_volume)
    assert shapes == [(4, 4, 4), (5, 4, 3)]
    (message,) = [line for line in capfd.readouterr().out.splitlines() if line.startswith(("Warning:", "Info:"))]
    assert "No spacing was given" in message and all(name in message for name in ("one_4x4x4", "two_5x4x3"))


def test_one_bad_file_of_several_imports_none(tmp_path, refused):
    (tmp_path / "one_4x4x4_uint8.raw").write_bytes(bytes(64))
    (tmp_path / "two.raw.gz").write_bytes(b"\x1f\x8bnot gzip")
    refused(
        import_volume, "two.raw.gz", directory=str(tmp_path),
        files=[{"name": "one_4x4x4_uint8.raw"}, {"name": "two.raw.gz"}])  # fmt: skip


def write_vdb(path, *grids):
    bpy.utils.expose_bundled_modules()
    import openvdb

    made = []
    for name, kind, array in grids:
        grid = getattr(openvdb, kind)()
        grid.copyFromArray(np.ascontiguousarray(array))
        grid.name = name
        rows = [[0.5, 0, 0, 0], [0, 0.5, 0, 0], [0, 0, 0.5, 0], [10, 20, 30, 1]]  # row vectors: translation last
        grid.transform = openvdb.createLinearTransform(rows)
        made.append(grid)
    openvdb.write(str(path), grids=made)
    del made, grid


def test_vdb_stands_where_blender_puts_it(tmp_path, bridge):
    array = np.zeros((4, 5, 6), dtype=np.float32)
    array[1:3, 1:4, 1:5] = np.random.default_rng(1).random((2, 3, 4)) + 0.5
    path = tmp_path / "fog.vdb"
    write_vdb(path, ("density", "FloatGrid", array), ("speed", "Vec3SGrid", np.ones((4, 5, 6, 3), np.float32)))
    import_volume(filepath=str(path), grid="density")
    volume = bridge("volumes.volumes").load_volume(active())
    # the active box is [1, 2] x [1, 3] x [1, 4], dilated by one voxel; world units are meters
    np.testing.assert_allclose(volume.affine[:3, 3], (10.0, 20.0, 30.0))
    low, high = extremes(box_corners(active()))
    np.testing.assert_allclose(low, (10.0, 20.0, 30.0), rtol=1e-6)
    np.testing.assert_allclose(high, (11.5, 22.0, 32.5), rtol=1e-6)
    np.testing.assert_allclose(volume.voxels, array.transpose(2, 1, 0), rtol=1e-6)


def test_bad_files_are_refused_in_a_sentence(tmp_path, refused):
    short = tmp_path / "short.raw"
    short.write_bytes(bytes(100))
    refused(import_volume, "100", filepath=str(short), shape=(7, 6, 5), dtype="uint8")
    packed = gzip.compress(np.random.default_rng(0).bytes(4096))
    (tmp_path / "cut.raw.gz").write_bytes(packed[: len(packed) // 2])
    refused(import_volume, "cut.raw.gz", filepath=str(tmp_path / "cut.raw.gz"), shape=(16, 16, 16), dtype="uint8")
    (tmp_path / "nan_4x4x4_float32.raw").write_bytes(np.full(64, np.nan, np.float32).tobytes())
    refused(
        import_volume, NO_NUMBER, filepath=str(tmp_path / "nan_4x4x4_float32.raw"), shape=(4, 4, 4), dtype="float32"
    )
    refused(import_volume, "missing.raw", filepath=str(tmp_path / "missing.raw"), shape=(4, 4, 4), dtype="uint8")
    (tmp_path / "odd.xyz").write_bytes(bytes(64))
    refused(import_volume, "odd.xyz", filepath=str(tmp_path / "odd.xyz"))
    refused(import_volume, "file")


@pytest.mark.parametrize("spacing", [(1.0, 0.0, 1.0), (1.0, -1.0, 1.0)])
def test_zero_and_negative_spacing_are_refused(phantom, refused, spacing):
    refused(import_volume, "spacing", filepath=str(phantom[0]), shape=(7, 6, 5), dtype="uint8", spacing=spacing)


def test_unknown_type_is_refused(phantom):
    with pytest.raises(TypeError, match="complex64"):
        import_volume(filepath=str(phantom[0]), shape=(7, 6, 5), dtype="complex64")


def test_a_size_that_nothing_fits_is_refused(tmp_path, refused):
    (tmp_path / "prime.raw").write_bytes(bytes(10007))
    refused(import_volume, "Shape", filepath=str(tmp_path / "prime.raw"))


def test_vdb_without_numbers_and_broken_vdb_are_refused(tmp_path, refused):
    write_vdb(tmp_path / "wind.vdb", ("wind", "Vec3SGrid", np.ones((3, 3, 3, 3), np.float32)))
    refused(import_volume, "wind", filepath=str(tmp_path / "wind.vdb"))
    (tmp_path / "broken.vdb").write_bytes(b"not a grid")
    refused(import_volume, "broken.vdb", filepath=str(tmp_path / "broken.vdb"))
    write_vdb(tmp_path / "cut.vdb", ("density", "FloatGrid", np.ones((9, 9, 9), np.float32)))
    whole = (tmp_path / "cut.vdb").read_bytes()
    (tmp_path / "cut.vdb").write_bytes(whole[:-50])
    refused(import_volume, "cut.vdb is damaged", filepath=str(tmp_path / "cut.vdb"))


def test_the_command_line_refuses_a_vdb_without_numbers_too(tmp_path, core, capsys):
    write_vdb(tmp_path / "wind.vdb", ("wind", "Vec3SGrid", np.ones((3, 3, 3, 3), np.float32)))
    (tmp_path / "broken.vdb").write_bytes(b"not a grid")
    for name, words in (("wind.vdb", "no numeric grid"), ("broken.vdb", "not an OpenVDB file")):
        assert core("cli.main").main(["info", str(tmp_path / name)]) == 2
        sentence = capsys.readouterr().err
        assert words in sentence and len(sentence.strip().splitlines()) == 1


def test_moved_file_gives_one_sentence_and_relocate_heals_it(volume_object, phantom, tmp_path, bridge, core):
    volumes = bridge("volumes.volumes")
    elsewhere = tmp_path / "elsewhere.raw"
    phantom[0].rename(elsewhere)
    volumes.forget_all()
    with pytest.raises(core("scene").RleSplatError, match="Relocate"):
        volumes.load_volume(volume_object)
    assert bpy.ops.rle_splat.relocate_volume(filepath=str(elsewhere)) == {"FINISHED"}
    np.testing.assert_array_equal(volumes.load_volume(volume_object).voxels, phantom[1])


def test_relocate_to_a_file_that_does_not_fit_changes_nothing(volume_object, tmp_path, refused):
    (tmp_path / "small.raw").write_bytes(bytes(3))
    before = volume_object.rle_splat.filepath
    refused(bpy.ops.rle_splat.relocate_volume, "3", filepath=str(tmp_path / "small.raw"))
    assert volume_object.rle_splat.filepath == before


def test_changed_voxels_are_noticed(volume_object, phantom, bridge):
    warnings = []
    bridge("volumes.volumes").load_volume(volume_object, warnings.append)
    assert not warnings
    phantom[0].write_bytes(bytes(phantom[1].size))
    bridge("volumes.volumes").load_volume(volume_object, warnings.append)
    assert len(warnings) == 1 and "changed" in warnings[0]


def test_histogram_on_the_object_counts_every_voxel(volume_object, phantom):
    assert sum(json.loads(volume_object.rle_splat.histogram)["counts"]) == phantom[1].size


def test_dropped_files_reach_the_importer(addon):
    handler = bpy.types.FileHandler.bl_rna_get_subclass_py("RLE_SPLAT_FH_volume")
    assert handler.bl_import_operator == "rle_splat.import_volume"
    assert {".raw", ".gz", ".vdb"} <= set(handler.bl_file_extensions.split(";"))


def test_dialog_fills_in_a_guess_for_each_file_picked(tmp_path, addon):
    """``check`` is what Blender calls whenever another file is picked or a value is edited in the dialog."""
    operators = import_module(f"{addon.__name__}.operators.import_volume")
    dialog = SimpleNamespace(directory="", files=(), filepath="", guessed_for="", guess_text="")
    dialog.chosen_paths = lambda: operators.RLE_SPLAT_OT_import_volume.chosen_paths(dialog)
    import_module(f"{addon.__name__}.bridge.data.source_options").clear(dialog)
    (tmp_path / "one_4x4x4_uint8.raw").write_bytes(bytes(range(64)))
    (tmp_path / "two_5x4x3_int16_be_0.5x0.5x2.0.raw").write_bytes(np.arange(60, dtype=">i2").tobytes())
    check = operators.RLE_SPLAT_OT_import_volume.check
    dialog.filepath = str(tmp_path / "one_4x4x4_uint8.raw")
    assert check(dialog, None) and dialog.shape == (4, 4, 4) and dialog.dtype == "uint8" and dialog.guess_text
    dialog.shape = (2, 4, 8)
    assert not check(dialog, None) and dialog.shape == (2, 4, 8)  # an edit by hand stays
    dialog.filepath = str(tmp_path / "two_5x4x3_int16_be_0.5x0.5x2.0.raw")
    assert check(dialog, None) and dialog.shape == (5, 4, 3)
    assert (dialog.dtype, dialog.byte_order, dialog.spacing) == ("int16", "big", (0.5, 0.5, 2.0))


def test_the_dialog_and_the_import_open_each_file_once(tmp_path, addon, monkeypatch):
    operators, opened = import_module(f"{addon.__name__}.operators.import_volume"), []
    names = [f"page_{i}.tif" for i in range(3)]
    for name in names:
        (tmp_path / name).touch()
    operator = operators.RLE_SPLAT_OT_import_volume
    dialog = SimpleNamespace(guessed_for="", use_sequence=False, files=[SimpleNamespace(name=name) for name in names])
    dialog.directory, dialog.chosen_paths = str(tmp_path), lambda: operator.chosen_paths(dialog)
    import_module(f"{addon.__name__}.bridge.data.source_options").clear(dialog)
    monkeypatch.setattr(operators, "format_of", lambda path: opened.append(path) or operators.TIFF)
    monkeypatch.setattr(operators, "is_page", lambda _path: True)
    assert operator.check(dialog, None) and len(opened) == 3
    assert operator.paths(dialog) == [str(tmp_path / names[0])] and len(opened) == 6


def test_a_volume_that_does_not_fit_is_refused_before_memory_is_taken(tmp_path, refused, core, monkeypatch):
    path = tmp_path / "large_64x64x64_uint8.raw.gz"
    path.write_bytes(gzip.compress(bytes(64**3)))
    monkeypatch.setattr(core("runtime.memory"), "available_bytes", lambda: 1000)
    refused(import_volume, "256.0 KiB of memory and 1000 bytes are free", filepath=str(path))
