"""The cache of compiled kernels, when several processes compile for it at once."""

import pytest

from rle_splat.jit import compiled

if not compiled():
    pytest.skip("nothing is compiled without numba", allow_module_level=True)

from rle_splat.kernel_cache import _SealedFiles


def test_two_processes_at_once_do_not_take_each_others_machine_code(tmp_path, monkeypatch):
    """One begins to keep a version of a kernel; before it has, another process keeps another version."""
    one, other, later = (_SealedFiles(str(tmp_path), "kernel-1.py311", "stamp") for _ in range(3))
    write = one._save_data

    def interrupted(name, data):
        with monkeypatch.context() as patch:
            patch.setattr(other, "_load_index", dict)  # read before the one had written its own
            other.save(("float64",), "for float64")
        write(name, data)

    monkeypatch.setattr(one, "_save_data", interrupted)
    one.save(("float32",), "for float32")
    found = {key: later.load((key,)) for key in ("float32", "float64")}
    assert "for float32" in found.values() or "for float64" in found.values()
    assert all(data in (None, f"for {key}") for key, data in found.items()), found


def test_every_version_is_found_again(tmp_path):
    for key in ("float32", "float64", "float32"):
        _SealedFiles(str(tmp_path), "kernel-1.py311", "stamp").save((key,), key)
    again = _SealedFiles(str(tmp_path), "kernel-1.py311", "stamp")
    assert [again.load((key,)) for key in ("float32", "float64", "int8")] == ["float32", "float64", None]
    assert len(list(tmp_path.glob("*.nbc"))) == 2  # what is compiled once more takes the place of what was there
