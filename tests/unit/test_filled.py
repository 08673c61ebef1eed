"""Proves that what an intermediate image says to be empty is empty, and that the warp, which does not look there, makes
the picture of one that looks everywhere, to the bit."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from rle_splat.effects.ray_mode import OF_VALUES
from rle_splat.pipeline.render import render
from rle_splat.runtime.steps import drain
from rle_splat.scene import Mist, Quality
from rle_splat.splat.pixel_block import BLOCK
from rle_splat.volume.volume import Volume
from rle_splat.warp.warp import warp_steps
from tests.unit.test_crop import TRIANGLES, VOLUME, bits, scene_of

PIPELINE = sys.modules["rle_splat.pipeline.render"]  # the module: the package's name for it is the function
CASES = {
    "post": (Quality(), {}),
    "draft": (Quality.preset("draft"), {}),
    "strict": (Quality.preset("strict"), {}),
    "keys": (Quality(warp_filter="keys"), {}),
    "meshes": (Quality(), {"triangles": TRIANGLES}),
    "mist": (Quality(), {"mist": Mist(10.0, 40.0)}),
    "largest values": (Quality(), {"mode": "mip"}),
    "smallest values": (Quality(), {"mode": "minip"}),
    "mean values": (Quality(), {"mode": "average"}),
    "X-ray": (Quality(), {"mode": "xray"}),
    "pre": (Quality(classification="pre"), {}),
    "pre, meshes": (Quality(classification="pre"), {"triangles": TRIANGLES}),
    "paper": (Quality.paper(), {}),
}


# A few voxels by themselves, on all sides of an eye in their midst.
DOTS = Volume((np.random.default_rng(3).random(VOLUME.voxels.shape) < 0.012).astype(np.float32), VOLUME.affine)


@pytest.mark.parametrize(
    ("name", "kind", "way"),
    (*((name, kind, "numba") for name in CASES for kind in ("ortho", "perspective", "inside")),
     *((name, "perspective", "numpy") for name in ("post", "pre", "largest values", "X-ray"))),
    indirect=["way"],
)  # fmt: skip
def test_the_warp_looks_wherever_there_is_anything(monkeypatch, name, kind, way):
    quality, more = CASES[name]
    shares = []

    def everywhere(images, *others):
        found, whole = (yield from warp_steps(images, *others)), []
        for image in images:
            height, width = image.half_depth.shape
            some = (image.pixels != (0.0, 0.0, 0.0, 1.0)).any(axis=-1)
            columns, (first, last) = np.arange(width), image.filled[:, :, None]
            inside = (first <= columns) & (columns < last)
            assert not some[~inside].any() and np.isinf(image.half_depth[~inside]).all()
            # Up to blocks of pixels no more than that.
            for row in range(height):
                columns = np.flatnonzero(some[row])
                if len(columns) == 0:
                    assert first[row] >= last[row]
                else:
                    assert columns[0] - BLOCK < first[row] <= columns[0] < last[row] <= columns[-1] + BLOCK
            shares.append(inside.mean())
            whole.append(replace(image, filled=np.array((np.zeros(height), np.full(height, width)), np.int32)))
        for ours, theirs in zip(found, drain(warp_steps(whole, *others)), strict=True):
            np.testing.assert_array_equal(bits(ours), bits(theirs))
        return found

    monkeypatch.setattr(PIPELINE, "warp_steps", everywhere)
    of_values = more.get("mode") in OF_VALUES
    scene = replace(scene_of(kind, **more), volume=VOLUME if of_values else DOTS)
    picture = render(scene, quality)
    assert picture.rgba[..., 3].max() > 0.2
    assert max(shares) > 0.0 and (of_values or min(shares) < 0.8)


def test_a_picture_of_nothing_is_clear(way):
    """Of base planes with nothing on them."""
    scene = scene_of("perspective")
    hidden = replace(scene.transfer_function, opacity=((0.0, 0.0), (300.0, 0.0)))
    picture = render(replace(scene, transfer_function=hidden), Quality())
    assert not picture.rgba.any() and len(np.unique(picture.depth)) == 1
