"""Proves that sheets handled in groups make, to the bit, the picture that one after the other makes."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import Shade
from rle_splat.pipeline.render import render
from rle_splat.runtime.jit import compiled
from rle_splat.scene import Light, Quality
from rle_splat.splat import pixel_block, scalar_splat
from tests.unit.test_crop import bits, scene_of

pytestmark = pytest.mark.skipif(not compiled(), reason="without numba there are no groups")
STRICT = Quality.preset("strict")


def with_and_without(monkeypatch, scene, quality):
    """A picture made in groups, and the same without any."""
    asked, told = scalar_splat._grouped, []

    def spying(*arguments):
        told.append(asked(*arguments))
        return told[-1]

    monkeypatch.setattr(scalar_splat, "_grouped", spying)
    grouped = render(scene, quality)
    assert told and all(told)
    monkeypatch.setattr(scalar_splat, "_grouped", lambda *arguments: None)
    return grouped, render(scene, quality)


def assert_same(one, other):
    assert one.rgba[..., 3].max() > 0.3
    np.testing.assert_array_equal(bits(one.rgba), bits(other.rgba))
    np.testing.assert_array_equal(bits(one.depth), bits(other.depth))


@pytest.mark.parametrize("depth_rule", ["midpoint-2", "midpoint-4", "midpoint-7", "gauss2", "simpson"])
@pytest.mark.parametrize("kind", ["ortho", "perspective"])
def test_whatever_the_rule_and_the_view(monkeypatch, kind, depth_rule):
    assert_same(*with_and_without(monkeypatch, scene_of(kind), replace(STRICT, depth_rule=depth_rule)))


@pytest.mark.parametrize("color", [(1.0, 1.0, 1.0), (1.0, 0.5, 0.2)], ids=["white", "colored"])
@pytest.mark.parametrize("specular", [0.0, 0.5])
def test_lit(monkeypatch, specular, color):
    scene = scene_of("perspective")
    tf = replace(scene.transfer_function, shade=Shade(specular=specular))
    scene = replace(scene, transfer_function=tf, lights=(Light("SUN", color, 2.0),))
    assert_same(*with_and_without(monkeypatch, scene, STRICT))


def test_rows_of_more_blocks_than_a_word_has_bits(monkeypatch):
    scene, quality = scene_of("ortho"), replace(STRICT, sheet_density=4.0, rays=0.0)
    grouped, single = with_and_without(monkeypatch, replace(scene, width=400, height=360), quality)
    assert max(plane["width"] for plane in grouped.report["plan"]["base_planes"]) > 64 * pixel_block.BLOCK
    assert_same(grouped, single)


@pytest.mark.deep
def test_behind_so_many_sheets_that_doubles_add_up(monkeypatch):
    """Lit, in groups, which differs from sums of singles by their roundings."""
    scene = scene_of("perspective")
    single, asked = render(scene, STRICT), scalar_splat._grouped
    monkeypatch.setattr(pixel_block, "MOST_SHEETS_IN_SINGLE", 8)
    grouped = []
    monkeypatch.setattr(scalar_splat, "_grouped", lambda *given: grouped.append(asked(*given)) or grouped[-1])
    double = render(scene, STRICT)
    assert grouped and all(grouped) and double.rgba[..., 3].max() > 0.3
    off = np.abs(double.rgba - single.rgba).max()
    assert 0.0 < off < 2e-5


def test_in_a_crop(monkeypatch):
    whole = render(scene_of("perspective"), STRICT)
    left, top, right, bottom = crop = (7, 5, 30, 21)
    part, single = with_and_without(monkeypatch, replace(scene_of("perspective"), crop=crop), STRICT)
    assert_same(part, single)
    np.testing.assert_array_equal(bits(part.rgba), bits(whole.rgba[top:bottom, left:right]))
