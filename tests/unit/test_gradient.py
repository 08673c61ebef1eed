"""Normals against analytic fields under any affine (catalogue C9; V8 and V13 are in tests/stability)."""

import numpy as np
import pytest

from rle_splat.accuracy.normals import normals_at
from rle_splat.volume.gradient import unit_normals
from rle_splat.volume.volume import Volume
from tests.ways import BY_TYPE, EVERY_TYPE, RARE_TYPES, both, by

AFFINES = {
    "plain": np.eye(4),
    "anisotropic": np.diag((0.5, 2.0, 7.0, 1.0)),
    "mirrored": np.diag((1.0, -1.0, 1.5, 1.0)),
    "sheared": np.array([[1.0, 0.7, -0.2, 9.0], [0.1, 1.2, 0.5, -4.0], [0.0, 0.3, 0.8, 1.0], [0, 0, 0, 1.0]]),
    "turned": np.array([[0.36, 0.48, -0.8, 1e3], [-0.8, 0.6, 0.0, 0], [0.48, 0.64, 0.6, 0], [0, 0, 0, 1.0]]),
}


def everywhere(volume):
    """Row starts and columns that name every voxel."""
    nx, ny, nz = volume.shape_xyz
    return np.arange(nz * ny + 1, dtype=np.int64) * nx, np.tile(np.arange(nx, dtype=np.uint16), nz * ny)


def all_normals(voxels, affine=AFFINES["plain"], slope=1.0):
    volume = Volume(voxels, np.eye(4), slope=slope)
    return unit_normals(volume, *everywhere(volume), affine).reshape(*voxels.shape, 3)


@pytest.mark.parametrize(
    ("name", "dtype", "way"),
    [(name, *how) for a, name in enumerate(AFFINES) for b, how in enumerate(BY_TYPE) if (a + b) % 2],
    indirect=["way"],
)
def test_a_linear_field_has_its_normal_everywhere_faces_too(name, dtype, way):
    affine = AFFINES[name]
    z, y, x = np.indices((4, 5, 6))
    voxels = (3 * x - 2 * y + 5 * z + 20).astype(dtype)
    # The field's value at a world point is g . point: g solves linear^T g = index gradient.
    truth = np.linalg.solve(affine[:3, :3].T, (3.0, -2.0, 5.0))
    truth /= np.linalg.norm(truth)
    for slope in (2.0, -0.001):
        got = all_normals(voxels, affine, slope)
        np.testing.assert_allclose(got, np.broadcast_to(truth * np.sign(slope), got.shape), atol=2e-7)


@pytest.mark.parametrize("dtype", [dtype for dtype in EVERY_TYPE if dtype not in RARE_TYPES])
def test_kernel_and_reference_agree(dtype):
    voxels = np.random.default_rng(2).integers(0, 100, (6, 7, 8)).astype(dtype)
    one, two = both(lambda: all_normals(voxels, AFFINES["sheared"]))
    np.testing.assert_allclose(one, two, atol=1e-6)
    assert (np.abs(np.linalg.norm(one, axis=-1) - 1.0) < 1e-6).mean() > 0.9


@pytest.mark.parametrize("shape", ((6, 7, 8), (1, 5, 4), (3, 1, 2)))
@pytest.mark.parametrize("dtype", EVERY_TYPE)
def test_the_references_have_the_same_normals_by_code_of_their_own(dtype, shape):
    voxels = np.random.default_rng(2).integers(0, 100, shape).astype(dtype)
    voxels[:, 3:] = 7  # no normal in there
    if dtype.startswith("float"):
        voxels[0, 0, :2] = np.nan, np.inf
        voxels[-1] *= 1e30
    indices = tuple(np.indices(shape).reshape(3, -1))
    found = normals_at(Volume(voxels, np.eye(4), slope=-2.0), indices, AFFINES["sheared"])
    with by("numpy" if dtype in RARE_TYPES else "numba"):
        expected = all_normals(voxels, AFFINES["sheared"], slope=-2.0)
    np.testing.assert_allclose(found, expected.reshape(-1, 3), atol=1e-6)


def test_the_normal_does_not_know_the_scale_of_world_or_values(way):
    voxels = np.random.default_rng(2).random((5, 5, 5)).astype(np.float32)
    truth = all_normals(voxels, AFFINES["sheared"])
    for scale in (1e-12, 1e12, 1e-130, 1e130):
        np.testing.assert_allclose(all_normals(voxels, AFFINES["sheared"] * scale), truth, atol=1e-6)
    faint = voxels * np.float32(2.0**-60)
    np.testing.assert_allclose(all_normals(faint, AFFINES["sheared"]), truth, atol=1e-6)


def test_neighbors_that_are_not_finite_do_no_harm(way):
    x = np.indices((5, 5, 5))[2].astype(np.float32)
    for bad in (np.nan, np.inf, -np.inf):
        voxels = x.copy()
        voxels[2, 2, 2] = bad
        got = all_normals(voxels)
        np.testing.assert_allclose(got, np.broadcast_to((1, 0, 0), got.shape), atol=1e-6)
    lost = all_normals(np.full((3, 3, 3), np.inf, np.float32))
    assert not lost.any()  # and no NaN either, which would count as any


@pytest.mark.parametrize("shape", ((1, 1, 1), (1, 5, 5), (5, 1, 5), (5, 5, 1), (2, 2, 2)))
def test_thin_volumes_have_no_gradient_across(shape, way):
    for dtype in (np.uint8, np.float32):
        voxels = np.random.default_rng(0).integers(0, 200, shape).astype(dtype)
        got = all_normals(voxels)
        assert np.isfinite(got).all()
        for axis in range(3):
            if shape[axis] == 1:
                assert not got[..., 2 - axis].any()


def some_voxels(mask):
    """Row starts and columns that name the voxels of a mask."""
    row_start = np.append(0, np.cumsum(mask.sum(axis=2).reshape(-1))).astype(np.int64)
    return row_start, np.nonzero(mask)[2].astype(np.uint16)


def in_blobs(shape, share, seed):
    """A mask in pieces of every length along x, empty and full rows among them."""
    random = np.random.default_rng(seed)
    mask = np.repeat(random.random(shape) < share, random.integers(1, 60), axis=2)[:, :, : shape[2]]
    mask ^= random.random(shape) < 0.02
    mask[0, 0], mask[0, 1] = False, True
    return mask


@pytest.mark.parametrize("threads", (1, 2))
@pytest.mark.parametrize("dtype", ("uint8", "int16", "int32", "float32"))
def test_a_normal_does_not_depend_on_the_other_voxels_wanted(dtype, way, threads):
    """Near ones along a row are worked on together, wherever they begin and whatever lies between them."""
    shape = (6, 9, 403)
    voxels = np.random.default_rng(4).integers(0, 100, shape).astype(dtype)
    volume = Volume(voxels, np.eye(4))
    everything = unit_normals(volume, *everywhere(volume), AFFINES["sheared"], threads=threads).reshape(*shape, 3)
    blobs, dots = in_blobs(shape, 0.5, 1), np.random.default_rng(5).random(shape) < 0.03
    for wanted in (np.zeros(shape, bool), blobs, ~blobs, blobs & ~dots, dots, dots & dots[:, :, ::-1]):
        got = unit_normals(volume, *some_voxels(wanted), AFFINES["sheared"], threads=threads)
        np.testing.assert_array_equal(got, everything[wanted])
