"""OME-Zarr 0.4 and 0.5, written by zarr: levels, axes, units, frames, and damaged folders."""

import json
import shutil
import sys

import numpy as np
import pytest

from rle_splat.cli.main import main
from rle_splat.read import ome_zarr
from rle_splat.read.formats import format_of, read_volume
from rle_splat.runtime import memory
from rle_splat.scene import RleSplatError

zarr = pytest.importorskip("zarr")

SHAPE = (10, 12, 14)  # z, y, x of the finest level
MICROMETER, NANOMETER = "micrometer", "nanometer"


def values(level=0, dtype=np.uint16, *before):
    """Every voxel of every level is different; ``before``: lengths of the axes before z."""
    shape = (*before, *(n >> level for n in SHAPE))
    return (1000 * level + np.arange(np.prod(shape))).astype(dtype).reshape(shape)


def axes_of(names, unit):
    kinds = {"t": "time", "c": "channel"}
    return [
        {"name": n, "type": kinds.get(n, "space"), **({} if n in kinds or unit is None else {"unit": unit})}
        for n in names
    ]


def write(path, version="0.5", names="zyx", unit=MICROMETER, dtype=np.uint16, before=(), levels=2, **facts):
    """An image of two levels; voxels of the finest are 0.5 x 0.6 x 0.7 long (z, y, x)."""
    datasets = []
    group = zarr.open_group(str(path), mode="w", zarr_format=3 if version == "0.5" else 2)
    for level in range(levels):
        data = values(level, dtype, *before)
        chunks = (*(1 for _ in before), 4, 5, 6)
        array = group.create_array(str(level), shape=data.shape, chunks=chunks, dtype=data.dtype)
        array[...] = data
        side = 2.0**level
        scale = [*(1.0 for _ in before), 0.5 * side, 0.6 * side, 0.7 * side]
        offset = [*(0.0 for _ in before), *((side - 1.0) / 2.0 * length for length in (0.5, 0.6, 0.7))]
        transforms = [{"type": "scale", "scale": scale}, {"type": "translation", "translation": offset}]
        datasets.append({"path": str(level), "coordinateTransformations": transforms})
    image = {"axes": axes_of(names, unit), "datasets": datasets, **facts}
    if version == "0.5":
        group.attrs["ome"] = {"version": "0.5", "multiscales": [image]}
    else:
        group.attrs["multiscales"] = [{"version": "0.4", **image}]
    return path


@pytest.mark.parametrize("version", ["0.4", "0.5"])
@pytest.mark.parametrize("level", [0, 1])
def test_every_level_is_where_its_metadata_say(tmp_path, version, level):
    path = write(tmp_path / "a.ome.zarr", version)
    assert format_of(path).name == "OME-Zarr"
    volume = read_volume(path, level=level)
    np.testing.assert_array_equal(volume.voxels, values(level))
    side = 2.0**level
    np.testing.assert_allclose(np.diag(volume.affine), (0.7 * side, 0.6 * side, 0.5 * side, 1.0))
    np.testing.assert_allclose(volume.affine[:3, 3], 0.5 * (side - 1.0) * np.array((0.7, 0.6, 0.5)))
    assert volume.unit == "um" and volume.levels == ((14, 12, 10), (7, 6, 5))
    assert any("Level 1" in remark for remark in volume.remarks) == (level == 1)


def test_the_file_inside_stands_for_the_folder(tmp_path):
    for version, name in (("0.5", "zarr.json"), ("0.4", ".zattrs")):
        path = write(tmp_path / version, version)
        np.testing.assert_array_equal(read_volume(path / name).voxels, values())


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32, ">u2", np.int64])
def test_types(tmp_path, dtype):
    volume = read_volume(write(tmp_path / "a.zarr", "0.4", dtype=dtype))
    np.testing.assert_array_equal(volume.voxels, values(0, dtype))


@pytest.mark.parametrize("names", ["tczyx", "ctzyx"])
def test_times_and_channels_are_frames(tmp_path, names):
    path = write(tmp_path / "a.zarr", names=names, before=(2, 3))
    every = values(0, np.uint16, 2, 3)
    every = every if names[0] == "t" else every.swapaxes(0, 1)  # by time, then by channel
    for number in (1, 3, 5):
        volume = read_volume(path, frame=number)
        np.testing.assert_array_equal(volume.voxels, every.reshape(6, *SHAPE)[number - 1])
        assert volume.frames == 6 and volume.frame_axis == "time and channel"
    with pytest.raises(RleSplatError, match="There is no volume 7"):
        read_volume(path, frame=7)
    assert read_volume(write(tmp_path / "b.zarr", names="tzyx", before=(2,)), frame=2).frame_axis == "time"


def test_units(tmp_path):
    for unit, name, factor in ((NANOMETER, "nm", 1.0), ("angstrom", "mm", 1e-7), (None, "mm", 1.0)):
        volume = read_volume(write(tmp_path / f"{name}-{factor}.zarr", unit=unit))
        assert volume.unit == name
        np.testing.assert_allclose(volume.spacing, factor * np.array((0.7, 0.6, 0.5)))
    assert any("no unit of length" in remark for remark in volume.remarks)
    mixed = axes_of("zyx", MICROMETER)
    mixed[0]["unit"] = NANOMETER
    volume = read_volume(write(tmp_path / "mixed.zarr", **{"axes": mixed}))
    assert volume.unit == "mm"
    np.testing.assert_allclose(volume.spacing, (0.7e-3, 0.6e-3, 0.5e-6))


def test_transformations_of_all_levels_come_last(tmp_path):
    shared = [{"type": "scale", "scale": [2.0, 2.0, 2.0]}]
    volume = read_volume(write(tmp_path / "a.zarr", coordinateTransformations=shared), level=1)
    np.testing.assert_allclose(volume.spacing, (2.8, 2.4, 2.0))
    np.testing.assert_allclose(volume.affine[:3, 3], (0.7, 0.6, 0.5))


def test_the_level_that_fits_is_read(tmp_path, monkeypatch):
    path = write(tmp_path / "a.zarr")
    monkeypatch.setattr(ome_zarr, "SHARE", 1.0)
    free = values(1).nbytes
    monkeypatch.setattr(ome_zarr, "available_bytes", lambda: free)
    volume = read_volume(path)
    assert volume.shape_xyz == (7, 6, 5) and "the finest that fits into memory" in " ".join(volume.remarks)
    monkeypatch.setattr(ome_zarr, "available_bytes", lambda: free - 1)
    assert read_volume(path).shape_xyz == (7, 6, 5)  # the coarsest, whatever fits
    memory.limit_to(values(0).nbytes - 1)
    try:
        with pytest.raises(RleSplatError, match="are free"):
            read_volume(path, level=0)
    finally:
        memory.limit_to(None)


def test_voxels_in_a_scratch_file(tmp_path):
    path = write(tmp_path / "a.zarr")
    memory.limit_to(1)
    try:
        volume = read_volume(path, level=0, scratch=tmp_path / "voxels")
    finally:
        memory.limit_to(None)
    assert (tmp_path / "voxels").stat().st_size == volume.voxels.nbytes
    np.testing.assert_array_equal(volume.voxels, values())


def test_info_names_the_levels(tmp_path, capsys, monkeypatch):
    path = write(tmp_path / "a.zarr")
    monkeypatch.setattr(ome_zarr, "QUICK_VOXELS", values(1).size)
    report = tmp_path / "report.json"
    assert main(["info", str(path), "--json", str(report)]) == 0
    assert json.loads(report.read_text())["levels"] == [[14, 12, 10], [7, 6, 5]]
    shown = capsys.readouterr().out
    assert "0: 14 x 12 x 10, 1: 7 x 6 x 5" in shown and "to answer at once" in shown


def refused(path, match, **options):
    with pytest.raises(RleSplatError, match=match):
        read_volume(path, **options)


def test_a_level_that_is_not_there(tmp_path):
    refused(write(tmp_path / "a.zarr"), "There is no level 2: a.zarr has 2; give one from 0", level=2)
    shutil.rmtree(tmp_path / "a.zarr" / "1")
    refused(tmp_path / "a.zarr", "Level '1' of a.zarr is damaged or cut short")


@pytest.mark.parametrize("version", ["0.4", "0.5"])
def test_a_chunk_that_is_cut_short(tmp_path, version):
    path = write(tmp_path / "a.zarr", version)
    folder, name = (path / "0" / "c", "2") if version == "0.5" else (path / "0", "0.0.2")
    chunk = max((file for file in folder.rglob(name) if file.is_file()), key=lambda file: file.stat().st_size)
    chunk.write_bytes(chunk.read_bytes()[:-7])
    refused(path, "A chunk of a.zarr is damaged or cut short")


@pytest.mark.parametrize(
    "change, match",
    [
        ({"axes": []}, "without the description"),
        ({"axes": axes_of("xyz", MICROMETER)}, "The axes of a.zarr are x, y, z"),
        ({"datasets": []}, "has z, y and x"),
        ({"datasets": [{"path": "../b"}]}, "lies outside of it"),
        ({"datasets": 3}, "without the description"),
        ({"datasets": [{"path": "0", "coordinateTransformations": [{"type": "rotation"}]}]}, "without the description"),
    ],
)
def test_metadata_that_make_no_sense(tmp_path, change, match):
    path = write(tmp_path / "a.zarr", "0.4")
    facts = json.loads((path / ".zattrs").read_text())
    facts["multiscales"][0].update(change)
    (path / ".zattrs").write_text(json.dumps(facts))
    refused(path, match)


def test_folders_of_another_kind(tmp_path):
    group = zarr.open_group(str(tmp_path / "a.zarr"), mode="w")
    refused(tmp_path / "a.zarr", "a.zarr is a Zarr folder without the description of an OME-Zarr image")
    group.attrs["ome"] = {"version": "0.5", "plate": {}}
    refused(tmp_path / "a.zarr", "a.zarr holds several images")
    (tmp_path / "a.zarr" / "zarr.json").write_text("{")
    refused(tmp_path / "a.zarr", "it is not JSON")


def test_without_zarr(tmp_path, monkeypatch):
    path = write(tmp_path / "a.zarr")
    monkeypatch.setitem(sys.modules, "zarr", None)
    refused(path, "needs the package zarr")
