"""Voxel records of 8 bytes: what a code keeps, and what the picture loses by it."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.placing import RecordPositions
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.comparison.ours import decode
from rle_splat.encode import encode_kernels, reference
from rle_splat.encode.encode import encode
from rle_splat.encode.records import decoding_of, empty_records, unpack
from rle_splat.encode.store import read_encoded, write_encoded
from rle_splat.encode.stored import StoredVolume
from rle_splat.pipeline.encode_scene import encode as encode_scene
from rle_splat.pipeline.render import render
from rle_splat.pipeline.scan_source import classify_and_shade
from rle_splat.runtime.jit import run_either
from rle_splat.runtime.steps import Clock
from rle_splat.scene import Light, Quality, RleSplatError, Scene
from rle_splat.shade.lighting import lighting
from rle_splat.shade.shading import color_bound, light_records
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from tests.encoded import to_volume_order, validate
from tests.ways import WAYS, both, by

SHORT = 8
MOST_DENSITY, MOST_COLOR = 16.6, 1.3
QUALITY = Quality.preset("standard", classification="pre")
# Largest difference of any channel to 16 bytes, in levels of 1/255: a homogeneous thin medium, whose errors all go
# the same way; and a lit ball with hard and soft parts.
THIN_LEVELS, LIT_LEVELS = 0.05, 0.1


def random_records(n=20001, seed=3):
    """(n, 4) float32 and its unassociated colors; densities over nine powers of ten, the ends among them."""
    rng = np.random.default_rng(seed)
    density = (MOST_DENSITY * 10.0 ** rng.uniform(-9, 0, n)).astype(np.float32)
    density[:3] = 0.0, MOST_DENSITY, np.float32(2.0**-149)
    color = (rng.random((n, 3)) * MOST_COLOR).astype(np.float32)
    color[3:6] = 0.0, MOST_COLOR, np.float32(1e-30)
    return np.concatenate((density[:, None] * color, density[:, None]), axis=1), color


def packed(records, most=(MOST_DENSITY, MOST_COLOR)):
    decoding = decoding_of(SHORT, *most)
    codes = empty_records(SHORT, len(records))
    run_either(0, encode_kernels.pack, reference.pack, records, 1.0 / decoding.astype(np.float64), codes)
    return codes, decoding


def test_kernel_and_reference_agree_to_the_bit():
    records, _ = random_records()
    np.testing.assert_array_equal(*both(lambda: packed(records)[0]))


def test_what_a_code_keeps():
    records, color = random_records()
    density = records[:, 3].astype(np.float64)
    got = unpack(*packed(records)).astype(np.float64)
    bound = density * 2.0**-12 * 1.01 + MOST_DENSITY * 2.0**-30
    assert (np.abs(got[:, 3] - density) <= bound).all()
    assert got[0].tolist() == [0.0, 0.0, 0.0, 0.0] and got[1, 3] == pytest.approx(MOST_DENSITY, rel=1e-3)
    seen = got[:, 3] > 0.0
    # Color times density is a number of its own, good to 2^-12.
    error = np.abs(got[seen, :3] / got[seen, 3:] - color[seen])
    step = 2.1 * 2.0**-12 * color[seen] + MOST_COLOR * MOST_DENSITY * 2.0**-30 / density[seen, None]
    usual = density[seen] > MOST_DENSITY * 1e-6
    assert (error <= step + 1e-6)[usual].all()


def test_any_scale_is_met():
    records, _ = random_records(500)
    for density, color in ((1e-12, 1.0), (1e12, 1.0), (1.0, 1e4), (1e-36, 1e-6), (0.0, 0.0)):
        scaled = records.astype(np.float64)
        scaled[:, 3] *= density / MOST_DENSITY
        scaled[:, :3] = scaled[:, :3] * (color / MOST_COLOR) * (density / MOST_DENSITY)
        got = unpack(*packed(scaled.astype(np.float32), most=(density, color)))
        assert np.isfinite(got).all() and (got >= 0.0).all()
        np.testing.assert_allclose(got[1, 3], density, rtol=1e-3)


def block(alpha):
    """256 slices of the same thin medium; their picture's alpha is 1 - (1 - alpha)^256."""
    volume = Volume(np.full((8, 256, 8), 100, np.uint8), np.eye(4))
    opacity = ((0, alpha), (150, alpha), (200, 1.0))  # a solid medium is in the function, so codes must span it all
    function = TransferFunction(opacity=opacity, color=((0, 1.0, 0.37, 0.61),), shade=None)
    camera, matrix = turntable(volume, 0, 0, fit=0.02)
    return Scene(volume, function, camera, 16, 16, matrix, headlight=False)


def test_thin_media_keep_their_depth():
    for alpha in (0.0005, 0.001, 0.002, 0.003, 0.01):
        scene = block(alpha)
        best = render(scene, QUALITY).rgba
        np.testing.assert_allclose(best[4:-4, 4:-4, 3], 1.0 - (1.0 - alpha) ** 256, atol=2e-3)
        short = render(scene, replace(QUALITY, record=SHORT)).rgba
        assert 255.0 * np.abs(short - best).max() <= THIN_LEVELS
        linear = 1.0 - (1.0 - np.rint(alpha * 255.0) / 255.0) ** 256  # what a linear alpha of 8 bits would make of it
        if alpha <= 0.002:
            assert 255.0 * abs(linear - best[8, 8, 3]) > 25.0


def ball():
    z, y, x = np.indices((40, 38, 42))
    radius = np.sqrt((x - 20.0) ** 2 + (y - 19.0) ** 2 + (z - 20.0) ** 2)
    volume = Volume((250.0 / (1.0 + np.exp(0.7 * (radius - 15.0)))).astype(np.uint8), np.eye(4))
    function = TransferFunction(
        opacity=((20, 0.0), (120, 0.02), (230, 0.05), (240, 1.0)), color=((20, 1.0, 0.3, 0.1), (250, 0.9, 0.9, 0.8))
    )
    return volume, function


def lit_scene(azimuth, elevation=10, lights=()):
    volume, function = ball()
    camera, matrix = turntable(volume, azimuth, elevation, perspective=True)
    return Scene(volume, function, camera, 96, 96, matrix, lights=lights, headlight=not lights)


@pytest.mark.parametrize("view", ((10, 10), (80, 10), (10, 80)))
def test_pictures_of_short_records(view):
    scene = lit_scene(*view)
    best = render(scene, QUALITY).rgba
    short = render(scene, replace(QUALITY, record=SHORT))
    assert 255.0 * np.abs(short.rgba - best).max() <= LIT_LEVELS
    memory = short.report["memory_bytes"]
    assert memory["voxel_data"] == SHORT * short.report["volume"]["visible_voxels"]
    assert short.report["plan"]["record"] == SHORT
    # The same codes by kernels and by their reference implementation.  (Their shading may round a color to the next
    # code.)
    classified, colors = classify_and_shade(scene, QUALITY, Clock())
    axis = "xyz".index(memory["axes_held"][0])
    stored = StoredVolume.of({axis: encode(classified, colors, axis, record=SHORT)}, scene.volume.affine)
    pictures = both(lambda: render(replace(scene, volume=stored), replace(QUALITY, record=SHORT)).rgba)
    assert np.abs(pictures[0] - pictures[1]).max() < 2e-5


@pytest.mark.parametrize("model", ("extinction", "opacity"))
def test_the_three_axes_hold_the_same_records(model):
    scene = lit_scene(20)
    classified, colors = classify_and_shade(scene, QUALITY, Clock())
    grids = []
    for axis in (0, 1, 2):
        for way in WAYS:
            with by(way):
                encoded = encode(classified, colors, axis, model, record=SHORT)
                grids.append(to_volume_order(decode(encoded), axis))
            validate(encoded)
            assert encoded.record == SHORT
    for other in grids[1:]:
        np.testing.assert_array_equal(other, grids[0])
    exact = to_volume_order(decode(encode(classified, colors, 2, model)), 2)
    np.testing.assert_allclose(grids[0][..., 3], exact[..., 3], rtol=0.003, atol=1e-5)


@pytest.mark.parametrize("at_once", ((1 << 22, 1), (1000, 300), (1, 1 << 18)))
def test_the_pieces_that_records_are_packed_in_leave_no_trace(at_once, monkeypatch):
    """Between two chances to cancel, and within: pieces of one plane, of some, and of all."""
    near = Light("POINT", energy=400000.0, matrix_world=np.diag((1.0, 1.0, 1.0, 1.0)))
    lit, quality = lit_scene(20, lights=(near,)), replace(QUALITY, record=SHORT)
    whole = encode_scene(lit, quality).axes
    for name, voxels in zip(("RECORDS_AT_ONCE", "PACKED_AT_ONCE"), at_once):
        monkeypatch.setattr(sys.modules[encode.__module__], name, voxels)
    for axis in (0, 1, 2):
        pieces = encode_scene(lit, quality, axes=(axis,)).axes[axis]
        np.testing.assert_array_equal(pieces.voxel_data, whole[axis].voxel_data)
        assert pieces.most_color == whole[axis].most_color


def test_lights_among_the_voxels_are_measured_first():
    near = Light("POINT", energy=400000.0, matrix_world=np.diag((1.0, 1.0, 1.0, 1.0)))
    scene = lit_scene(10, lights=(near,))
    best = render(scene, QUALITY).rgba
    assert best[..., :3].max() > 1.0  # brighter than any color of the function
    short = render(scene, replace(QUALITY, record=SHORT)).rgba
    assert np.abs(short - best).max() <= 1.5 * LIT_LEVELS / 255.0 * best.max()


def test_the_bound_of_the_colors_holds_and_is_near():
    scene = lit_scene(10)
    classified, _ = classify_and_shade(scene, QUALITY, Clock())
    normals = np.random.default_rng(1).normal(size=(classified.visible_voxels, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    suns = (Light("SUN", (1, 0.5, 0.1), 5.0), Light("SUN", (0.1, 0.2, 1.0), 2.0))
    everywhere = RecordPositions.in_order(classified.voxels, 0, classified.shape_xyz[2])
    for lights in (suns, ()):
        falling = lighting(np.eye(4), Shade(0.3, 0.8, 0.5, 10.0), lights, headlight_direction=(0.0, 0.6, -0.8),
                           eye=(0.0, 0.0, 1.0, 0.0))  # fmt: skip
        records = np.empty((classified.visible_voxels, 4), np.float32)
        brightest = light_records(classified, normals, falling, None, everywhere, records)
        assert brightest <= color_bound(classified, falling) <= 2.5 * brightest
    point = lighting(np.eye(4), Shade(), (Light("POINT"),))
    assert color_bound(classified, point) is None
    assert color_bound(classified, None) == classified.color.max()


def test_short_records_come_back_from_a_file(tmp_path):
    classified, colors = classify_and_shade(lit_scene(20), QUALITY, Clock())
    axes = {axis: encode(classified, colors, axis, record=SHORT) for axis in (0, 2)}
    path = tmp_path / "v.rle"
    write_encoded(StoredVolume.of(axes, np.eye(4)), path)
    back = read_encoded(path)
    assert back.record == SHORT
    for axis, encoded in axes.items():
        np.testing.assert_array_equal(back.axes[axis].voxel_data, encoded.voxel_data)
        np.testing.assert_array_equal(back.axes[axis].decoding, encoded.decoding)
        assert back.axes[axis].most_color == pytest.approx(float(colors.max()), rel=0.01)
    for wrong in (None, encoded.decoding[:-1].copy(), -encoded.decoding, encoded.decoding.astype(np.float64),
                  np.full_like(encoded.decoding, np.nan)):  # fmt: skip
        with pytest.raises(RleSplatError, match="damaged"):
            validate(replace(axes[2], decoding=wrong))
    with pytest.raises(RleSplatError, match="record"):
        write_encoded(StoredVolume.of({**axes, 1: encode(classified, colors, 1)}, np.eye(4)), path)


def test_other_sizes_are_refused():
    with pytest.raises(RleSplatError, match="16, 8 bytes"):
        Quality(classification="pre", record=5)
    classified, colors = classify_and_shade(lit_scene(20), QUALITY, Clock())
    with pytest.raises(RleSplatError, match="bytes"):
        encode(classified, colors, 0, record=12)
