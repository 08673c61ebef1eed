"""Full disks and folders without rights: one sentence each, and nothing half-made is left."""

import json
import os
import shutil
import subprocess
import sys

import pytest

POSIX = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="Windows has other rights")
LITTLE = 48  # KiB of the disk
# Root is held to the rights of folders too; others have no such capabilities to lose.
HELD_TO_RIGHTS = ("setpriv", "--bounding-set=-dac_override,-dac_read_search")
EACH = """
import json, sys
from rle_splat.cli.main import main
for words in json.loads(sys.argv[1]):
    print(main(words), file=sys.stderr)
"""


@POSIX
def test_a_pipe_is_no_volume(tmp_path):
    """Nobody writes into it, so that opening it would wait."""
    names = ("a.raw", "a.nii", "a.mha", "a.tif", "a", "a.rle")
    for name in names:
        os.mkfifo(tmp_path / name)
    volume = [str(tmp_path / name) for name in names]
    words = [["info", path] for path in volume]
    words += [["render", path, "-o", str(tmp_path / "a.npy")] for path in volume]
    words += [["render", path, "--shape", "2", "2", "2", "-o", str(tmp_path / "a.npy")] for path in volume[:1]]
    (tmp_path / "scan").mkdir()
    for name in ("a.dcm", "1.tif", "2.tif", "a.nii", "b.nii"):
        os.mkfifo(tmp_path / "scan" / name)
    words += [["info", str(tmp_path / "scan")]]
    expected = [f"{path} is neither a file nor a folder; give the path of one." for _, path, *_ in words]
    expected[-1] = "scan holds no medical images, and no other files; choose the folder of the series."
    done = subprocess.run([sys.executable, "-c", EACH, json.dumps(words)], capture_output=True, text=True)
    assert done.stderr.splitlines() == [line for one in expected for line in (one, "2")]


@pytest.fixture
def disk(tmp_path):
    """A disk of few KiB."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = shutil.which("mount")
    words = [mount, "-t", "tmpfs", "-o", f"size={LITTLE}k", "none", place]
    if mount is None or subprocess.run(words, capture_output=True).returncode:
        pytest.skip("mounting is not allowed here")
    yield place
    subprocess.run(["umount", place], check=True)


@pytest.mark.parametrize(
    "command, output, words",
    [
        ("encode", "a.rle", ("--folder",)),
        ("encode", "a.rle", ()),
        ("render", "a.npy", ("--size", 96)),
        ("render", "a.png", ("--size", 160)),
        ("render", "a.tif", ("--size", 96)),
        ("render", "a.exr", ("--size", 96)),
        ("render", "a.npy", ("--size", 96, "--tile", 32)),
        ("render", "a.exr", ("--size", 96, "--tile", 32)),
        ("figure", "a.svg", ()),
    ],
)
def test_a_full_disk(disk, raw, raw_options, call, command, output, words):
    """With the file before it kept."""
    if output.endswith(".exr"):
        pytest.importorskip("OpenEXR")
    (disk / "others").write_bytes(bytes(1024 * (LITTLE - 4)))
    is_folder = "--folder" in words
    if not is_folder:
        (disk / output).write_bytes(b"")
    result = call(command, raw, *raw_options, *words, "-o", disk / output)
    assert result.code in (1, 2) and result.err.count("\n") == 1, result
    assert str(disk / output) in result.err and ".part-" not in result.err, result.err
    assert "make room there" in result.err, result.err
    assert sorted(path.name for path in disk.iterdir()) == sorted(["others", *([] if is_folder else [output])])
    assert is_folder or not (disk / output).read_bytes()


@POSIX
def test_folders_without_rights(tmp_path, raw, raw_options):
    for name in ("read-only", "closed", "closed/inner", "table.rle", "image.zarr"):
        (tmp_path / name).mkdir()
    for name in ("table.rle/header.json", "image.zarr/zarr.json", "closed/a.raw"):
        (tmp_path / name).write_text("{}")
    options = [str(raw), *raw_options]
    jobs = [
        ["encode", *options, "--folder", "-o", "read-only/a.rle"], ["encode", *options, "-o", "read-only/a.rle"],
        ["render", *options, "-o", "read-only/a.png"], ["render", *options, "--tile", "16", "-o", "read-only/a.tif"],
        ["encode", *options, "--folder", "-o", "closed/a.rle"], ["encode", *options, "-o", "closed/inner/a.rle"],
        ["render", *options, "-o", "closed/a.png"], ["render", "closed/a.raw", *raw_options, "-o", "a.png"],
        ["render", "table.rle", "-o", "a.png"], ["info", "image.zarr"], ["info", "closed"],
    ]  # fmt: skip
    shut = {"read-only": 0o500, "closed": 0, "table.rle": 0, "image.zarr": 0}
    words = [sys.executable, "-c", EACH, json.dumps(jobs)]
    if os.geteuid() == 0:
        if shutil.which(HELD_TO_RIGHTS[0]) is None:
            pytest.skip("root may write everywhere")
        words = [*HELD_TO_RIGHTS, *words]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    try:
        for name, mode in shut.items():
            (tmp_path / name).chmod(mode)
        said = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True).stderr
    finally:
        for name in shut:
            (tmp_path / name).chmod(0o700)
    lines = said.splitlines()
    assert len(lines) == 2 * len(jobs), said
    for job, sentence, code in zip(jobs, lines[::2], lines[1::2], strict=True):
        assert "Permission denied" in sentence and code in "12", (job, sentence)
        assert any(advice in sentence for advice in ("choose another place", "its permissions")), sentence
    assert not list(tmp_path.rglob("*.part-*")) and not list((tmp_path / "read-only").iterdir())
