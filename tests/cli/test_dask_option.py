"""What the options of a cluster refuse before they look for one."""

import pytest

from devtools.docs_reference import command_parser
from rle_splat.cli import cluster, dask_option

# Files that workers neither read nor write.
OF_THE_CLIENT = {
    "json", "shadow_pass", "channel_function", "motion", "camera_path", "environment", "label_functions",
}  # fmt: skip


@pytest.mark.parametrize("words, sentence", [
    (("--workers", 2), "--workers has no effect without --dask"),
    (("--dask", "--workers", 0), "--workers is 0; give --workers a number from 1 to 1024"),
    (("--dask", "tcp://a:1", "--workers", 2), "--dask tcp://a:1 has its own workers"),
    (("--dask", "--tolerance", 4), "--tolerance and --dask cannot be combined; choose a --quality"),
    (("--dask", "--memory-limit", "1g"), "--memory-limit and --dask cannot be combined"),
    (("--dask", "--tile", 32, "--frames", 1, 2, "--turn", 3), "On a cluster each frame is one task; remove --tile"),
    (("--dask", "--slabs", 2, "--frames", 1, 2, "--turn", 3), "On a cluster each frame is one task; remove --slabs"),
    (("--slabs", 2), "--slabs has no effect without --dask"),
    (("--dask", "--slabs", 0), "--slabs is 0; give a number from 1 to 1024"),
])  # fmt: skip
def test_wrong_options_are_one_sentence(refused, tmp_path, words, sentence):
    assert sentence in refused("render", tmp_path / "missing.raw", "-o", tmp_path / "a.npy", *words)


def test_the_volume_behind_dask_is_told_from_an_address(refused, tmp_path):
    (tmp_path / "scan:1.nrrd").touch()
    for volume in ("scan.nrrd", tmp_path / "scan:1.nrrd"):
        sentence = refused("render", "-o", tmp_path / "a.npy", "--dask", volume)
        assert f"{str(volume)!r} is no address such as tcp://host:8786; if it is the volume, put it before" in sentence


def test_slabs_want_a_folder_of_tables(refused, raw, raw_options, tmp_path):
    sentence = refused("render", raw, *raw_options, "-o", tmp_path / "a.npy", "--dask", "--slabs", 2)
    assert f"and {raw} is none; make one with rle-splat encode --folder" in sentence


def test_a_missing_package_is_named(refused, tmp_path, monkeypatch):
    monkeypatch.setattr(dask_option, "find_spec", lambda name: None)
    sentence = refused("render", tmp_path / "missing.raw", "-o", tmp_path / "a.npy", "--dask")
    assert "install rle-splat[scale]" in sentence


def test_workers_get_every_file_by_its_absolute_path():
    options = {action.dest for action in command_parser("render")._actions if "FILE" in str(action.metavar)}
    assert options - OF_THE_CLIENT == {*cluster.PATHS, "channel"} - {"volume"}
