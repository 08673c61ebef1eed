"""The byte order of a raw file: what the bytes say counts, whatever words its name has; the name where they say
nothing."""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from rle_splat.read.formats import read_volume
from rle_splat.read.guess import guess_raw, layout_steps
from rle_splat.runtime.steps import drain

DATA = Path(os.environ.get("RLE_SPLAT_DATA") or Path(__file__).resolve().parents[2] / "../shared/data")
SHAPE = (40, 32, 24)
ORDERS = {"<": "little", ">": "big"}
NOISE = {"noise-free": 0.0, "noisy": 0.1}
# Of each kind: words of a head, a place or an article; and words that can only mean a byte order.
NAMES = (
    "{}.raw", "big_head_{}.raw", "little_big_head_{}.raw", "le_crane_{}.raw", "be_{}.raw", "little_{}.raw",
    "head_{}_big.raw", "head_{}_uint16be.raw", "head_{}_le.raw", "head_{}_little-endian.raw", "head_{}_msb.raw",
)  # fmt: skip


def field(low, high, noise):
    """Values (nz, ny, nx) from low to high, noise of that share of the range among them."""
    z, y, x = (np.linspace(0.0, 3.0, n) for n in SHAPE[::-1])
    values = np.sin(x) * np.cos(y)[:, None] * np.sin(z + 0.5)[:, None, None]
    values += noise * np.random.default_rng(5).standard_normal(values.shape)
    return low + (high - low) * (values - values.min()) / np.ptp(values)


def written(path, values):
    path.write_bytes(gzip.compress(values.tobytes(), 1) if path.suffix == ".gz" else values.tobytes())
    return path


@pytest.mark.parametrize("noise", NOISE)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("kind, low, high", [("u2", 0, 900), ("i2", -1000, 3000), ("f4", -1.0, 1.0), ("u4", 0, 70000)])
def test_no_word_of_a_name_overrules_the_bytes(tmp_path, kind, low, high, order, name, noise):
    values = field(low, high, NOISE[noise]).astype(order + kind)
    path = written(tmp_path / name.format("x".join(map(str, SHAPE))), values)
    dtype = np.dtype(kind).name
    guess = guess_raw(path, dtype=dtype)
    assert (guess.byte_order, guess.certain) == (ORDERS[order], True), guess.reasons
    layout, (remark,), _ = drain(layout_steps(path, SHAPE, dtype))
    assert layout.byte_order == ORDERS[order] and f"assumed to be {ORDERS[order]}" in remark
    assert "far smoother" in remark
    volume = read_volume(path, dtype=dtype)
    np.testing.assert_array_equal(volume.voxels, values)
    assert any("far smoother" in remark for remark in volume.remarks)


@pytest.mark.parametrize("order", ORDERS)
def test_a_name_that_the_bytes_contradict_is_said_to_be_wrong(tmp_path, order):
    wrong = {"<": "be", ">": "le"}[order]
    path = written(tmp_path / f"head_40x32x24_uint16{wrong}.raw.gz", field(0, 900, 0.1).astype(order + "u2"))
    volume = read_volume(path)
    assert volume.voxels.max() == 900
    other = ORDERS[{"<": ">", ">": "<"}[order]]
    sentence = f"The file name gives {other}-endian, but read as uint16, {ORDERS[order]}-endian,"
    assert any(sentence in remark for remark in volume.remarks), volume.remarks


@pytest.mark.parametrize(
    "name, order",
    [
        ("head_{}_uint16be.raw", "big"), ("head_{}_uint16le.raw", "little"), ("head_{}_uint16_be.raw", "big"),
        ("head_uint16-big_{}.raw", "big"), ("head_{}_uint16_msb.raw.gz", "big"), ("head_{}_uint16_lsb.raw", "little"),
        ("head_{}_be.raw", "big"), ("head_be_{}_u16.raw", "big"), ("head_{}_le.raw", "little"),
        ("head_{}_big-endian.raw", "big"), ("bigendian_head_{}.raw", "big"), ("little_endian_{}.raw", "little"),
        ("big_head_{}_uint16le.raw", "little"), ("little_head_{}_be.raw", "big"),
        ("big_head_{}.raw", None), ("head_{}_big.raw", None), ("be_{}.raw", None), ("le_{}_uint16.raw", None),
        ("{}_uint16_big_head.raw", None), ("{}_le_crane_uint16.raw", None), ("head_lebanon_{}_uint16.raw", None),
        ("head_be_{}_le.raw", None), ("{}.raw", None),
    ],
)  # fmt: skip
def test_where_the_bytes_do_not_tell_only_an_unmistakable_suffix_does(tmp_path, name, order):
    values = np.random.default_rng(3).integers(0, 1 << 16, SHAPE[::-1], "u2")
    path = written(tmp_path / name.format("x".join(map(str, SHAPE))), values)
    guess = guess_raw(path, dtype="uint16")
    assert guess.certain == (order is not None), guess.reasons
    assert order is None or guess.byte_order == order
    layout, (remark,), _ = drain(layout_steps(path, SHAPE, "uint16"))
    assert layout.byte_order == (order or "little")
    assert ("neither the file's name nor its bytes decide it" if order is None else "the bytes are ambiguous") in remark


def test_numbers_of_one_byte_are_the_same_times_256_in_the_other_order(tmp_path):
    """So an unmistakable suffix is believed; without one, that they are small is likelier."""
    small = field(0, 200, 0.1).astype("<u2")
    for values, name, order, most in (
        (small, "a_40x32x24_uint16le.raw", "little", 200), (small, "b_40x32x24_uint16be.raw", "big", 51200),
        (small, "big_c_40x32x24_uint16.raw", "little", 200), (small.astype(">u2"), "little_d_40x32x24.raw", "big", 200),
    ):  # fmt: skip
        volume = read_volume(written(tmp_path / name, values), shape=SHAPE, dtype="uint16")
        assert volume.voxels.max() == most, name
        assert guess_raw(tmp_path / name, dtype="uint16").byte_order == order
    signed = field(-100, 100, 0.1).astype("<i2")
    assert guess_raw(written(tmp_path / "e_40x32x24_int16be.raw", signed)).byte_order == "big"


def test_a_given_byte_order_stands(tmp_path):
    path = written(tmp_path / "head_40x32x24_uint16le.raw", field(0, 900, 0.0).astype("<u2"))
    assert guess_raw(path, byte_order="big").byte_order == "big"
    layout, remarks, _ = drain(layout_steps(path, SHAPE, "uint16", "big"))
    assert (layout.byte_order, remarks) == ("big", ())


def test_a_file_too_large_to_be_counted_is_told_by_its_bytes(tmp_path):
    """As the import dialog does it, which fills in what was guessed."""
    path = written(tmp_path / "big_head_40x32x24_uint16be.raw.gz", field(0, 900, 0.1).astype("<u2"))
    guess = guess_raw(path, limit=1000)
    assert guess.size is None and guess.byte_order == "little"


@pytest.mark.parametrize("name", ["cthead_256x256x113_uint16be.raw.gz", "lobster_120x120x34_uint16le.raw.gz"])
@pytest.mark.parametrize("called", ["big_head_{}_uint16le.raw.gz", "le_{}_uint16be.raw.gz", "scan_{}.raw.gz"])
def test_real_scans_are_read_right_by_whatever_name(tmp_path, name, called):
    if not (DATA / name).exists():
        pytest.skip(f"needs the scan {name} in ../shared/data or $RLE_SPLAT_DATA")
    shape = name.split("_")[1]
    path = tmp_path / called.format(shape)
    path.write_bytes((DATA / name).read_bytes())
    order = "big" if "be." in name else "little"
    guess = guess_raw(path)
    assert (guess.dtype, guess.byte_order, guess.certain) == ("uint16", order, True)
    assert drain(layout_steps(path, guess.shape, "uint16"))[0].byte_order == order
