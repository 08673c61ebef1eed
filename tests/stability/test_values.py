"""Values, V1 to V5, V14 and V15 of the catalogue: opacities at both ends, colors and extinctions of any size, under
every classification.  What is stored, and how it is read: test_values_stored.py."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rle_splat.accuracy.metrics import difference
from rle_splat.classify.classification import classify, optical_depth
from rle_splat.classify.limits import BRIGHTEST, LEAST_DISTANCE
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.encode.encode import encode
from rle_splat.pipeline.render import render
from rle_splat.scene import CLASSIFICATIONS, LIGHT_TYPES, NO_DEPTH, Light, Quality, RleSplatError
from rle_splat.volume.volume import Volume
from tests.stability.scenes import EXACT, FINER, WHITE, columns, drawn, from_above, noise, sheets, transfer, turned

every_classification = pytest.mark.parametrize("classification", CLASSIFICATIONS)
every_finer = pytest.mark.parametrize("classification", FINER)


# --- opacities at both ends -----------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", (np.uint8, np.float32))
def test_V1_nothing_visible(record, dtype, way):
    clear = TransferFunction(opacity=((0, 0.0),), color=WHITE)
    volume = Volume(np.ones((3, 4, 5), dtype), np.eye(4))
    classified = classify(volume, clear, np.eye(4))
    assert classified.visible_fraction == 0.0 and len(classified.row_start) == 13
    entries = classified.visible_voxels + int(classified.row_start.any())
    for axis in (0, 1, 2):
        tables = encode(classified, classified.color, axis)
        entries += int((tables.scanline_pointers != -1).sum()) + len(tables.runs) + len(tables.voxel_data)
    record("V1", "voxels, runs and scanlines that are not flagged empty", entries, 0, "either", "whole numbers")
    picture = render(turned(volume, clear), Quality())
    assert (picture.depth == NO_DEPTH).all() and "transparent" in " ".join(picture.report["remarks"])
    record("V1", "largest channel of the picture", np.abs(picture.rgba).max(), 0, "either", "exactly 0 in any width")


@every_classification
def test_V1_nothing_visible_however_classified(record, classification, way):
    volume = Volume(noise(), np.eye(4))
    for points in (((0, 0.0),), ((500, 0.0), (501, 0.7)), ((-501, 0.7), (-500, 0.0))):
        picture = drawn(turned(volume, TransferFunction(opacity=points, color=WHITE)), classification)
        record("V1", "largest channel of the picture", np.abs(picture).max(), 0, "either", "exactly 0 in any width")


@pytest.mark.parametrize("termination", (0.0, 1 / 1024))
@pytest.mark.parametrize("model", ("extinction", "opacity"))
def test_V2_all_opaque(record, width, model, termination, way):
    scene = from_above(np.ones((6, 8, 9), np.float32), transfer(((0, 1.0),), ((0, 0.5, 1.0, 0.0),)))
    picture = render(scene, replace(EXACT, termination=termination, model=model))
    assert np.isfinite(picture.rgba).all() and np.isfinite(picture.depth).all()
    record(
        "V2",
        "1 - alpha over max(T_min, 2^-24)",
        (1.0 - picture.rgba[..., 3]).max() / max(termination, 2.0**-24),
        1.0,
        width,
    )
    color = picture.rgba[..., :3] / picture.rgba[..., 3:]
    record("V2", "error of its color, steps of 255", 255.0 * np.abs(color - (0.5, 1.0, 0.0)).max(), 0.01, width)
    # The camera is 10 before the first slice, whose sheet is a voxel thick: light is gone before the second.
    behind = picture.depth.max() - 10.0 - 1.0
    record("V2", "voxels behind the first slice at which half the light is left", max(behind, 0.0), 0.5, width)


@every_finer
def test_V2_all_opaque_however_classified(record, width, classification, way):
    scene = from_above(np.ones((6, 8, 9), np.float32), transfer(((0, 1.0),), ((0, 0.5, 1.0, 0.0),)))
    picture = drawn(scene, classification, termination=0.0)
    assert np.isfinite(picture).all()
    alpha = picture[2:-2, 2:-2, 3]
    record("V2", "1 - alpha over max(T_min, 2^-24)", (1.0 - alpha).max() * 2.0**24, 1.0, width)


def test_V3_opacities_next_to_one_and_denormal(record, width, way):
    alphas = [0.0, 2.0**-149, 2.0**-126, 1e-30, 2.0**-24, 2.0**-23, 1e-3, 0.5, 1 - 2.0**-23, 1 - 2.0**-24, 1.0]
    n, row = 5, np.arange(len(alphas), dtype=np.float64)
    scene = from_above(np.broadcast_to(row, (n, 3, len(alphas))), transfer(tuple(zip(row, alphas))))
    seen = sheets(scene)[1]
    assert np.isfinite(seen).all()
    alpha = 1.0 - seen[:, 3].astype(np.float64)
    record("V3", "alpha falling while the voxels' alpha grows", max(-np.diff(alpha).min(), 0.0), 0, width)
    thin = np.array(alphas[1:6])
    record(
        "V3",
        "alpha of 5 thin sheets - 5 alpha, in units of 2^-24",
        np.abs(alpha[1:6] - n * thin).max() * 2**24,
        1.0,
        width,
    )
    faint = seen[1, 0] / (n * alphas[1])
    record(
        "V3",
        "relative error of the color of 5 denormal sheets, or none of it",
        min(abs(faint - 1.0), faint),
        0.0,
        width,
    )
    record(
        "V3",
        "relative error of the color of 5 sheets of alpha = 1e-30",
        abs(seen[3, 0] / (n * 1e-30) - 1.0),
        3e-7,
        width,
    )
    record(
        "V3",
        "relative error of the optical depth of alpha = 2^-149",
        abs(float(optical_depth(2.0**-149)) * 2.0**149 - 1.0),
        0.0,
        "float64",
        "a step of the classification",
    )


def float32_opacities() -> np.ndarray:
    """Opacities that float32 holds exactly, so that rounding them is not counted; from 1e-30 to 1 - 1e-6."""
    alphas = np.concatenate((10.0 ** np.linspace(-30, -1, 60), 1.0 - 10.0 ** np.linspace(-1, -6, 20)))
    return np.sort(alphas.astype(np.float32)).astype(np.float64)


def corrected(alphas, exponent, width_of_row=10, **how) -> np.ndarray:
    """What one sheet makes of opacities ``alphas`` when a ray stays in it for ``exponent`` reference distances: the
    color of a white medium, which alpha is too, but without its rounding next to 1."""
    value = np.arange(len(alphas), dtype=np.float64)
    scene = from_above(value.reshape(1, -1, width_of_row), transfer(tuple(zip(value, alphas)), distance=1.0 / exponent))
    return sheets(scene, **how)[..., 0].ravel().astype(np.float64)


@pytest.mark.parametrize("model", ("extinction", "opacity"))
def test_V4_opacity_correction(record, width, model, way):
    alphas, how = float32_opacities(), dict(model=model)
    identity = corrected(alphas, 1.0, **how)
    record(
        "V4",
        "x = 1: difference from alpha, ulp",
        np.abs((identity - alphas) / np.spacing(alphas.astype("f4"))).max(),
        3.0,
        width,
        looser="1 ulp where nothing is raised to a power; log1p in the record and expm1 round apart",
    )
    before = 0.0
    for exponent in (1e-6, 1e-3, 0.1, 0.5, 1.0, 2.0, 10.0, 1e3, 1e6):
        found = corrected(alphas, exponent, **how)
        true = -np.expm1(exponent * np.log1p(-alphas))
        record("V4", "relative error of 1 - (1 - alpha)^x", np.abs(found / true - 1.0).max(), 2e-6, width)
        falling = max(-np.diff(found).min(), (before - found).max(), 0.0)
        record("V4", "falling while alpha or x grows, in units of 2^-24", falling * 2.0**24, 1.0, width)
        before = found
    for one, two in ((0.5, 4.0), (1e-3, 10.0)):
        twice = corrected(corrected(alphas, one, **how), two, **how)
        once = corrected(alphas, one * two, **how)
        shown = alphas < 0.99  # above, 1 - alpha itself has few digits once alpha is rounded to float32
        record(
            "V4",
            "relative difference of corrected twice and once by the product",
            np.abs(twice / once - 1.0)[shown].max(),
            2e-6,
            width,
        )


def test_V5_phi(record, width, way):
    tau = np.concatenate((10.0 ** np.linspace(-30, -1, 100), np.linspace(0.1, 100, 150)))
    alphas, value = -np.expm1(-0.1 * tau), np.arange(250.0)
    tau = 10.0 * -np.log1p(-alphas)
    scene = from_above(value.reshape(1, 10, 25), transfer(tuple(zip(value, alphas)), distance=0.1))
    seen = sheets(scene).reshape(-1, 4)
    phi = -np.expm1(-tau) / tau
    record(
        "V5", "relative error of phi, tau from 1e-30 to 100", np.abs(seen[:, 0] / tau / phi - 1.0).max(), 3e-7, width
    )
    record("V5", "error of the transmittance", np.abs(seen[:, 3] - np.exp(-tau)).max(), 2.0**-23, width)


# --- colors and extinctions of any size ----------------------------------------------------------------------


@pytest.mark.parametrize("warp_filter", ("bilinear", "cubic"))
def test_V14_colors_above_one(record, width, warp_filter, way):
    bright = TransferFunction(
        opacity=((0, 0.0), (120, 1.0)), color=((0, 50.0, 0.5, 0.0), (120, 1.0, 7.0, 1000.0)), shade=None
    )
    scene = turned(Volume(noise("uint8"), np.eye(4)), bright)
    knobs = Quality(classification="pre", warp_filter=warp_filter, sheet_density=1.5)
    picture = render(scene, knobs).rgba.astype(np.float64)
    assert picture[..., 2].max() > 100.0 and np.isfinite(picture).all()
    record(
        "V14",
        "color above the brightest times alpha, relative",
        (picture[..., :3] / 1000.0 - picture[..., 3:]).max(),
        2.0**-22,
        width,
    )
    record("V14", "color below 0", max(-picture.min(), 0.0), 0, width)
    with pytest.raises(RleSplatError, match="negative"):
        TransferFunction(opacity=((0, 0.5),), color=((0, 1.0, -1e-9, 1.0),))


@pytest.mark.parametrize("record_bytes", (16, 8))
def test_V14_the_brightest_there_may_be(record, width, record_bytes, way):
    """Colors and extinctions at their limits multiply to what float32 still holds; beyond, one sentence."""
    voxels = Volume(noise("float32"), np.eye(4))
    function = TransferFunction(
        opacity=((0, 0.0), (120, 1.0)), color=((0, BRIGHTEST, 0.0, 1.0),), opacity_unit_distance=1e-300, shade=None
    )
    quality = Quality(classification="pre", record=record_bytes)
    picture = render(turned(voxels, function), quality).rgba
    bad = (~np.isfinite(picture)).sum()
    record("V14", "pixels that are not finite at the limits", bad, 0, width)
    error = np.abs(picture[..., 0] / BRIGHTEST - picture[..., 3]).max()
    record(
        "V14",
        f"relative error of the color at the limits, {record_bytes} bytes a voxel",
        error,
        1e-6 if record_bytes == 16 else 0.02,
        width,
    )
    for channels in ((2 * BRIGHTEST, 0, 0), (0, 1e39, 0), (0, 0, 1e300)):
        with pytest.raises(RleSplatError, match=r"above 1e\+09.*darker\.$"):
            TransferFunction(opacity=((0, 0.5),), color=((0, *channels),))


@every_finer
@pytest.mark.parametrize("distance", (1e-300, 1e-30, 1e30, 1e300))
def test_V14_V15_the_brightest_and_the_densest_however_classified(record, width, distance, classification, way):
    function = TransferFunction(
        opacity=((0, 0.0), (120, 1.0)), color=((0, BRIGHTEST, 0.0, 1.0),), opacity_unit_distance=distance, shade=None
    )
    picture = drawn(turned(Volume(noise(), np.eye(4)), function), classification)
    assert (picture[..., 3].max() > 0.9) == (distance < 1.0)
    case = "V14" if distance < 1.0 else "V15"
    record(case, "pixels that are not finite at the limits", (~np.isfinite(picture)).sum(), 0, width)
    error = np.abs(picture[..., 0] / BRIGHTEST - picture[..., 3]).max()
    record(case, "relative error of the color at the limits, finer classifications", error, 1e-5, width)


@pytest.mark.parametrize(
    ("classification", "kind"),
    [*(("pre", kind) for kind in LIGHT_TYPES), *((name, kind) for name in FINER for kind in ("SUN", "POINT"))],
)
def test_V14_lights_of_any_energy(record, classification, kind, way):
    """As bright as it may be, or refused in one sentence; never a pixel that is no number."""
    function = TransferFunction(opacity=((0, 0.0), (120, 1.0)), color=((0, 1.0, 0.0, 0.5),))
    pose = np.eye(4)
    pose[:3, 3] = 3.0, 3.0, 20.0
    bad = refused = 0
    for energy in (1e-300, 1.0, 1e6, 1e12, 1e30, 1e300):
        light = Light(kind, (1.0, 0.5, 1e-300), energy, pose)
        scene = turned(Volume(noise("float32"), np.eye(4)), function, 24, lights=(light,))
        try:
            bad += (~np.isfinite(drawn(scene, classification))).sum()
        except RleSplatError as problem:
            assert "brighter" in str(problem) and str(problem).endswith(".")
            refused += 1
    assert 1 <= refused <= 3
    record("V14", "pixels that are not finite under lights of 1e-300 to 1e300 W", bad, 0, "either", "whole numbers")


@every_classification
@pytest.mark.parametrize("away", (0.003, 1.0, 50.0))
def test_V14_a_lamp_lights_small_volumes_at_any_distance(record, away, classification):
    """Voxels of a fifth of a millimeter in a world of meters: however strong the lamp would be half a voxel away, what
    arrives is what counts."""
    z, y, x = np.indices((12, 12, 12)) - 5.5
    ball = (200.0 - 16.0 * np.sqrt(x * x + y * y + z * z)).clip(0, 255).astype(np.uint8)
    volume = Volume(ball, np.diag((2e-4, 2e-4, 2e-4, 1.0)), unit="m")
    matt = TransferFunction(opacity=((100, 0.0), (150, 0.5)), color=WHITE, shade=Shade(0.0, 1.0, 0.0, 1.0))
    pose = np.eye(4)
    pose[:3, 3] = 0.001, 0.001, away

    def seen(energy):
        scene = turned(volume, matt, 24, lights=(Light("POINT", energy=energy, matrix_world=pose),), headlight=False)
        return drawn(scene, classification)[..., 0].astype(np.float64)

    # The light is as far off, to two parts in a thousand or less, for every voxel that is seen; 10 W twice is 20 W.
    weak, strong = seen(1.0), seen(1e6 * away**2)
    assert weak.max() > 0.0
    share = np.abs(strong / (1e6 * away**2) - weak).max() / weak.max()
    record(
        "V14",
        "light of a lamp that does not grow with its energy, relative",
        share,
        2e-3,
        "float32",
        "light is kept in 16 bits where sheets are classified",
    )


@pytest.mark.parametrize("model", ("extinction", "opacity"))
def test_V15_extinction_of_any_size(record, width, model, way):
    """Slabs of optical depth 1e-30 to beyond float32, by the reference distance and by the scale of the world."""
    value = np.arange(4.0)
    alphas = (0.0, 1e-6, 0.5, 1.0)
    tau = optical_depth(np.array(alphas))
    colors = ((0.0, 0.0, 0.5, 1.0),)
    for distance in (1e-300, 1e-39, 1e-30, 1e-12, 1.0, 1e12, 1e30, 1e39, 1e300):
        function = transfer(tuple(zip(value, alphas)), colors, distance)
        with np.errstate(over="ignore"):
            true = -np.expm1(-3.0 * tau / distance)
        scene = from_above(np.broadcast_to(value, (3, 2, 4)), function)
        seen = columns(scene, model=model)[0]
        assert np.isfinite(seen).all()
        record("V15", "error of alpha, extinction 1e-300 to 1e300", np.abs(seen[:, 3] - true).max(), 2e-6, width)
        off = np.abs(seen[:, :3] - seen[:, 3:] * np.array(colors[0][1:])).max()
        record("V15", "error of the color, extinction 1e-300 to 1e300", off, 1e-6, width)
        if distance <= 1e-12:
            behind = sheets(scene, model=model)[0, 2:, 3].max()
            record("V15", "transmittance of what is opaque by far", behind, 1e-30, width)
    dense = classify(Volume(np.ones((2, 2, 2)), np.eye(4)), transfer(((0, 1.0),), distance=1e-300), np.eye(4))
    assert dense.opacity_distance == LEAST_DISTANCE and 1e27 < dense.extinction.min() < dense.extinction.max() * 1.01


@every_classification
def test_V15_the_world_may_be_of_any_size(record, width, classification, way):
    function = transfer(((0, 0.0), (120, 0.6)), ((0, 0.2, 0.5, 1.0), (120, 1.0, 0.3, 0.0)), None)
    scenes = [from_above(noise(), function, scale) for scale in (1e-12, 1.0, 1e12)]
    if classification == "pre":
        finer, bound, pictures = "", 1e-3, [columns(scene) for scene in scenes]
    else:
        finer, bound = ", finer classifications", 0.01
        pictures = [drawn(scene, classification) for scene in scenes]
    assert pictures[1][..., 3].max() > 0.5
    for picture in pictures[::2]:
        worst = difference(picture, pictures[1]).largest
        record("V15", f"world scaled by 1e-12 and 1e12{finer}: difference, steps of 255", worst, bound, width)


def test_every_value_is_told_from_its_neighbors():
    """The bounds above hold for nothing: a picture of something else is far outside them."""
    one, two = (columns(from_above(noise(seed=s), transfer(((0, 0.0), (120, 0.6))))) for s in (3, 4))
    assert difference(one, two).largest > 10.0 and math.isfinite(difference(one, two).rmse)
