"""The picture files hold what the renderer made: read back with other readers and compared."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from rle_splat.cli.images import write_picture, writer_for
from rle_splat.figure.plan import FigureStyle
from rle_splat.scene import NO_DEPTH, Rendering, RleSplatError
from rle_splat.scene.display import encode_srgb, over_background, straight_alpha, to_bytes


@pytest.fixture
def picture():
    """A random premultiplied picture with fully clear and fully opaque pixels; 5 rows, 7 columns."""
    random = np.random.default_rng(7)
    rgba = random.random((5, 7, 4)).astype(np.float32)
    rgba[0, 0, 3], rgba[1, 1, 3] = 0.0, 1.0
    rgba[..., :3] *= rgba[..., 3:]
    depth = random.random((5, 7)).astype(np.float32) * 100.0
    depth[0, 0] = NO_DEPTH
    return rgba, depth


@pytest.mark.parametrize(
    "linear, encoded",
    # Published anchors of the curve: ends, middle gray, and both sides of the joint.
    [(0.0, 0.0), (1.0, 1.0), (0.18, 0.4613561), (0.5, 0.7353570), (0.0031308, 0.0404499), (0.001, 0.01292)],
)
def test_srgb_anchors(linear, encoded):
    assert encode_srgb(linear) == pytest.approx(encoded, abs=2e-6)


def test_srgb_inverts_its_definition():
    """Decoding by the standard's inverse formula, written here by itself, gives the input back."""
    linear = np.linspace(0.0, 1.0, 1001)
    encoded = encode_srgb(linear).astype(np.float64)
    decoded = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    assert np.abs(decoded - linear).max() < 1e-6


def test_srgb_clamps():
    assert encode_srgb(np.array([-1.0, 2.0])) == pytest.approx([0.0, 1.0], abs=1e-6)


def test_png_over_background_is_read_back(tmp_path, picture):
    Image = pytest.importorskip("PIL.Image")
    rgba, depth = picture
    background = (0.2, 0.5, 0.9)
    path = tmp_path / "p.png"
    writer_for(path)(path, rgba, depth, background)
    back = np.asarray(Image.open(path))
    expected = encode_srgb(rgba[..., :3] + (1 - rgba[..., 3:]) * np.array(background)) * 255
    assert back.shape == (5, 7, 3)
    assert np.abs(back - expected).max() <= 0.5 + 1e-3


def test_png_straight_alpha_is_read_back(tmp_path, picture):
    Image = pytest.importorskip("PIL.Image")
    rgba, depth = picture
    path = tmp_path / "p.png"
    write_picture(Rendering(rgba, depth, {}), path)
    image = Image.open(path)
    back = np.asarray(image)
    assert image.mode == "RGBA" and "srgb" in image.info
    alpha = rgba[..., 3]
    assert np.abs(back[..., 3] - 255.0 * alpha).max() <= 0.5 + 1e-3
    seen = alpha > 0
    expected = encode_srgb(rgba[seen][:, :3] / alpha[seen][:, None]) * 255
    assert np.abs(back[seen][:, :3] - expected).max() <= 0.5 + 1e-3
    assert (back[~seen] == 0).all()
    assert np.array_equal(back, Rendering(rgba, depth, {}).to_srgb())


def test_pixels_for_display_are_over_a_background(picture):
    rgba, depth = picture
    shown = Rendering(rgba, depth, {}).to_srgb((0.5, 0.2, 1.0))
    expected = encode_srgb(rgba[..., :3] + (1 - rgba[..., 3:]) * np.array((0.5, 0.2, 1.0))) * 255
    assert shown.dtype == np.uint8 and np.abs(shown - expected).max() <= 0.5 + 1e-3
    assert np.array_equal(Rendering(rgba, depth, {}).to_srgb("white"), to_bytes(rgba, (1.0, 1.0, 1.0)))


@pytest.mark.parametrize("wrong", ["pink", "123", (0.5, 0.5), (0.5, -0.1, 0.5), None, 1.0])
def test_a_wrong_background_gets_a_sentence(tmp_path, picture, wrong):
    rendering = Rendering(*picture, {})
    for call in (rendering.to_srgb, partial(write_picture, rendering, tmp_path / "p.png"), FigureStyle):
        with pytest.raises(RleSplatError, match="background must be white, black, transparent or three"):
            call(background=wrong)


def test_exr_is_read_back(tmp_path, picture):
    OpenEXR = pytest.importorskip("OpenEXR")
    rgba, depth = picture
    path = tmp_path / "p.exr"
    write_picture(Rendering(rgba, depth, {}), path, background=(1.0, 1.0, 1.0))
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        assert set(channels) == {"R", "G", "B", "A", "Depth.Z"}
        for index, name in enumerate("RGBA"):
            assert channels[name].pixels.dtype == np.float32
            assert np.array_equal(channels[name].pixels, rgba[..., index])
        assert np.array_equal(channels["Depth.Z"].pixels, depth)


def test_npy_is_exact(tmp_path, picture):
    rgba, depth = picture
    path = tmp_path / "p.npy"
    writer_for(path)(path, rgba, depth, background=(1.0, 1.0, 1.0))
    back = np.load(path)
    assert back.dtype == np.float32 and np.array_equal(back, rgba)


def test_clear_pixels_show_the_background_and_no_warning(picture):
    rgba, _ = picture
    assert over_background(rgba, (0.1, 0.2, 0.3))[0, 0] == pytest.approx((0.1, 0.2, 0.3))
    assert straight_alpha(rgba)[0, 0].tolist() == [0.0, 0.0, 0.0, 0.0]
    assert to_bytes(rgba, (0.0, 0.0, 0.0)).dtype == np.uint8


@pytest.mark.parametrize("name", ["p.jpg", "p", "p.png.bak"])
def test_unknown_suffixes_are_refused(name):
    with pytest.raises(RleSplatError, match="suffix"):
        writer_for(name)
