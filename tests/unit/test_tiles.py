"""Proves that a picture in tiles is the whole picture to the bit, whatever is in the scene, and that the tiles share
what does not depend on them."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.pipeline import tiles
from rle_splat.pipeline.render import render
from rle_splat.runtime.memory import limit_to
from rle_splat.runtime.steps import drain
from rle_splat.scene import Camera, Light, Mist, Pose, Quality, RleSplatError
from tests.unit.test_crop import HEIGHT, WIDTH, bits, scene_of

POST = Quality()
SIDE = 40
BESIDE = np.array(((1, 0, 0, -30), (0, 1, 0, -20), (0, 0, 1, 50), (0, 0, 0, 1)), float)


def in_tiles(scene, quality, side=SIDE):
    """(rgba, depth, report) of a picture in tiles."""
    strips = []
    report = drain(tiles.render_tiles_steps(scene, quality, side, lambda *rows: strips.append(rows)))
    rgba, depth = (np.concatenate(rows) for rows in zip(*strips, strict=True))
    return rgba, depth, report


def lens_of(camera):
    """The camera with a lens that blurs."""
    return replace(camera, aperture_radius=0.2, focus_distance=10.0)


def moved(scene):
    """The scene, small, with an open shutter."""
    other = scene.camera.matrix_world.copy()
    other[:3, 3] += (2.0, 1.0, 0.0)
    poses = [Pose(matrix, scene.volume_matrix) for matrix in (scene.camera.matrix_world, other)]
    return replace(scene, motion=tuple(poses), width=44, height=36)


LAMP = {"lights": (Light("POINT", (1.0, 1.0, 1.0), 3e5, BESIDE, radius=1.0),), "world": (0.1, 0.1, 0.1)}
SCENES = {
    "ortho": lambda: scene_of("ortho"),
    "perspective": lambda: scene_of("perspective"),
    "inside": lambda: scene_of("inside"),
    "shadows": lambda: scene_of("perspective", **LAMP, volume_shadows=True),
    "lens": lambda: replace(scene_of("ortho"), camera=lens_of(scene_of("perspective").camera), width=24, height=20),
    "motion": lambda: moved(scene_of("ortho")),
    "mist": lambda: scene_of("perspective", mist=Mist(start=5.0, depth=40.0)),
    "a crop": lambda: scene_of("ortho", crop=(11, 7, WIDTH, 60)),
}


@pytest.mark.parametrize("name", SCENES)
def test_a_picture_in_tiles_is_the_whole_picture_to_the_bit(name):
    scene = SCENES[name]()
    whole = render(scene, POST)
    side = SIDE if scene.width == WIDTH else 16
    rgba, depth, report = in_tiles(scene, POST, side)
    assert whole.rgba[..., 3].max() > 0.2
    np.testing.assert_array_equal(bits(rgba), bits(whole.rgba))
    np.testing.assert_array_equal(bits(depth), bits(whole.depth))
    assert report["image"] == whole.report["image"] and report["volume"] == whole.report["volume"]
    assert [effect["on"] for effect in report["effects"]] == [effect["on"] for effect in whole.report["effects"]]
    assert report["tiles"]["side"] == side and report["tiles"]["count"] > 3


@pytest.mark.parametrize("quality", [
    Quality(classification="pre"), Quality(axis_fade=15.0), Quality(rays=0.1),
], ids=["pre", "fade", "rays"])  # fmt: skip
def test_under_other_knobs(quality):
    scene = scene_of("ortho")
    whole = render(scene, quality)
    rgba, _, report = in_tiles(scene, quality, 33)
    np.testing.assert_array_equal(bits(rgba), bits(whole.rgba))
    assert report["rays"]["pixels"] == whole.report["rays"]["pixels"]


def test_tiles_cover_each_pixel_once():
    seen = np.zeros((HEIGHT, WIDTH), int)
    for left, top, right, bottom in tiles.tiles_of((0, 0, WIDTH, HEIGHT), 32):
        seen[top:bottom, left:right] += 1
    assert (seen == 1).all()


def test_what_tiles_have_in_common_is_made_once(monkeypatch):
    made = []
    cache = tiles.StageCache
    monkeypatch.setattr(tiles, "StageCache", lambda most: made.append(cache(most)) or made[-1])
    scene, quality, whole = scene_of("perspective", **LAMP, volume_shadows=True), Quality(classification="pre"), cache()
    render(scene, quality, cache=whole)
    in_tiles(scene, quality)
    assert made[0].made == whole.made and "shadows" in whole.made and "records" in whole.made


def test_a_picture_beside_the_volume_is_refused_and_an_empty_tile_is_not():
    scene = scene_of("ortho")
    turned = np.diag((-1.0, 1.0, -1.0, 1.0))
    away = Camera(scene.camera.matrix_world @ turned, type="ORTHO", ortho_scale=10.0)
    with pytest.raises(RleSplatError, match="does not see the volume"):
        in_tiles(replace(scene, camera=away), POST)
    corner = replace(scene, width=9 * WIDTH, camera=replace(scene.camera, sensor_fit="VERTICAL"))
    assert in_tiles(corner, POST)[0][:, :SIDE].max() == 0.0


def test_the_side_follows_the_free_memory():
    scene = replace(scene_of("perspective"), width=8192, height=8192)
    sides = []
    try:
        for free in (1 << 30, 1 << 28, 1 << 27):
            limit_to(free)
            sides.append(tiles.choose_tile_side(scene, POST))
        limit_to(1 << 24)
        with pytest.raises(RleSplatError, match="make the picture narrower"):
            tiles.choose_tile_side(scene, POST)
    finally:
        limit_to(None)
    assert sides == sorted(sides, reverse=True) and len(set(sides)) > 1 and set(sides) <= set(tiles.SIDES)
    assert tiles.choose_tile_side(scene_of("perspective"), POST) is None
