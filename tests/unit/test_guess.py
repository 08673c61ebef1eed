"""What a raw file is taken for, and how sure we say we are."""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from rle_splat.read.guess import guess_raw

DATA = Path(os.environ.get("RLE_SPLAT_DATA") or Path(__file__).resolve().parents[2] / "../shared/data")


def smooth(shape, low, high):
    """A smooth field (nz, ny, nx) float64 between low and high, with the least bit of noise."""
    z, y, x = (np.linspace(0.0, 3.0, n) for n in shape[::-1])
    field = np.sin(x) * np.cos(y)[:, None] * np.sin(z + 0.5)[:, None, None]
    field += 0.001 * np.random.default_rng(2).standard_normal(field.shape)
    return low + (high - low) * (field - field.min()) / np.ptp(field)


def file_of(tmp_path, name, shape, dtype, low=0.0, high=4000.0, header=0):
    path = tmp_path / name
    content = bytes(header) + smooth(shape, low, high).astype(dtype).tobytes()
    path.write_bytes(gzip.compress(content, 1) if name.endswith(".gz") else content)
    return path


@pytest.mark.parametrize(
    "name, shape, dtype, expected",
    [
        ("head_20x18x10_uint16be.raw.gz", (20, 18, 10), ">u2", ("uint16", "big")),
        ("head-20x18x10-int16-le.raw", (20, 18, 10), "<i2", ("int16", "little")),
        ("head_20x18x10_float32_big.raw", (20, 18, 10), ">f4", ("float32", "big")),
        ("head.20x18x10.double.little-endian.raw", (20, 18, 10), "<f8", ("float64", "little")),
        ("head_20X18X10_UCHAR.RAW", (20, 18, 10), "u1", ("uint8", "little")),
        ("head_20_18_10_ushort_msb.raw", (20, 18, 10), ">u2", ("uint16", "big")),
        ("head_20x18x10_i16lsb.raw", (20, 18, 10), "<i2", ("int16", "little")),
        ("cube_24^3_16bit_be.raw", (24, 24, 24), ">u2", ("uint16", "big")),
    ],
)
def test_names_that_say_everything(tmp_path, name, shape, dtype, expected):
    guess = guess_raw(file_of(tmp_path, name, shape, dtype, high=200.0))
    assert guess.certain
    assert (guess.shape, guess.dtype, guess.byte_order, guess.header_bytes) == (shape, *expected, 0)
    assert guess.candidates[0].shape == shape


@pytest.mark.parametrize(
    "dtype, low, expected",
    [
        (">u2", 0.0, ("uint16", "big")),
        ("<u2", 0.0, ("uint16", "little")),
        ("<i2", -1000.0, ("int16", "little")),
        (">i2", -1000.0, ("int16", "big")),
        ("<f4", -1000.0, ("float32", "little")),
        (">f4", 0.0, ("float32", "big")),
        ("<f8", 0.0, ("float64", "little")),
    ],
)
def test_with_a_known_shape_the_bytes_tell_type_and_order(tmp_path, dtype, low, expected):
    guess = guess_raw(file_of(tmp_path, "scan.raw.gz", (40, 30, 20), dtype, low), shape=(40, 30, 20))
    assert (guess.dtype, guess.byte_order) == expected
    assert guess.certain
    assert any("smoother" in reason for reason in guess.reasons)


def test_without_a_shape_it_proposes_but_is_not_certain(tmp_path):
    guess = guess_raw(file_of(tmp_path, "scan.raw", (64, 64, 64), "u1", high=255.0))
    assert (guess.shape, guess.dtype, guess.certain) == ((64, 64, 64), "uint8", False)
    assert "guess" in guess.reasons[-1]
    guess = guess_raw(file_of(tmp_path, "scan2.raw", (128, 128, 37), "<i2", -1000.0))
    assert (guess.shape, guess.dtype, guess.certain) == ((128, 128, 37), "int16", False)


def test_every_candidate_fits_the_size(tmp_path):
    path = file_of(tmp_path, "scan.raw", (128, 128, 48), "<u2")
    guess = guess_raw(path)
    assert len(guess.candidates) > 2
    assert {candidate.total_bytes for candidate in guess.candidates} == {path.stat().st_size}


def test_a_surplus_is_proposed_as_a_header_but_not_believed(tmp_path):
    guess = guess_raw(file_of(tmp_path, "a_20x18x10_uint8.raw", (20, 18, 10), "u1", high=255.0, header=352))
    assert (guess.header_bytes, guess.certain) == (352, False)
    guess = guess_raw(file_of(tmp_path, "a_20x18x10_uint8_header352.raw", (20, 18, 10), "u1", high=255.0, header=352))
    assert (guess.header_bytes, guess.certain) == (352, True)


def test_a_spacing_in_the_name_is_not_taken_for_a_shape(tmp_path):
    guess = guess_raw(file_of(tmp_path, "a_0.5x0.5x1.25_20x18x10_uint8.raw", (20, 18, 10), "u1", high=255.0))
    assert (guess.shape, guess.spacing, guess.certain) == ((20, 18, 10), (0.5, 0.5, 1.25), True)


@pytest.mark.parametrize("size", [0, 1, 7, 104729])
def test_sizes_that_nothing_fits_say_so(tmp_path, size):
    path = tmp_path / "scan.raw"
    path.write_bytes(bytes(size))
    guess = guess_raw(path)
    assert (guess.shape, guess.certain, guess.candidates, guess.size) == (None, False, (), size)
    assert any("No known layout" in reason for reason in guess.reasons)


def test_a_name_that_contradicts_the_size_is_not_believed(tmp_path):
    path = tmp_path / "scan_64x64x64_uint8.raw"
    path.write_bytes(bytes(1000))
    assert not guess_raw(path).certain


def test_beyond_the_limit_the_size_is_not_counted(tmp_path):
    guess = guess_raw(file_of(tmp_path, "a_40x30x20_uint8.raw.gz", (40, 30, 20), "u1", high=255.0), limit=1000)
    assert guess.size is None and not guess.certain
    assert any("more than 1000 bytes" in reason for reason in guess.reasons)


@pytest.mark.parametrize(
    "name, shape, dtype, order",
    [
        ("cthead_256x256x113_uint16be.raw.gz", (256, 256, 113), "uint16", "big"),
        ("engine_256x256x110_uint8.raw.gz", (256, 256, 110), "uint8", "little"),
        ("lobster_120x120x34_uint16le.raw.gz", (120, 120, 34), "uint16", "little"),
    ],
)
def test_real_scans_are_recognised_by_name_and_proposed_without(tmp_path, name, shape, dtype, order):
    if not (DATA / name).exists():
        pytest.skip(f"needs the scan {name} in ../shared/data or $RLE_SPLAT_DATA")
    guess = guess_raw(DATA / name)
    assert (guess.shape, guess.dtype, guess.byte_order, guess.certain) == (shape, dtype, order, True)
    nameless = tmp_path / "scan.raw.gz"
    nameless.write_bytes((DATA / name).read_bytes())
    guess = guess_raw(nameless)
    assert (guess.shape, guess.dtype, guess.byte_order, guess.certain) == (shape, dtype, order, False)
