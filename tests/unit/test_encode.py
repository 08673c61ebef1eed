"""The four tables against a slow encoder written from the paper's words; what they hold in hard cases is in
tests/stability/test_encoding.py."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.classification import ClassifiedVolume
from rle_splat.classify.visible import row_offsets
from rle_splat.encode.encode import encode, fetch_chunks, place_chunks, run_tables
from rle_splat.runtime.steps import drain
from rle_splat.scene import RleSplatError
from rle_splat.volume.axes import AXES
from tests.encoded import validate
from tests.ways import WAYS, both, by

ALL_TABLES = ("scanline_pointers", "data_pointers", "runs", "voxel_data", "scanline_data_pointers")


def classified_from(mask, seed=0):
    """A classified volume whose visible voxels are ``mask`` (nz, ny, nx), with random opacity and color."""
    rng = np.random.default_rng(seed)
    nz, ny, nx = mask.shape
    count = int(mask.sum())
    return ClassifiedVolume.from_lists(
        shape_xyz=(nx, ny, nz), row_start=row_offsets(mask.reshape(nz * ny, nx).sum(axis=1)),
        column=np.nonzero(mask)[2].astype(np.uint16 if nx <= 65536 else np.int32),
        extinction=rng.random(count, dtype=np.float32) * 3 + np.float32(2.0**-149),
        opacity=rng.random(count, dtype=np.float32) + np.float32(2.0**-149),
        color=rng.random((count, 3), dtype=np.float32), nan_voxels=0, unit_length=1.0, opacity_distance=1.0,
    )  # fmt: skip


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
    # Scanlines of whole words of 64 voxels, of one more and one less; runs that end where a word does or go on.
    yield "words", np.repeat(rng.random((2, 64, 16)) < 0.5, 8, axis=2)
    yield "words and one", np.repeat(rng.random((2, 5, 129)) < 0.5, 13, axis=1)
    yield "words but one", np.repeat(rng.random((2, 127, 21)) < 0.7, 3, axis=2)
    yield "full words", np.ones((2, 64, 128), bool)


CASES = dict(masks())


@pytest.mark.parametrize("model", ("extinction", "opacity"))
@pytest.mark.parametrize("axis", (0, 1, 2))
@pytest.mark.parametrize("name", CASES)
def test_tables_are_the_papers_to_the_bit(name, axis, model):
    mask = CASES[name]
    classified = classified_from(mask)
    truth = paper_tables(mask, dense_from(mask, classified, model), axis)
    for encoded in both(lambda: encode(classified, classified.color, axis, model)):
        for table, expected in zip(ALL_TABLES, truth):
            got = getattr(encoded, table)
            np.testing.assert_array_equal(got.reshape(-1), np.array(expected, dtype=got.dtype).reshape(-1), table)
        assert encoded.runs.dtype == np.uint16 and encoded.data_pointers.dtype == np.int64
        assert encoded.scanline_pointers.dtype == np.int32
        assert (encoded.width, encoded.n_scanlines, encoded.n_slices) == tuple(mask.shape[::-1][i] for i in AXES[axis])
        validate(encoded)


@pytest.mark.parametrize("name", ("primes", "words", "words and one"))
def test_threads_change_nothing(name):
    classified = classified_from(CASES[name])
    for axis in (0, 1, 2):
        one, two = (encode(classified, classified.color, axis, threads=n) for n in (1, 2))
        for table in ALL_TABLES:
            np.testing.assert_array_equal(getattr(one, table), getattr(two, table))


def with_bits(voxels, mask):
    """The same voxels, and a bit for each."""
    nz, ny, nx = mask.shape
    padded = np.zeros((nz * ny, -(-nx // 64) * 64), bool)
    padded[:, :nx] = mask.reshape(nz * ny, nx)
    bits = np.packbits(padded, axis=1, bitorder="little").view("<u8").astype(np.uint64)
    return replace(voxels, bits=bits)


@pytest.mark.parametrize("name", CASES)
def test_bits_and_columns_make_the_same_tables(name):
    voxels = classified_from(CASES[name]).voxels
    for axis in (0, 1, 2):
        of_columns, of_bits = (run_tables(one, axis) for one in (voxels, with_bits(voxels, CASES[name])))
        for table in ("scanline_pointers", "data_pointers", "runs", "scanline_data_pointers"):
            np.testing.assert_array_equal(getattr(of_columns, table), getattr(of_bits, table), table)


@pytest.mark.parametrize("size", (1, 2, 3, 4, 6, 8, 12, 14, 16))
@pytest.mark.parametrize("name", ("empty", "one voxel", "random", "primes", "words", "words and one", "full words"))
def test_records_of_any_size_go_to_their_scanlines_and_come_back(name, size):
    """Against the voxels' own order sorted by scanline; with more beside them that must stay as it is."""
    mask = CASES[name]
    voxels = classified_from(mask).voxels
    z, y, x = np.nonzero(mask)
    records = np.random.default_rng(size).integers(1, 256, (len(x), size), np.uint8)
    for axis, order in enumerate((np.lexsort((y, z, x)), np.lexsort((x, z, y)), np.arange(len(x)))):
        for bits in (False, True):
            found = with_bits(voxels, mask) if bits else voxels
            tables = run_tables(found, axis)
            for way in WAYS:
                room = np.zeros((len(x) + 64, size), np.uint8)
                target = room[32 : 32 + len(x)]
                with by(way):
                    drain(place_chunks(tables, found, records, target))
                np.testing.assert_array_equal(target, records[order])
                assert not room[:32].any() and not room[32 + len(x) :].any()
                if axis != 0:
                    continue
                room = np.zeros_like(room)
                back = room[32 : 32 + len(x)]
                with by(way):
                    drain(fetch_chunks(tables, found, back, target))
                np.testing.assert_array_equal(back, records)
                assert not room[:32].any() and not room[32 + len(x) :].any()


def test_records_that_kernels_cannot_move_are_refused():
    voxels = classified_from(CASES["random"]).voxels
    records = np.zeros((len(voxels), 17), np.uint8)
    with pytest.raises(ValueError, match="not 17"):
        drain(place_chunks(run_tables(voxels, 0), voxels, records, records.copy()))
    with pytest.raises(ValueError, match="along y"):
        drain(fetch_chunks(run_tables(voxels, 1), voxels, records, records.copy()))


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
    with pytest.raises(RleSplatError, match="color"):
        encode(classified, classified.color[:-1], 0)


def test_bytes_are_told_per_table():
    classified = classified_from(CASES["full"])
    encoded = encode(classified, classified.color, 2)
    assert encoded.table_bytes["voxel_data"] == 60 * 16 and encoded.table_bytes["runs"] == 12 * 2 * 2
    assert encoded.nbytes == sum(getattr(encoded, table).nbytes for table in ALL_TABLES)
