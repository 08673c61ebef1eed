"""Indirect light: what turns it off, its amount, and its bound; its formula is tested in test_light_model.py."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.scene import Quality, RleSplatError
from tests.lamps import point, sun
from tests.truths.test_shadows import lit_blob, scene_of
from tests.ways import NUMPY, both

INDIRECT_IS_OFF = {
    "amount 0": ({"indirect_light": 0.0}, "post", "indirect light is turned off"),
    "pre": ({}, "pre", "the volume is pre-classified"),
    "no shadows": ({"volume_shadows": False}, "post", "only light that casts shadows is scattered, and none does"),
    "shadows off by hand": ({"effects": {"shadows": False}}, "post", "only light that casts shadows is scattered"),
    "a headlight": ({"lights": (), "headlight": True}, "post", "only light that casts shadows is scattered"),
    "a lamp without shadows": ({"lights": (sun((0, 0, -1), casts_shadow=False),)}, "post", "only light that casts"),
    "by hand": ({"effects": {"indirect light": False}}, "post", "by hand"),
    "a mode": ({"mode": "mip"}, "post", "nothing is shaded"),
}  # fmt: skip


@NUMPY
@pytest.mark.parametrize("name", INDIRECT_IS_OFF)
def test_indirect_light_that_is_off_is_no_part_of_a_picture(name, way, monkeypatch):
    monkeypatch.setattr("rle_splat.pipeline.shadows.scattered_light_steps", None)
    more, classification, reason = INDIRECT_IS_OFF[name]
    scene = replace(lit_blob(), **{"indirect_light": 1.0, **more})
    quality = Quality(classification=classification)
    rendering = render(scene, quality)
    row = next(row for row in rendering.report["effects"] if row["name"] == "indirect light")
    assert not row["on"] and reason in row["reason"] and row["ms"] == 0.0
    plain = replace(scene, indirect_light=0.0, effects={k: v for k, v in scene.effects.items() if k == "shadows"})
    np.testing.assert_array_equal(rendering.rgba, render(plain, quality).rgba)


@NUMPY
def test_the_amount_of_indirect_light_sweeps_nothing_and_counts_in_proportion(way):
    cache, found = StageCache(), []
    for amount in (1.0, 0.5, 0.0):
        found.append(render(lit_blob(indirect_light=amount), Quality(), cache=cache).rgba.astype(float))
        assert cache.made["shadows"] == 1 + (amount == 0.0)
    assert np.abs(found[0] - found[2]).max() > 0.03
    np.testing.assert_allclose(found[1], 0.5 * (found[0] + found[2]), atol=8e-3)  # the warp stops at 0 at edges
    forced = render(lit_blob(effects={"indirect light": True}), Quality(), cache=cache).rgba
    np.testing.assert_array_equal(forced, found[0].astype(np.float32))
    with pytest.raises(RleSplatError, match="turned on by hand, but the volume is pre-classified"):
        render(lit_blob(effects={"indirect light": True}), Quality(classification="pre"))


@pytest.mark.parametrize("bad", [-1, 2, np.nan, "much", None])
def test_an_amount_of_indirect_light_that_is_none_is_one_sentence(bad):
    with pytest.raises(RleSplatError, match=r"^Indirect light must be a number from 0 to 1, not .*\.$"):
        lit_blob(indirect_light=bad)


def test_kernels_scatter_light_as_their_reference_does():
    lamp = point((30, 8, 8), energy=2e4)
    scene = lit_blob(indirect_light=1.0, ambient_occlusion=0.7, world=(0.2, 0.3, 0.4))
    scene = replace(scene, lights=(*scene.lights, lamp, replace(lamp, casts_shadow=False)))
    ours, reference = both(lambda: render(scene, Quality()).rgba)
    assert np.abs(ours - reference).max() < 2e-3
    assert np.abs(ours - render(replace(scene, indirect_light=0.0), Quality()).rgba).max() > 0.02


def test_light_scattered_in_a_cloud_is_never_above_light_that_nothing_blocks():
    haze, quality = np.full((16, 16, 16), 0.25), Quality.preset("fine")
    scene = scene_of(haze, None, [sun((0.3, 0.4, -1.0), energy=np.pi)])
    lit, direct = (render(replace(scene, indirect_light=amount), quality).rgba for amount in (1.0, 0.0))
    assert (lit <= lit[..., 3:] + 1e-3).all() and (lit >= direct - 1e-3).all() and (lit - direct).max() > 0.05
