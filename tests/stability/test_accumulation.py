"""Group A of the catalogue: sheet upon sheet, in float32 and in float64."""

from __future__ import annotations

import math
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS, blobs
from rle_splat.classify.classification import classify
from rle_splat.classify.transfer_function import Shade
from rle_splat.encode.encode import encode
from rle_splat.pipeline.render import render, render_steps
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.jit import compiled, kernel
from rle_splat.runtime.steps import drain
from rle_splat.scene import MODELS, WARP_FILTERS, Light, Quality
from rle_splat.splat import pixel_block, scalar_splat, splat
from rle_splat.splat.pixel_block import BLOCK, TRANSMITTANCE, accumulator, composite_added, composite_extinction
from rle_splat.splat.splat import OPAQUE, splat_steps
from rle_splat.view.base_plane import base_plane
from rle_splat.view.eye import index_view
from rle_splat.view.footprints import FOOTPRINTS, GAUSSIAN, footprint_values
from rle_splat.view.principal_axis import candidate_pyramids
from rle_splat.warp.warp import warp_steps
from tests.stability.catalogue import WIDTHS
from tests.stability.scenes import columns, from_above, sheets, transfer
from tests.truths.conftest import OPACITY_IS_VALUE, Stage

WITH_KERNELS = pytest.mark.skipif(not compiled(), reason="there are no kernels without numba")
STAGE = Stage()
PIPELINE = import_module("rle_splat.pipeline.render")
STAGE_SHADE = Shade()
CLASSIFICATIONS = ("pre", "post")
BY_CLASSIFICATION = pytest.mark.parametrize("classification", CLASSIFICATIONS)
NEAREST = "light is kept in steps, and a value is classified by the nearest entry of a table"
ULP = 2.0**-24  # what float32 rounds a number below one by, at most
SINGLE, DOUBLE = WIDTHS
LIT_BEFORE = "lit before sums"


def intermediate(scene, quality, part=None):
    """The intermediate image of an unlit scene of one base plane; ``part``: a slice of its sheets."""
    view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    ((axis, sign),) = candidate_pyramids(view)
    plane = base_plane(
        view, scene.volume.shape_xyz, axis, sign, quality.depth_rule, quality.sheet_density, FOOTPRINTS[quality.kernel]
    )
    classified = classify(scene.volume, scene.transfer_function, scene.index_to_world)
    if part is not None:
        names = plane.sheets.__dataclass_fields__
        sheets = replace(plane.sheets, **{name: getattr(plane.sheets, name)[part] for name in names})
        plane = replace(plane, sheets=sheets, scale=plane.scale[part], offset=plane.offset[part])
    return drain(splat_steps(encode(classified, classified.color, axis), plane, quality)), len(plane.sheets)


# --- A1 -------------------------------------------------------------------------------------------------------


@kernel
def _extinctions(sheet, length, state, before, count):
    for _ in range(count):
        composite_extinction(
            sheet, 0, 0, np.float32(0.0), length, 0, np.float32(1.0), np.float32(OPAQUE), state, 0, before
        )


@kernel
def _opacities(sheet, length, state, before, count):
    for _ in range(count):
        composite_added(sheet, 0, 0, np.float32(0.0), length, 0, np.float32(1.0), np.float32(OPAQUE), state, 0, before)


def behind_sheets(loop, value, count, width):
    """(color, transmittance) of one pixel behind ``count`` sheets of a white medium of that extinction or opacity."""
    kind = np.dtype(width).type
    sheet, length = np.full(4 * BLOCK, value, np.float32), np.ones(BLOCK, np.float32)
    state, before = np.zeros(4 * BLOCK, kind), np.zeros(BLOCK, kind)
    state[TRANSMITTANCE:] = 1.0
    loop(sheet, length, state, before, count)
    assert (state[TRANSMITTANCE:] == state[TRANSMITTANCE]).all() and (state[:BLOCK] == state[0]).all()
    return float(state[0]), float(state[TRANSMITTANCE])


@WITH_KERNELS
@pytest.mark.parametrize("count", (10**3, 10**4, 10**5, 10**6, 10**7))
@pytest.mark.parametrize("model", MODELS)
def test_A1_thin_sheets_whose_optical_depths_add_up_to_one(record, model, count):
    value = np.float32(1.0 / count)
    loop = _extinctions if model == "extinction" else _opacities
    exact = math.exp(count * (-float(value) if model == "extinction" else math.log1p(-float(value))))
    for width in WIDTHS:
        color, transmittance = behind_sheets(loop, value, count, width)
        off, gained = abs(transmittance - exact), abs(color + transmittance - 1.0)
        record("A1", "error of T behind n sheets, in units of n 2^-24", off / (count * ULP), 1.0, width)
        if width == DOUBLE:
            none = "chosen for no more than 16,384 sheets"
            record("A1", "error of T behind up to 1e7 sheets", off, 1e-12, width, why=none)
            record("A1", "color + T - 1 behind up to 1e7 sheets", gained, 1e-12, width, why=none)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("model, classification", (("extinction", "pre"), ("opacity", "pre"), ("extinction", "post")))
def test_A1_the_plan_counts_the_sheets(record, model, classification, width, way, monkeypatch):
    """A column of as many slices as float32 is good for, and one slice more; the reference implementation has a lower
    limit here, for it takes its time."""
    if way == "numpy":
        monkeypatch.setattr(pixel_block, "MOST_SHEETS_IN_SINGLE", 500)
    most = pixel_block.MOST_SHEETS_IN_SINGLE
    assert accumulator(most) is np.float32 and accumulator(most + 1) is np.float64
    asked = []
    for module in ("scratch", "reference.sheet_buffer", "reference.scalar_sheets"):
        monkeypatch.setattr(f"rle_splat.splat.{module}.accumulator", lambda n: asked.append(n) or accumulator(n))
    # Records, lengths and the finished picture are float32 in either case: a few roundings in all.
    count, bound = (most, most * ULP) if width == SINGLE else (most + 1, 4.0 * ULP)
    long = count - (classification == "post")  # half of the first slice and of the last are outside its box
    alpha = np.float32(-math.expm1(-1.0 / long))
    scene = from_above(np.ones((count, 4, 4), np.uint8), transfer(((0.0, 0.0), (1.0, float(alpha)))))
    found = columns(scene, model=model, classification=classification)[1, 1]
    assert set(asked) == {count}
    claim = f"error of A in a picture of {'no more' if width == SINGLE else 'more'} than {most} sheets"
    exact = -math.expm1(long * math.log1p(-float(alpha)))
    record("A1", claim, abs(float(found[3]) - exact), bound, width, why="another number of sheets")


# --- A2, A3: the end of a ray ---------------------------------------------------------------------------------


@pytest.mark.parametrize("tau", (0.05, 2.0, 16.6))
@BY_CLASSIFICATION
def test_A2_transmittance_underflows_to_the_end_of_the_ray(record, width, way, tau, classification):
    """No least transmittance is asked for: behind 1e-30 the ray ends, and no denormal number is left to work with."""
    count = int(70.0 / tau) + 40
    seen = transfer(((0.5, 0.0), (0.5, -math.expm1(-tau))))
    solid = np.ones((2 * count, 4, 4), np.uint8)
    whole, front = (
        sheets(from_above(voxels, seen), classification=classification)[1:3, 1:3]
        for voxels in (solid, solid * (np.arange(2 * count) >= count)[:, None, None])
    )
    transmittance = whole[..., 3]
    assert transmittance.max() <= OPAQUE and np.isfinite(whole).all()
    denormal = (transmittance > 0.0) & (transmittance < np.finfo(np.float32).tiny)
    record("A2", "denormal transmittances left behind an opaque medium", denormal.sum(), 0, width)
    record("A2", "numbers that matter behind T = 1e-30 changes", (front != whole).sum(), 0, width)


@pytest.mark.parametrize("termination", (1 / 1024, 1 / 256, 1 / 64, 1 / 16))
@BY_CLASSIFICATION
def test_A3_early_termination_costs_its_bound_and_no_more(record, width, termination, classification):
    """Sheets of an optical depth of a fiftieth: whatever lies behind is cut off at the bound, in every channel."""
    scene = from_above(np.ones((600, 4, 4), np.uint8), transfer(((0.0, 0.0), (1.0, -math.expm1(-0.02)))))
    full, short = (columns(scene, termination=t, classification=classification)[1, 1] for t in (0.0, termination))
    lost = (full - short) / termination
    record("A3", "what termination cuts off, in units of T_min * c_max", lost.max(), 1.001, width)
    record("A3", "part of the bound that a saturating scene does not attain", 1.0 - lost.min(), 0.05, width)


# --- A4, A5: orders and bands ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("width", "footprint", "taps"),
    ((DOUBLE, "tent", 8), (SINGLE, "tent", 8), (SINGLE, "bspline2", 27), (SINGLE, "bspline3", 27),
     (SINGLE, "gaussian", 125)),
    indirect=("width",),
)  # fmt: skip
def test_A4_order_inside_a_sheet_is_worth_its_roundings(record, width, way, footprint, taps):
    """The same voxels met in the opposite order, along scanlines and across them."""
    voxels = np.random.default_rng(4).integers(1, 256, (3, 24, 24)).astype(np.uint8)
    voxels[:, :4] = voxels[:, -4:] = voxels[..., :4] = 0
    voxels[..., -4:] = 0
    faint = transfer(((0.0, 0.0), (255.0, 0.2)), color=((0.0, 1.0, 0.2, 0.1), (255.0, 0.2, 0.4, 0.9)))
    plain, turned = (
        columns(from_above(v, faint), kernel=footprint).astype(np.float64) for v in (voxels, voxels[:, ::-1, ::-1])
    )
    assert plain[..., 3].max() > 0.3
    record(
        "A4",
        "change of a sum of taps whose order is reversed, in units of taps * 2^-24",
        np.abs(turned[::-1, ::-1] - plain).max() / (taps * ULP),
        1.0,
        width,
    )


@WITH_KERNELS
@pytest.mark.parametrize("rows", (2, 6, 10, 30))
@pytest.mark.parametrize("threads", (1, 2))
@BY_CLASSIFICATION
def test_A5_bands_and_threads_change_no_bit(record, monkeypatch, rows, threads, classification):
    """The rows of the intermediate image, taken so many at a time (more threads: test_same_picture)."""
    scene = STAGE.on_turntable(FIELDS["smooth"](20)[:, :17], 35.0, 25.0, True, size=(70, 61))
    whole = STAGE.render(scene, threads=1, classification=classification)
    module, name, first_row = {"pre": (splat, "splat_rows", 7), "post": (scalar_splat, "splat_scalar_rows", 13)}[
        classification
    ]
    calls, work = [], getattr(module, name)
    with monkeypatch.context() as patch:
        patch.setattr(splat, "BAND", {1: 2 * rows, 2: rows // 2}[threads])
        patch.setattr(splat, "WORK_AT_ONCE", 0)
        patch.setattr(splat, "BANDS_EACH", 1)
        patch.setattr(module, name, lambda *a: calls.append(a[first_row : first_row + 2]) or work(*a))
        split = STAGE.render(scene, threads=threads, classification=classification)
    assert max(last - first for first, last in calls) == rows and len(calls) > 2
    changed = (split.rgba != whole.rgba).sum() + (split.depth != whole.depth).sum()
    record("A5", "numbers whose bits change with threads and bands", changed, 0, SINGLE, why="bands share no sum")


# --- A6 to A9: what any picture keeps to ----------------------------------------------------------------------


def over(front, back):
    """(..., 4) color and transmittance, float64: one partial image over another."""
    return np.concatenate((front[..., :3] + front[..., 3:] * back[..., :3], front[..., 3:] * back[..., 3:]), axis=-1)


@pytest.mark.parametrize("depth_rule", ("slice", "simpson"))
@pytest.mark.parametrize("pieces", (2, 3, 5, 9))
def test_A6_over_is_associative(record, width, depth_rule, pieces):
    """Sheets split between them at random, put together again as a tree; nothing in front changes nothing."""
    random = np.random.default_rng(pieces)
    scene = STAGE.on_turntable(0.6 * blobs((20, 20, 20), 2), 35.0, 25.0, size=(40, 40))
    quality = Quality(classification="pre", depth_rule=depth_rule, termination=0.0)
    whole, sheets = intermediate(scene, quality)
    cuts = np.sort(random.choice(np.arange(1, sheets), pieces - 1, replace=False))
    images = [
        intermediate(scene, quality, slice(first, last))[0].pixels.astype(np.float64)
        for first, last in zip((0, *cuts), (*cuts, sheets), strict=True)
    ]
    depth = 0
    while len(images) > 1:
        images = [over(*images[i : i + 2]) if i + 1 < len(images) else images[i] for i in range(0, len(images), 2)]
        depth += 1
    assert whole.pixels[..., 3].min() < 0.3
    error = np.abs(images[0] - whole.pixels).max() / (4 * ULP * depth)
    record("A6", "error of a tree of over, in units of 4 * 2^-24 * its depth", error, 1.0, width)
    nothing = np.broadcast_to(np.array((0.0, 0.0, 0.0, 1.0)), whole.pixels.shape)
    for both in (over(nothing, whole.pixels), over(whole.pixels, nothing)):
        record("A6", "numbers that over changes where one side is nothing", (both != whole.pixels).sum(), 0, width)


@pytest.mark.parametrize("slices", (15, 128))
@pytest.mark.parametrize("tau", (1e-7, 1e-3, 0.1, 1.0, 5.0, 16.6))
@BY_CLASSIFICATION
def test_A7_a_white_furnace_is_as_bright_as_it_is_opaque(record, width, way, slices, tau, classification):
    """Emission of color one: what is emitted is what is hidden, sheet for sheet, before any clamp."""
    scene = from_above(np.ones((slices, 8, 8), np.uint8), transfer(((0.0, 0.0), (1.0, -math.expm1(-tau)))))
    pixels = sheets(scene, classification=classification)[1:-1, 1:-1].astype(np.float64)
    assert pixels[..., 3].min() < math.exp(-min((slices - 1) * tau, 30.0)) * 1.001
    error = np.abs(pixels[..., :3] + pixels[..., 3:] - 1.0).max()
    if slices == 15:
        record("A7", "emitted + transmitted light - 1, behind 15 sheets", error, 1e-6, width)
    record("A7", "emitted + transmitted light - 1, in units of n 2^-24", error / (slices * ULP), 1.0, width)
    rgba = columns(scene, classification=classification).astype(np.float64)
    unequal = np.abs(rgba[..., :3] - rgba[..., 3:]).max() / (slices * ULP)
    record("A7", "color - alpha of a white picture, in units of n 2^-24", unequal, 1.0, width)


@BY_CLASSIFICATION
def test_A8_a_denser_medium_hides_more_and_more_light_shows_more(record, width, way, classification, monkeypatch):
    random = np.random.default_rng(8)
    field = np.where(random.random((14, 14, 14)) < 0.5, 0.0, random.random((14, 14, 14)) * 0.4)
    field[0, 0, 0] = 0.9  # out of the way: the range of values, and so the table, stays the same
    quality = Quality(classification=classification, termination=0.0, depth_rule="simpson")

    def seen(field, **more):
        images = []
        with monkeypatch.context() as patch:
            patch.setattr(PIPELINE, "warp_steps", lambda made, *rest: images.extend(made) or warp_steps(made, *rest))
            render(STAGE.on_turntable(field, 35.0, 25.0, size=(24, 24), **more), quality)
        return images[0].pixels

    base = seen(field)
    for _ in range(4):
        more = field.copy()
        more[tuple(random.integers(1, 14, 3))] += 0.3
        added = seen(more)
        assert (added[..., 3] < base[..., 3]).any()
        record("A8", "rise of T where the medium is made denser", (added - base)[..., 3].max(), 0.0, width)
    brighter = replace(OPACITY_IS_VALUE, color=tuple((x, 1.2 * r, g, b + 0.1) for x, r, g, b in OPACITY_IS_VALUE.color))
    lit = seen(field, transfer_function=brighter)
    assert (lit[..., 3] == base[..., 3]).all()
    record("A8", "fall of C where emission is added", (base - lit)[..., :3].max(), 0.0, width)


@pytest.mark.parametrize("warp_filter", WARP_FILTERS)
@BY_CLASSIFICATION
def test_A9_color_never_exceeds_what_its_opacity_allows(record, width, warp_filter, way, classification):
    """A binary medium of HDR colors, so that the filters' negative lobes have something to overshoot."""
    random = np.random.default_rng(9)
    colors = ((0.0, 7.5, 0.0, 0.2), (1.0, 0.1, 2.0, 0.0))
    harsh = transfer(((0.5, 0.0), (0.5, 0.98)), color=colors)
    field = (random.random((16, 16, 16)) < 0.1) * 1.0
    for perspective in (False, True):
        scene = STAGE.on_turntable(field, 35.0, 25.0, perspective, size=(48, 48), transfer_function=harsh)
        rgba = STAGE.render(
            scene, warp_filter=warp_filter, sheet_density=1.0, termination=0.0, classification=classification
        ).rgba.astype(np.float64)
        assert rgba[..., 3].max() > 0.9
        over_bright = (rgba[..., :3] - 7.5 * rgba[..., 3:]).max()
        record("A9", "color beyond c_max * A after the warp", over_bright, 4 * 7.5 * ULP, width)
        record("A9", "color or alpha below 0, alpha above 1", max(-rgba.min(), rgba[..., 3].max() - 1.0), 0.0, width)


# --- A10, A11: kernels ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("width", "footprint"), ((DOUBLE, "tent"), *((SINGLE, name) for name in FOOTPRINTS)), indirect=("width",)
)
@pytest.mark.parametrize("rule", ("slice", "simpson", "gauss2"))
def test_A10_a_constant_volume_is_constant_at_every_sub_pixel_offset(record, width, footprint, way, rule):
    """Optical depth of every sheet pixel over the middle of a block, at 0.39 and 2.93 pixels a voxel."""
    block = np.zeros((20, 26, 26), np.uint8)
    block[4:-4, 1:-1, 1:-1] = 1
    scene = from_above(block, transfer(((0.0, 0.0), (1.0, -math.expm1(-0.05)))))
    for pixels in (76, 10):
        for moved in (0.0, 1 / 3, 0.5):
            camera = replace(scene.camera, shift_x=moved / pixels, shift_y=-0.3 * moved / pixels)
            quality = Quality(classification="pre", kernel=footprint, depth_rule=rule, termination=0.0)
            image, sheets = intermediate(replace(scene, camera=camera, width=pixels, height=pixels), quality)
            x, y = image.base_plane.points
            middle = np.ix_(np.abs(y - 12.5) < 8.0, np.abs(x - 12.5) < 8.0)
            tau = -np.log(image.pixels[..., 3][middle].astype(np.float64))
            assert tau.size >= 36 and sheets >= 14
            # T itself is float32: one rounding of it is this much of an optical depth of 0.6.
            stored = ULP / tau.mean()
            record(
                "A10",
                "relative ripple of optical depth in a constant block, beside 2^-24 of T",
                np.ptp(tau) / tau.mean() - 2.0 * stored,
                2e-6,
                width,
                looser="the sums of taps are float32: a rounding more for each",
            )
            if (footprint, rule) != ("gaussian", "slice"):
                record(
                    "A10",
                    "relative error of optical depth through a constant block, beside n 2^-24 of T",
                    abs(tau.mean() / 0.6 - 1.0) - sheets * stored,
                    1e-6,
                    width,
                )


def test_A10_the_gaussian_is_normalized_because_it_must(record):
    """The lattice sums of the footprints as they are: all but the Gaussian are one without division."""
    at = np.linspace(0.0, 1.0, 401)[:, None] + np.arange(-4, 5)
    for kind in range(5):
        ripple = np.ptp(footprint_values(kind, at).sum(axis=1))
        if kind == GAUSSIAN:
            assert ripple > 2e-4  # the premise of the normalization
        else:
            record(
                "A10",
                "ripple of the lattice sum of B-splines",
                ripple,
                1e-12,
                DOUBLE,
                why="weights are made in float64",
            )


@BY_CLASSIFICATION
def test_A11_a_finer_grid_converges_at_the_kernels_order(record, width, classification):
    """The same Gaussian blob on grids of 16, 32 and 64, seen by the same camera: differences fall by four."""

    def picture(count, depth_rule):
        h = 16.0 / count
        z, y, x = (np.indices((count,) * 3) + 0.5) * h - 8.0
        tau = 0.3 * np.exp(-0.5 * ((x - 0.6) ** 2 + (y + 0.9) ** 2 + z * z) / 1.8**2)
        scene = STAGE.on_turntable(-np.expm1(-tau), 0.0, 0.0, size=(40, 40), fit=0.8, spacing=(h, h, h))
        return STAGE.render(
            scene, sheet_density=4.0, depth_rule=depth_rule, termination=0.0, classification=classification
        ).rgba

    for rule in ("slice", "gauss2"):
        coarse, middle, fine = (picture(count, rule)[..., 3] for count in (16, 32, 64))
        order = math.log2(np.abs(coarse - middle).max() / np.abs(middle - fine).max())
        record("A11", "distance of the tent's observed order from 2", abs(order - 2.0), 0.15, width)


# --- A14, A15 -------------------------------------------------------------------------------------------------


def light_at(place, kind="POINT", **more):
    matrix = np.eye(4)
    matrix[:3, 3] = place
    return Light(kind, matrix_world=matrix, **more)


@pytest.mark.parametrize("kind", ("POINT", "SPOT", "AREA", "SUN"))
@BY_CLASSIFICATION
def test_A14_lights_none_two_at_a_voxel_and_inside(record, kind, classification):
    """Finite, never dark of a sudden, and the sum of what each gives; a light at a voxel is like one beside it."""
    field = FIELDS["smooth"](16)
    shaded = transfer(((0.0, 0.0), (1.0, 0.5)), shade=STAGE_SHADE)

    def lit(*lights):
        scene = STAGE.on_turntable(field, size=(32, 32), transfer_function=shaded, lights=lights)
        return STAGE.render(scene, warp_filter="bilinear", classification=classification).rgba

    none = lit()
    at, inside = light_at((8.0, 7.0, 9.0), kind, energy=50.0), light_at((7.6, 7.3, 8.2), kind, energy=50.0)
    pictures = {"none": none, "at": lit(at), "inside": lit(inside), "two": lit(at, inside), "same": lit(at, at)}
    not_finite = sum((~np.isfinite(picture)).sum() for picture in pictures.values())
    how = {"width": SINGLE, "why": LIT_BEFORE}
    record("A14", "numbers that are not finite", not_finite, 0, **how)
    assert none[..., :3].max() > 0.1 and all((p[..., 3] == none[..., 3]).all() for p in pictures.values())
    # P / (4 pi^2 d^2) with d at least half a voxel, or a sun's E / pi; diffuse and specular parts of one each at most.
    strongest = 50.0 / math.pi if kind == "SUN" else 50.0 / (4.0 * math.pi**2 * 0.25) * (4.0 if kind == "AREA" else 1.0)
    brightest = (pictures["at"][..., :3] - pictures["at"][..., 3:]).max() / (2.0 * strongest)
    record("A14", "light at a voxel, in units of what half a voxel's distance allows", brightest, 1.0, **how)
    darker = max((pictures[name] - pictures["two"]).max() for name in ("at", "inside"))
    if classification == "pre":
        record("A14", "fall of a color when a light is added", darker, 1e-6, **how)
    else:
        record("A14", "the same, post-classified", darker, 1 / 255, **how, looser=NEAREST)


@BY_CLASSIFICATION
def test_A15_jobs_that_interleave_share_a_store_and_no_result(record, classification):
    """A picture begun, its transfer function changed half-way and drawn again from the same store, then both ended."""
    volume = STAGE.volume(FIELDS["smooth"](14))
    first = STAGE.on_turntable(FIELDS["smooth"](14), size=(30, 30))
    changed = replace(OPACITY_IS_VALUE, opacity=((0.0, 0.0), (0.3, 0.9), (1.0, 0.1)))
    others = (
        replace(first, transfer_function=changed),
        replace(first, volume=replace(volume, slope=0.5)),
        replace(first, volume_matrix=first.volume_matrix @ np.diag((1.0, 1.5, 1.0, 1.0))),
        replace(first, lights=(Light("SUN"),), transfer_function=replace(OPACITY_IS_VALUE, shade=STAGE_SHADE)),
    )
    quality = Quality(classification=classification)
    fresh = [render(scene, quality).rgba for scene in (first, *others)]
    assert all((picture != fresh[0]).any() for picture in fresh[1:])
    wrong, most = 0, len(list(render_steps(first, quality)))
    for other, picture in zip(others, fresh[1:], strict=True):
        for steps in range(1, most, 3):
            store = StageCache()
            begun = render_steps(first, quality, cache=store)
            for _ in range(steps):
                next(begun)
            wrong += (render(other, quality, cache=store).rgba != picture).any()
            wrong += (drain(begun).rgba != fresh[0]).any()
            wrong += (render(other, quality, cache=store).rgba != picture).any()
    record("A15", "stale pictures of jobs that interleave", wrong, 0, SINGLE, why="sums are not stored")
