"""The tests under Wine: what they need, the archives that are unpacked, and the reason where they cannot run."""

import hashlib
import zipfile
from pathlib import Path
from types import SimpleNamespace

import pytest

from devtools import build, kernels, testing, windows
from devtools.places import PYTHONS, Failure


@pytest.mark.parametrize("lacking", ["unshare", "mvn"])
def test_a_skip_with_its_reason_where_a_program_is_missing(monkeypatch, lacking, capsys):
    monkeypatch.setattr(windows.shutil, "which", lambda name: None if name == lacking else f"/usr/bin/{name}")
    assert testing.test_windows([]) == 1  # nothing passed
    assert f"Windows under Wine (Windows' Python under Wine needs the program {lacking})" in capsys.readouterr().out


def test_a_skip_with_its_reason_without_root(monkeypatch, tmp_path):
    monkeypatch.setattr(windows, "SYSTEM", windows.SmallSystem("trixie", tmp_path, ("wine",), "Wine", "1 GB"))
    monkeypatch.setattr("devtools.small_system.can_apt", lambda: False)
    monkeypatch.setattr(windows.shutil, "which", lambda name: f"/usr/bin/{name}")
    (stage,) = windows.windows_stages([], [], [])
    assert stage.verdict == "SKIPPED" and stage.missing == "Wine needs root and apt-get to be set up here"


@pytest.fixture
def archive(monkeypatch, tmp_path):
    """An archive that has been fetched, with one file that is wanted and two that are not."""
    monkeypatch.setattr(windows, "BUILD", tmp_path)
    path = tmp_path / "java" / "lib-1-windows-x86_64.jar"
    path.parent.mkdir()
    with zipfile.ZipFile(path, "w") as made:
        for name in ("in/a.dll", "in/b.dll", "out/a.dll"):
            made.writestr(name, name)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return windows.Archive("org:lib:1:jar:windows-x86_64", digest, "in/", ("a.dll",))


def test_the_wanted_files_of_an_archive_are_unpacked(archive, tmp_path):
    windows._unpack(archive, tmp_path / "python")
    assert [(file.name, file.read_text()) for file in (tmp_path / "python").iterdir()] == [("a.dll", "in/a.dll")]


def test_another_archive_than_the_pinned_one_is_refused(archive, tmp_path):
    with zipfile.ZipFile(tmp_path / "java" / archive.name, "a") as made:
        made.writestr("in/c.dll", "c")
    with pytest.raises(Failure, match="does not have the pinned checksum"):
        windows._unpack(archive, tmp_path / "python")
    assert not (tmp_path / "python").exists()


def test_the_first_program_of_wine_begins_in_a_folder_that_is_there(monkeypatch, tmp_path):
    """Its folder is in the small system, which has just been made."""
    began = []

    def begins(command, sentence, **options):
        folder = Path(command[-4] + command[-3])
        began.append((command[-2:], folder.is_dir()))
        raise Failure(sentence)

    monkeypatch.setattr(windows, "SYSTEM", SimpleNamespace(folder=tmp_path, set_up=lambda: None))
    monkeypatch.setattr(windows, "DRIVE", tmp_path / windows.PREFIX.lstrip("/") / "drive_c")
    monkeypatch.setattr(windows.shutil, "which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr(windows, "run_quietly", begins)
    with pytest.raises(Failure, match="could not make its drive C"):
        windows.set_up()
    assert began == [(["wineboot", "--init"], True)]


def test_paths_and_commands_of_windows():
    assert windows._of_windows(windows.CLONE / "out" / "a.jsonl") == "C:\\rle_splat\\out\\a.jsonl"
    command = windows._command("python.exe", "-c", "1", inside=windows.CLONE)
    assert command[-5:] == [str(windows.SYSTEM.folder), "/wine/drive_c/rle_splat", "python.exe", "-c", "1"]


def test_kernels_for_windows_that_are_made_are_taken(monkeypatch, tmp_path):
    """Others are compiled in there, by Windows' Python of the tests, for the level of most processors; the other Python
    takes what it has compiled."""
    monkeypatch.setattr(kernels, "BUILD", tmp_path / "made")
    monkeypatch.setattr(windows, "DRIVE", tmp_path)
    monkeypatch.setattr(windows, "_inside", lambda: tmp_path)
    monkeypatch.setattr(windows, "_lend", lambda environment, version: f"C:\\python{version}\\python.exe")
    commands = []

    def makes(command, sentence, **options):
        words = command[command.index("-m") - 1 :]
        commands.append((*words, options["env"]["NUMBA_CPU_NAME"]))
        with zipfile.ZipFile(tmp_path / words[3].removeprefix("C:\\"), "w") as made:
            made.comment = words[4].encode()
        return "1"

    monkeypatch.setattr(kernels, "run_quietly", makes)
    monkeypatch.setattr(kernels, "ROOT", tmp_path)
    (other,) = (version for version in PYTHONS if version != windows.TESTED)
    for _ in range(2):
        path = windows._kernels(other)
        assert path == kernels.made_under_wine(other) and kernels.is_made(path)
    assert build._kernels_of_others("windows-x64", other) == [path]
    assert build._kernels_of_others("macos-arm64", other) == []
    level, digest = kernels.LEVELS["windows-x64"], kernels.source_digest().decode()

    def words(version, *how):
        name = kernels.made_under_wine(version).name
        return (f"C:\\python{version}\\python.exe", "-m", "devtools.pack_kernels", f"C:\\{name}", digest, *how, level)

    assert commands == [words(windows.TESTED), words(other, f"C:\\made-{path.name}")], "once"


@pytest.mark.parametrize(
    ("core", "order"),
    [
        (["tests/read/test_nifti.py"], ["Windows, core"]),
        (["tests/read", "tests/cli"], ["kernels", "Windows, core"]),
        ([], ["Windows, read", "kernels", *(f"Windows, {name}" for name in windows.CORE_FOLDERS), "Windows, bpy"]),
    ],
)
def test_reading_does_not_wait_for_kernels(monkeypatch, core, order):
    done = []
    monkeypatch.setattr(windows, "set_up", lambda: None)
    monkeypatch.setattr(windows, "bring_kernels", lambda: done.append("kernels"))
    monkeypatch.setattr(windows, "_core", lambda name, words: done.append(name))
    monkeypatch.setattr(windows, "_bpy", lambda words: done.append("Windows, bpy") or [])
    windows.windows_stages(core, [], [])
    assert done == order
