"""Hard limits: long dimensions, more voxels than 32 bits count, the worst runs there are, and work stopped half-way."""

import os
import sys
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from rle_splat import memory_estimate
from rle_splat.accuracy.metrics import difference
from rle_splat.accuracy.truths import truth
from rle_splat.axes import AXES
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.encode.encode import encode
from rle_splat.encode.store import StoredVolume
from rle_splat.encode_scene import encode_scene, encode_scene_steps
from rle_splat.jit import compiled
from rle_splat.kept import Kept
from rle_splat.medium import classify_and_shade
from rle_splat.read.formats import read_volume
from rle_splat.render import render, render_steps
from rle_splat.scene import Camera, Quality, RleSplatError, Scene
from rle_splat.steps import Clock
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

QUALITY = Quality.preset("standard")
FUNCTION = TransferFunction(opacity=((80, 0.0), (250, 0.5)), color=((80, 1.0, 0.3, 0.1), (250, 0.4, 0.6, 0.9)))
LONG = 70_000  # more than 16 bits count
LARGE = (65_536, 16_400, 2)  # more voxels than 31 bits count; what a raw file may have along an edge
needs_kernels = pytest.mark.skipif(not compiled(), reason="too slow without kernels")


def looking(axis, middle, height):
    """An orthographic camera that looks along +``axis`` at ``middle``, from 60 before it."""
    forward = np.eye(3)[axis]
    up = np.eye(3)[(axis + 2) % 3]
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack((np.cross(forward, up), up, -forward), axis=1)
    matrix[:3, 3] = np.asarray(middle) - 60.0 * forward
    return Camera(matrix, "ORTHO", ortho_scale=height)


def close_up(volume, axis, middle):
    """A picture, 32 pixels a side, of the 16 voxels about a place."""
    return Scene(volume, FUNCTION, looking(axis, middle, 16.0), 32, 32, headlight=False)


def speckled(shape):
    """Voxels in runs of one and more, some of them transparent."""
    return np.random.default_rng(8).integers(0, 256, shape).astype(np.uint8)


# --- dimensions over 65,535 -----------------------------------------------------------------------------------


@needs_kernels
@pytest.mark.parametrize("axis", (0, 1, 2))
@pytest.mark.parametrize("long", (0, 1, 2))
def test_the_far_end_of_a_long_volume_is_drawn_as_if_it_were_all(long, axis):
    """The last voxels of 70,000, behind a transparent run that 16 bits cannot hold, against the same voxels alone."""
    shape = [3, 3, 3]
    shape[2 - long] = 12
    end = speckled(shape)
    start = LONG - 12
    shape[2 - long] = LONG
    voxels = np.zeros(shape, np.uint8)
    np.moveaxis(voxels, 2 - long, 0)[start:] = np.moveaxis(end, 2 - long, 0)
    shift, middle = np.eye(4), np.full(3, 1.0)
    shift[long, 3], middle[long] = start, start + 5.0
    alone = render(close_up(Volume(end, shift), axis, middle), QUALITY)
    whole = render(close_up(Volume(voxels, np.eye(4)), axis, middle), QUALITY)
    assert whole.report["plan"]["base_planes"][0]["principal_axis"].endswith("xyz"[axis])
    assert whole.report["volume"]["visible_voxels"] == alone.report["volume"]["visible_voxels"] > 20
    assert alone.rgba[..., 3].max() > 0.3
    assert 255.0 * np.abs(whole.rgba - alone.rgba).max() < 1.0


# --- more than 2^31 voxels, runs and records ------------------------------------------------------------------


def sparse(path, size):
    """A file of ``size`` zero bytes that takes no room on the disk; the test is left out where it would."""
    if sys.platform == "win32":
        pytest.skip("files are not sparse here unless told")
    with open(path, "wb") as file:
        file.truncate(size)
    if os.stat(path).st_blocks * 512 > size // 100:
        pytest.skip("files are not sparse here")
    return path


@needs_kernels
def test_a_volume_of_more_than_32_bits_of_voxels(tmp_path):
    """A file that is nearly all holes: its last voxels, against the same ones alone."""
    path = sparse(tmp_path / "large.raw", int(np.prod(LARGE)))
    corner = np.array((LARGE[0] - 12, LARGE[1] - 10, 0))
    end = speckled((2, 10, 12))
    with open(path, "r+b") as file:
        for z in range(2):
            for y in range(10):
                file.seek((z * LARGE[1] + int(corner[1]) + y) * LARGE[0] + int(corner[0]))
                file.write(end[z, y].tobytes())
    volume = read_volume(path, shape=LARGE, dtype="uint8", spacing=(1.0, 1.0, 1.0))
    assert volume.voxels.size > 1 << 31 and LARGE[0] > np.iinfo(np.uint16).max
    shift = np.eye(4)
    shift[:3, 3] = corner
    tracemalloc.start()
    try:
        stored = encode_scene(close_up(volume, 2, corner + 5.0), QUALITY)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 0.1 * volume.voxels.size
    for axis, tables in stored.axes.items():
        assert tables.visible_voxels == (end > 80).sum()
        alone, whole = (
            render(close_up(one, axis, corner + 5.0), QUALITY).rgba for one in (Volume(end, shift), stored)
        )
        assert alone[..., 3].max() > 0.3 and 255.0 * np.abs(whole - alone).max() < 1.0


@needs_kernels
@pytest.mark.parametrize("record", (16, 4))
@pytest.mark.parametrize("axis", (0, 1, 2))
def test_tables_with_more_than_32_bits_of_runs_and_records(axis, record, tmp_path):
    """The tables of a small volume behind 2^31 runs and 2^31 records of holes: the picture keeps its bits."""
    volume = Volume(speckled((14, 15, 16)), np.eye(4))
    scene = close_up(volume, axis, (8.0, 7.0, 7.0))
    classified, colors = classify_and_shade(scene, QUALITY, Clock())
    tables = encode(classified, colors, axis, record=record)
    beyond = (1 << 31) + 5

    def behind_holes(table, name):
        shape = (beyond + len(table), *table.shape[1:])
        path = sparse(tmp_path / name, int(np.prod(shape)) * table.itemsize)
        mapped = np.memmap(path, table.dtype, "r+", shape=shape)
        mapped[beyond:] = table
        return np.asarray(mapped)

    pointers = tables.scanline_pointers.astype(np.int64)
    far = replace(
        tables, runs=behind_holes(tables.runs, "runs"), voxel_data=behind_holes(tables.voxel_data, "records"),
        scanline_pointers=np.where(pointers < 0, -1, pointers + beyond), data_pointers=tables.data_pointers + beyond,
        scanline_data_pointers=tables.scanline_data_pointers + beyond,
    )  # fmt: skip
    near, moved = (
        render(replace(scene, volume=StoredVolume({axis: one}, volume.affine)), replace(QUALITY, record=record)).rgba
        for one in (tables, far)
    )
    assert near[..., 3].max() > 0.3
    np.testing.assert_array_equal(moved, near)


# --- the worst runs -------------------------------------------------------------------------------------------


def checkerboard(n):
    """Every other voxel: as many runs as there are voxels, and one more in every other scanline."""
    return Volume((np.indices((n, n, n)).sum(axis=0) % 2 * 250).astype(np.uint8), np.eye(4))


def solid(n):
    return Volume(np.random.default_rng(1).integers(100, 256, (n, n, n)).astype(np.uint8), np.eye(4))


@pytest.mark.parametrize("axis, view", ((0, (79, 12)), (1, (11, 14)), (2, (20, 77))))
@pytest.mark.parametrize("make", (checkerboard, solid))
def test_the_worst_runs_are_drawn_right(make, axis, view):
    """Against the truth, from within the block's outline, with four sheet pixels to a picture's."""
    volume = make(14)
    camera, matrix = turntable(volume, *view, fit=0.5, width=32, height=32)
    faint = replace(FUNCTION, opacity=((80, 0.0), (250, 0.15)), shade=None)
    scene = Scene(volume, faint, camera, 32, 32, matrix, headlight=False)
    if make is checkerboard:
        tables = encode_scene(scene, QUALITY, (axis,)).axes[axis]
        assert len(tables.runs) == 14**3 + 14**2 // 2
    fine = replace(QUALITY, depth_rule="midpoint-8", sheet_density=4.0, termination=0.0)
    rendering, true = render(scene, fine), truth(scene, "T1", tolerance=1e-6)[0].reshape(32, 32, 4)
    assert rendering.report["plan"]["base_planes"][0]["principal_axis"].endswith("xyz"[axis])
    found, moved = (difference(rendering.rgba, picture) for picture in (true, np.roll(true, 1, axis=1)))
    assert found.rmse < 0.05 and found.largest < 0.3 and moved.rmse > 20.0 * found.rmse


@pytest.mark.parametrize("make", (checkerboard, solid))
def test_the_worst_runs_are_in_the_estimate(make):
    scene = replace(close_up(make(64), 2, (32.0, 32.0, 32.0)), headlight=True)
    encode_scene(scene, QUALITY)  # whatever is made once
    tracemalloc.start()
    try:
        stored = encode_scene(scene, QUALITY)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    wanted = memory_estimate.estimate(scene.volume, FUNCTION, QUALITY, axes=3)
    tables = sum(one.runs.nbytes for one in stored.axes.values())
    assert wanted.records == sum(one.voxel_data.nbytes for one in stored.axes.values())
    assert tables <= wanted.runs and 0.9 * peak <= wanted.needed <= 1.8 * peak


@pytest.mark.parametrize("make", (checkerboard, solid))
def test_the_worst_runs_are_refused_when_they_do_not_fit(make, monkeypatch):
    scene = close_up(make(64), 2, (32.0, 32.0, 32.0))
    wanted = memory_estimate.estimate(scene.volume, FUNCTION, QUALITY).needed
    for module in ("memory_estimate", "kept", "memory"):
        monkeypatch.setattr(f"rle_splat.{module}.available_bytes", lambda: wanted // 2)
    with pytest.raises(RleSplatError, match="are free"):
        render(scene, QUALITY)


# --- work stopped half-way ------------------------------------------------------------------------------------


def two_pictures():
    """The one that is kept, and one that shares nothing with it but the voxels, from inside: three principal axes."""
    volume = Volume(speckled((18, 19, 20)), np.eye(4))
    camera, matrix = turntable(volume, 20, 10, width=40, height=40)
    first = Scene(volume, FUNCTION, camera, 40, 40, matrix)
    inside = np.eye(4)
    inside[:3, 3] = 9.2, 9.1, 8.9
    wide = Camera(inside, lens=8.0, clip_start=0.01)
    brighter = replace(FUNCTION, opacity=((60, 0.0), (250, 0.2)), shade=None)
    return first, Scene(volume, brighter, wide, 40, 40, headlight=False)


@pytest.mark.parametrize("record", (16, 4))
def test_what_follows_a_cancelled_picture_is_as_if_it_had_never_been(record, monkeypatch):
    """Cancelled at every step there is; then both the picture that was kept and the cancelled one keep their bits."""
    monkeypatch.setattr(sys.modules[encode.__module__], "VOXELS_AT_ONCE", 500)  # more steps, as large volumes have
    first, other = two_pictures()
    quality = replace(QUALITY, record=record)
    undisturbed = {name: render(scene, quality) for name, scene in (("first", first), ("other", other))}
    store = Kept()
    render(first, quality, kept=store)
    told = []
    while True:
        before, size = store.contents, store.nbytes
        work = render_steps(other, quality, store)
        messages = [next(work).message for _ in range(len(told) + 1)]
        work.close()
        told.append(messages[-1])
        if told[-1] == "Done":
            break
        assert store.contents == before and store.nbytes == size, told
        again = {"first": render(first, quality, kept=store), "other": render(other, quality, kept=Kept())}
        for name, picture in again.items():
            np.testing.assert_array_equal(picture.rgba, undisturbed[name].rgba)
            np.testing.assert_array_equal(picture.depth, undisturbed[name].depth)
    assert {"Counting", "Encoding", "Splatting"} <= set(told) and len(told) > 15


def test_what_follows_a_cancelled_encoding_is_as_if_it_had_never_been(monkeypatch):
    monkeypatch.setattr(sys.modules[encode.__module__], "VOXELS_AT_ONCE", 500)
    scene = two_pictures()[0]
    for record in (16, 8):
        quality = replace(QUALITY, record=record)
        whole = encode_scene(scene, quality).axes
        steps = len(list(encode_scene_steps(scene, quality)))
        assert steps > 15
        for stop in range(1, steps + 1):
            work = encode_scene_steps(scene, quality)
            for _ in range(stop):
                next(work)
            work.close()
        again = encode_scene(scene, quality).axes
        for axis in AXES:
            for table in ("scanline_pointers", "data_pointers", "runs", "voxel_data"):
                np.testing.assert_array_equal(getattr(again[axis], table), getattr(whole[axis], table))
