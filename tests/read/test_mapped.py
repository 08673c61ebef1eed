"""Large unpacked files are mapped, not read; what only looks at them reads a few planes."""

import json
import os

import nibabel
import nrrd
import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.cli.main import main
from rle_splat.pipeline.render import render_steps
from rle_splat.read import streaming
from rle_splat.read.formats import read_volume
from rle_splat.runtime.steps import drain
from rle_splat.scene import Camera, Labels, Quality, RleSplatError, Scene
from rle_splat.volume import few_planes
from rle_splat.volume.mapped_files import list_mapped_files
from rle_splat.volume.volume import Volume

SHAPE = (9, 10, 11)  # x, y, z


def values():
    """Every voxel is different."""
    return np.arange(np.prod(SHAPE), dtype=np.int16).reshape(SHAPE[::-1]).transpose(2, 1, 0)


def write(path, given):
    if path.suffix == ".nii":
        nibabel.save(nibabel.Nifti1Image(given, np.eye(4)), path)
    elif path.suffix == ".nrrd":
        nrrd.write(str(path), given, {"encoding": "raw"})
    else:
        path.write_bytes(given.tobytes(order="F"))


def is_mapped(volume):
    base = volume.voxels
    while base is not None and not isinstance(base, np.memmap):
        base = base.base
    return base is not None


@pytest.fixture
def all_large(monkeypatch):
    monkeypatch.setattr(streaming, "LEAST_MAPPED", 1)


@pytest.mark.parametrize("suffix", [".nii", ".nhdr", ".raw"])
def test_a_large_file_is_mapped(tmp_path, all_large, suffix):
    path = tmp_path / f"a{suffix}"
    if suffix == ".nhdr":
        nrrd.write(str(path), values(), {"encoding": "raw"})
    else:
        write(path, values())
    volume = read_volume(path, **({"shape": SHAPE, "dtype": "int16"} if suffix == ".raw" else {}))
    assert is_mapped(volume) and not volume.voxels.flags.writeable
    np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), values())


@pytest.mark.parametrize("suffix", [".nii", ".nrrd", ".raw"])
def test_some_voxels_of_a_file(tmp_path, all_large, suffix):
    write(tmp_path / f"a{suffix}", values())
    given = {"shape": SHAPE, "dtype": "int16"} if suffix == ".raw" else {}
    volume = read_volume(tmp_path / f"a{suffix}", level=1, **given)
    np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), values()[1::2, 1::2, 1::2])
    np.testing.assert_allclose(volume.spacing, 2.0)
    assert not is_mapped(volume) and read_volume(tmp_path / f"a{suffix}", level=0, **given).shape_xyz == SHAPE


def test_a_frame_of_a_large_file_is_mapped(tmp_path, all_large):
    nibabel.save(nibabel.Nifti1Image(np.stack((values(), values() + 1), axis=3), np.eye(4)), tmp_path / "a.nii")
    volume = read_volume(tmp_path / "a.nii", frame=2)
    assert is_mapped(volume)
    np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), values() + 1)


@pytest.mark.parametrize("given", [values().astype(">i2"), values().astype(np.int64)])
def test_what_kernels_cannot_read_is_copied(tmp_path, all_large, given):
    write(tmp_path / "a.nrrd", given)
    volume = read_volume(tmp_path / "a.nrrd")
    assert not is_mapped(volume)
    np.testing.assert_array_equal(volume.voxels.transpose(2, 1, 0), given)


@pytest.mark.parametrize("suffix", [".nii", ".raw"])
def test_a_small_file_is_copied(tmp_path, suffix):
    """It may be replaced while it is shown."""
    write(tmp_path / f"a{suffix}", values())
    given = {"shape": SHAPE, "dtype": "int16"} if suffix == ".raw" else {}
    assert not is_mapped(read_volume(tmp_path / f"a{suffix}", **given))


@pytest.mark.skipif(os.name == "nt", reason="Windows lets nobody cut a mapped file")
@pytest.mark.parametrize("which", ["volume", "labels"])
def test_a_mapped_file_that_is_cut_short_while_it_is_read(tmp_path, all_large, which):
    """A read beyond its end would end the program."""
    np.arange(64**3, dtype=np.int32).astype(np.int16).tofile(tmp_path / "a.raw")
    in_file = read_volume(tmp_path / "a.raw", shape=(64, 64, 64), dtype="int16")
    copied = Volume(np.array(in_file.voxels), np.eye(4))
    volume, labels = (in_file, copied) if which == "volume" else (copied, in_file)
    place = np.eye(4)
    place[:3, 3] = 32.0, 32.0, 100.0
    camera = Camera(place, "ORTHO", ortho_scale=64.0, clip_end=200.0)
    function = TransferFunction(opacity=((0, 0.0), (1000, 0.5)), color=((0.0, 1.0, 1.0, 1.0),))
    scene = Scene(volume, function, camera, 8, 8, labels=Labels(labels))
    steps = render_steps(scene, Quality())
    next(steps)
    os.truncate(tmp_path / "a.raw", 4096)
    with pytest.raises(RleSplatError, match=r"a\.raw was cut short .* 4096 of 524288 bytes are left"):
        drain(steps)


@pytest.mark.parametrize("copy", [np.memmap.copy, lambda mapped: mapped.astype(np.float32)])
def test_a_copy_of_a_mapped_array_is_of_no_file(tmp_path, copy):
    """It is a numpy.memmap still, with no file's name."""
    np.save(tmp_path / "a.npy", values())
    volume = Volume(copy(np.load(tmp_path / "a.npy", mmap_mode="r")), np.eye(4))
    function = TransferFunction(opacity=((0, 0.0), (1000, 0.5)), color=((0.0, 1.0, 1.0, 1.0),))
    scene = Scene(volume, function, Camera(np.eye(4), "ORTHO", ortho_scale=64.0, clip_end=200.0), 8, 8)
    assert list_mapped_files(scene) == []


def test_a_large_file_that_breaks_off(tmp_path, all_large):
    write(tmp_path / "a.nii", values())
    content = (tmp_path / "a.nii").read_bytes()
    (tmp_path / "a.nii").write_bytes(content[:-1])
    with pytest.raises(RleSplatError, match=r"a\.nii breaks off"):
        read_volume(tmp_path / "a.nii")


def test_a_few_planes_lie_where_they_were():
    volume = Volume(values().transpose(2, 1, 0).copy(), np.diag((1.0, 2.0, 3.0, 1.0)))
    assert few_planes.few_planes(volume) is volume
    plane = volume.voxels[0].nbytes
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(few_planes, "LARGE", 4 * plane)
        patch.setattr(few_planes, "MOST_BYTES", 4 * plane)
        few = few_planes.few_planes(volume)
    assert len(few.voxels) == 4 and "4 of its 11 planes" in few.remarks[-1]
    for index, kept in enumerate(few.voxels):
        where = (few.affine @ (0.0, 0.0, index, 1.0))[2] / 3.0
        np.testing.assert_array_equal(kept, volume.voxels[round(where)])


@pytest.mark.parametrize("dtype", [np.int16, np.float32])
def test_info_of_a_large_volume_reads_a_few_planes(tmp_path, monkeypatch, capsys, dtype):
    """Of planes that grow brighter, the outermost values are not seen."""
    planes = np.broadcast_to(np.arange(16, dtype=dtype)[:, None, None], (16, 8, 8)).copy()
    (tmp_path / "a.raw").write_bytes(planes.tobytes())
    monkeypatch.setattr(few_planes, "LARGE", planes[:4].nbytes)
    monkeypatch.setattr(few_planes, "MOST_BYTES", planes[:4].nbytes)
    report = tmp_path / "report.json"
    options = ["--shape", "8", "8", "16", "--dtype", np.dtype(dtype).name, "--json", str(report)]
    assert main(["info", str(tmp_path / "a.raw"), *options]) == 0
    found = json.loads(report.read_text())
    assert found["range"] == [2.0, 14.0] and "4 of its 16 planes" in capsys.readouterr().out
    assert found["shape_xyz"] == [8, 8, 16] and found["memory_bytes"]["voxels"] == planes.nbytes
