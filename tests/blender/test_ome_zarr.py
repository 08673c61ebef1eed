"""OME-Zarr in Blender: a clear error without the package zarr; with it, the level that was read is kept."""

import sys

import bpy
import numpy as np
import pytest

from tests.blender.formats import write_zarr


@pytest.fixture
def pyramid(tmp_path):
    fine = np.arange(8 * 9 * 10, dtype=np.uint16).reshape(8, 9, 10)
    return write_zarr(tmp_path / "a.zarr", (fine, fine[::2, ::2, ::2]))


def test_without_the_package(pyramid, monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    before = set(bpy.data.objects)
    with pytest.raises(RuntimeError, match=r"needs the package zarr; install it into this Python"):
        bpy.ops.rle_splat.import_dicom_series(directory=str(pyramid))
    assert set(bpy.data.objects) == before


def test_the_level_is_kept(pyramid, bridge, core):
    pytest.importorskip("zarr", reason="the zip has no zarr")
    core("runtime.memory").limit_to(4 * 8 * 9 * 10)  # a quarter of it is less than the finest level
    try:
        bpy.ops.rle_splat.import_volume(filepath=str(pyramid / "zarr.json"))
    finally:
        core("runtime.memory").limit_to(None)
    owner = bpy.context.view_layer.objects.active
    assert owner.rle_splat.level == 1
    bridge("volumes.volumes").forget_all()
    assert bridge("volumes.volumes").load_volume(owner).shape_xyz == (5, 5, 4)
    bpy.ops.rle_splat.reload_volume(level=0)
    assert bridge("volumes.volumes").load_volume(owner).shape_xyz == (10, 9, 8) and owner.rle_splat.level == 0
    assert bridge("volumes.volumes").load_volume(owner).unit == "um"
