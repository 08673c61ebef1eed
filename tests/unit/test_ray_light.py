"""Single rays are lit as ``shade.sample_light`` says: kernels against numpy for each kind of lamp, material and world,
near and far, with shadows and occlusion; and to the bit for any number of threads."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.lookup_table import lookup_table
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.raycast.rays import RowVoxels, bricks_of, rays_through
from rle_splat.raycast.trace import trace
from rle_splat.runtime.jit import read_only
from rle_splat.scene import Environment, Quality
from rle_splat.shade.lighting import lighting
from rle_splat.shade.sample_light import ONE, sample_light
from rle_splat.view.base_plane import base_plane
from rle_splat.view.eye import index_view
from rle_splat.view.principal_axis import candidate_pyramids, dominant_axis
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from tests.lamps import LAMPS
from tests.ways import both

SHAPE = (13, 15, 70)  # z, y, x: rows of more than a word of bits
FUNCTION = TransferFunction("all", None, ((0.2, 0.0), (1.0, 0.5)), ((0.0, 0.9, 0.3, 0.1), (1.0, 0.3, 0.4, 1.0)), 1.0)
SHADE = Shade(ambient=0.2, diffuse=0.7, specular=0.4, shininess=12.5)
SIDE = 20
MATERIALS = {
    "matt": replace(SHADE, specular=0.0), "two-sided": replace(SHADE, two_sided=True),
    "sharp": replace(SHADE, shininess=1e9),
}  # fmt: skip


def traced(
    shade, lights=(), casting=(), opened=False, perspective=False, threads=0, axis=(35.0, 25.0), indirect=0.0, **around
):
    """The rays of a small picture through kept voxels at random, whose codes are random, too."""
    random = np.random.default_rng(5)
    volume = Volume(random.random(SHAPE, np.float32), np.diag((0.2, 1.1, 0.9, 1.0)))
    shape = volume.shape_xyz
    camera, matrix = turntable(volume, *axis, 1.0, perspective, 40.0)
    to_world = matrix @ volume.affine
    eye = np.append(camera.matrix_world[:3, 3], 1.0) if perspective else np.append(camera.matrix_world[:3, 2], 0.0)
    falling = lighting(to_world, shade, lights, eye=eye, **around)
    light = None if falling is None else sample_light(falling, shape, casting, opened, indirect)
    kept = random.random(SHAPE) < 0.97
    rows = kept.reshape(-1, shape[0])
    bits = np.zeros((len(rows), -(-shape[0] // 64) * 64), bool)
    bits[:, : shape[0]] = rows
    bits = np.packbits(bits, axis=1, bitorder="little").view(np.uint64)
    codes = random.normal(0.0, 0.5, (rows.sum(), 0 if light is None else light.planes)).clip(-1.0, 1.0)
    codes[:, 3:] = np.abs(codes[:, 3:])
    codes[::3] = 0
    row_start = np.append(0, np.cumsum(rows.sum(axis=1)))
    voxels = RowVoxels(
        read_only(bits), read_only(row_start), bricks_of(bits, shape), volume.voxels[kept],
        read_only(np.rint(codes * ONE).astype(np.int16)), np.array([(0.2, 1.0)]), SHAPE,
    )  # fmt: skip
    view = index_view(camera, to_world, SIDE, SIDE)
    down, right = np.divmod(np.arange(SIDE**2), SIDE)
    axes, signs = dominant_axis(view.ray_directions(right + 0.5, down + 0.5))
    table, found = lookup_table(volume, FUNCTION, (0.0, 1.0), 1.0), np.zeros((SIDE**2, 4), np.float32)
    for number, sign in candidate_pyramids(view):
        mine = np.flatnonzero((axes == number) & (signs == sign))
        plane = base_plane(view, shape, number, sign, "slice", 1.0, boxed=True) if len(mine) else None
        if plane is not None:
            rays = rays_through(plane, view, shape, right[mine] + 0.5, down[mine] + 0.5, (0.0, 1e9))
            quality = Quality(classification="post", termination=1e-6, threads=threads)
            found[mine] = trace(voxels, 0.0, table, rays, 3, quality, light)[0]
    return found


def agree(*arguments, **how):
    kernels, reference = both(lambda: traced(*arguments, **how))
    assert reference[..., 3].max() > 0.5 and np.isfinite(reference).all()
    assert np.abs(kernels - reference).max() < 2e-6 * max(1.0, reference.max())
    return kernels


@pytest.mark.parametrize("number, kind", list(enumerate(LAMPS)))
def test_kinds_of_lamps(number, kind):
    lit = agree(SHADE, (LAMPS[kind],), perspective=number % 2 == 0)
    assert np.abs(lit - traced(SHADE, (LAMPS["sun"],), headlight_direction=(0.0, 0.0, 1.0))).max() > 0.1


@pytest.mark.parametrize("name", MATERIALS)
def test_materials(name):
    lit = agree(MATERIALS[name], tuple(LAMPS.values()), headlight_direction=(0.6, 0.0, 0.8), perspective=True)
    assert np.abs(lit - traced(SHADE, tuple(LAMPS.values()), perspective=True)).max() > 1e-3


def test_shadows_and_occlusion():
    lights = tuple(LAMPS.values())
    open_to_all = agree(SHADE, lights)
    shadowed = agree(SHADE, lights, casting=(3, 1), opened=True)
    assert shadowed[..., :3].sum() < 0.8 * open_to_all[..., :3].sum()


def test_indirect_light():
    how = dict(casting=(3, 0), opened=True, perspective=True)
    whole = agree(SHADE, tuple(LAMPS.values()), indirect=1.0, **how)
    assert np.abs(whole - traced(SHADE, tuple(LAMPS.values()), **how)).max() > 0.01


def test_a_world_that_differs_by_direction():
    random = np.random.default_rng(2)
    second = random.normal(0.0, 0.1, (3, 3, 3))
    second = second + second.swapaxes(0, 1)
    second -= np.multiply.outer(np.eye(3), np.trace(second) / 3.0)
    around = Environment(random.normal(0.0, 0.2, (3, 3)), second)
    world = agree(SHADE, world=(0.5, 0.6, 0.4), environment=around, opened=True)
    assert np.abs(world - traced(SHADE, world=(0.5, 0.6, 0.4), opened=True)).max() > 1e-3


def test_without_light():
    agree(None)


def test_any_number_of_threads():
    lights = tuple(LAMPS.values())
    one, more = (traced(SHADE, lights, (0, 4), perspective=True, threads=threads) for threads in (1, 0))
    assert (one == more).all()
