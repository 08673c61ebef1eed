"""Raw files: every type, byte order, header and packing gives the voxels that were written; every misfit a sentence."""

import gzip
import inspect
import os

import numpy as np
import pytest

from rle_splat.read.formats import FORMATS, OPTIONS, format_of, read_steps, read_volume, suffixes, write_volume
from rle_splat.read.layout import content_bytes
from rle_splat.runtime.steps import drain
from rle_splat.scene import RleSplatError
from rle_splat.volume.volume import STORED_TYPES, Volume

SHAPE = (5, 4, 3)  # nx, ny, nz


def voxels_of(dtype):
    rng = np.random.default_rng(11)
    if np.dtype(dtype).kind == "f":
        return rng.standard_normal(SHAPE[::-1]).astype(dtype)
    bounds = np.iinfo(dtype)
    return rng.integers(bounds.min, bounds.max, SHAPE[::-1], dtype=dtype, endpoint=True)


def write(path, content: bytes):
    path.write_bytes(gzip.compress(content) if path.name.endswith(".gz") else content)
    return path


@pytest.mark.parametrize("header", [0, 6, 16])
@pytest.mark.parametrize("suffix", [".raw", ".raw.gz"])
@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("dtype", STORED_TYPES)
def test_every_layout_is_read_exactly(tmp_path, dtype, order, suffix, header):
    voxels = voxels_of(dtype)
    stored = voxels.astype(np.dtype(dtype).newbyteorder("<" if order == "little" else ">"))
    path = write(tmp_path / f"scan{suffix}", b"h" * header + stored.tobytes())
    volume = read_volume(
        path, shape=SHAPE, dtype=dtype, byte_order=order, header_bytes=header, spacing=(0.5, 1, 2.5),
        slope=2.0, intercept=-1024.0, value_unit="HU",
    )  # fmt: skip
    np.testing.assert_array_equal(volume.voxels, voxels)
    assert volume.voxels.dtype == {"int8": "int16"}.get(dtype, dtype) and volume.voxels.dtype.isnative
    assert volume.voxels.flags.aligned and volume.voxels.flags.c_contiguous
    assert volume.shape_xyz == SHAPE
    assert volume.spacing.tolist() == [0.5, 1.0, 2.5]
    assert (volume.slope, volume.intercept, volume.value_unit) == (2.0, -1024.0, "HU")


def test_missing_spacing_is_remarked_and_given_spacing_is_not(tmp_path):
    path = write(tmp_path / "a.raw", voxels_of("uint8").tobytes())
    assert any("1 × 1 × 1 mm" in r for r in read_volume(path, shape=SHAPE, dtype="uint8").remarks)
    assert read_volume(path, shape=SHAPE, dtype="uint8", spacing=(1, 1, 1)).remarks == ()


@pytest.mark.parametrize("suffix", [".raw", ".raw.gz"])
@pytest.mark.parametrize("surplus", [-7, 60, 1])
def test_a_wrong_size_names_both_sizes_and_what_would_fit(tmp_path, suffix, surplus):
    path = write(tmp_path / f"a{suffix}", bytes(60 + surplus))
    with pytest.raises(RleSplatError) as caught:
        read_volume(path, shape=SHAPE, dtype="uint8")
    sentence = str(caught.value)
    assert f"holds {60 + surplus} bytes" in sentence and "need 60 bytes" in sentence
    if surplus == 60:
        assert "5 x 4 x 6 voxels of uint8" in sentence and "5 x 4 x 3 voxels of uint16" in sentence
        assert "after a header of 60 bytes" in sentence


def test_a_truncated_gzip_is_named_as_such(tmp_path):
    whole = gzip.compress(np.random.default_rng(0).integers(0, 255, 6000, dtype=np.uint8).tobytes())
    path = tmp_path / "a.raw.gz"
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(RleSplatError, match="ends too early"):
        read_volume(path, shape=(10, 20, 30), dtype="uint8")
    path.write_bytes(whole[:1000] + b"\xff" * 500 + whole[1500:])
    with pytest.raises(RleSplatError, match=r"damaged|valid|ends too early|holds"):
        read_volume(path, shape=(10, 20, 30), dtype="uint8")
    path.write_bytes(b"not packed at all")
    with pytest.raises(RleSplatError, match="not a valid gzip"):
        read_volume(path, shape=(10, 20, 30), dtype="uint8")


def test_joined_gzip_members_are_one_file(tmp_path):
    voxels = voxels_of("uint8")
    path = tmp_path / "a.raw.gz"
    path.write_bytes(gzip.compress(voxels.tobytes()[:20]) + gzip.compress(voxels.tobytes()[20:]))
    np.testing.assert_array_equal(read_volume(path, shape=SHAPE, dtype="uint8").voxels, voxels)


def test_a_shape_that_the_packed_file_cannot_hold_allocates_nothing(tmp_path):
    path = write(tmp_path / "a.raw.gz", bytes(1000))
    with pytest.raises(RleSplatError, match="holds 1000 bytes"):
        read_volume(path, shape=(60000, 60000, 60000), dtype="float64")


def test_a_file_that_unpacks_without_end_is_counted_only_so_far(tmp_path):
    path = write(tmp_path / "a.raw.gz", bytes(1 << 24))
    assert content_bytes(path, limit=1 << 22) is None
    assert content_bytes(path) == 1 << 24


@pytest.mark.parametrize(
    "options, words",
    [
        (dict(dtype="float16"), "no voxel type 'float16'"),
        (dict(dtype="int64"), "no voxel type"),
        (dict(shape=(5, 4)), "three whole numbers"),
        (dict(shape=(5, 4, 2.5)), "three whole numbers"),
        (dict(shape=(5, 4, 0)), "from 1"),
        (dict(shape=(-5, -4, 3)), "from 1"),
        (dict(byte_order="middle"), "little or big"),
        (dict(header_bytes=-1), "whole number of bytes"),
        (dict(spacing=(1, 0, 1)), "above zero"),
        (dict(spacing=(1, -1, 1)), "above zero"),
        (dict(spacing=(1, 1)), "three numbers"),
        (dict(spacing=(1, 1, float("nan"))), "finite"),
        (dict(slope=0.0), "not zero"),
        (dict(intercept=float("inf")), "finite"),
        (dict(grid="density"), "does not apply"),
    ],
)
def test_each_wrong_option_gets_its_sentence(tmp_path, options, words):
    path = write(tmp_path / "a.raw", bytes(60))
    with pytest.raises(RleSplatError, match=words):
        read_volume(path, **{"shape": SHAPE, "dtype": "uint8", **options})


def test_an_option_that_no_format_has_gets_its_sentence(tmp_path):
    path = write(tmp_path / "a.raw", bytes(60))
    with pytest.raises(RleSplatError, match="no volume option 'colour'"):
        drain(read_steps(path, shape=SHAPE, dtype="uint8", colour="red"))


def test_the_parameters_of_read_volume_are_the_options_of_all_formats():
    assert set(inspect.signature(read_volume).parameters) == {"path", *OPTIONS}


def test_files_that_are_not_there_or_of_no_known_kind(tmp_path):
    with pytest.raises(RleSplatError, match="no file"):
        read_volume(tmp_path / "nothing.raw")
    with pytest.raises(RleSplatError, match="folder"):
        read_volume(tmp_path)
    path = write(tmp_path / "scan.xyz", bytes(60))
    with pytest.raises(RleSplatError, match=r"no suffix of a known format.*\.vdb"):
        read_volume(path)
    assert read_volume(path, shape=SHAPE, dtype="uint8").shape_xyz == SHAPE  # raw, once its layout is said


@pytest.mark.parametrize("is_folder", [False, True])
def test_encoded_voxels_are_no_volume(tmp_path, is_folder):
    path = tmp_path / "scan.rle"
    path.mkdir() if is_folder else path.write_bytes(b"any")
    with pytest.raises(RleSplatError, match="holds voxels that are classified already, and no values; give"):
        read_volume(path)


def test_an_unnamed_layout_is_asked_for_with_what_would_fit(tmp_path):
    path = write(tmp_path / "scan.raw", bytes(64**3))
    with pytest.raises(RleSplatError, match=r"give its shape.*64 x 64 x 64 voxels of uint8"):
        read_volume(path)


def test_a_name_that_says_everything_is_enough(tmp_path):
    voxels = voxels_of("int16")
    path = write(tmp_path / "scan_5x4x3_int16be_0.5x0.5x2mm.raw.gz", voxels.astype(">i2").tobytes())
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.voxels, voxels)
    assert volume.spacing.tolist() == [0.5, 0.5, 2.0]
    assert any("guessed" in remark for remark in volume.remarks)


@pytest.mark.parametrize("suffix", [".raw", ".raw.gz"])
@pytest.mark.parametrize("dtype", STORED_TYPES)
def test_written_files_read_back_the_same(tmp_path, dtype, suffix):
    volume = Volume(voxels_of(dtype), np.diag((0.5, 1.5, 2.0, 1.0)), slope=0.5, intercept=3.0, value_unit="HU")
    options = write_volume(volume, tmp_path / f"out{suffix}")
    again = read_volume(tmp_path / f"out{suffix}", **options)
    np.testing.assert_array_equal(again.physical(again.voxels), volume.physical(volume.voxels))
    assert (again.affine == volume.affine).all() and again.value_unit == "HU"
    assert os.listdir(tmp_path) == [f"out{suffix}"]


def test_a_failed_write_leaves_nothing_and_says_why(tmp_path):
    volume = Volume(voxels_of("uint8"), np.eye(4))
    with pytest.raises(RleSplatError, match="Cannot write"):
        write_volume(volume, tmp_path / "no folder" / "out.raw")
    with pytest.raises(RleSplatError, match="no suffix of a writable format"):
        write_volume(volume, tmp_path / "out.png")
    assert os.listdir(tmp_path) == []


def test_the_table_of_formats_is_consistent():
    every = suffixes()
    assert len(set(every)) == len(every)
    assert all("." in s for s in every)
    assert {name for entry in FORMATS for name in entry.all_options} == set(OPTIONS)
    assert format_of("A/B.RAW.GZ").name == "raw"
    assert format_of("smoke.vdb").name == "OpenVDB"
    assert format_of("a.png") is None
