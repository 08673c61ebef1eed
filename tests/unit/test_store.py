"""`.rle` files come back as they were, and damaged, lying or foreign ones end in one sentence."""

import itertools
import json
import os
import zipfile
import zlib

import numpy as np
import pytest

from rle_splat.classify.classification import ClassifiedVolume
from rle_splat.classify.visible import row_offsets
from rle_splat.comparison.ours import decode
from rle_splat.encode import store
from rle_splat.encode.encode import encode
from rle_splat.encode.members import HEADER
from rle_splat.encode.store import read_encoded, write_encoded
from rle_splat.encode.stored import StoredVolume
from rle_splat.scene import RleSplatError


def encoded(axis=2, density=0.4, shape=(5, 4, 6)):
    rng = np.random.default_rng(4)
    mask = rng.random(shape) < density
    nz, ny, nx = shape
    n = int(mask.sum())
    classified = ClassifiedVolume.from_lists(
        (nx, ny, nz), row_offsets(mask.reshape(nz * ny, nx).sum(axis=1)), np.nonzero(mask)[2].astype(np.uint16),
        rng.random(n, dtype=np.float32), rng.random(n, dtype=np.float32), rng.random((n, 3), dtype=np.float32),
        0, 1.0, 1.0,
    )  # fmt: skip
    return encode(classified, classified.color, axis)


def stored(axes=(0, 1, 2), **kwargs):
    return StoredVolume.of({axis: encoded(axis, **kwargs) for axis in axes}, np.diag((0.5, 0.5, 2.0, 1.0)), "mm", 0.001,
                        {"name": "CT-Bone"}, {"headlight": True}, "head.raw", ("a remark",))  # fmt: skip


@pytest.mark.parametrize("axes", ((0, 1, 2), (1,)))
@pytest.mark.parametrize("density", (0.4, 0.0, 1.0))
def test_a_file_comes_back_as_it_was(tmp_path, axes, density):
    """And as the same bytes, saved again."""
    before = stored(axes, density=density)
    write_encoded(before, tmp_path / "v.rle")
    after = read_encoded(tmp_path / "v.rle")
    assert after.principal_axes == axes and after.shape_xyz == (6, 4, 5) and after.model == "extinction"
    for axis, tables in after.axes.items():
        np.testing.assert_array_equal(decode(tables), decode(before.axes[axis]))
        assert not tables.runs.flags.writeable and not tables.voxel_data.flags.writeable
    np.testing.assert_array_equal(after.affine, before.affine)
    for name in ("unit", "unit_length", "transfer_function", "lighting", "source", "remarks", "most_color"):
        assert getattr(after, name) == getattr(before, name)
    write_encoded(after, tmp_path / "w.rle")
    assert (tmp_path / "w.rle").read_bytes() == (tmp_path / "v.rle").read_bytes()


def test_nothing_half_made_is_left(tmp_path, monkeypatch):
    path = tmp_path / "v.rle"
    path.write_bytes(b"the old file")
    for interruption in (OSError(28, "No space left on device"), KeyboardInterrupt()):

        def broken(part, members, interruption=interruption):
            part.write_bytes(b"half")
            raise interruption

        with monkeypatch.context() as patch:
            patch.setattr(store, "write_file", broken)
            with pytest.raises((RleSplatError, KeyboardInterrupt)):
                write_encoded(stored(), path)
        assert [p.name for p in tmp_path.iterdir()] == ["v.rle"] and path.read_bytes() == b"the old file"
    with pytest.raises(RleSplatError, match="Cannot write"):
        write_encoded(stored(), tmp_path / "nowhere" / "v.rle")


def refused(path):
    """Opening the file, or the tables in it, ends in one sentence."""
    with pytest.raises(RleSplatError) as problem:
        assert read_encoded(path).axes
    text = str(problem.value)
    assert text.endswith(".") and "\n" not in text and len(text) < 400


def test_a_foreign_missing_or_cut_file_is_refused(tmp_path):
    path = tmp_path / "v.rle"
    with pytest.raises(RleSplatError, match="No such file"):
        read_encoded(path)
    write_encoded(stored(), path)
    whole = path.read_bytes()
    for content in (b"", b"hello", whole[: len(whole) // 2], whole[:-1], whole[1:]):
        path.write_bytes(content)
        refused(path)


@pytest.mark.skipif(os.name == "nt", reason="Windows lets nobody cut a mapped file")
def test_a_file_that_is_cut_while_it_is_open_is_refused(tmp_path):
    path = tmp_path / "v.rle"
    write_encoded(stored(), path)
    opened = read_encoded(path)
    assert len(opened.axes) == 3
    with open(path, "r+b") as file:
        file.truncate(1000)
    with pytest.raises(RleSplatError, match="was cut while it was open"):
        assert opened.axes


def test_a_flipped_byte_is_found_or_does_no_harm(tmp_path):
    path = tmp_path / "v.rle"
    write_encoded(stored((2,), shape=(2, 3, 4)), path)
    whole = path.read_bytes()
    truth = decode(read_encoded(path).axes[2])
    found = 0
    for at in range(len(whole)):
        flip = (0x01, 0x80, 0xFF)[at % 3]
        path = tmp_path / f"{at}.rle"  # Windows lets nobody write to a mapped file
        path.write_bytes(whole[:at] + bytes([whole[at] ^ flip]) + whole[at + 1 :])
        try:
            same = read_encoded(path).axes[2]
        except RleSplatError:
            found += 1
            continue
        np.testing.assert_array_equal(decode(same), truth)  # a byte nobody reads, such as a date
    assert found > 0.5 * len(whole)


def members_of(path) -> dict:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def zipped(path, members, compression=zipfile.ZIP_STORED):
    """A file of the same members by another program, which aligns nothing."""
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(name, content)


def test_a_file_that_another_program_zipped(tmp_path):
    path = tmp_path / "v.rle"
    write_encoded(stored(), path)
    truth, members = decode(read_encoded(path).axes[1]), members_of(path)
    zipped(path, members)
    np.testing.assert_array_equal(decode(read_encoded(path).axes[1]), truth)
    zipped(path, members, zipfile.ZIP_DEFLATED)
    refused(path)


@pytest.mark.parametrize(
    "change",
    (
        {"format": "other"},
        {"version": 2},
        {"record": 8},
        {"record": 5},
        {"record": 6},
        {"record": [6]},
        {"shape_xyz": [6, 4, 6]},
        {"shape_xyz": [4, 6, 5]},
        {"shape_xyz": [0, 4, 5]},
        {"shape_xyz": [10**9, 10**9, 10**9]},
        {"shape_xyz": "big"},
        {"model": "x"},
        {"axes": []},
        {"axes": ["w"]},
        {"axes": ["x"]},
        {"affine": [[1, 2], [3, 4]]},
        {"unit_length": -1},
        {"unit_length": None},
        {"unit": 3},
        {"remarks": None},
        {"axes": 7},
        {"visible": 7},
        {"most_color": -1},
        {"slabs": []},
        {"coarse": True},
        {"classification": "post"},
        {"dtypes": {}},
    ),
)
def test_a_lying_header_is_refused(tmp_path, change):
    path = tmp_path / "v.rle"
    write_encoded(stored((2,)), path)
    members = members_of(path)
    text = json.dumps({**json.loads(members[HEADER][8:]), **change})
    zipped(path, {**members, HEADER: f"{zlib.crc32(text.encode()):08x}{text}"})
    refused(path)


def test_lying_members_are_refused(tmp_path):
    path = tmp_path / "v.rle"
    write_encoded(stored((2,)), path)
    members, numbers = members_of(path), itertools.count()
    for name, content in members.items():
        for lie in (None, b"", content[:-4], content + b"more", bytes(len(content))):
            path = tmp_path / f"{next(numbers)}.rle"  # Windows lets nobody write to a mapped file
            zipped(path, {key: value for key, value in {**members, name: lie}.items() if value is not None})
            refused(path)
