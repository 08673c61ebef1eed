"""Kernels and their reference implementations, K1 to K7: what once set them apart, and what may.

The searches of scenes compare both ray by ray (``references.Splat.differences``); each cause that they found of a ray
that differs has a case here, where it is either gone or held to what it can do, against a closed form.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from rle_splat.classify.transfer_function import Shade
from rle_splat.effects.depth_layers import REACH
from rle_splat.encode import encode_kernels, reference
from rle_splat.encode.records import decoding_of, empty_records, unpack
from rle_splat.runtime.jit import compiled, run_either
from rle_splat.runtime.steps import drain
from rle_splat.scene import Quality
from rle_splat.volume.volume import Volume
from tests.stability.references import NUDGE, STEPS, Splat, by_stages, tables_apart
from tests.stability.scenes import EXACT, from_above, sheets, transfer, turned, unlike
from tests.stability.strategies import smooth_field
from tests.ways import both

pytestmark = pytest.mark.skipif(not compiled(), reason="kernels are what is compared")
VALUE_IS_OPACITY = ((0.0, 0.0), (1.0, 1.0))
DEPTH_OF_ONE = 24.0 * math.log(2.0)  # optical depth of an opacity of one, per opacity distance
WHOLE = "whole numbers"
CODES = "codes are whole numbers"
HALF = "the least transmittance is float32, and two float64 ones never fall to either side of it"
FINER = (2, 3, 6, 7, 10, 14)  # sheet pixels a voxel


def splat_of(scene, quality=EXACT, **knobs) -> Splat:
    """The one base plane of a scene."""
    _, (splat,), _ = by_stages(scene, replace(quality, **knobs))
    return splat


def finer(scene, times: int):
    return replace(scene, width=times * scene.width, height=times * scene.height)


def positions(splat) -> tuple[np.ndarray, np.ndarray]:
    """Where the sheet pixels of parallel rays down z lie among columns and rows of voxels."""
    plane = splat.given["plane"]
    sizes = plane.width, plane.height
    return tuple((np.arange(size) - plane.offset[0, n]) / plane.scale[0, n] for n, size in enumerate(sizes))


def moved(splat, along: float) -> Splat:
    """The same by the kernels, every ray ``along`` voxels further."""
    plane = splat.given["plane"]
    given = {**splat.given, "plane": replace(plane, offset=plane.offset - np.array((along, 0.0)) * plane.scale)}
    return Splat(splat.steps, given, drain(splat.steps(**given)), splat.most)


@pytest.mark.parametrize("kernel", ("nearest", "gaussian"))
def test_K1_rays_on_the_step_where_a_footprint_ends(record, kernel):
    """Where a box ends, halfway between two voxels, or a Gaussian is cut, kernels and reference implementation took
    different sides, as one divided and the other multiplied by an inverse: now both compute the position of a ray by
    the same rounded steps."""
    opacities = np.random.default_rng(1).uniform(0.05, 0.9, (3, 8, 9))
    on_steps = 0
    for times in FINER:
        scene = finer(from_above(opacities, transfer(VALUE_IS_OPACITY)), times)
        splat = splat_of(scene, kernel=kernel, sheet_density=1.0)
        steps = 0.5 if kernel == "nearest" else 0.0
        x, y = positions(splat)
        on_steps += sum(int((abs((position + steps + 0.5) % 1.0 - 0.5) < 1e-12).sum()) for position in (x, y))
        differences = splat.differences()
        unlike = differences.ends + differences.edges + differences.odd
        claim = f"rays on different sides of a step in kernels and reference implementation, {kernel}"
        record("K1", claim, unlike, 0)
        if kernel != "nearest":
            continue
        depth = np.pad(-np.log1p(-opacities).sum(axis=0), 1)  # nothing around
        row, column = (np.clip(np.floor(p + 0.5).astype(int) + 1, 0, n + 1) for p, n in ((y, 8), (x, 9)))
        off = abs(splat.image.pixels[..., 3] - np.exp(-depth[np.ix_(row, column)])).max()
        record("K1", "error of the transmittance of the voxel that a ray is in", off, 5e-7)
    assert on_steps > 50


CODED = 256


def coded(numbers, channel: int, size: int):
    """Codes of records whose ``channel``, red or density, is ``numbers``, and what is made of them again."""
    records = np.zeros((len(numbers), 4), np.float32)
    records[:, 3] = 1.0
    records[:, channel] = numbers
    decoding, codes = decoding_of(size, 1.0, 1.0), empty_records(size, len(numbers))
    run_either(0, encode_kernels.pack, reference.pack, records, 1.0 / decoding.astype(np.float64), codes)
    return codes.reshape(len(numbers), -1), unpack(codes, decoding)[:, channel]


@pytest.mark.parametrize("size", STEPS)
def test_K2_a_number_on_the_middle_between_two_codes(record, size):
    """Two numbers a rounding apart may have different codes, of which there is no getting rid: neighbors at least, and
    the same number has the same code from both.  The middles are found by halving, from the codes alone."""
    for channel, step in zip((0, 3), STEPS[size], strict=True):
        low = np.random.default_rng(size).uniform(0.1, 0.9, CODED).astype(np.float32).view(np.int32)
        first, _ = coded(low.view(np.float32), channel, size)
        high = (low.view(np.float32) + np.float32(0.02)).view(np.int32)
        assert (coded(high.view(np.float32), channel, size)[0] != first).any(axis=1).all()
        while (high - low).max() > 1:
            middle = (low + high) // 2
            same = (coded(middle.view(np.float32), channel, size)[0] == first).all(axis=1)
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        jump = 0.0
        for side in (low, high):
            one, two = (codes for codes, _ in both(partial(coded, side.view(np.float32), channel, size)))
            claim = "codes of one number that differ between kernels and reference implementation"
            record("K2", claim, unlike(one, two), 0, "either", WHOLE)
            jump = coded(side.view(np.float32), channel, size)[1] - jump
        jump = jump / (1.0 if channel == 0 else high.view(np.float32))
        claim = f"what a rounding may change, in steps of a code, {size} bytes"
        record("K2", claim, jump.max() / step, 1.01, "either", CODES)


@pytest.mark.parametrize("size", STEPS)
def test_K2_lit_records_are_a_code_apart_at_most(record, size):
    volume = Volume(smooth_field((24, 24, 24), np.random.default_rng(2)), np.eye(4))
    scene = replace(turned(volume, transfer(VALUE_IS_OPACITY, shade=Shade())), headlight=True)
    plan = Quality(classification="pre", record=size)
    one, two = (splat.given["encoded"] for splat in both(partial(splat_of, scene, plan)))
    unlike_tables, _ = tables_apart(one, two)
    claim = "tables of lit media that differ between kernels and reference implementation"
    record("K2", claim, unlike_tables, 0, "either", WHOLE)
    (ours, theirs), (of_color, of_density) = (one.decoded(), two.decoded()), STEPS[size]
    kept = ours[:, 3] > 0.0
    assert (kept == (theirs[:, 3] > 0.0)).all()
    ours, theirs = ours[kept], theirs[kept]
    off = abs(ours[:, 3] - theirs[:, 3]) / (of_density * ours[:, 3])
    record("K2", f"densities of lit records apart, in steps of a code, {size} bytes", off.max(), 1.01, "either", CODES)
    shares = [each[:, :3] / each[:, 3:] for each in (ours, theirs)]
    off = abs(shares[0] - shares[1]).max() / (of_color * one.most_color)
    record("K2", f"colors of lit records apart, in steps of a code, {size} bytes", off, 1.01, "either", CODES)


def test_K3_a_ray_that_ends_a_sheet_sooner(record):
    """Behind four sheets transmittances are a rounding apart, and rays end at the larger of the two: one goes on."""
    alphas, ended = np.linspace(0.2, 0.6, 64), 0
    front = np.tile(alphas, (4, 2, 1))
    scene = from_above(np.concatenate((np.full((3, 2, 64), 0.5), front)), transfer(VALUE_IS_OPACITY))
    behind = [seen[0, :, 3] for seen in both(partial(sheets, from_above(front, transfer(VALUE_IS_OPACITY))))]
    apart = np.flatnonzero(behind[0] != behind[1])[:5]
    exact = 1.0 - (1.0 - alphas) ** 4 * 0.5**3
    for n in apart:
        least = float(max(pixel[n] for pixel in behind))
        splat = splat_of(scene, termination=least)
        differences = splat.differences()
        ended += differences.ends
        claim = "rays that one of the two ended sooner, beyond what the plan's termination allows"
        record("K3", claim, differences.odd, 0, "float32", HALF)
        for image in (splat.image.pixels, splat.by_reference()):
            u, v = (-o for o in splat.given["plane"].origin)
            off = (exact[n] - image[v, u + n, :3]).max() / least
            record("K3", "error of either, in units of T_min", off, 1.0 + 1e-4, "float32", HALF)
    assert ended > 0


BEYOND = (0.0, 1e-9, 1e-8, 3e-8, 1e-7, 3e-7, 1e-6)  # voxels


@pytest.mark.parametrize("dense", (1.0, 1e6, 1e14))
def test_K4_a_ray_that_touches_the_end_of_a_medium_dense_beyond_measure(record, width, dense):
    """Of the last ten-millionth of a voxel a ray may see all or nothing: shares of voxels are float32.  Either is what
    a ray sees that is moved by 2^-22 of a voxel."""
    function = transfer(((0.0, 1.0),), distance=1.0 / dense)
    splat, seen = splat_of(finer(from_above(np.ones((3, 5, 6)), function), 7), sheet_density=1.0), 0
    for beyond in (*BEYOND, *(-b for b in BEYOND)):
        for end in (0.0, 1.0 / 7.0):  # sheet pixels lie at sevenths of a voxel
            ray = moved(splat, end + beyond)
            differences, (x, y) = ray.differences(), positions(ray)
            seen += differences.edges
            claim = "rays at the end of a dense medium that differ by more than the reference implementation's so moved"
            record("K4", claim, differences.odd, 0, width)
            inside = (y > 0.01) & (y < 3.99)
            shares = [np.clip(np.minimum(x + 1.0, 6.0 - x) + side, 0.0, 1.0) for side in (-NUDGE, NUDGE)]
            most, least = (np.exp(-3.0 * DEPTH_OF_ONE * dense * share) for share in shares)
            for image in (ray.image.pixels, ray.by_reference()):
                transmittance = image[inside][..., 3]
                off = np.maximum(least - transmittance, transmittance - most).max()
                record("K4", "transmittance beyond that of rays moved by 2^-22 of a voxel", off, 1e-6, width)
    assert seen > 0 or dense == 1.0


def test_K5_a_value_on_the_edge_of_an_entry_of_the_table(record, width):
    """A constant that float32 rounds to either side of an entry: where the function is a peak a thousand of its
    roundings wide, an entry is a level and more.  Either is what a value shows that is 2^-22 of itself further."""
    value, half, seen = 104.5415, 5e-3, 0
    function = transfer(((value - half, 0.0), (value, 1.0), (value + half, 0.0)), distance=30.0)
    for more in np.arange(0.0, 4e-3, 5e-4):
        voxels = np.full((4, 7, 8), value + more, np.float32)
        voxels[0, 0, 0] = value - 2.0 * half  # so that the table has a range
        plan = Quality(classification="post", depth_rule="slice", sheet_density=1.0)
        splat = splat_of(finer(from_above(voxels, function), 7), plan)
        differences, (x, y), stored = splat.differences(), positions(splat), float(voxels[1, 1, 1])
        seen += differences.edges
        claim = "rays that differ by more than the reference implementation's of values so moved"
        record("K5", claim, differences.odd, 0, width)
        unsure = NUDGE * stored + 1.0 / splat.given["table"].rate
        near = np.array([max(abs(stored - value) - unsure, 0.0), abs(stored - value) + unsure])
        most, least = (1.0 - np.clip(1.0 - near[::-1] / half, 0.0, 1.0 - 2.0**-24)) ** (3.0 / 30.0)
        inside = np.ix_((y > 1.01) & (y < 5.99), (x > 1.01) & (x < 6.99))
        for image in (splat.image.pixels, splat.by_reference()):
            transmittance = image[inside][..., 3]
            off = np.maximum(least - transmittance, transmittance - most).max()
            claim = "transmittance beyond that of values 2^-22 of themselves and an entry further"
            record("K5", claim, off, 1e-6, width)
    assert seen > 0


@pytest.mark.parametrize("kernel", ("bspline2", "bspline3", "gaussian"))
def test_K6_opacities_that_add_up_to_one_over_a_small_part_of_their_length(record, kernel):
    """float32 knows what is left of an opacity of one to 2^-24 of it, and the power of a short length makes that large.
    Either is what a medium shows that is 2^-22 of itself denser or thinner."""
    seen, power = 0, 1.0 / 16.0
    function = transfer(((0.0, 1.0),), distance=1.0 / power)
    for times in FINER:
        splat = splat_of(
            finer(from_above(np.ones((5, 7, 8)), function), times), kernel=kernel, sheet_density=1.0, model="opacity",
            depth_rule="midpoint-1",
        )  # fmt: skip
        differences, (x, y) = splat.differences(), positions(splat)
        seen += differences.edges
        claim = "rays through opacities of one that differ by more than the reference implementation's so much denser"
        record("K6", claim, differences.odd, 0)
        if kernel == "bspline2":  # of the first and the last sheet half, and four of nearly one
            inside = np.ix_((y > 1.51) & (y < 4.49), (x > 1.51) & (x < 5.49))
            most, least = (0.5**2 * left**4 for left in (2.0**-24, 2.0**-22 + 2.0**-24))
            for image in (splat.image.pixels, splat.by_reference()):
                transmittance = image[inside][..., 3]
                off = np.maximum(most**power - transmittance, transmittance - least**power).max()
                record("K6", "transmittance beyond that of opacities from 1 - 2^-24 to 1 - 2^-22", off, 1e-6)
    assert seen > 0


EDGE = 12  # voxels of each column, from the first, that a mesh lies behind


def test_K7_rays_past_a_silhouette_that_end_as_those_before_it(record, width):
    """What lies behind a mesh's silhouette is a second picture, and what ends in it as in the first is taken from
    there: rays that nobody had given it to splat were held against the reference's as if its kernels had made them."""
    share, (before, slices) = 0.3, (3, 6)
    (left, right), (low, high), z = (-50.0, 50.0), (-50.0, EDGE - 0.5), slices - before - 0.5
    corners = np.array(((left, low, z), (right, low, z), (right, high, z), (left, high, z)))
    scene = from_above(
        np.full((slices, 30, 20), share), transfer(VALUE_IS_OPACITY), triangles=corners[[(0, 1, 2), (0, 2, 3)]]
    )
    _, splats, _ = by_stages(scene, EXACT)
    filled, kinds = 0, set()
    for splat, side in zip(splats, (REACH + 1, -REACH - 1), strict=True):  # past the edge, and short of it
        differences, (x, y) = splat.differences(), positions(splat)
        filled += int((splat.image.pixels != splat.pixels).any(axis=-1).sum())
        unlike = differences.ends + differences.edges + differences.odd
        claim = "rays of either picture that differ between kernels and reference implementation"
        record("K7", claim, unlike, 0, width)
        inside = np.ix_((y > -0.01) & (y < 29.01), (x > -0.01) & (x < 19.01))
        ends = y[inside[0].ravel()] < EDGE + side
        kinds |= set(ends)
        expected = (1.0 - share) ** np.where(ends, before, slices)[:, None]
        off = abs(splat.image.pixels[inside][..., 3] - expected).max()
        record("K7", "error of the transmittance of either picture, filled in", off, 1e-6, width)
    assert filled > 0 and kinds == {True, False}
