"""Work stopped half-way, at every step there is, leaves everything as it was."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.encode.encode import encode
from rle_splat.pipeline.encode_scene import encode as encode_scene
from rle_splat.pipeline.encode_scene import encode_steps
from rle_splat.pipeline.render import render, render_steps
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.scene import Camera, Quality, Scene
from rle_splat.splat import splat
from rle_splat.view.turntable import turntable
from rle_splat.volume.axes import AXES
from rle_splat.volume.volume import Volume

QUALITY = Quality.preset("standard", classification="pre")
FUNCTION = TransferFunction(opacity=((80, 0.0), (250, 0.5)), color=((80, 1.0, 0.3, 0.1), (250, 0.4, 0.6, 0.9)))


def speckled(shape):
    """Voxels in runs of one and more, some of them transparent."""
    return np.random.default_rng(8).integers(0, 256, shape).astype(np.uint8)


def two_pictures():
    """The one that is kept, and one that shares nothing with it but the voxels, from inside: three principal axes."""
    volume = Volume(speckled((18, 19, 20)), np.eye(4))
    camera, matrix = turntable(volume, 20, 10)
    first = Scene(volume, FUNCTION, camera, 40, 40, matrix)
    inside = np.eye(4)
    inside[:3, 3] = 9.2, 9.1, 8.9
    wide = Camera(inside, lens=8.0, clip_start=0.01)
    brighter = replace(FUNCTION, opacity=((60, 0.0), (250, 0.2)), shade=None)
    return first, Scene(volume, brighter, wide, 40, 40, headlight=False)


@pytest.mark.parametrize("mixed", (False, True))
@pytest.mark.parametrize("workers", (1, 2))
@pytest.mark.parametrize("columns, sheets", ((900, 20), (900, 100), (2000, 600)))
def test_rows_are_splatted_a_few_at_a_time(columns, sheets, workers, mixed, monkeypatch):
    """Of a small volume so many that a thread works for 8 to 20 ms, of a large one as few as threads can share."""
    calls = []
    monkeypatch.setattr(splat, "is_loaded", lambda *_: True)
    plane, of_sheets = SimpleNamespace(width=columns, height=1000), SimpleNamespace(begin=np.zeros(sheets))
    arguments = (SimpleNamespace(width=24),), plane, of_sheets, None, workers, (), mixed
    steps = list(splat.row_steps(lambda *given: calls.append(given[1:3]), *arguments))
    assert len(steps) == len(calls) and [first for first, _ in calls[1:]] == [last for _, last in calls[:-1]]
    most = max(last - first for first, last in calls)
    least = splat.BAND // 2 if workers == 1 else 2 * splat.BAND * splat.BANDS_EACH
    assert calls[-1][1] == 1000
    assert most == least or most * (columns + 24) * sheets <= (1_500_000 if mixed else 12_000_000) * workers


def test_what_follows_a_cancelled_picture_is_as_if_it_had_never_been(monkeypatch):
    """Cancelled at every step there is; then both the picture that was kept and the cancelled one keep their bits."""
    monkeypatch.setattr(sys.modules[encode.__module__], "RECORDS_AT_ONCE", 1500)  # more steps, as large volumes have
    first, other = two_pictures()
    quality = QUALITY
    undisturbed = {name: render(scene, quality) for name, scene in (("first", first), ("other", other))}
    store = StageCache()
    render(first, quality, cache=store)
    told = []
    while True:
        before, size = store.contents, store.nbytes
        work = render_steps(other, quality, cache=store)
        messages = [next(work).message for _ in range(len(told) + 1)]
        work.close()
        told.append(messages[-1])
        if told[-1] == "Done":
            break
        assert store.contents == before and store.nbytes == size, told
        again = {"first": render(first, quality, cache=store), "other": render(other, quality, cache=StageCache())}
        for name, picture in again.items():
            np.testing.assert_array_equal(picture.rgba, undisturbed[name].rgba)
            np.testing.assert_array_equal(picture.depth, undisturbed[name].depth)
    assert {"Counting", "Encoding", "Splatting"} <= set(told) and len(told) > 15


def test_what_follows_a_cancelled_encoding_is_as_if_it_had_never_been(monkeypatch):
    monkeypatch.setattr(sys.modules[encode.__module__], "RECORDS_AT_ONCE", 1500)
    scene = two_pictures()[0]
    for record in (16, 8):
        quality = replace(QUALITY, record=record)
        whole = encode_scene(scene, quality).axes
        steps = len(list(encode_steps(scene, quality)))
        assert steps > 15
        for stop in range(1, steps + 1):
            work = encode_steps(scene, quality)
            for _ in range(stop):
                next(work)
            work.close()
        again = encode_scene(scene, quality).axes
        for axis in AXES:
            for table in ("scanline_pointers", "data_pointers", "runs", "voxel_data"):
                np.testing.assert_array_equal(getattr(again[axis], table), getattr(whole[axis], table))
