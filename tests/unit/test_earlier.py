"""Files of earlier versions: version 0.2 encoded one small ball into all that are in ``data``."""

from pathlib import Path

import numpy as np
import pytest

from rle_splat.encode.earlier import lengthen
from rle_splat.encode.store import load
from rle_splat.pipeline.render import render
from rle_splat.runtime.steps import drain
from rle_splat.scene import Quality, Scene
from rle_splat.view.turntable import turntable

DATA = Path(__file__).with_name("data")
# Name -> bytes of its records, what they become, and the largest difference to 16 bytes in levels of 1/255.
SAVED = {"16.rle": (16, 0.0), "8.rle": (8, 0.1), "6.rle": (8, 0.3), "4.rle": (8, 1.5)}
VIEWS = {0: (90.0, 10.0), 1: (5.0, 10.0), 2: (20.0, 80.0)}  # principal axis -> azimuth, elevation


def picture(name, axis):
    stored = load(DATA / name)
    camera, matrix = turntable(stored, *VIEWS[axis], width=24, height=24)
    scene = Scene(stored, None, camera, 24, 24, matrix, headlight=False)
    return stored, render(scene, Quality(classification="pre", record=stored.record)).rgba


@pytest.mark.parametrize("axis", VIEWS)
@pytest.mark.parametrize("name", SAVED)
def test_what_earlier_versions_saved_opens(name, axis):
    stored, rgba = picture(name, axis)
    record, levels = SAVED[name]
    assert (stored.record, stored.shape_xyz, stored.source) == (record, (9, 8, 10), "ball.raw")
    assert drain(stored.tables_steps(axis))[0].record == record
    _, best = picture("16.rle", axis)
    assert best[..., 3].max() > 0.5 and 255.0 * np.abs(rgba - best).max() <= levels


@pytest.mark.parametrize("dtype, words, size", ((np.uint16, 3, 4), (np.uint32, 1, 2052)))
def test_scales_that_do_not_fit_are_an_error(dtype, words, size):
    stored = np.random.default_rng(1).integers(0, np.iinfo(dtype).max, (9, words), dtype)
    voxel_data, decoding = lengthen(stored, np.full(size, 2.0, np.float32))
    assert voxel_data.dtype == np.uint64 and len(voxel_data) == 9 and decoding.shape == (4,)
    for wrong in (np.ones(size - 1), np.full(size, np.nan), np.full(size, -1.0), np.full(size, 1e38)):
        with pytest.raises(ValueError, match="scales"):
            lengthen(stored, wrong)
