"""Samples of sheets are lit as ``shade.sample_light`` says: kernels against numpy for each kind of lamp, material and
world, near and far, for sheets in groups and alone; and to the bit for any number of threads."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.lookup_table import lookup_table
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.classify.visible import VisibleVoxels
from rle_splat.encode.scalars import ScalarVolume, in_scanlines, scalar_table_steps
from rle_splat.runtime.steps import drain
from rle_splat.scene import Environment, Quality
from rle_splat.shade.lighting import lighting
from rle_splat.shade.sample_light import NORMAL, ONE, sample_light
from rle_splat.splat import scalar_splat
from rle_splat.view.base_plane import base_plane
from rle_splat.view.eye import index_view
from rle_splat.view.principal_axis import candidate_pyramids
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from tests.lamps import LAMPS
from tests.ways import both

SHAPE = (13, 15, 37)  # z, y, x
# Of any value the same, so that rounding does not count; and a ramp.
EVEN = TransferFunction("even", None, ((-1.0, 0.3), (2.0, 0.3)), ((0.0, 0.9, 0.3, 0.1),), 1.0)
RAMP = TransferFunction("ramp", None, ((0.2, 0.0), (1.0, 0.4)), ((0.0, 0.9, 0.3, 0.1), (1.0, 0.3, 0.4, 1.0)), 1.0)
SHADE = Shade(ambient=0.2, diffuse=0.7, specular=0.4, shininess=12.5)
SIDE = 40
ALONE, TOGETHER, BETWEEN = "slice", "midpoint-4", "preintegrated"  # each sheet has its own slab, or is the end of one
ALL = tuple(LAMPS.values())
MATERIALS = {
    "matt": replace(SHADE, specular=0.0), "one-sided": replace(SHADE, two_sided=False), "two-sided": SHADE,
    "flat": replace(SHADE, shininess=0.5), "sharp": replace(SHADE, shininess=1000.0),
    "mirror": replace(SHADE, shininess=1e9),
}  # fmt: skip


def voxels_of(volume, kept) -> VisibleVoxels:
    """Those voxels that are kept, (z, y, x) bool."""
    rows = kept.reshape(-1, kept.shape[2])
    pieces = (np.diff(rows.astype(np.int8), axis=1, prepend=0) > 0).sum(axis=1).astype(np.int32)
    row_start = np.append(0, np.cumsum(rows.sum(axis=1))).astype(np.int64)
    column = np.nonzero(rows)[1].astype(np.uint16)
    return VisibleVoxels(volume.shape_xyz, row_start, pieces, column, volume.voxels[kept], 0)


def splatted(
    shade, lights=(), casting=(), opened=False, perspective=False, threads=0, azimuth=35.0, rule=ALONE, thinned=False,
    indirect=0.0, termination=1e-6, function=EVEN, **around,
):  # fmt: skip
    """The largest base plane of a small picture of kept voxels at random, whose codes are random, too."""
    random = np.random.default_rng(5)
    volume = Volume(random.random(SHAPE, np.float32), np.diag((0.2, 1.1, 0.9, 1.0)))
    camera, matrix = turntable(volume, azimuth, 25.0, 1.0, perspective, 40.0)
    to_world = matrix @ volume.affine
    eye = np.append(camera.matrix_world[:3, 3], 1.0) if perspective else np.append(camera.matrix_world[:3, 2], 0.0)
    falling = lighting(to_world, shade, lights, eye=eye, **around)
    light = None if falling is None else sample_light(falling, volume.shape_xyz, casting, opened, indirect)
    kept = random.random(SHAPE) < 0.97
    voxels = voxels_of(volume, kept)
    codes = random.normal(0.0, 0.5, (len(voxels), thinned + (0 if light is None else light.planes))).clip(-1.0, 1.0)
    codes[:, NORMAL:] = np.abs(codes[:, NORMAL:])
    codes[::3, :NORMAL] = 0.0
    if thinned:
        codes[:, -1] = random.random(len(voxels))
    codes = np.rint(codes * ONE).astype(np.int16) if codes.size else None
    view = index_view(camera, to_world, SIDE, SIDE)
    planes = (base_plane(view, volume.shape_xyz, *one, rule, 1.0, boxed=True) for one in candidate_pyramids(view))
    plane = max((one for one in planes if one is not None), key=lambda one: one.width * one.height)
    tables = drain(scalar_table_steps(voxels, plane.axis))
    scalars = drain(in_scanlines(tables, voxels, voxels.stored))
    codes = None if codes is None else drain(in_scanlines(tables, voxels, codes.view(np.uint16))).view(np.int16)
    encoded = ScalarVolume(tables, scalars, 0.0, codes, light, thinned)
    quality = Quality(classification="post", termination=termination, threads=threads)
    table = lookup_table(volume, function, (0.0, 1.0), 1.0)
    return drain(scalar_splat.scalar_splat_steps(encoded, table, plane, quality)).pixels


def agree(*arguments, within=3e-5, **how):
    """What kernels make of the arguments of ``splatted``, which must be what numpy does.

    A sample whose value is rounded differently may have another entry of the lookup table, or count for nothing: one
    pixel of a thousand may be as wrong as that.
    """
    kernels, reference = both(lambda: splatted(*arguments, **how))
    assert reference[..., 3].min() < 0.5 and np.isfinite(reference).all()
    errors = np.abs(kernels - reference) / max(1.0, reference.max())
    assert errors.max() < 1e-2 and np.quantile(errors.max(axis=-1), 0.999) < within
    return kernels


@pytest.mark.parametrize("number, kind", list(enumerate(LAMPS)))
def test_kinds_of_lamps(number, kind):
    perspective = bool(number % 2)
    lit = agree(SHADE, (LAMPS[kind],), perspective=perspective, rule=BETWEEN)
    other = splatted(SHADE, headlight_direction=(0.0, 0.0, 1.0), perspective=perspective, rule=BETWEEN)
    assert np.abs(lit - other).max() > 0.1


@pytest.mark.parametrize("name", MATERIALS)
def test_materials(name):
    how = dict(lights=ALL, headlight_direction=(0.6, 0.0, 0.8), perspective=True)
    lit = agree(MATERIALS[name], **how, within=1e-4)
    assert np.abs(lit - splatted(replace(SHADE, specular=0.3), **how)).max() > 1e-3


@pytest.mark.parametrize(
    ("rule", "azimuth"), ((ALONE, 0.0), (ALONE, 200.0), (TOGETHER, 80.0), (BETWEEN, 80.0), (BETWEEN, 200.0))
)
def test_shadows_and_occlusion(rule, azimuth):
    how = dict(lights=ALL, rule=rule, azimuth=azimuth, perspective=azimuth > 100.0, function=RAMP)
    shadowed = agree(SHADE, casting=(3, 1), opened=True, **how, within=1e-4)
    assert shadowed[..., :3].sum() < 0.8 * splatted(SHADE, **how)[..., :3].sum()


@pytest.mark.parametrize(("rule", "perspective"), ((ALONE, True), (TOGETHER, False), (BETWEEN, False), (BETWEEN, True)))
def test_indirect_light(rule, perspective):
    """Of lamps that cast shadows, near and far; the amount counts, and without any such lamp it does not."""
    how = dict(lights=ALL, rule=rule, perspective=perspective, function=RAMP, opened=True)
    whole = agree(SHADE, casting=(3, 0), indirect=1.0, **how, within=1e-4)
    half, none = (splatted(SHADE, casting=(3, 0), indirect=amount, **how) for amount in (0.5, 0.0))
    assert np.abs(whole - half).max() > 3e-3 < np.abs(half - none).max()
    np.testing.assert_array_equal(splatted(SHADE, indirect=1.0, **how), splatted(SHADE, **how))


def test_many_lamps_that_scatter_along_x():
    """Codes of more than 16 bytes, in the order of principal axis x, too."""
    agree(SHADE, ALL, casting=(0, 1, 2, 3), opened=True, indirect=1.0, azimuth=80.0, function=RAMP, within=1e-4)


@pytest.mark.parametrize("rule", (TOGETHER, BETWEEN))
def test_thinned(rule):
    lit = agree(SHADE, (LAMPS["sun"],), casting=(0,), rule=rule, thinned=True)
    assert lit[..., 3].mean() > splatted(SHADE, (LAMPS["sun"],), casting=(0,), rule=rule)[..., 3].mean() + 0.05
    assert np.abs(lit - agree(None, rule=rule, thinned=True)).max() > 0.1


@pytest.mark.parametrize("rule", (TOGETHER, BETWEEN))
def test_a_world_that_differs_by_direction(rule):
    random = np.random.default_rng(2)
    second = random.normal(0.0, 0.1, (3, 3, 3))
    second = second + second.swapaxes(0, 1)
    second -= np.multiply.outer(np.eye(3), np.trace(second) / 3.0)
    around = Environment(random.normal(0.0, 0.2, (3, 3)), second)
    world = agree(SHADE, world=(0.5, 0.6, 0.4), environment=around, opened=True, rule=rule)
    assert np.abs(world - splatted(SHADE, world=(0.5, 0.6, 0.4), opened=True, rule=rule)).max() > 1e-3


@pytest.mark.parametrize("rule", (ALONE, TOGETHER, BETWEEN))
def test_without_light(rule):
    agree(None, rule=rule, function=RAMP, within=1e-4)


@pytest.mark.parametrize("rule", (ALONE, TOGETHER, BETWEEN))
def test_light_that_samples_share_errs_by_little(rule):
    """Samples that weigh ``LEAST`` terminations together may have the light of one of them."""
    agree(SHADE, ALL, casting=(2,), rule=rule, termination=1e-3, within=4e-3)


@pytest.mark.parametrize("rule", (TOGETHER, BETWEEN))
def test_any_number_of_threads(rule):
    how = dict(casting=(0, 4), perspective=True, rule=rule, termination=1e-3)
    one, *others = (splatted(SHADE, ALL, threads=threads, **how) for threads in (1, 2, 4))
    assert all((one == other).all() for other in others)
