"""Folders of tables: the same pictures as in memory, jobs that were killed go on, and damage is told."""

import errno
import json
import os
import shutil
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import rle_splat
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.encode import folder as folder_form
from rle_splat.encode.folder import FolderWriter, unfinished_path
from rle_splat.encode.store import read_encoded
from rle_splat.pipeline import encode_folder, memory_estimate
from rle_splat.pipeline.encode_folder import encode_folder_steps
from rle_splat.pipeline.render import render
from rle_splat.runtime import whole_files
from rle_splat.runtime.steps import drain
from rle_splat.scene import Environment, Light, Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.reduced import reduce_steps
from rle_splat.volume.volume import Volume

NX, NY, NZ = 22, 19, 17
FUNCTION = {
    "name": "Blobs", "unit": None, "opacity": [[60, 0.0], [120, 0.3], [200, 0.9]],
    "color": [[60, 0.9, 0.4, 0.2], [200, 0.8, 0.9, 1.0]],
    "shade": {"ambient": 0.2, "diffuse": 0.7, "specular": 0.3, "shininess": 20.0},
}  # fmt: skip
QUALITIES = {
    "pre": Quality.preset("standard", classification="pre"),
    "post": Quality(classification="post", depth_rule="preintegrated", rays=0.0, sheet_density=1.0),
}
VIEWS = {0: (90.0, 10.0), 1: (5.0, 10.0), 2: (20.0, 80.0)}  # principal axis -> azimuth, elevation


def volume_of(dtype=np.uint8):
    z, y, x = np.mgrid[:NZ, :NY, :NX].astype(np.float64)
    values = 127.0 + 60.0 * np.sin(0.9 * x + 0.3 * y) * np.cos(0.7 * y - 0.2 * z) + 60.0 * np.sin(0.8 * z)
    return Volume(np.rint(values).astype(dtype), np.diag((1.0, 1.1, 0.9, 1.0)), name="blobs")


def scene_of(volume, axis=1, **changes):
    azimuth, elevation = VIEWS[axis]
    camera, matrix = turntable(volume, azimuth, elevation)
    function = TransferFunction.from_json(FUNCTION)
    given = {"headlight": True, "volume_matrix": matrix, **changes}
    return Scene(volume=volume, transfer_function=function, camera=camera, width=40, height=32, **given)


@pytest.fixture
def few_planes(monkeypatch):
    """Chunks of three planes."""
    monkeypatch.setattr(encode_folder._Chunks, "planes_at_once", lambda *_: 3)


def encoded(path, scene, quality, **options):
    return rle_splat.encode_folder(scene, path, quality, **options)


def from_folder(path, scene, quality):
    return render(replace(scene, volume=read_encoded(path), lights=(), headlight=False), quality)


@pytest.mark.parametrize("classification", QUALITIES)
@pytest.mark.parametrize("axis", VIEWS)
def test_pictures_are_those_from_memory(tmp_path, few_planes, classification, axis):
    scene, quality = scene_of(volume_of(), axis), QUALITIES[classification]
    encoded(tmp_path / "a.rle", scene, quality)
    there, here = from_folder(tmp_path / "a.rle", scene, quality), render(scene, quality)
    assert here.rgba[..., 3].max() > 0.5 and here.report["plan"]["base_planes"][0]["principal_axis"][1] == "xyz"[axis]
    np.testing.assert_array_equal(there.rgba, here.rgba)
    np.testing.assert_array_equal(there.depth, here.depth)


def test_short_records(tmp_path, few_planes):
    quality = replace(QUALITIES["pre"], record=8)
    scene = scene_of(volume_of(np.float32), 0)
    encoded(tmp_path / "a.rle", scene, quality)
    np.testing.assert_array_equal(from_folder(tmp_path / "a.rle", scene, quality).rgba, render(scene, quality).rgba)


LAMP = Light(type="POINT", energy=20000.0, matrix_world=np.eye(4) + np.outer((40.0, -20.0, 30.0, 0.0), (0, 0, 0, 1)))


@pytest.mark.parametrize("classification", QUALITIES)
def test_lights_are_kept(tmp_path, few_planes, classification):
    """A lamp beside the volume."""
    scene = scene_of(volume_of(), 0, lights=(LAMP,), headlight=False)
    quality = QUALITIES[classification]
    encoded(tmp_path / "a.rle", scene, quality)
    np.testing.assert_array_equal(from_folder(tmp_path / "a.rle", scene, quality).rgba, render(scene, quality).rgba)


SECOND = np.zeros((3, 3, 3))
SECOND[0, 1] = SECOND[1, 0] = 0.1
AROUND = {
    "lamp": {"lights": (LAMP,), "headlight": False},
    "lamp and headlight": {"lights": (LAMP,)},
    "world": {"world": (0.5, 0.6, 0.4), "headlight": False},
    "environment": {"world": (0.5, 0.6, 0.4), "environment": Environment(np.eye(3) * 0.2, SECOND)},
}  # fmt: skip


@pytest.mark.parametrize("around", AROUND)
def test_post_classified_folders_are_lit_from_any_view(tmp_path, few_planes, around):
    """By what shone on the scene of another view."""
    scene, quality = scene_of(volume_of(), 0, **AROUND[around]), QUALITIES["post"]
    encoded(tmp_path / "a.rle", scene_of(volume_of(), 1, **AROUND[around]), quality)
    bare = {"world": None, "environment": None}
    there, here = from_folder(tmp_path / "a.rle", replace(scene, **bare), quality), render(scene, quality)
    np.testing.assert_array_equal(there.rgba, here.rgba)
    assert np.abs(here.rgba - render(replace(scene, lights=(), headlight=True, **bare), quality).rgba).max() > 0.02


def test_lights_turn_with_their_folder(tmp_path, few_planes):
    """The picture of a volume that is turned with its camera is the same, lamps and all."""
    scene, quality = scene_of(volume_of(), 1, lights=(LAMP,)), QUALITIES["post"]
    encoded(tmp_path / "a.rle", scene, quality)
    turn = np.array(((0.0, -1.0, 0.0, 5.0), (1.0, 0.0, 0.0, -2.0), (0.0, 0.0, 1.0, 3.0), (0.0, 0.0, 0.0, 1.0)))
    camera = replace(scene.camera, matrix_world=turn @ scene.camera.matrix_world)
    turned = replace(scene, camera=camera, volume_matrix=turn @ scene.volume_matrix)
    there, here = (from_folder(tmp_path / "a.rle", one, quality).rgba for one in (turned, scene))
    assert np.abs(there - here).max() < 1e-4


@pytest.mark.slow
def test_unshaded_and_one_axis(tmp_path, few_planes):
    unshaded = TransferFunction.from_json({**FUNCTION, "shade": False})
    for classification, quality in QUALITIES.items():
        path = tmp_path / f"{classification}.rle"
        scene = replace(scene_of(volume_of(np.int32), 2), transfer_function=unshaded)  # a type that is converted
        encoded(path, scene, quality, axes=(1, 2))
        assert not any("across" in file.name for file in path.iterdir())
        np.testing.assert_array_equal(from_folder(path, scene, quality).rgba, render(scene, quality).rgba)
        with pytest.raises(RleSplatError, match="needs principal axis x"):
            from_folder(path, replace(scene_of(volume_of(), 0), transfer_function=unshaded), quality)


def test_chunks_follow_the_memory_that_is_left(tmp_path, monkeypatch):
    """As many planes as fit, one where the next one is denser than was thought, and a sentence where none fits."""
    scene, quality = scene_of(volume_of()), QUALITIES["pre"]
    plane = 96 * NX * NY  # bytes, of which a visible voxel takes about 80
    monkeypatch.setattr(encode_folder, "SHARE", 1.0)
    monkeypatch.setattr(encode_folder, "available_bytes", lambda: plane)
    assert NZ // 2 < encoded(tmp_path / "a.rle", scene, quality)["folder"]["slabs"] <= NZ
    np.testing.assert_array_equal(from_folder(tmp_path / "a.rle", scene, quality).rgba, render(scene, quality).rgba)
    for module in (encode_folder, memory_estimate):
        monkeypatch.setattr(module, "available_bytes", lambda: plane // 100)
    with pytest.raises(RleSplatError, match=r"The \d+ voxels that the transfer function shows need about .* are free"):
        encoded(tmp_path / "b.rle", scene, quality)
    assert [file.name for file in tmp_path.iterdir()] == ["a.rle"]


@pytest.mark.parametrize("classification", QUALITIES)
def test_a_large_volume_is_stored_in_larger_voxels_too(tmp_path, few_planes, monkeypatch, classification):
    """They are those of the volume made smaller; a job that goes on keeps them, and a folder without them is read."""
    monkeypatch.setattr(encode_folder, "COARSE_VOXELS", NX * NY * NZ // 4)
    scene, quality, path = scene_of(volume_of()), QUALITIES[classification], tmp_path / "a.rle"
    encoded(path, scene, quality)
    whole = read_encoded(path)
    assert whole.coarse.shape_xyz == (-(-NX // 2), -(-NY // 2), -(-NZ // 2)) and whole.coarse.coarse is None
    function = TransferFunction.from_json({**FUNCTION, "opacity_unit_distance": 0.9})  # of the volume's own voxels
    coarse = replace(scene, volume=drain(reduce_steps(scene.volume, (2, 2, 2))), transfer_function=function)
    quality = replace(quality, name="knobs")  # a preset would follow single rays in memory, where walls are hard
    here = render(coarse, quality)
    assert here.rgba[..., 3].max() > 0.5
    np.testing.assert_array_equal(from_folder(path / "coarse", coarse, quality).rgba, here.rgba)
    made = (path / "coarse" / folder_form.HEADER).stat().st_mtime_ns
    path.rename(unfinished_path(path))
    steps = encode_folder._coarse_steps(scene, quality, unfinished_path(path) / "coarse", (0, 1, 2), "")
    assert list(steps) == [] and (unfinished_path(path) / "coarse" / folder_form.HEADER).stat().st_mtime_ns == made
    unfinished_path(path).rename(path)
    (path / "coarse" / folder_form.HEADER).unlink()
    with pytest.raises(RleSplatError, match="Cannot read"):
        read_encoded(path)
    monkeypatch.setattr(encode_folder, "COARSE_VOXELS", NX * NY * NZ)
    encoded(tmp_path / "b.rle", scene, quality)
    assert read_encoded(tmp_path / "b.rle").coarse is None and not (tmp_path / "b.rle" / "coarse").exists()
    monkeypatch.setattr(encode_folder, "COARSE_VOXELS", (NX // 2) * (NY // 2) * (NZ // 2))  # odd sides are rounded up
    encoded(tmp_path / "c.rle", scene, quality)
    assert read_encoded(tmp_path / "c.rle").coarse.shape_xyz == (-(-NX // 4), -(-NY // 4), -(-NZ // 4))
    assert not (tmp_path / "c.rle" / "coarse" / "coarse").exists()


def test_nothing_visible(tmp_path, few_planes):
    dark = TransferFunction.from_json({**FUNCTION, "opacity": [[900, 0.0], [901, 1.0]]})
    for classification, quality in QUALITIES.items():
        path = tmp_path / f"{classification}.rle"
        scene = replace(scene_of(volume_of(), 0), transfer_function=dark)
        encoded(path, scene, quality)
        assert not from_folder(path, scene, quality).rgba.any()


# --- jobs that are killed, and jobs that fail -------------------------------------------------------------------------


class Killed(BaseException):
    """Stands for a signal: nothing is tidied up."""


def killed_at(monkeypatch, path, scene, quality, writes):
    """Encode, and end in the middle of the ``writes``-th write, with half of it in the file."""
    append, count = FolderWriter._append, iter(range(10**6))

    def failing(writer, name, content):
        if next(count) == writes:
            append(writer, name, content[: len(content) // 2])
            raise Killed
        append(writer, name, content)

    with monkeypatch.context() as patch:
        patch.setattr(FolderWriter, "_append", failing)
        patch.setattr(FolderWriter, "__exit__", lambda *_: None)
        try:
            encoded(path, scene, quality)
        except Killed:
            return True
    return False


def test_a_killed_job_goes_on(tmp_path, few_planes, monkeypatch):
    scene, quality = scene_of(volume_of()), QUALITIES["post"]
    encoded(tmp_path / "whole.rle", scene, quality)
    wanted = {file.name: file.read_bytes() for file in (tmp_path / "whole.rle").iterdir()}
    went_on = set()
    for writes in (0, 17, 36):
        path = tmp_path / f"{writes}.rle"
        assert killed_at(monkeypatch, path, scene, quality, writes) == (not path.exists())
        report = encoded(path, scene, quality)
        went_on.add(report["folder"]["resumed_at_plane"])
        assert {file.name: file.read_bytes() for file in path.iterdir()} == wanted
        assert not unfinished_path(path).exists()
    assert len(went_on) == 3


def test_another_job_begins_anew(tmp_path, few_planes, monkeypatch):
    scene, quality = scene_of(volume_of()), QUALITIES["pre"]
    assert killed_at(monkeypatch, tmp_path / "a.rle", scene, quality, 20)
    other = replace(quality, record=8)
    assert encoded(tmp_path / "a.rle", scene, other)["folder"]["resumed_at_plane"] == 0
    np.testing.assert_array_equal(from_folder(tmp_path / "a.rle", scene, other).rgba, render(scene, other).rgba)


def test_a_failed_job_leaves_nothing(tmp_path, few_planes, monkeypatch):
    """A full disk, and a job that is canceled; the folder that was there before stays."""
    scene, quality = scene_of(volume_of()), QUALITIES["pre"]
    encoded(tmp_path / "a.rle", scene, quality)
    before = sorted(file.name for file in tmp_path.rglob("*"))
    append, count = FolderWriter._append, iter(range(100))

    def full(writer, name, content):
        if next(count) == 12:
            raise OSError(28, "No space left on device")
        append(writer, name, content)

    with monkeypatch.context() as patch:
        patch.setattr(FolderWriter, "_append", full)
        with pytest.raises(RleSplatError, match="No space left on device; choose another place, or make room"):
            encoded(tmp_path / "a.rle", scene, replace(quality, record=8))
    steps = encode_folder_steps(scene, quality, tmp_path / "a.rle")
    for step in steps:
        if "Encoding" in step.message:
            break
    steps.close()
    assert sorted(file.name for file in tmp_path.rglob("*")) == before
    assert read_encoded(tmp_path / "a.rle").record == 16


def test_two_jobs_for_one_place(tmp_path, few_planes, monkeypatch):
    """The second is refused before it reads anything, also where the disk has no locks."""
    scene, quality, path = scene_of(volume_of()), QUALITIES["pre"], tmp_path / "a.rle"
    lock = tmp_path / ".a.rle.lock"
    lock.write_bytes(b"")  # of a process that was killed
    encoded(tmp_path / "whole.rle", scene, quality)
    wanted = {file.name: file.read_bytes() for file in (tmp_path / "whole.rle").iterdir()}
    first = encode_folder_steps(scene, quality, path)
    for step in first:
        if "planes 4 to 6" in step.message:
            break
    with pytest.raises(RleSplatError, match="another command is writing there; wait until it has ended"):
        next(encode_folder_steps(scene, quality, path))
    drain(first)
    assert {file.name: file.read_bytes() for file in path.iterdir()} == wanted
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.rle", "whole.rle"]

    def unknown(*_):
        raise OSError(errno.ENOSYS, "Function not implemented")

    fcntl = pytest.importorskip("fcntl", reason="Windows locks otherwise")
    monkeypatch.setattr(fcntl, "flock", unknown)
    path = tmp_path / "b.rle"
    both = encode_folder_steps(scene, quality, path), encode_folder_steps(scene, quality, path)
    with pytest.raises(RleSplatError, match="another command is writing there"):
        for _ in zip(*both):
            pass
    drain(both[0])  # the one that noticed leaves the folder to the other
    assert {file.name: file.read_bytes() for file in path.iterdir()} == wanted


@pytest.mark.parametrize("held", ["a.rle", ".a.rle.unfinished"])
@pytest.mark.parametrize("times", [2, 3])
def test_a_folder_that_a_program_holds(tmp_path, few_planes, monkeypatch, held, times):
    """Windows refuses to rename a folder with an open file: one that is shown, or that a virus scanner reads.

    It is tried three times; then the chunks wait for the same job.
    """
    scene, quality = scene_of(volume_of()), QUALITIES["pre"]
    path, os_replace, calls, pauses = tmp_path / "a.rle", os.replace, [], []
    encoded(path, scene, quality)

    def refuse(source, target):
        calls.append(source.name)
        if source.name == held and calls.count(held) <= times:
            raise PermissionError(13, "Access is denied")
        os_replace(source, target)

    other = replace(quality, record=8)
    refused = pytest.raises(RleSplatError, match=r"a program shows it or reads its files; close it there, and run")
    with monkeypatch.context() as patch, refused if times == 3 else nullcontext():
        patch.setattr(os, "replace", refuse)
        patch.setattr(whole_files, "time", SimpleNamespace(sleep=pauses.append))
        encoded(path, scene, other)
    assert calls.count(held) == 3 and 0.0 < sum(pauses) <= 0.5
    if times == 3:
        assert read_encoded(path).record == 16
        assert encoded(path, scene, other)["folder"]["resumed_at_plane"] == scene.volume.shape_xyz[2]
    assert read_encoded(path).record == 8 and [file.name for file in tmp_path.iterdir()] == ["a.rle"]
    assert not (path / "journal").exists()


def test_a_folder_comes_back_whose_replacement_was_killed_between_its_two_renames(tmp_path, few_planes):
    scene, quality, path = scene_of(volume_of()), QUALITIES["pre"], tmp_path / "a.rle"
    encoded(path, scene, quality)
    path.rename(tmp_path / ".a.rle.replaced")
    steps = encode_folder_steps(scene, replace(quality, record=8), path)
    for step in steps:
        if "Encoding" in step.message:
            break
    steps.close()
    assert read_encoded(path).record == 16 and [file.name for file in tmp_path.iterdir()] == ["a.rle"]


def test_what_a_folder_cannot_hold(tmp_path):
    scene = scene_of(volume_of())
    shadowed = replace(scene, ambient_occlusion=1.0)
    with pytest.raises(RleSplatError, match="need all voxels at once"):
        encoded(tmp_path / "a.rle", shadowed, QUALITIES["pre"])
    (tmp_path / "mine").mkdir()
    for path, match in ((tmp_path / "mine", "something else has this name"), (tmp_path / "no" / "a", "does not exist")):
        with pytest.raises(RleSplatError, match=match):
            encoded(path, scene, QUALITIES["pre"])
    assert [file.name for file in tmp_path.iterdir()] == ["mine"]


# --- damage -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("classification", QUALITIES)
def test_damage_is_told(tmp_path, few_planes, classification):
    """Every file cut short, gone, or with one bit changed; no picture is made."""
    scene, quality = scene_of(volume_of(), 0), QUALITIES[classification]
    encoded(tmp_path / "a.rle", scene, quality)
    for file in sorted(path.name for path in (tmp_path / "a.rle").iterdir()):
        if file.startswith("rows"):  # not needed for this view
            continue
        content = (tmp_path / "a.rle" / file).read_bytes()
        changed = bytearray(content)
        changed[len(content) // 2] ^= 4
        for damage in (content[:-1], content + b"x", bytes(changed), None):
            shutil.copytree(tmp_path / "a.rle", tmp_path / "b.rle")
            (tmp_path / "b.rle" / file).unlink()
            if damage is not None:
                (tmp_path / "b.rle" / file).write_bytes(damage)
            with pytest.raises(RleSplatError, match=r"b\.rle.*(encode the volume again|check the path)"):
                from_folder(tmp_path / "b.rle", scene, quality)
            shutil.rmtree(tmp_path / "b.rle")


@pytest.mark.parametrize(
    "change",
    [
        {"shape_xyz": [NX, NY, NZ + 1]},
        {"shape_xyz": [NX + 1, NY, NZ]},
        {"record": 8},
        {"model": "x"},
        {"axes": []},
        {"classification": "x"},
        {"affine": 3},
        {"slabs": []},
        {"dtypes": {}},
        {"most_color": -1.0},
        {"unit_length": float("nan")},
        {"unit_length": 0.0},
        {"transfer_function": "other.json"},
        {"lighting": []},
        {"decoding": [1.0, 1.0]},
        {"version": 9},
        {"format": "x"},
        {"remarks": 4},
        {"affine": [[float("nan")] * 4] * 4},
        {"remarks": "deep"},
    ],
    ids=str,
)
def test_headers_that_say_something_else(tmp_path, few_planes, monkeypatch, change):
    """With a checksum that fits: kernels have no bounds checks."""
    scene, quality = scene_of(volume_of()), QUALITIES["pre"]
    encoded(tmp_path / "a.rle", scene, quality)
    header = tmp_path / "a.rle" / folder_form.HEADER
    content = json.dumps({**json.loads(header.read_text()[8:]), **change}).replace('"deep"', "[" * 9999 + "]" * 9999)
    header.write_text(f"{folder_form.zlib.crc32(content.encode()):08x}{content}")
    with pytest.raises(RleSplatError, match=r"a\.rle|principal axis z"):
        from_folder(tmp_path / "a.rle", scene, quality)


def test_tables_that_lie(tmp_path, few_planes):
    """With checksums that fit: runs that leave the volume."""
    scene, quality = scene_of(volume_of()), QUALITIES["pre"]
    encoded(tmp_path / "a.rle", scene, quality)
    folder = tmp_path / "a.rle"
    runs = np.fromfile(folder / "rows.runs", np.uint16)
    runs[:] += 1
    runs.tofile(folder / "rows.runs")
    header = json.loads((folder / folder_form.HEADER).read_text()[8:])
    at = 0
    for _, tables in header["slabs"]:
        size = tables["rows.runs"][0]
        tables["rows.runs"][1] = folder_form.zlib.crc32(runs.view(np.uint8)[at : at + size].tobytes())
        at += size
    content = json.dumps(header)
    (folder / folder_form.HEADER).write_text(f"{folder_form.zlib.crc32(content.encode()):08x}{content}")
    with pytest.raises(RleSplatError, match="the runs of a scanline do not sum"):
        from_folder(folder, scene, quality)
