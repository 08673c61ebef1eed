"""The folder of the cache of kernels: which one it is, who may write to it, and what is removed from it."""

import os
import sys
import tempfile
from pathlib import Path

import pytest

from rle_splat.runtime import cache_folder as places
from rle_splat.runtime.cache_folder import CACHE_VARIABLE, NUMBA_VARIABLE


@pytest.fixture(autouse=True)
def no_folder_for_numba(monkeypatch):
    """Whoever runs the tests may have given numba a folder; these choose their own."""
    monkeypatch.delenv(NUMBA_VARIABLE, raising=False)


def test_folders_that_another_process_removes_meanwhile_are_no_fault(tmp_path, monkeypatch):
    """Two that start at once after an update both remove the oldest kernels."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    folders = [tmp_path / f"{places.KERNEL_PREFIX}{n}" for n in range(places.KEPT_VERSIONS + 2)]
    for age, folder in enumerate(folders):
        folder.mkdir()
        os.utime(folder, (1e9 - age, 1e9 - age))
    stat = Path.stat

    def vanishing(path, **how):
        if path == folders[1]:
            raise FileNotFoundError(path)
        return stat(path, **how)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "stat", vanishing)
        assert places.kernel_folder().parent == tmp_path
    assert [folder for folder in folders if folder.exists()] == [folders[0], *folders[2 : places.KEPT_VERSIONS]]


def test_another_numba_and_another_release_have_a_folder_of_their_own(monkeypatch):
    here = places.kernel_folder("0.68.1")
    assert places.kernel_folder("0.68.1") == here
    other = places.kernel_folder("0.0.1")
    monkeypatch.setattr(places, "RELEASE", "0.0.1")
    assert len({here, other, places.kernel_folder("0.68.1")}) == 3 and other.parent == here.parent


NOWHERE = Path(os.devnull) / "rle_splat"  # where nothing can be kept
needs_users = pytest.mark.skipif(not hasattr(os, "getuid"), reason="users share no temporary folder here")


def for_others(folder, mode):
    """Let others into a folder; where its group may write to it, a group that is not the user's own, if possible."""
    folder.chmod(mode)
    if os.getuid() == 0:
        os.chown(folder, 0, 12345)


@needs_users
def test_kernels_are_loaded_from_no_temporary_folder_that_others_can_write_to(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv(CACHE_VARIABLE, str(Path(os.devnull) / "cache"))
    own = places.cache_folder()
    assert own.parent == tmp_path and own.stat().st_mode & 0o777 == 0o700
    assert places.cache_folder() == own
    for mode in (0o777, 0o702, 0o770)[: 3 if os.getuid() == 0 else 2]:
        for_others(own, mode)
        assert places.cache_folder() == NOWHERE
    own.chmod(0o755)
    assert places.cache_folder() == own
    own.rename(tmp_path / "elsewhere")
    own.symlink_to(tmp_path / "elsewhere")
    assert places.cache_folder() == NOWHERE


# The variables that give a folder, in the order in which they count, with where in it kernels are.
GIVEN = ((NUMBA_VARIABLE, "rle_splat"), (CACHE_VARIABLE, ""), ("XDG_CACHE_HOME", "rle_splat"))
needs_variables = pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="XDG_CACHE_HOME is Linux's")


@pytest.fixture
def given(tmp_path, monkeypatch, request):
    """A variable that gives a folder, the folder, and where in it kernels would be."""
    variable, inside = request.param
    for name, _ in GIVEN:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(Path, "home", lambda: Path(os.devnull))  # where nothing can be kept
    folder = tmp_path / "given"
    monkeypatch.setenv(variable, str(folder))
    return folder, folder / inside


@needs_variables
@pytest.mark.parametrize("given", GIVEN, indirect=True, ids=[variable for variable, _ in GIVEN])
def test_kernels_are_loaded_from_no_given_folder_that_others_can_write_to(given, tmp_path, monkeypatch):
    """Nor from one of another user's: what is loaded is run."""
    folder, inside = given
    old = os.umask(0o002)
    try:
        assert places.cache_folder() == inside
    finally:
        os.umask(old)
    assert inside.stat().st_mode & 0o777 == 0o700
    temporary = tmp_path / f"rle_splat-{os.getuid()}"
    for place in {folder, inside}:
        for mode in (0o777, 0o702, 0o770)[: 3 if os.getuid() == 0 else 2]:
            for_others(place, mode)
            assert places.cache_folder() == temporary and places.kernel_folder().parent == temporary
        place.chmod(0o700)
    assert places.cache_folder() == inside
    with monkeypatch.context() as patch:
        patch.setattr(os, "getuid", lambda: 54321)
        assert places.cache_folder() == NOWHERE, "a folder that this user does not own"


@needs_variables
@pytest.mark.parametrize("given", GIVEN, indirect=True, ids=[variable for variable, _ in GIVEN])
def test_a_given_folder_that_cannot_be_written_to_is_replaced_by_another(given, tmp_path):
    folder, _ = given
    folder.write_text("a file in its place")
    assert places.cache_folder() == places.kernel_folder().parent == tmp_path / f"rle_splat-{os.getuid()}"


@needs_variables
def test_a_folder_for_numba_that_cannot_be_written_to_is_replaced_by_the_next(tmp_path, monkeypatch):
    (tmp_path / "numba").write_text("a file in its place")
    monkeypatch.setenv(NUMBA_VARIABLE, str(tmp_path / "numba"))
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "ours"))
    assert places.kernel_folder().parent == tmp_path / "ours"


@needs_variables
@pytest.mark.parametrize("given", GIVEN, indirect=True, ids=[variable for variable, _ in GIVEN])
def test_a_given_folder_may_be_a_link_and_a_group_of_the_users_own_may_write_to_it(given, tmp_path):
    """As with an umask of 002, the default of many systems; kernels are then loaded from where the link leads."""
    folder, inside = given
    (tmp_path / "real").mkdir(mode=0o775)
    os.chmod(tmp_path / "real", 0o775 if os.getuid() == os.getgid() else 0o755)
    folder.symlink_to(tmp_path / "real")
    assert places.cache_folder() == tmp_path / "real" / inside.relative_to(folder)


@needs_users
def test_a_user_without_a_home_has_kernels_in_the_temporary_folder(tmp_path, monkeypatch):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(Path, "home", homeless)
    for variable in (CACHE_VARIABLE, "XDG_CACHE_HOME"):
        monkeypatch.delenv(variable, raising=False)
    assert places.cache_folder().parent == tmp_path
