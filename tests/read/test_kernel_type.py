"""Voxels are read in a type that kernels travel for, where one holds all values exactly."""

import numpy as np
import pytest

from rle_splat.pipeline.prepare import STORED_TYPES
from rle_splat.read import kernel_type, streaming
from rle_splat.read.formats import read_volume
from rle_splat.read.kernel_type import KERNEL_TYPES
from rle_splat.volume.mapped_files import is_mapped

NARROWED = [
    ("int8", (-3, 5), "int16"),
    ("int8", (0, 127), "uint8"),
    ("int32", (0, 255), "uint8"),
    ("int32", (0, 256), "int16"),
    ("int32", (-1024, 3071), "int16"),
    ("int32", (-1, 2**15), "float32"),
    ("uint32", (0, 2**15), "uint16"),
    ("uint32", (0, 2**16 - 1), "uint16"),
    ("int32", (-(2**24), 2**24), "float32"),
    ("float64", (-0.5, 2.0**40, np.nan, -np.inf), "float32"),
]
KEPT = [
    ("int32", (-(2**24) - 1, 0)),
    ("uint32", (0, 2**24 + 1)),
    ("float64", (0.1, 1.0)),
    ("float64", (1.0, 1e300)),
    ("float64", (1.0, 2.0**-160)),
]


def read(path, dtype, values, **options):
    """A raw file of the values, over and over in its last plane alone."""
    voxels = np.full((3, 4, 5), values[0], dtype)
    voxels[-1] = np.resize(np.array(values, dtype), (4, 5))
    voxels.tofile(path)
    given = dict(shape=(5, 4, 3), dtype=dtype, byte_order="little", spacing=(1, 1, 1), slope=0.1, intercept=-7.0)
    return voxels, read_volume(path, **given | options)


def test_the_types_are_those_of_prepared_kernels():
    assert KERNEL_TYPES == STORED_TYPES


@pytest.mark.parametrize("dtype, values, narrow", NARROWED)
def test_values_that_fit_are_exact_in_fewer_bits(tmp_path, dtype, values, narrow):
    voxels, volume = read(tmp_path / "a.raw", dtype, values)
    assert volume.voxels.dtype == narrow and volume.remarks == ()
    np.testing.assert_array_equal(volume.physical(volume.voxels), voxels.astype(np.float64) * 0.1 - 7.0)


@pytest.mark.parametrize("dtype, values", KEPT)
def test_values_that_do_not_fit_keep_their_type(tmp_path, dtype, values):
    voxels, volume = read(tmp_path / "a.raw", dtype, values)
    assert volume.voxels.dtype == dtype
    np.testing.assert_array_equal(volume.voxels, voxels)


def test_voxels_that_a_level_leaves_out_do_not_decide(tmp_path):
    voxels = np.zeros((4, 4, 4), np.int32)
    voxels[0, 0, 0] = 2**30
    voxels.tofile(tmp_path / "a.raw")
    options = dict(shape=(4, 4, 4), dtype="int32", byte_order="little", spacing=(1, 1, 1))
    assert [read_volume(tmp_path / "a.raw", level=n, **options).voxels.dtype for n in (0, 1)] == ["int32", "uint8"]


def test_without_memory_for_both_the_type_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel_type, "available_bytes", lambda: 119)  # 60 voxels of int16 need 120
    assert read(tmp_path / "a.raw", "int32", (-1, 1))[1].voxels.dtype == "int32"
    monkeypatch.setattr(kernel_type, "available_bytes", lambda: 120)
    assert read(tmp_path / "a.raw", "int32", (-1, 1))[1].voxels.dtype == "int16"


def test_a_mapped_file_stays_mapped(tmp_path, monkeypatch):
    monkeypatch.setattr(streaming, "LEAST_MAPPED", 1)
    volume = read(tmp_path / "a.raw", "int32", (0, 5))[1]
    assert volume.voxels.dtype == "int32" and is_mapped(volume.voxels)
