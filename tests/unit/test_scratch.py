"""Proves that the scratch of the splat is kept from picture to picture, and that nothing in it reaches a picture."""

import numpy as np
import pytest

from rle_splat.pipeline.render import render
from rle_splat.runtime.jit import compiled
from rle_splat.scene import Mist, Quality
from rle_splat.splat import scalar_splat, scratch, splat
from tests.unit.test_crop import TRIANGLES, bits, scene_of

pytestmark = pytest.mark.skipif(not compiled(), reason="there are no kernels without numba")

CASES = {
    "post": (Quality(), {}),
    "post, draft": (Quality.preset("draft"), {}),
    "post, meshes": (Quality(), {"triangles": TRIANGLES}),
    "post, mist": (Quality(), {"mist": Mist(10.0, 40.0)}),
    "post, largest values": (Quality(), {"mode": "mip"}),
    "post, X-ray": (Quality(), {"mode": "xray"}),
    "pre": (Quality(classification="pre"), {}),
    "pre, meshes": (Quality(classification="pre"), {"triangles": TRIANGLES}),
    "pre, wide": (Quality(classification="pre", kernel="bspline3", record=8), {}),
    "paper": (Quality.paper(), {}),
}


@pytest.mark.parametrize("kind", ["ortho", "inside"])
@pytest.mark.parametrize("name", CASES)
def test_what_the_scratch_held_before_is_not_seen(name, kind):
    quality, more = CASES[name]
    scene = scene_of(kind, **more)
    first = render(scene, quality)
    assert first.rgba[..., 3].max() > 0.3
    held = scratch._KEPT[-1]
    for byte in (0xFF, 0x00, 0x3F):  # numbers that are none, nothing, and ordinary ones
        held[:] = byte
        again = render(scene, quality)
        np.testing.assert_array_equal(bits(again.rgba), bits(first.rgba))
        np.testing.assert_array_equal(bits(again.depth), bits(first.depth))
        assert scratch._KEPT[-1] is held


@pytest.mark.parametrize("kind", ["ortho", "inside"])
@pytest.mark.parametrize("name", CASES)
def test_only_kernels_write_to_the_scratch(monkeypatch, name, kind):
    """What comes before them may run while another thread's kernel uses it."""
    quality, more = CASES[name]
    scene = scene_of(kind, **more)
    render(scene, quality)
    held, planes = scratch._KEPT[-1], []
    held[:] = 0x3F

    def spying(row_steps):
        def steps(*arguments):
            assert (held == 0x3F).all()
            yield from row_steps(*arguments)
            held[:] = 0x3F
            planes.append(1)

        return steps

    for module in (splat, scalar_splat):
        monkeypatch.setattr(module, "row_steps", spying(module.row_steps))
    render(scene, quality)
    assert planes and scratch._KEPT[-1] is held


def test_the_scratch_grows_and_what_is_too_large_is_not_kept(monkeypatch):
    monkeypatch.setattr(scratch, "_KEPT", [])
    small = scratch._memory(1000)
    assert scratch._memory(500) is small and small.ctypes.data % scratch.CACHE_LINE == 0
    larger = scratch._memory(small.size + 1)
    assert larger is not small and scratch._memory(1000) is larger
    monkeypatch.setattr(scratch, "MOST_KEPT", larger.size)
    huge = scratch._memory(larger.size + 1)
    assert huge.size > larger.size and scratch._memory(1000) is larger
