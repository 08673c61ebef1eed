"""Each kind of bad medical file gets one sentence in Blender's own report, and the scene is as it was."""

import bpy
import numpy as np
import pytest


@pytest.fixture
def bad(addon):
    """The table of bad files; it needs the libraries of the installed extension."""
    pytest.importorskip("pydicom", reason="the zip has no wheels")
    pytest.importorskip("nibabel", reason="the zip has no wheels")
    pytest.importorskip("rle_splat", reason="what writes the files needs the package, not the extension")
    from importlib import import_module

    return import_module("tests.read.bad_files").BAD


def values_of(group) -> dict:
    """Every stored property of a property group, as plain data."""
    found = {}
    for name in group.bl_rna.properties.keys():
        value = getattr(group, name, None)
        if name in ("rna_type", "bl_rna"):
            continue
        if hasattr(value, "bl_rna") and hasattr(value, "name_full"):
            value = value.name_full
        elif isinstance(value, bpy.types.PropertyGroup):
            value = values_of(value)
        elif hasattr(value, "keys") and hasattr(value, "add"):
            value = [values_of(row) for row in value]
        elif hasattr(value, "__len__") and not isinstance(value, str):
            value = tuple(value)
        is_plain = isinstance(value, (dict, list, tuple, str, int, float, type(None)))
        found[name] = value if is_plain else repr(value)
    return found


def scene_as_it_is() -> dict:
    """All that a failed import or Relocate must leave alone."""
    datablocks = {
        kind: sorted(one.name_full for one in getattr(bpy.data, kind))
        for kind in ("objects", "meshes", "collections", "node_groups", "images", "cameras", "materials", "texts")
    }
    volumes = {one.name: values_of(one.rle_splat) for one in bpy.data.objects if one.rle_splat.is_volume}
    places = {one.name: tuple(map(tuple, one.matrix_world)) for one in bpy.data.objects}
    return {
        "datablocks": datablocks, "volumes": volumes, "places": places, "scene": values_of(bpy.context.scene.rle_splat),
        "active": bpy.context.view_layer.objects.active.name,
        "selected": [one.name for one in bpy.context.selected_objects],
    }  # fmt: skip


@pytest.fixture
def scan(bad, tmp_path):
    """A good file, imported: a volume that Relocate reads from elsewhere."""
    import nibabel

    nibabel.save(nibabel.Nifti1Image(np.arange(210, dtype=np.int16).reshape(7, 6, 5), np.eye(4)), tmp_path / "good.nii")
    bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / "good.nii"))
    return bpy.context.view_layer.objects.active


def test_the_comparison_sees_a_change(scan):
    before = scene_as_it_is()
    scan.rle_splat.opacity_scale = 0.5
    assert scene_as_it_is() != before


def test_each_is_refused_in_a_sentence(scan, bad, bridge, refused, tmp_path):
    voxels = bridge("volumes.volumes").load_volume(scan)
    before = scene_as_it_is()
    assert len(bad) == 29
    for number, (name, (write, words)) in enumerate(bad.items()):
        path = write(tmp_path / str(number))
        words = {"several series": "There are 2 series; set series to the number of one"}.get(name, words)
        for operator in (bpy.ops.rle_splat.import_volume, bpy.ops.rle_splat.relocate_volume):
            refused(operator, words, filepath=str(path))
            assert scene_as_it_is() == before, name
    assert bridge("volumes.volumes").load_volume(scan) is voxels, "the voxels are those in memory, too"
