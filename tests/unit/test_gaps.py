"""Closing of short gaps, against a walk through every scanline; and that no picture of sheets by themselves changes."""

from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest

from rle_splat.classify.gaps import SHORT, close_gaps
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline import scalar_source
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.scene import Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

# Below, at and beyond a word of 64 voxels and two; fewer rows than a gap has; one of anything.
SHAPES = ((63, 7, 3), (64, 9, 2), (65, 3, 4), (127, 8, 1), (128, 1, 5), (129, 20, 2), (1, 30, 3), (4, 4, 4), (1, 1, 1))


def walked(line):
    """A scanline of bools with its short gaps closed."""
    found, begin = line.copy(), 0
    for kept, group in groupby(line):
        end = begin + len(list(group))
        if not kept and 0 < begin and end < len(line) and end - begin <= SHORT:
            found[begin:end] = True
        begin = end
    return found


def packed(mask):
    nz, ny, nx = mask.shape
    bytes_ = np.zeros((nz * ny, -(-nx // 64) * 64), np.uint8)
    bytes_[:, :nx] = mask.reshape(-1, nx)
    return np.packbits(bytes_, axis=1, bitorder="little").view("<u8").copy()


@pytest.mark.parametrize("share", (0.0, 0.02, 0.15, 0.5, 0.9, 1.0))
def test_gaps_are_closed_along_the_rows_and_then_across_them(share, way):
    random = np.random.default_rng(int(100 * share))
    for nx, ny, nz in SHAPES:
        mask = random.random((nz, ny, nx)) < share
        bits = packed(mask)
        close_gaps(bits, (nx, ny, nz), threads=2)
        along = np.apply_along_axis(walked, 2, mask)
        np.testing.assert_array_equal(bits, packed(np.apply_along_axis(walked, 1, along)), f"{nx} {ny} {nz}")


@pytest.mark.parametrize("gap", (1, SHORT - 1, SHORT, SHORT + 1))
def test_a_gap_is_closed_up_to_its_length_wherever_it_lies(gap):
    for first in range(0, 130 - gap - 1):
        mask = np.zeros((1, 1, 130), bool)
        mask[0, 0, [first, first + gap + 1]] = True
        bits = packed(mask)
        close_gaps(bits, (130, 1, 1))
        mask[0, 0, first : first + gap + 2] |= gap <= SHORT
        np.testing.assert_array_equal(bits, packed(mask))


def noisy(dtype, holes=False):
    """Shells with noise, whose runs are many and short."""
    z, y, x = np.indices((20, 22, 26)) - np.array((9.5, 10.5, 12.5))[:, None, None, None]
    random = np.random.default_rng(7)
    values = 60.0 * np.cos(1.1 * np.sqrt(x * x + y * y + z * z)) + random.normal(90.0, 18.0, x.shape)
    values = np.clip(values, 0.0, 255.0).astype(dtype)
    if holes:
        values[random.random(x.shape) < 0.03] = np.nan
    return Volume(values, np.eye(4))


FUNCTION = TransferFunction(
    opacity=((110, 0.0), (125, 0.5), (140, 0.0)), color=((110, 1.0, 0.3, 0.1), (140, 0.2, 0.9, 0.8))
)


def scene(volume, perspective, function=FUNCTION):
    camera, matrix = turntable(volume, 30, 20, perspective=perspective)
    return Scene(volume, function, camera, 48, 48, matrix, headlight=True)


# Knobs of sheets by themselves and of slabs between sheets; the name is no preset's, whose plan depends on the scene.
KNOBS = {
    "coarse": Quality(name="coarse", depth_rule="slice-2", sheet_density=0.4, warp_filter="bilinear"),
    "strict": Quality.preset("strict", name="as strict"),
    "between": Quality.preset("standard", name="as standard"),
}


# Numpy is given the coarse pictures alone: it takes a minute for the others.
@pytest.mark.parametrize("perspective", (False, True))
@pytest.mark.parametrize(
    "knobs, way", (("coarse", "numba"), ("coarse", "numpy"), ("strict", "numba")), indirect=("way",)
)
def test_pictures_of_sheets_by_themselves_are_the_same_to_the_bit(monkeypatch, knobs, perspective, way):
    quality = replace(KNOBS[knobs])
    for dtype in (np.uint8, np.float32):
        wanted = scene(noisy(dtype), perspective)
        closed = render(wanted, quality)
        with monkeypatch.context() as patch:
            patch.setattr(scalar_source, "close_gaps", lambda *_, **__: None)
            plain = render(wanted, quality)
        assert closed.report["volume"]["visible_voxels"] > plain.report["volume"]["visible_voxels"]
        assert closed.rgba.tobytes() == plain.rgba.tobytes() and closed.depth.tobytes() == plain.depth.tobytes()
        assert plain.rgba[..., 3].max() > 0.5


@pytest.mark.parametrize("first", ("coarse", "between"))
def test_slabs_between_sheets_have_voxels_of_their_own(first):
    """Where both ends of a slab count, a voxel more may change what is seen: whatever was drawn before."""
    wanted, cache = scene(noisy(np.uint8), True), StageCache()
    render(wanted, KNOBS[first], cache=cache)
    for quality in (KNOBS["coarse"], KNOBS["between"]):
        picture = render(wanted, quality, cache=cache).rgba
        assert picture.tobytes() == render(wanted, quality).rgba.tobytes()
    # What slabs need serves sheets by themselves, and not the other way round.
    assert cache.made["relevant"] == (2 if first == "coarse" else 1)


def test_what_is_no_number_is_never_kept():
    volume = noisy(np.float32, holes=True)
    cache = StageCache()
    render(scene(volume, True), KNOBS["coarse"], cache=cache)
    (voxels,) = [held.voxels for (stage, _), (held, *_) in cache._results.items() if stage == "relevant"]
    assert len(voxels) > 0 and not np.isnan(voxels.stored).any()
