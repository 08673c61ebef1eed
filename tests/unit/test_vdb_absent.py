"""OpenVDB files on a Python without the module openvdb; with it, tests/blender/test_vdb.py reads and writes them."""

import sys

import numpy as np
import pytest

from rle_splat.read.formats import read_volume, write_volume
from rle_splat.scene import RleSplatError
from rle_splat.volume.volume import Volume


@pytest.fixture(autouse=True)
def no_openvdb(monkeypatch):
    for name in ("openvdb", "pyopenvdb"):
        monkeypatch.setitem(sys.modules, name, None)  # makes the import fail


def test_reading_says_where_the_module_is_to_be_had(tmp_path):
    (tmp_path / "smoke.vdb").write_bytes(b" BDV\0\0\0\0")
    with pytest.raises(RleSplatError, match=r"openvdb.*Blender.*PYTHONPATH"):
        read_volume(tmp_path / "smoke.vdb")


def test_writing_says_it_too_and_leaves_nothing(tmp_path):
    with pytest.raises(RleSplatError, match="openvdb"):
        write_volume(Volume(np.zeros((2, 2, 2), np.uint8), np.eye(4)), tmp_path / "out.vdb")
    assert list(tmp_path.iterdir()) == []
