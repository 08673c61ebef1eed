"""The four tables against a slow encoder written from the paper's words; what they hold in hard cases is in
tests/stability/test_encoding.py."""

import numpy as np
import pytest

from rle_splat.axes import AXES
from rle_splat.classify.classification import ClassifiedVolume
from rle_splat.classify.visible import row_offsets
from rle_splat.encode.encode import encode
from rle_splat.encode.validate import validate
from rle_splat.scene import RleSplatError

BACKENDS = ("numba", "numpy")
ALL_TABLES = ("scanline_pointers", "data_pointers", "runs", "voxel_data", "scanline_data_pointers")


def classified_from(mask, seed=0):
    """A classified volume whose visible voxels are ``mask`` (nz, ny, nx), with random opacity and colour."""
    rng = np.random.default_rng(seed)
    nz, ny, nx = mask.shape
    count = int(mask.sum())
    return ClassifiedVolume.from_lists(
        shape_xyz=(nx, ny, nz), row_start=row_offsets(mask.reshape(nz * ny, nx).sum(axis=1)),
        column=np.nonzero(mask)[2].astype(np.uint16 if nx <= 65536 else np.int32),
        extinction=rng.random(count, dtype=np.float32) * 3 + np.float32(2.0**-149),
        opacity=rng.random(count, dtype=np.float32) + np.float32(2.0**-149),
        color=rng.random((count, 3), dtype=np.float32), nan_voxels=0, unit_length=1.0, opacity_distance=1.0,
    )


def dense_from(mask, classified, model):
    """(nz, ny, nx, 4) records laid out directly."""
    dense = np.zeros((*mask.shape, 4), dtype=np.float32)
    density = classified.extinction if model == "extinction" else classified.opacity
    dense[mask] = np.concatenate((density[:, None] * classified.color, density[:, None]), axis=1)
    return dense


def paper_tables(mask, dense, axis):
    """The four tables, and the derived one, by walking slices, scanlines and voxels one at a time."""
    nx, ny, nz = mask.shape[::-1]
    n_slices, n_scanlines, width, voxel = {
        "x": (nx, nz, ny, lambda k, j, i: (j, i, k)),
        "y": (ny, nz, nx, lambda k, j, i: (j, k, i)),
        "z": (nz, ny, nx, lambda k, j, i: (k, j, i)),
    }["xyz"[axis]]
    pointers, data_pointers, runs, data, scanline_data = [], [], [], [], []
    for k in range(n_slices):
        data_pointers.append(len(data))
        for j in range(n_scanlines):
            scanline_data.append(len(data))
            visible = [bool(mask[voxel(k, j, i)]) for i in range(width)]
            if not any(visible):
                pointers.append(-1)
                continue
            pointers.append(len(runs))
            current, length = False, 0
            for i in range(width):
                if visible[i] != current:
                    runs.append(length)
                    current, length = visible[i], 0
                length += 1
                if visible[i]:
                    data.append(dense[voxel(k, j, i)])
            runs.append(length)
    data_pointers.append(len(data))
    return pointers, data_pointers, runs, data, scanline_data


def masks():
    rng = np.random.default_rng(11)
    checker = np.indices((6, 5, 8)).sum(axis=0) % 2 == 0
    yield "random", rng.random((5, 7, 11)) < 0.4
    yield "sparse", rng.random((13, 3, 17)) < 0.02
    yield "dense", rng.random((3, 13, 7)) < 0.95
    yield "empty", np.zeros((3, 4, 5), bool)
    yield "full", np.ones((3, 4, 5), bool)
    yield "checkerboard", checker
    yield "1 x N x N", rng.random((7, 6, 1)) < 0.5
    yield "N x 1 x 1", rng.random((1, 1, 9)) < 0.5
    yield "N x N x 1", rng.random((1, 9, 8)) < 0.5
    yield "one voxel", np.ones((1, 1, 1), bool)
    yield "no voxel of one", np.zeros((1, 1, 1), bool)
    yield "cube of two", rng.random((2, 2, 2)) < 0.5
    yield "primes", rng.random((19, 23, 29)) < 0.3
    yield "runs", np.repeat(rng.random((7, 6, 5)) < 0.4, 5, axis=2)


CASES = dict(masks())


@pytest.mark.parametrize("model", ("extinction", "opacity"))
@pytest.mark.parametrize("axis", (0, 1, 2))
@pytest.mark.parametrize("name", CASES)
def test_tables_are_the_papers_to_the_bit(name, axis, model):
    mask = CASES[name]
    classified = classified_from(mask)
    truth = paper_tables(mask, dense_from(mask, classified, model), axis)
    for backend in BACKENDS:
        encoded = encode(classified, classified.color, axis, model, backend=backend)
        for table, expected in zip(ALL_TABLES, truth):
            got = getattr(encoded, table)
            np.testing.assert_array_equal(got.reshape(-1), np.array(expected, dtype=got.dtype).reshape(-1), table)
        assert encoded.runs.dtype == np.uint16 and encoded.data_pointers.dtype == np.int64
        assert encoded.scanline_pointers.dtype == np.int32
        assert (encoded.width, encoded.n_scanlines, encoded.n_slices) == tuple(mask.shape[::-1][i] for i in AXES[axis])
        validate(encoded)


def test_threads_change_nothing():
    classified = classified_from(CASES["primes"])
    for axis in (0, 1, 2):
        one, two = (encode(classified, classified.color, axis, threads=n) for n in (1, 2))
        for table in ALL_TABLES:
            np.testing.assert_array_equal(getattr(one, table), getattr(two, table))


def test_shaded_colors_are_what_is_stored():
    mask = CASES["random"]
    classified = classified_from(mask)
    shaded = np.random.default_rng(2).random((int(mask.sum()), 3)) * 5  # float64 and above 1: allowed
    encoded = encode(classified, shaded, 2, "opacity")
    np.testing.assert_allclose(encoded.voxel_data[:, :3], classified.opacity[:, None] * shaded, rtol=3e-7)


def test_wrong_requests_are_refused():
    classified = classified_from(CASES["random"])
    with pytest.raises(RleSplatError, match="axis"):
        encode(classified, classified.color, 3)
    with pytest.raises(RleSplatError, match="model"):
        encode(classified, classified.color, 0, "emission")
    with pytest.raises(RleSplatError, match="colour"):
        encode(classified, classified.color[:-1], 0)


def test_bytes_are_told_per_table():
    classified = classified_from(CASES["full"])
    encoded = encode(classified, classified.color, 2)
    assert encoded.table_bytes["voxel_data"] == 60 * 16 and encoded.table_bytes["runs"] == 12 * 2 * 2
    assert encoded.nbytes == sum(getattr(encoded, table).nbytes for table in ALL_TABLES)
