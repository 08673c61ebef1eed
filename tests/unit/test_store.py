"""`.rle` files come back as they were, and damaged, lying or foreign ones end in one sentence."""

import io
import json
import zipfile

import numpy as np
import pytest

from rle_splat.classify.classification import ClassifiedVolume
from rle_splat.classify.visible import row_offsets
from rle_splat.encode.encode import encode
from rle_splat.encode.store import StoredVolume, load, save
from rle_splat.encode.tables import TABLES
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
    )
    return encode(classified, classified.color, axis)


def stored(axes=(0, 1, 2), **kwargs):
    return StoredVolume({axis: encoded(axis, **kwargs) for axis in axes}, np.diag((0.5, 0.5, 2.0, 1.0)), "mm", 0.001,
                        {"name": "CT-Bone"}, {"headlight": True}, "head.raw", ("a remark",))


def assert_one_sentence(problem):
    text = str(problem.value)
    assert text.endswith(".") and "\n" not in text and len(text) < 400


@pytest.mark.parametrize("axes", ((0, 1, 2), (1,)))
@pytest.mark.parametrize("density", (0.4, 0.0, 1.0))
def test_a_file_comes_back_as_it_was(tmp_path, axes, density):
    before = stored(axes, density=density)
    save(tmp_path / "v.rle", before)
    after = load(tmp_path / "v.rle")
    assert tuple(after.axes) == axes and after.shape_xyz == (6, 4, 5) and after.model == "extinction"
    for axis in axes:
        for table in (*TABLES, "scanline_data_pointers"):
            one, two = getattr(before.axes[axis], table), getattr(after.axes[axis], table)
            np.testing.assert_array_equal(one, two)
            assert one.dtype == two.dtype and one.shape == two.shape and not two.flags.writeable
    np.testing.assert_array_equal(after.affine, before.affine)
    for name in ("unit", "unit_length", "transfer_function", "lighting", "source", "remarks"):
        assert getattr(after, name) == getattr(before, name)


def test_nothing_half_made_is_left(tmp_path, monkeypatch):
    path = tmp_path / "v.rle"
    path.write_bytes(b"the old file")
    for interruption in (OSError(28, "No space left on device"), KeyboardInterrupt()):
        def broken(file, interruption=interruption, **members):
            file.write(b"half")
            raise interruption
        with monkeypatch.context() as patch:
            patch.setattr(np, "savez", broken)
            with pytest.raises((RleSplatError, KeyboardInterrupt)):
                save(path, stored())
        assert [p.name for p in tmp_path.iterdir()] == ["v.rle"] and path.read_bytes() == b"the old file"
    with pytest.raises(RleSplatError, match="Cannot write"):
        save(tmp_path / "nowhere" / "v.rle", stored())


def test_a_foreign_missing_or_cut_file_is_refused(tmp_path):
    path = tmp_path / "v.rle"
    with pytest.raises(RleSplatError, match="No such file"):
        load(path)
    save(path, stored())
    whole = path.read_bytes()
    for content in (b"", b"hello", whole[: len(whole) // 2], whole[:-1], whole[1:]):
        path.write_bytes(content)
        with pytest.raises(RleSplatError) as problem:
            load(path)
        assert_one_sentence(problem)


def test_a_flipped_byte_is_found_or_does_no_harm(tmp_path):
    path = tmp_path / "v.rle"
    save(path, stored((2,), shape=(2, 3, 4)))
    whole = path.read_bytes()
    truth = load(path)
    found = 0
    for at in range(len(whole)):
        flip = (0x01, 0x80, 0xFF)[at % 3]
        path.write_bytes(whole[:at] + bytes([whole[at] ^ flip]) + whole[at + 1 :])
        try:
            same = load(path)
        except RleSplatError:
            found += 1
            continue
        for table in TABLES:  # a byte nobody reads, such as a date
            np.testing.assert_array_equal(getattr(same.axes[2], table), getattr(truth.axes[2], table))
    assert found > 0.7 * len(whole)


def rewritten(path, **changes):
    """The archive at ``path`` with members replaced: arrays, or raw bytes."""
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    for name, value in changes.items():
        if isinstance(value, np.ndarray):
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, value)
            value = buffer.getvalue()
        members[f"{name}.npy"] = value
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, content in members.items():
            if content is not None:
                archive.writestr(name, content)


def header_of(path, **changes):
    with zipfile.ZipFile(path) as archive, archive.open("header.npy") as member:
        header = json.loads(np.lib.format.read_array(member).tobytes())
    return np.frombuffer(json.dumps({**header, **changes}).encode(), np.uint8)


@pytest.mark.parametrize("change", (
    {"format": "other"}, {"version": 1}, {"record": 8}, {"record": 5},
    {"shape_xyz": [6, 4, 6]}, {"shape_xyz": [4, 6, 5]}, {"shape_xyz": [0, 4, 5]},
    {"shape_xyz": [10**9, 10**9, 10**9]}, {"shape_xyz": "big"}, {"model": "x"}, {"axes": []}, {"axes": ["w"]},
    {"axes": ["x"]}, {"affine": [[1, 2], [3, 4]]}, {"unit_length": -1}, {"unit_length": None}, {"unit": 3},
    {"remarks": None}, {"axes": 7},
))
def test_a_lying_header_is_refused(tmp_path, change):
    path = tmp_path / "v.rle"
    save(path, stored((2,)))
    rewritten(path, header=header_of(path, **change))
    with pytest.raises(RleSplatError) as problem:
        load(path)
    assert_one_sentence(problem)


def test_lying_members_are_refused(tmp_path):
    path = tmp_path / "v.rle"
    whole = stored((2,))
    huge = io.BytesIO()
    np.lib.format.write_array_header_1_0(huge, {"descr": "<f4", "fortran_order": False, "shape": (10**13, 4)})
    pickled = io.BytesIO()
    np.lib.format.write_array(pickled, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    negative = io.BytesIO()
    np.lib.format.write_array_header_1_0(negative, {"descr": "<f4", "fortran_order": False, "shape": (-1, -4)})
    for lie in (huge.getvalue(), pickled.getvalue(), negative.getvalue(), None, b"", b"\x93NUMPY\x09\x00garbage"):
        save(path, whole)
        rewritten(path, z_voxel_data=lie)
        with pytest.raises(RleSplatError) as problem:
            load(path)
        assert_one_sentence(problem)
