"""Thumbnails of presets: rendered from the volume, kept on disk by content, and never without a window.

The generator that a timer drives in a window is driven here as it is; window_presets.py looks at the pictures.
"""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")


@pytest.fixture
def cache(tmp_path, monkeypatch, core):
    """A folder of its own for thumbnails."""
    monkeypatch.setenv("RLE_SPLAT_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    return tmp_path / "cache" / "thumbnails"


@pytest.fixture
def thumbnails(bridge, monkeypatch, core):
    """The module, which counts the thumbnails that it makes; forgets everything."""
    module, picture = bridge("look.thumbnails"), core("pipeline.thumbnail")
    made = []

    def counted(*arguments):
        made.append(arguments)
        return picture.thumbnail_steps(*arguments)

    monkeypatch.setattr(module, "thumbnail_steps", counted)
    module.stop()
    module.rendered = made
    yield module
    module.stop()
    del module.rendered


@pytest.fixture
def ball(tmp_path):
    """A ball that grows denser inwards, above the middle of its box."""
    z, y, x = np.mgrid[:30, :24, :26] - np.array((19.0, 12.0, 13.0))[:, None, None, None]
    return scenes.import_raw(tmp_path, np.clip(255 - 25 * np.sqrt(x**2 + y**2 + z**2), 0, 255).astype(np.uint8))


def entries(bridge, owner):
    groups = bridge("look.preset_entries").groups(owner.rle_splat)
    return {entry.name: entry for group in groups for entry in group.entries}


def picture(thumbnails, bridge, owner, name, segments=None):
    volume = bridge("volumes.volumes").load_volume(owner)
    steps = thumbnails.picture_steps(entries(bridge, owner)[name], volume, segments)
    while True:
        try:
            next(steps)
        except StopIteration as finished:
            return finished.value


def test_a_thumbnail_shows_the_volume(ball, thumbnails, bridge, cache):
    pixels = picture(thumbnails, bridge, ball, "mr-head")
    assert pixels.shape == (128, 128, 3) and pixels.dtype == np.uint8
    background = pixels[0, 0]
    shown = np.abs(pixels.astype(int) - background).max(axis=2) > 20
    rows, columns = np.nonzero(shown)
    assert 0.05 < shown.mean() < 0.7, "neither blank nor filled"
    assert rows.mean() < 60, "the ball lies above the middle, and up is up"
    assert abs(columns.mean() - 63.5) < 3


def test_what_is_black_as_in_a_pet_lies_on_white(ball, thumbnails, bridge, cache):
    pixels = picture(thumbnails, bridge, ball, "pet").astype(int)
    assert pixels[0, 0].min() > 200 and pixels[0, 0].min() - pixels.min() > 50, "black on black"


def test_presets_look_different(ball, thumbnails, bridge, cache):
    pictures = [picture(thumbnails, bridge, ball, name) for name in ("AUTO", "mr-head", "faint", "smoke")]
    for i, one in enumerate(pictures):
        for other in pictures[:i]:
            assert np.abs(one.astype(int) - other).max() > 10


def test_a_thumbnail_is_rendered_once(ball, thumbnails, bridge, cache):
    first = picture(thumbnails, bridge, ball, "mr-head")
    assert len(thumbnails.rendered) == 1
    thumbnails.stop()  # what is in memory
    np.testing.assert_array_equal(picture(thumbnails, bridge, ball, "mr-head"), first)
    assert len(thumbnails.rendered) == 1 and len(list(cache.iterdir())) == 1
    (file,) = cache.iterdir()
    file.write_bytes(b"damaged")
    np.testing.assert_array_equal(picture(thumbnails, bridge, ball, "mr-head"), first)
    assert len(thumbnails.rendered) == 2, "a damaged file is rendered anew"


def test_the_file_is_named_by_content_alone(ball, thumbnails, bridge, cache, core, tmp_path):
    key_of = core("pipeline.thumbnail").thumbnail_key
    volume = bridge("volumes.volumes").load_volume(ball)
    preset = core("classify.presets").preset
    keys = {key_of(volume, preset(name)) for name in ("mr-head", "faint", "smoke")}
    other = scenes.import_raw(tmp_path, np.full((4, 5, 6), 9, np.uint8), name="other")
    keys.add(key_of(bridge("volumes.volumes").load_volume(other), preset("mr-head")))
    assert len(keys) == 4 and all(len(key) == 32 and int(key, 16) for key in keys)
    picture(thumbnails, bridge, ball, "mr-head")
    (file,) = cache.iterdir()
    assert file.suffix == ".npz" and len(file.stem) == 32 and int(file.stem, 16)


def test_old_thumbnails_are_forgotten(bridge, cache, monkeypatch):
    files = bridge("look.thumbnails")
    monkeypatch.setattr(files, "MOST_FILES", 3)
    pixels = np.zeros((128, 128, 3), np.uint8)
    for number in range(6):
        files.save_file(f"{number}", pixels)
    assert len(list(cache.iterdir())) == 3 and files.load_file("5") is not None
    assert files.load_file("absent") is None


def test_in_the_background_nothing_is_rendered(ball, thumbnails, bridge, cache):
    for entry in entries(bridge, ball).values():
        assert thumbnails.icon(ball, entry) == 0
    assert thumbnails._tick not in bridge("loop.timer")._due
    assert not thumbnails.rendered and not cache.exists()


def test_a_hidden_rest_is_left_out(ball, thumbnails, bridge, cache):
    """The lower half of the ball is in no segment, and has a picture of its own while it is hidden."""
    name = next(iter(entries(bridge, ball)))
    whole = picture(thumbnails, bridge, ball, name)
    volume = bridge("volumes.volumes").load_volume(ball)
    segments = replace(volume, voxels=(np.mgrid[:30, :24, :26][0] >= 19).astype(np.uint8))
    half = picture(thumbnails, bridge, ball, name, segments)
    background, (rows, _columns) = whole[0, 0], (whole != whole[0, 0]).any(axis=2).nonzero()
    middle = (rows.min() + rows.max()) // 2
    assert (half[middle + 6 :] == background).all() and (half[: middle - 6] != background).any()
    assert len(thumbnails.rendered) == 2 and np.array_equal(picture(thumbnails, bridge, ball, name), whole)


def test_what_hides_the_rest_asks_for_other_pictures(ball, thumbnails, bridge, cache, tmp_path):
    labels, entry = bridge("volumes.labels"), next(iter(entries(bridge, ball).values()))
    path = tmp_path / "cube_segments_26x24x30_uint8.raw"
    path.write_bytes((np.mgrid[:30, :24, :26][0] >= 19).astype(np.uint8).tobytes())
    ball.rle_splat.label_file = str(path)
    bpy.ops.rle_splat.load_segments()
    shown = thumbnails._key(ball, entry)
    assert not labels.hides_rest(ball)
    next(row for row in ball.rle_splat.labels if row.label == 0).show = False
    assert labels.hides_rest(ball) and thumbnails._key(ball, entry) != shown
    volume = bridge("volumes.volumes").load_volume(ball)
    assert labels.map_at_hand(ball, volume).voxels.max() == 1
    path.unlink()
    assert labels.map_at_hand(ball, volume) is None


def test_the_timer_makes_what_is_asked_for_in_short_steps(ball, thumbnails, bridge, cache, monkeypatch):
    """As in a window whose sidebar shows the tab; while others work it waits, and without the tab it ends."""
    shown, busy = [True], [True]
    monkeypatch.setattr(thumbnails, "_tab_is_shown", lambda: shown[0])
    monkeypatch.setattr(thumbnails, "_others_work", lambda: busy[0])
    entry = entries(bridge, ball)["mr-head"]
    assert thumbnails.icon(ball, entry) == 0
    assert thumbnails._tick() == thumbnails.BUSY and not thumbnails.rendered
    busy[0] = False
    ticks = 0
    while thumbnails._wanted and ticks < 1000:
        assert thumbnails._tick() == thumbnails.timer.AT_ONCE
        ticks += 1
    assert bridge("loop.store").has_any(thumbnails.COARSE)
    (collection,) = thumbnails._collections
    (preview,) = collection.values()  # its icon is 0 in background mode
    assert tuple(preview.image_size) == (128, 128) and len(thumbnails.rendered) == 1
    drawn = np.array(preview.image_pixels_float).reshape(128, 128, 4)[::-1]
    np.testing.assert_allclose(255 * drawn[..., :3], picture(thumbnails, bridge, ball, "mr-head"), atol=0.6)
    thumbnails.icon(ball, entry)
    assert not thumbnails._wanted, "it is there"
    assert thumbnails._tick() is None, "nothing is left to do"
    thumbnails.icon(ball, entries(bridge, ball)["faint"])
    shown[0] = False
    assert thumbnails._tick() is None and len(thumbnails.rendered) == 1
    assert not bridge("loop.store").has_any(thumbnails.COARSE) and not thumbnails._wanted


def test_a_preset_that_cannot_be_read_is_tried_once(ball, thumbnails, bridge, cache, monkeypatch):
    monkeypatch.setattr(thumbnails, "_tab_is_shown", lambda: True)
    monkeypatch.setattr(thumbnails, "_others_work", lambda: False)
    entry = bridge("look.preset_entries").Entry("gone", "gone", "", (1, 2))
    assert thumbnails.icon(ball, entry) == 0
    while thumbnails._tick() is not None:
        pass
    assert thumbnails.icon(ball, entry) == 0 and not thumbnails._wanted


@pytest.mark.parametrize("level", ("", "x86-64-v3"))
def test_a_thumbnail_compiles_no_kernels_of_gradient_opacity(ball, thumbnails, bridge, cache, core, monkeypatch, level):
    function = core("classify.transfer_function")
    preset = core("classify.presets").preset("mr-head")
    own = bridge("look.own_presets")
    monkeypatch.setattr(thumbnails.jit, "compiled", lambda: not level)  # what is not refused is made by numpy
    monkeypatch.setattr(thumbnails.jit, "shipped_level", lambda: level)
    own.save("steep", replace(preset, gradient_opacity=function.GradientOpacity(2.0, 9.0)), overwrite=True)
    try:
        if not level:
            with pytest.raises(core("scene").RleSplatError, match="would take long"):
                picture(thumbnails, bridge, ball, "steep")
        else:
            steep = picture(thumbnails, bridge, ball, "steep")
            assert np.abs(steep.astype(int) - picture(thumbnails, bridge, ball, "mr-head")).max() > 10
    finally:
        own.delete("steep")
    assert len(thumbnails.rendered) == 2 * bool(level)


def test_voxels_that_are_not_in_memory_are_not_read(ball, thumbnails, bridge, cache, monkeypatch):
    monkeypatch.setattr(thumbnails, "_tab_is_shown", lambda: True)
    monkeypatch.setattr(thumbnails, "_others_work", lambda: False)
    bridge("volumes.volumes").forget_all()
    thumbnails.icon(ball, entries(bridge, ball)["mr-head"])
    assert thumbnails._tick() is None
    assert not bridge("volumes.volumes").is_at_hand(ball) and not thumbnails.rendered
