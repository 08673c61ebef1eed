"""Proves the finer grid of the classification refined: that its voxels, made a few planes at a time, are those of the
whole grid; which of them are shown and where; the light between the scan's voxels; what is kept; and what it costs."""

import sys
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.classification import ClassifiedVolume
from rle_splat.classify.placing import RecordPositions
from rle_splat.classify.refined import FineVoxels, RefinedVolume, fine_block_steps
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.classify.visible import Visibility, VisibleVoxels, count_steps, fill_steps
from rle_splat.pipeline import memory_estimate as estimate
from rle_splat.pipeline import quick_estimate
from rle_splat.pipeline.encode_scene import encode_scene
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.steps import drain
from rle_splat.scene import Light, Quality, RleSplatError, Scene
from rle_splat.shade.lighting import lighting
from rle_splat.shade.refined_light import RefinedLight, lit_voxels
from rle_splat.shade.shading import normals, shaded_colors
from rle_splat.view.turntable import turntable
from rle_splat.volume.blocks import BLOCK_X, BLOCK_Y, BLOCK_Z
from rle_splat.volume.volume import Volume

FUNCTION = TransferFunction(
    opacity=((80, 0.0), (120, 0.3), (150, 0.0)), color=((80, 1.0, 0.3, 0.1), (250, 0.9, 0.9, 0.8)),
    shade=Shade(ambient=0.2, diffuse=0.7, specular=0.4, shininess=12.0),
)
BACKENDS = ("numba", "numpy")
SHAPE = (45, 11, 9)  # x, y, z: at 2, 3 and 4 times several blocks along x, and ends that fill none


def waves(dtype=np.uint8, shape=SHAPE, top=200.0):
    """Values from 0 to ``top`` with regions that FUNCTION shows, and blocks that it hides."""
    z, y, x = np.ogrid[: shape[2], : shape[1], : shape[0]]
    values = 0.5 * top * (1.0 + np.sin(0.35 * x + 0.2) * np.cos(0.4 * y) * np.sin(0.3 * z + 0.5)) * (x < 25)
    return Volume(values.astype(dtype), np.diag((1.0, 1.2, 0.9, 1.0)))


def trilinear(values, refinement):
    """The whole finer grid, by weights of all corners."""
    weights = []
    for n in values.shape:
        at = np.arange(refinement * (n - 1) + 1) / refinement
        weights.append(np.maximum(1.0 - np.abs(at[:, None] - np.arange(n)), 0.0))
    return np.einsum("zi,yj,xk,ijk->zyx", *weights, values.astype(np.float64), optimize=True)


def all_planes(voxels: FineVoxels, backend="numba"):
    everything = np.ones([-(-n // size) for n, size in zip(voxels.shape, (BLOCK_Z, BLOCK_Y, BLOCK_X))], np.uint8)
    return voxels.planes(0, voxels.shape[0], everything, everything.astype(voxels.dtype), backend=backend)


def scene_of(volume, function=FUNCTION, size=32, **more):
    camera, matrix = turntable(volume, 20, 10, width=size, height=size)
    return Scene(volume, function, camera, size, size, matrix, **more)


def refined_quality(refinement=2, **knobs):
    return Quality(classification="refined", refinement=refinement, **knobs)


# --- the finer voxels -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("refinement", (2, 3, 4))
@pytest.mark.parametrize("dtype", (np.uint8, np.int8, np.uint16, np.int16, np.int32, np.float32, np.float64))
def test_fine_voxels_are_interpolated_and_the_scans_own_are_exact(dtype, refinement):
    volume = replace(waves(dtype, top=120.0), slope=-2.0, intercept=260.0)  # the function varies from 5 to 90
    fine = RefinedVolume(volume, FUNCTION, refinement)
    voxels, made = fine.voxels, all_planes(fine.voxels)
    assert made.shape == voxels.shape == fine.shape_xyz[::-1] == tuple(refinement * (n - 1) + 1 for n in SHAPE[::-1])
    assert made.dtype == voxels.dtype and (made == all_planes(voxels, "numpy")).all()
    found, expected, own = voxels.stored(made), trilinear(volume.voxels, refinement), volume.voxels.astype(np.float64)
    most = 1e-4
    if made.dtype == np.uint16:
        # Codes end past the ends to which the function varies: beyond, nothing could be told apart.
        low, high = voxels.base, voxels.base + 65535 * voxels.step
        assert low == 4.0 and 91.0 <= high < 133.0 and voxels.step == 1 / 512
        expected, own, most = np.clip(expected, low, high), np.clip(own, low, high), 0.51 * voxels.step
    assert np.abs(found - expected).max() <= most
    np.testing.assert_array_equal(found[::refinement, ::refinement, ::refinement], own)
    np.testing.assert_allclose(fine.physical(made), 260.0 - 2.0 * found, rtol=1e-12)
    corner = np.array((*(np.array(SHAPE) - 1) * refinement, 1.0))
    np.testing.assert_allclose(fine.affine @ corner, volume.affine @ (*np.array(SHAPE) - 1.0, 1.0))


def test_codes_are_as_fine_as_the_varying_values_allow():
    """A function that varies over 171 values gets 256 codes for each; flat ends, however far, do not make it fewer."""
    far = replace(FUNCTION, opacity=((-9e4, 0.0), *FUNCTION.opacity, (9e4, 0.0)))
    for function in (FUNCTION, far):
        voxels = RefinedVolume(waves(np.int16), function, 2).voxels
        assert voxels.dtype == np.uint16 and voxels.step == 1 / 256 and voxels.base == 79
    flat = TransferFunction(opacity=((5, 0.5),), color=((0, 1, 1, 1),))
    for volume in (waves(), waves(np.int16)):
        shown = drain(count_steps(*_visibility(RefinedVolume(volume, flat, 2))))
        assert shown[0].sum() == np.prod([2 * n - 1 for n in SHAPE])


def _visibility(volume, backend="auto"):
    return Visibility(volume, volume.tf), drain(fine_block_steps(volume, backend=backend))


def test_a_region_at_the_very_value_of_a_step_is_not_lost():
    """Labels: everything from 3 on is shown, and a region of exactly 3 with it, at any slope."""
    voxels = np.zeros((6, 6, 6), np.uint8)
    voxels[1:5, 1:5, 1:5] = 3
    for slope, intercept in ((1.0, 0.0), (0.1, 0.7), (-0.3, 1e3)):
        value = 3 * slope + intercept
        points = ((value, 0.0), (value, 0.5)) if slope > 0 else ((value, 0.5), (value + 0.1, 0.0))
        function = TransferFunction(opacity=points, color=((0, 1, 1, 1),))
        for dtype in (np.uint8, np.float32):
            volume = Volume(voxels.astype(dtype), np.eye(4), slope=slope, intercept=intercept)
            shown, blocks = _visibility(RefinedVolume(volume, function, 3))
            counts = drain(count_steps(shown, blocks))[0].reshape(16, 16)
            assert (counts[3:13, 3:13] >= 10).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_values_that_are_no_numbers(backend):
    """A fine voxel next to a NaN is NaN, one that merely touches its cell is not; infinite is the nearest point."""
    voxels = np.full((3, 3, 5), 100.0, np.float32)
    voxels[1, 1, 1], voxels[0, 0, 4], voxels[2, 2, 4] = np.nan, np.inf, -np.inf
    volume = RefinedVolume(Volume(voxels, np.eye(4)), FUNCTION, 2)
    made = all_planes(volume.voxels, backend)
    expected = np.zeros(made.shape, bool)
    expected[1:4, 1:4, 1:4] = True
    np.testing.assert_array_equal(np.isnan(made), expected)
    assert made[0, 0, 8] == 250.0 and made[4, 4, 8] == 80.0 and made[0, 0, 7] == 175.0
    blocks = drain(fine_block_steps(volume, backend=backend))
    assert blocks.nan_voxels == 1 and blocks.low.min() == 80.0 and blocks.high.max() == 250.0
    picture = render(scene_of(volume.source), refined_quality(backend=backend))
    assert np.isfinite(picture.rgba).all() and "1 voxels are not numbers" in " ".join(picture.report["remarks"])


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("refinement", (2, 3, 4))
@pytest.mark.parametrize("dtype", (np.uint8, np.float32))
def test_blocks_bound_every_fine_voxel(dtype, refinement, backend):
    volume = RefinedVolume(waves(dtype), FUNCTION, refinement)
    blocks, made = drain(fine_block_steps(volume, backend=backend)), all_planes(volume.voxels)
    for k, j, b in np.ndindex(blocks.low.shape):
        part = made[k * BLOCK_Z :, j * BLOCK_Y :, b * BLOCK_X :][:BLOCK_Z, :BLOCK_Y, :BLOCK_X]
        assert blocks.low[k, j, b] <= part.min() and part.max() <= blocks.high[k, j, b]
    assert (blocks.low == drain(fine_block_steps(volume)).low).all()


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("refinement", (2, 3, 4))
@pytest.mark.parametrize("dtype", (np.uint8, np.float32))
def test_what_is_shown_is_what_the_whole_grid_shows(dtype, refinement, backend, monkeypatch):
    """Made slab by slab and block by block, as from the whole grid at once."""
    monkeypatch.setattr("rle_splat.classify.refined.FINE_VOXELS_AT_ONCE", 1)  # one row of blocks at a time
    volume = RefinedVolume(waves(dtype), FUNCTION, refinement)
    shown, blocks = _visibility(volume, backend)
    relevant = shown.relevant(blocks)
    assert 0 < relevant.sum() < relevant.size
    made = all_planes(volume.voxels)
    seen = np.asarray(FUNCTION.alpha_at(volume.physical(made))) > 0.0
    counted = drain(count_steps(shown, blocks, backend=backend))
    voxels = drain(fill_steps(shown, blocks, counted, backend=backend))
    nx = volume.shape_xyz[0]
    np.testing.assert_array_equal(np.diff(voxels.row_start), seen.reshape(-1, nx).sum(axis=1))
    np.testing.assert_array_equal(voxels.column, np.nonzero(seen)[2])
    np.testing.assert_array_equal(voxels.stored, made[seen])
    opens = seen & ~np.pad(seen, ((0, 0), (0, 0), (1, 0)))[:, :, :-1]
    np.testing.assert_array_equal(voxels.row_pieces, opens.reshape(-1, nx).sum(axis=1))


def test_a_block_that_is_left_out_ends_in_what_is_hidden():
    """Whoever counts connected pieces looks at the voxel before a block, whether it was made or not."""
    voxels = RefinedVolume(waves(), FUNCTION, 2).voxels
    relevant = np.ones([-(-n // size) for n, size in zip(voxels.shape, (BLOCK_Z, BLOCK_Y, BLOCK_X))], np.uint8)
    hidden = (relevant * 7).astype(voxels.dtype)
    relevant[0, 0, 0] = relevant[-1, -1, -1] = 0
    made, everything = voxels.planes(0, voxels.shape[0], relevant, hidden), all_planes(voxels)
    left_out = np.zeros(made.shape, bool)
    left_out[:BLOCK_Z, :BLOCK_Y, :BLOCK_X] = True
    left_out[-(voxels.shape[0] % BLOCK_Z) :, -(voxels.shape[1] % BLOCK_Y) :, -(voxels.shape[2] % BLOCK_X) :] = True
    assert (made[~left_out] == everything[~left_out]).all()
    assert (made[:BLOCK_Z, :BLOCK_Y, BLOCK_X - 1] == 7).all() and made[-1, -1, -1] == 7


# --- its light ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("specular", (0.0, 0.4))
def test_light_is_interpolated_between_the_scans_voxels(specular, backend):
    """Against every voxel of the scan lit, and all of that interpolated."""
    refinement, volume = 3, waves()
    matrix = np.diag((1.0, 1.2, 0.9, 1.0))
    shade = replace(FUNCTION.shade, specular=specular)
    point = Light("POINT", (1.0, 0.7, 0.5), 9000.0, np.eye(4) + np.outer((30.0, -9.0, 15.0, 0.0), (0, 0, 0, 1)))
    eye = np.array((5.0, -40.0, 4.0, 1.0))
    falling = lighting(matrix, shade, (point,), headlight_direction=(0.0, 1.0, 0.0), eye=eye)
    fine = RefinedVolume(volume, FUNCTION, refinement)
    shown, blocks = _visibility(fine)
    voxels = drain(fill_steps(shown, blocks, drain(count_steps(shown, blocks))))
    lit = lit_voxels(voxels, fine, matrix, backend=backend)
    light = RefinedLight(lit, falling, refinement, backend=backend)

    nx, ny, nz = SHAPE
    rows = np.arange(nz * ny + 1) * nx
    every = VisibleVoxels(
        SHAPE, rows, np.ones(nz * ny, np.int32), np.tile(np.arange(nx, dtype=np.uint16), nz * ny),
        np.zeros(nx * ny * nz, np.uint8), 0,
    )
    toward = normals(every, volume, matrix)
    white, black = (
        shaded_colors(ClassifiedVolume(every, np.full((1, 5), gray, np.float32), True, 1.0, 1.0), toward, falling)
        for gray in (1.0, 0.0)
    )
    at = np.repeat(np.arange(len(voxels.row_start) - 1), np.diff(voxels.row_start))
    seen = (at // voxels.shape_xyz[1], at % voxels.shape_xyz[1], voxels.column.astype(int))
    between = [
        np.stack([trilinear(part[:, c].reshape(nz, ny, nx), refinement)[seen] for c in range(3)], axis=1)
        for part in (white - black, black)
    ]
    properties = np.tile(np.array((2.0, 0.5, 0.9, 0.6, 0.3), np.float32), (len(voxels), 1))
    classified = ClassifiedVolume(voxels, properties, False, 1.0, 1.0)
    records = np.empty((len(voxels), 4), np.float32)
    most = light.records(classified, "extinction", RecordPositions.in_order(voxels, 0, voxels.shape_xyz[2]), records)
    expected = properties[0, 2:] * between[0] + between[1]
    np.testing.assert_allclose(records[:, :3] / 2.0, expected, atol=2e-6)
    assert (records[:, 3] == 2.0).all() and most == pytest.approx(expected.max(), abs=2e-6)
    assert np.ptp(expected) > 0.3 and (between[1].max() > 0.05) == (specular > 0.0)
    # No more voxels of the scan are lit than fine ones lie next to.
    touched = np.zeros((nz, ny, nx), bool)
    for corner in np.ndindex(2, 2, 2):
        touched[tuple((place + far * (refinement - 1)) // refinement for place, far in zip(seen, corner))] = True
    assert len(lit.voxels) == touched.sum()


# --- what is kept ---------------------------------------------------------------------------------------------


def test_what_is_kept_is_of_one_refinement():
    cache, scene = StageCache(), scene_of(waves(), headlight=True)
    first = render(scene, refined_quality(2), cache=cache)
    assert (render(scene, refined_quality(2), cache=cache).rgba == first.rgba).all()
    assert {"visible": 1, "normals": 1, "records": 1}.items() <= cache.made.items()
    for number, quality in enumerate((refined_quality(3), Quality(classification="pre"), refined_quality(4)), 2):
        other = render(scene, quality, cache=cache)
        assert cache.made["visible"] == cache.made["records"] == number
        assert (other.rgba == render(scene, quality).rgba).all() and (other.rgba != first.rgba).any()


def test_a_change_of_color_or_light_finds_no_voxels_anew():
    cache, scene = StageCache(), scene_of(waves(), headlight=True)
    render(scene, refined_quality(), cache=cache)
    bluer = replace(scene, transfer_function=replace(FUNCTION, color=((80, 0.1, 0.3, 1.0), (250, 0.9, 0.9, 0.8))))
    turned = scene_of(waves(), headlight=False, lights=(Light("SUN", (1.0, 1.0, 1.0), 3.0),))
    for number, changed in enumerate((bluer, turned), 2):
        found = render(changed, refined_quality(), cache=cache)
        assert cache.made["visible"] == cache.made["normals"] == 1 and cache.made["records"] == number
        assert (found.rgba == render(changed, refined_quality()).rgba).all()


# --- what it costs --------------------------------------------------------------------------------------------


def noise(n=48, dtype=np.uint8):
    """A smooth random field: surfaces everywhere."""
    values = np.random.default_rng(5).random((n // 4 + 1,) * 3)
    fine = trilinear(values, 4)[:n, :n, :n]
    return Volume((250.0 * fine).astype(dtype), np.eye(4))


@pytest.mark.parametrize("headlight", (False, True))
@pytest.mark.parametrize(("refinement", "dtype"), ((2, np.uint8), (3, np.uint8), (2, np.float32)))
def test_the_estimate_covers_what_a_picture_takes(refinement, dtype, headlight, monkeypatch):
    for name in ("classify.refined", "classify.sizes"):  # as large volumes have it: some planes at a time
        monkeypatch.setattr(f"rle_splat.{name}.FINE_VOXELS_AT_ONCE", 1 << 16)
    scene, quality = scene_of(noise(dtype=dtype), headlight=headlight), refined_quality(refinement)
    render(scene, quality)  # whatever is made once
    tracemalloc.start()
    report = render(scene, quality).report
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    needed = report["memory_estimate_bytes"]["needed"]
    assert 0.9 * peak <= needed <= 2.0 * peak
    assert report["memory_estimate_bytes"]["volume"] == scene.volume.voxels.nbytes
    quick = quick_estimate.estimate(scene.volume, FUNCTION, quality, shaded=headlight)
    assert quick.needed == pytest.approx(needed, rel=0.4) and quick.refinement == refinement


@pytest.mark.parametrize(
    ("share", "record", "words"),
    ((0.9, 16, "records of 8 bytes would fit"), (0.6, 4, "a refinement of 3 would fit"),
     (0.3, 16, "a refinement of 2 would fit"), (0.09, 16, "on the grid of the scan would fit"),
     (0.001, 16, "crop or downsample the volume")),
)  # fmt: skip
def test_too_fine_a_grid_is_refused_with_what_would_fit(share, record, words, monkeypatch):
    for name in ("classify.refined", "classify.sizes"):
        monkeypatch.setattr(f"rle_splat.{name}.FINE_VOXELS_AT_ONCE", 1 << 12)
    monkeypatch.setattr(sys.modules["rle_splat.encode.sizes"], "VOXELS_AT_ONCE", 1000)
    # Which is as much as the machine has cores, and more than the rest of so small a picture.
    monkeypatch.setattr("rle_splat.pipeline.source.scratch_bytes", lambda *_: 0)
    scene, quality = scene_of(noise(32), size=8), refined_quality(4, record=record)
    needed = render(scene, quality).report["memory_estimate_bytes"]["needed"]
    for module in ("pipeline.memory_estimate", "pipeline.stage_cache"):
        monkeypatch.setattr(f"rle_splat.{module}.available_bytes", lambda: int(share * needed / estimate.SPARE))
    with pytest.raises(RleSplatError, match="are free") as problem:
        render(scene, quality)
    assert words in str(problem.value)
    told = {"refinement of 3": dict(refinement=3), "refinement of 2": dict(refinement=2),
            "of the scan": dict(classification="pre"), "8 bytes": dict(record=8)}  # fmt: skip
    for part, less in told.items():
        if part in words:
            render(scene, replace(quality, **less))  # what is said to fit fits


# --- what is refused ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("refinement", (0, 1, 5, 2.5, "2"))
def test_refinements_that_there_are_not(refinement):
    with pytest.raises(RleSplatError, match="2, 3, 4"):
        Quality(refinement=refinement)


def test_rle_files_hold_the_grid_of_the_scan():
    scene = scene_of(waves(), headlight=False)
    with pytest.raises(RleSplatError, match="classification pre"):
        encode_scene(scene, refined_quality())
    stored = encode_scene(scene, Quality(classification="pre"), (1,))
    with pytest.raises(RleSplatError, match="classified already"):
        render(replace(scene, volume=stored), refined_quality())


def test_a_volume_one_voxel_thick_fills_no_box():
    """Nothing lies between the centers of one plane of voxels: an empty picture, not a mistake."""
    volume = waves(shape=(12, 12, 1))
    assert (render(scene_of(volume), refined_quality()).rgba == 0.0).all()
