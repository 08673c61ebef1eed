"""Numbered files: which belong together, and which frame each is."""

import pytest

from rle_splat.read.sequence import sequence_of
from rle_splat.scene import RleSplatError


@pytest.mark.parametrize("names, given, count, step, missing", [
    (("a_0001.vdb", "a_0002.vdb", "a_0004.vdb"), "a_0002.vdb", 4, 1, (3,)),
    (("a_10.vdb", "a_20.vdb", "a_30.vdb"), "a_30.vdb", 3, 10, ()),
    (("t9.raw.gz", "t10.raw.gz"), "t10.raw.gz", 2, 1, ()),
    (("f.0001.raw", "f.0002.raw"), "f.0001.raw", 2, 1, ()),
    (("s_1_8x6x5_uint8.raw", "s_2_8x6x5_uint8.raw"), "s_1_8x6x5_uint8.raw", 2, 1, ()),
    (("s_1_0.5x0.5x2.0.raw", "s_2_0.5x0.5x2.0.raw"), "s_2_0.5x0.5x2.0.raw", 2, 1, ()),
])  # fmt: skip
def test_found(tmp_path, names, given, count, step, missing):
    for name in names:
        (tmp_path / name).touch()
    found = sequence_of(tmp_path / given)
    assert (found.count, found.step, found.missing, found.first.name) == (count, step, missing, names[0])
    assert found.file(found.frame_of(tmp_path / given)).name == given


@pytest.mark.parametrize("names", [
    ("head.raw", "head2.raw"), ("a_8x6x5_uint8.raw", "a_8x6x5_uint16.raw"), ("a_4x4x4.raw", "a_5x4x4.raw"),
    ("a_01.raw", "a_2.raw"), ("a_1.raw", "a_2.vdb"), ("a_1.raw", "b_2.raw"),
])  # fmt: skip
def test_not_taken_together(tmp_path, names):
    for name in names:
        (tmp_path / name).touch()
    assert [sequence_of(tmp_path / name) for name in names] == [None, None]


def test_frames_without_a_file_are_refused(tmp_path):
    for number in (1, 3, 4):
        (tmp_path / f"a_{number}.vdb").touch()
    found = sequence_of(tmp_path / "a_4.vdb")
    for frame, words in ((0, "no time point 0"), (5, "one from 1 to 4"), (2, "Time point 2 is missing")):
        with pytest.raises(RleSplatError, match=words):
            found.file(frame)
    assert sequence_of(tmp_path / "a_9.vdb") is None
