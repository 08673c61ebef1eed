"""Values, V1 to V15 of the catalogue: opacities at both ends, what is not a number, transfer functions with steps,
stored types, and colours and extinctions of any size.  However else they are classified: test_values_classified.py."""

import gzip
import math
from dataclasses import replace

import numpy as np
import pytest

from rle_splat.accuracy.metrics import difference
from rle_splat.classify.classification import classify, optical_depth
from rle_splat.classify.limits import BRIGHTEST, LEAST_DISTANCE
from rle_splat.classify.shading import normals, shade
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.encode.encode import encode
from rle_splat.read.formats import read_volume
from rle_splat.render import render
from rle_splat.scene import NO_DEPTH, Light, Quality, RleSplatError
from rle_splat.volume.gradient import unit_normals
from rle_splat.volume.volume import STORED_TYPES, Volume
from tests.stability.scenes import (
    BACKENDS,
    EXACT,
    STEPPED,
    WHITE,
    columns,
    from_above,
    matter,
    noise,
    sheets,
    turned,
    unlike,
)

LEVEL = 1.0 / 255.0
BITS = "differing bits"
LISTS = ("row_start", "column", "extinction", "opacity", "color")
every_backend = pytest.mark.parametrize("backend", BACKENDS)


def lists_unlike(one, two) -> int:
    """How many entries of two ClassifiedVolumes differ."""
    return sum(unlike(getattr(one, name), getattr(two, name)) for name in LISTS)


# --- opacities at both ends -----------------------------------------------------------------------------------


@every_backend
@pytest.mark.parametrize("dtype", (np.uint8, np.float32))
def test_V1_nothing_visible(record, dtype, backend):
    clear = TransferFunction(opacity=((0, 0.0),), color=WHITE)
    volume = Volume(np.ones((3, 4, 5), dtype), np.eye(4))
    classified = classify(volume, clear, np.eye(4), backend=backend)
    assert classified.visible_fraction == 0.0 and len(classified.row_start) == 13
    entries = classified.visible_voxels + int(classified.row_start.any())
    for axis in (0, 1, 2):
        tables = encode(classified, classified.color, axis, backend=backend)
        entries += int((tables.scanline_pointers != -1).sum()) + len(tables.runs) + len(tables.voxel_data)
    record("V1", "voxels, runs and scanlines that are not flagged empty", entries, 0, "either", "whole numbers")
    picture = render(turned(volume, clear), Quality(backend=backend))
    assert (picture.depth == NO_DEPTH).all() and "transparent" in " ".join(picture.report["remarks"])
    record("V1", "largest channel of the picture", np.abs(picture.rgba).max(), 0, "either", "exactly 0 in any width")


@every_backend
@pytest.mark.parametrize("termination", (0.0, 1 / 1024))
@pytest.mark.parametrize("model", ("extinction", "opacity"))
def test_V2_all_opaque(record, width, model, termination, backend):
    scene = from_above(np.ones((6, 8, 9), np.float32), matter(((0, 1.0),), ((0, 0.5, 1.0, 0.0),)))
    picture = render(scene, replace(EXACT, backend=backend, termination=termination, model=model))
    assert np.isfinite(picture.rgba).all() and np.isfinite(picture.depth).all()
    record(
        "V2",
        "1 - alpha over max(T_min, 2^-24)",
        (1.0 - picture.rgba[..., 3]).max() / max(termination, 2.0**-24),
        1.0,
        width,
    )
    color = picture.rgba[..., :3] / picture.rgba[..., 3:]
    record("V2", "error of its colour, levels", 255.0 * np.abs(color - (0.5, 1.0, 0.0)).max(), 0.01, width)
    # The camera is 10 before the first slice, whose sheet is a voxel thick: light is gone before the second.
    behind = picture.depth.max() - 10.0 - 1.0
    record("V2", "voxels behind the first slice at which half the light is left", max(behind, 0.0), 0.5, width)


@every_backend
def test_V3_opacities_next_to_one_and_denormal(record, width, backend):
    alphas = [0.0, 2.0**-149, 2.0**-126, 1e-30, 2.0**-24, 2.0**-23, 1e-3, 0.5, 1 - 2.0**-23, 1 - 2.0**-24, 1.0]
    n, row = 5, np.arange(len(alphas), dtype=np.float64)
    scene = from_above(np.broadcast_to(row, (n, 3, len(alphas))), matter(tuple(zip(row, alphas))))
    seen = sheets(scene, backend)[1]
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
        "relative error of the colour of 5 denormal sheets, or none of it",
        min(abs(faint - 1.0), faint),
        0.0,
        width,
    )
    record(
        "V3",
        "relative error of the colour of 5 sheets of alpha = 1e-30",
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
    colour of white matter, which alpha is too, but without its rounding next to 1."""
    value = np.arange(len(alphas), dtype=np.float64)
    scene = from_above(value.reshape(1, -1, width_of_row), matter(tuple(zip(value, alphas)), distance=1.0 / exponent))
    return sheets(scene, **how)[..., 0].ravel().astype(np.float64)


@every_backend
@pytest.mark.parametrize("model", ("extinction", "opacity"))
def test_V4_opacity_correction(record, width, model, backend):
    alphas, how = float32_opacities(), dict(backend=backend, model=model)
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


@every_backend
def test_V5_phi(record, width, backend):
    tau = np.concatenate((10.0 ** np.linspace(-30, -1, 100), np.linspace(0.1, 100, 150)))
    alphas, value = -np.expm1(-0.1 * tau), np.arange(250.0)
    tau = 10.0 * -np.log1p(-alphas)
    scene = from_above(value.reshape(1, 10, 25), matter(tuple(zip(value, alphas)), distance=0.1))
    seen = sheets(scene, backend).reshape(-1, 4)
    phi = -np.expm1(-tau) / tau
    record(
        "V5", "relative error of phi, tau from 1e-30 to 100", np.abs(seen[:, 0] / tau / phi - 1.0).max(), 3e-7, width
    )
    record("V5", "error of the transmittance", np.abs(seen[:, 3] - np.exp(-tau)).max(), 2.0**-23, width)


# --- what is no number, or beyond the ends --------------------------------------------------------------------


@every_backend
@pytest.mark.parametrize("dtype", ("float32", "float64"))
def test_V6_not_a_number_is_transparent_and_counted(record, dtype, backend):
    values = noise(dtype)
    holes = np.random.default_rng(5).random(values.shape) < 0.2
    with_nan, with_air = values.copy(), values.copy()
    with_nan[holes], with_air[holes] = np.nan, 0.0
    one, two = (Volume(v, np.eye(4)) for v in (with_nan, with_air))
    first, second = (classify(v, STEPPED, np.eye(4), backend=backend) for v in (one, two))
    assert first.nan_voxels == holes.sum() and second.nan_voxels == 0
    record(
        "V6",
        f"{BITS} of the looks, against those voxels transparent",
        lists_unlike(first, second),
        0,
        "either",
        "the same numbers in any width",
    )
    unshaded = replace(STEPPED, shade=None)
    quality = Quality(backend=backend, classification="pre")
    pictures = [render(turned(v, unshaded), quality) for v in (one, two)]
    assert f"{holes.sum()} voxels are not numbers" in " ".join(pictures[0].report["remarks"])
    record("V6", f"{BITS} of the picture", unlike(*(p.rgba for p in pictures)), 0, "either", "the same sums")
    shaded = render(turned(one, STEPPED), quality).rgba
    record("V6", "pixels that are not finite, shaded", (~np.isfinite(shaded)).sum(), 0, "either", "whole numbers")


@every_backend
@pytest.mark.parametrize("slope", (1.0, -1.0))
def test_V7_V9_infinities_and_data_beyond_the_ends(record, slope, backend):
    ends = TransferFunction(opacity=((-5, 0.3), (0, 0.0), (5, 0.7)), color=((-5, 1, 0, 0), (5, 0, 1, 0)), shade=None)
    stored = np.array([-np.inf, np.inf, 1e308, -1e308, 5.0, -5.0, 0.0, 2.0]).reshape(2, 2, 2)
    held = np.clip(stored, -5, 5)
    one, two = (Volume(v, np.eye(4), slope=slope) for v in (stored, held))
    classified = [classify(v, ends, np.eye(4), backend=backend) for v in (one, two)]
    assert classified[0].visible_voxels == 7 and classified[0].nan_voxels == 0
    why = "the same numbers in any width"
    pictures = [render(turned(v, ends), Quality(backend=backend, classification="pre")).rgba for v in (one, two)]
    for case in ("V7", "V9"):
        record(
            case, f"{BITS} of the looks, against data clamped to the ends", lists_unlike(*classified), 0, "either", why
        )
        record(case, f"{BITS} of the picture, against data clamped to the ends", unlike(*pictures), 0, "either", why)
    lit = render(turned(one, replace(ends, shade=Shade())), Quality(backend=backend, classification="pre")).rgba
    record("V7", "pixels that are not finite, shaded", (~np.isfinite(lit)).sum(), 0, "either", "whole numbers")


# --- gradients ------------------------------------------------------------------------------------------------


def all_normals(voxels, backend) -> np.ndarray:
    volume = Volume(voxels, np.eye(4))
    nx, ny, nz = volume.shape_xyz
    rows, column = np.arange(nz * ny + 1, dtype=np.int64) * nx, np.tile(np.arange(nx, dtype=np.uint16), nz * ny)
    return unit_normals(volume, rows, column, np.eye(4), backend=backend).reshape(*voxels.shape, 3)


@every_backend
@pytest.mark.parametrize("dtype", STORED_TYPES)
def test_V8_a_constant_volume_has_no_normal_and_keeps_its_color(record, dtype, backend):
    volume = Volume(np.full((4, 4, 4), 77, dtype), np.eye(4))
    with np.errstate(all="raise"):
        found = np.count_nonzero(all_normals(volume.voxels, backend))
    record("V8", "components of normals other than 0", found, 0, "either", "whole numbers")
    white = TransferFunction(opacity=((0, 0.5),), color=((0, 0.2, 0.5, 1.0),))
    classified = classify(volume, white, np.eye(4), backend=backend)
    n = normals(classified, volume, np.eye(4), backend=backend)
    how = dict(headlight_direction=(0, 0, -1), eye=(0, 0, 1, 0), backend=backend)
    colors = shade(classified, n, np.eye(4), Shade(), (), **how)
    record(
        "V8",
        f"{BITS} of the shaded colours from the unshaded",
        unlike(colors, classified.color),
        0,
        "either",
        "the same numbers in any width",
    )


@every_backend
def test_V8_a_constant_volume_is_symmetric(record, width, backend):
    cube = np.full((6, 6, 6), 50.0, np.float32)
    scene = from_above(cube, matter(((0, 0.3),), ((0, 0.2, 0.5, 1.0),), shade=Shade()))
    picture = columns(replace(scene, headlight=True), backend)
    worst = max(np.abs(picture - np.flip(picture, axis)).max() for axis in (0, 1))
    worst = max(worst, np.abs(picture - picture.transpose(1, 0, 2)).max())
    record("V8", "asymmetry of its picture, levels", 255.0 * worst, 0.0, width)


@every_backend
@pytest.mark.parametrize("dtype, mean, worst", (("float32", 0.35, 0.8), ("uint8", 0.4, 1.0)))
def test_V13_angles_on_a_sphere(record, dtype, mean, worst, backend):
    z, y, x = np.indices((40, 40, 40)) - 19.5
    radius = np.sqrt(x * x + y * y + z * z)
    field = 255.0 / (1.0 + np.exp((radius - 13.0) / 1.5))
    voxels = np.rint(field).astype(dtype) if dtype == "uint8" else field.astype(dtype)
    edge = np.abs(radius - 13.0) < 1.5
    outward = np.stack((x, y, z), axis=-1)[edge] / radius[edge][:, None]
    angle = np.degrees(np.arccos(np.clip(-(all_normals(voxels, backend)[edge] * outward).sum(axis=1), -1.0, 1.0)))
    why = "gradients are formed in float64 and kept as float32"
    record("V13", f"mean angle error on a sphere of {dtype}, degrees", angle.mean(), mean, "float32", why)
    record("V13", f"largest angle error on a sphere of {dtype}, degrees", angle.max(), worst, "float32", why)


@every_backend
def test_V13_below_the_noise_floor_there_is_no_normal(record, backend):
    x = np.indices((5, 5, 40))[2]
    slow = (x // 8).astype(np.uint8)  # one step in eight voxels: mostly flat
    lone = np.zeros((5, 5, 5), np.uint8)
    lone[2, 2, 2] = 1  # one stray step: Sobel sees an eighth of it straight ahead
    flat = (x % 8 > 0) & (x % 8 < 7)
    wobble = 1000.0 * (1.0 + 2.0**-23 * np.random.default_rng(1).integers(-2, 3, (5, 5, 5)))
    found = [
        np.count_nonzero(all_normals(voxels, backend)[where])
        for voxels, where in ((lone, ...), (slow, flat), (wobble.astype(np.float32), ...))
    ]
    record("V13", "normals among steps of one stored value and rounding", sum(found), 0, "either", "whole numbers")
    clear = (1000.0 + 0.1 * x).astype(np.float32)
    off = np.abs(all_normals(clear, backend) - (1, 0, 0)).max()
    record("V13", "error of a normal just above the floor", off, 1e-6, "float32", "normals are kept as float32")


# --- transfer functions ---------------------------------------------------------------------------------------


@every_backend
@pytest.mark.parametrize("dtype", ("uint8", "int16", "float32", "float64"))
def test_V10_steps_duplicates_unsorted_and_single_points(record, dtype, backend):
    """Each function against the values read off it by hand, through the lists of every stored type."""
    values = np.array([0, 3, 4, 5, 6, 9, 10, 60], dtype).reshape(2, 2, 2)
    functions = {
        "unsorted": (((10, 0.6), (0, 0.2)), [0.2, 0.32, 0.36, 0.4, 0.44, 0.56, 0.6, 0.6]),
        "single": (((3, 0.7),), [0.7] * 8),
        "step": (((0, 0.1), (5, 0.1), (5, 0.9), (10, 0.9)), [0.1] * 3 + [0.9] * 5),
        "three at once": (((5, 0.1), (5, 0.5), (5, 0.9)), [0.1] * 3 + [0.9] * 5),
        "equal values keep their order": (((5, 0.9), (0, 0.5), (5, 0.1)), [0.5, 0.74, 0.82, 0.1, 0.1, 0.1, 0.1, 0.1]),
    }
    volume = Volume(values, np.eye(4))
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        for points, alphas in functions.values():
            classified = classify(volume, matter(points), np.eye(4), backend=backend)
            assert classified.visible_voxels == 8
            off = np.abs(classified.opacity - np.array(alphas)).max()
            record("V10", "error of alpha at steps and duplicates", off, 2.0**-24, "float32")
            off = np.abs(matter(points).alpha_at(values.ravel()) - np.array(alphas)).max()
            record("V10", "error of alpha at steps and duplicates", off, 2.0**-24, "float64")
    with pytest.raises(RleSplatError, match="no opacity points"):
        matter(())


def test_V10_a_step_is_right_continuous(record):
    step = matter(((0, 0.1), (5, 0.1), (5, 0.9), (10, 0.9)))
    below, at = step.alpha_at(np.nextafter(5.0, 0.0)), step.alpha_at(5.0)
    record(
        "V10",
        "error of alpha just left of a step and on it",
        max(abs(below - 0.1), abs(at - 0.9)),
        1e-15,
        "float64",
        "transfer functions are read in float64",
    )


@every_backend
@pytest.mark.parametrize("dtype", ("uint8", "uint16", "int16"))
def test_V10_tables_of_stored_values_are_exact(record, dtype, backend):
    """8- and 16-bit volumes go by a table of every stored value: at any size of it nothing is interpolated."""
    bounds = np.iinfo(dtype)
    stored = np.linspace(bounds.min, bounds.max, 512).astype(dtype).reshape(8, 8, 8)
    volume = Volume(stored, np.eye(4), slope=0.37, intercept=-11.0)
    low, high = volume.value_range
    rugged = matter(tuple((v, 0.1 + 0.8 * (i % 2)) for i, v in enumerate(np.linspace(low, high, 97))))
    classified = classify(volume, rugged, np.eye(4), backend=backend)
    off = np.abs(classified.opacity - rugged.alpha_at(volume.physical(stored)).ravel()).max()
    record(
        "V10",
        "difference of a table of stored values from the points",
        off,
        2.0**-24,
        "float32",
        "a table's entries are made in float64 and kept as float32",
    )


@every_backend
@pytest.mark.parametrize("dtype", ("int16", "float32"))
def test_V11_a_range_of_one_value_is_a_step(record, width, dtype, backend):
    ramp = matter(((0, 0.0), (100, 0.8)), ((0, 1.0, 0.2, 0.1), (100, 0.1, 0.3, 1.0)))
    step = matter(((40, 0.0), (40, 0.8)), ((40, 1.0, 0.2, 0.1), (40, 0.1, 0.3, 1.0)))
    volume = Volume(noise(dtype), np.eye(4))
    assert (volume.voxels > 40).any() and (volume.voxels < 40).any()
    with np.errstate(divide="raise", invalid="raise"):
        for narrow in (ramp.remapped(40, 40), ramp.windowed(40, 0.0)):
            pictures = [columns(from_above(volume.voxels, tf), backend) for tf in (narrow, step)]
            record("V11", f"{BITS} of the picture, against a step", unlike(*pictures), 0, width)
    assert 0.5 < pictures[0][..., 3].max()


# --- stored types ---------------------------------------------------------------------------------------------


@every_backend
@pytest.mark.parametrize("dtype", STORED_TYPES)
def test_V12_slope_and_intercept_come_before_the_points(record, dtype, backend):
    """A function that shows a single physical value, just where exact arithmetic in float64 puts it."""
    stored = noise(dtype)
    volume = Volume(stored, np.eye(4), slope=-2.5, intercept=0.125)
    for value in (float(stored.max()), float(stored.min()), float(stored[0, 0, 0])):
        at = -2.5 * value + 0.125  # exact: few bits
        shows = matter(((at, 0.0), (at, 0.5), (np.nextafter(at, np.inf), 0.5), (np.nextafter(at, np.inf), 0.0)))
        seen = classify(volume, shows, np.eye(4), backend=backend).visible_voxels
        record(
            "V12",
            "voxels shown wrongly by a function of one physical value",
            abs(seen - int((stored == value).sum())),
            0,
            "float64",
            "physical values are float64 for every stored type",
        )


@pytest.mark.parametrize("packed", (False, True))
@pytest.mark.parametrize("dtype", STORED_TYPES)
def test_V12_a_big_endian_file_is_its_byteswapped_twin(record, tmp_path, dtype, packed):
    stored = noise(dtype, (3, 4, 5))
    volumes = []
    for order in "<>":
        path = tmp_path / f"{'big' if order == '>' else 'little'}.raw{'.gz' if packed else ''}"
        content = stored.astype(stored.dtype.newbyteorder(order)).tobytes()
        path.write_bytes(gzip.compress(content) if packed else content)
        volumes.append(read_volume(path, shape=(5, 4, 3), dtype=dtype, byte_order="big" if order == ">" else "little"))
    assert volumes[0].key == volumes[1].key
    record(
        "V12",
        "voxels that differ between a big- and a little-endian file",
        unlike(*(v.voxels for v in volumes)),
        0,
        "either",
        "stored values",
    )


@every_backend
def test_V12_wrapped_values_are_told_apart(record, backend):
    """The same bytes as int16 and as uint16: -1 is not 65535."""
    stored = np.array([-1, -1024, 3071, 32767, -32768, 0, 1, -2], np.int16).reshape(2, 2, 2)
    dense = matter(((0, 0.0), (0, 0.5)))
    seen = [
        classify(Volume(v, np.eye(4)), dense, np.eye(4), backend=backend).visible_voxels
        for v in (stored, stored.view(np.uint16))
    ]
    record(
        "V12",
        "voxels at or above 0, miscounted as signed or unsigned",
        abs(seen[0] - 4) + abs(seen[1] - 8),
        0,
        "either",
        "whole numbers",
    )


# --- colours and extinctions of any size ----------------------------------------------------------------------


@every_backend
@pytest.mark.parametrize("warp_filter", ("bilinear", "cubic"))
def test_V14_colours_above_one(record, width, warp_filter, backend):
    bright = TransferFunction(
        opacity=((0, 0.0), (120, 1.0)), color=((0, 50.0, 0.5, 0.0), (120, 1.0, 7.0, 1000.0)), shade=None
    )
    scene = turned(Volume(noise("uint8"), np.eye(4)), bright)
    knobs = Quality(backend=backend, classification="pre", warp_filter=warp_filter, sheet_density=1.5)
    picture = render(scene, knobs).rgba.astype(np.float64)
    assert picture[..., 2].max() > 100.0 and np.isfinite(picture).all()
    record(
        "V14",
        "colour above the brightest times alpha, relative",
        (picture[..., :3] / 1000.0 - picture[..., 3:]).max(),
        2.0**-22,
        width,
    )
    record("V14", "colour below 0", max(-picture.min(), 0.0), 0, width)
    with pytest.raises(RleSplatError, match="negative"):
        TransferFunction(opacity=((0, 0.5),), color=((0, 1.0, -1e-9, 1.0),))


@every_backend
@pytest.mark.parametrize("record_bytes", (16, 8, 6, 4))
def test_V14_the_brightest_there_may_be(record, width, record_bytes, backend):
    """Colours and extinctions at their limits multiply to what float32 still holds; beyond, one sentence."""
    voxels = Volume(noise("float32"), np.eye(4))
    function = TransferFunction(
        opacity=((0, 0.0), (120, 1.0)), color=((0, BRIGHTEST, 0.0, 1.0),), opacity_unit_distance=1e-300, shade=None
    )
    quality = Quality(backend=backend, classification="pre", record=record_bytes)
    picture = render(turned(voxels, function), quality).rgba
    bad = (~np.isfinite(picture)).sum()
    record("V14", "pixels that are not finite at the limits", bad, 0, width)
    error = np.abs(picture[..., 0] / BRIGHTEST - picture[..., 3]).max()
    record(
        "V14",
        f"relative error of the colour at the limits, {record_bytes} bytes a voxel",
        error,
        1e-6 if record_bytes == 16 else 0.02,
        width,
    )
    for channels in ((2 * BRIGHTEST, 0, 0), (0, 1e39, 0), (0, 0, 1e300)):
        with pytest.raises(RleSplatError, match=r"brighter.*darker\.$"):
            TransferFunction(opacity=((0, 0.5),), color=((0, *channels),))


@every_backend
@pytest.mark.parametrize("kind", ("SUN", "POINT", "SPOT", "AREA"))
def test_V14_lights_of_any_energy(record, kind, backend):
    """As bright as it may be, or refused in one sentence; never a pixel that is no number."""
    function = TransferFunction(opacity=((0, 0.0), (120, 1.0)), color=((0, 1.0, 0.0, 0.5),))
    pose = np.eye(4)
    pose[:3, 3] = 3.0, 3.0, 20.0
    bad = refused = 0
    for energy in (1e-300, 1.0, 1e6, 1e12, 1e30, 1e300):
        light = Light(kind, (1.0, 0.5, 1e-300), energy, pose)
        scene = turned(Volume(noise("float32"), np.eye(4)), function, 24, lights=(light,))
        try:
            bad += (~np.isfinite(render(scene, Quality(backend=backend, classification="pre")).rgba)).sum()
        except RleSplatError as problem:
            assert "brighter" in str(problem) and str(problem).endswith(".")
            refused += 1
    assert 1 <= refused <= 3
    record("V14", "pixels that are not finite under lights of 1e-300 to 1e300 W", bad, 0, "either", "whole numbers")


@every_backend
@pytest.mark.parametrize("model", ("extinction", "opacity"))
def test_V15_extinction_of_any_size(record, width, model, backend):
    """Slabs of optical depth 1e-30 to beyond float32, by the reference distance and by the scale of the world."""
    value = np.arange(4.0)
    alphas = (0.0, 1e-6, 0.5, 1.0)
    tau = optical_depth(np.array(alphas))
    colors = ((0.0, 0.0, 0.5, 1.0),)
    for distance in (1e-300, 1e-39, 1e-30, 1e-12, 1.0, 1e12, 1e30, 1e39, 1e300):
        function = matter(tuple(zip(value, alphas)), colors, distance)
        with np.errstate(over="ignore"):
            true = -np.expm1(-3.0 * tau / distance)
        scene = from_above(np.broadcast_to(value, (3, 2, 4)), function)
        seen = columns(scene, backend, model=model)[0]
        assert np.isfinite(seen).all()
        record("V15", "error of alpha, extinction 1e-300 to 1e300", np.abs(seen[:, 3] - true).max(), 2e-6, width)
        off = np.abs(seen[:, :3] - seen[:, 3:] * np.array(colors[0][1:])).max()
        record("V15", "error of the colour, extinction 1e-300 to 1e300", off, 1e-6, width)
        if distance <= 1e-12:
            behind = sheets(scene, backend, model=model)[0, 2:, 3].max()
            record("V15", "transmittance of what is opaque by far", behind, 1e-30, width)
    dense = classify(
        Volume(np.ones((2, 2, 2)), np.eye(4)), matter(((0, 1.0),), distance=1e-300), np.eye(4), backend=backend
    )
    assert dense.opacity_distance == LEAST_DISTANCE and 1e27 < dense.extinction.min() < dense.extinction.max() * 1.01


@every_backend
def test_V15_the_world_may_be_of_any_size(record, width, backend):
    function = matter(((0, 0.0), (120, 0.6)), ((0, 0.2, 0.5, 1.0), (120, 1.0, 0.3, 0.0)), None)
    pictures = [columns(from_above(noise(), function, scale), backend) for scale in (1e-12, 1.0, 1e12)]
    assert pictures[1][..., 3].max() > 0.5
    for picture in pictures[::2]:
        record(
            "V15",
            "world scaled by 1e-12 and 1e12: difference, levels",
            difference(picture, pictures[1]).largest,
            1e-3,
            width,
        )


def test_every_value_is_told_from_its_neighbours():
    """The bounds above hold for nothing: a picture of something else is far outside them."""
    one, two = (columns(from_above(noise(seed=s), matter(((0, 0.0), (120, 0.6))))) for s in (3, 4))
    assert difference(one, two).largest > 10.0 and math.isfinite(difference(one, two).rmse)
