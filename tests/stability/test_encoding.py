"""Shape, memory and encoding, S1 to S8 of the catalogue: every mask comes back, nothing wraps, damage is refused."""

import dataclasses
import os
import sys
import tracemalloc
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from rle_splat.accuracy.metrics import difference
from rle_splat.accuracy.truths import truth
from rle_splat.classify.classification import classify
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.classify.visible import row_offsets
from rle_splat.comparison.ours import decode
from rle_splat.encode.encode import encode
from rle_splat.encode.store import read_encoded, write_encoded
from rle_splat.encode.stored import StoredVolume
from rle_splat.encode.tables import pointers_from_counts, scanline_pointers_from_counts
from rle_splat.pipeline import quick_estimate
from rle_splat.pipeline.encode_scene import encode as encode_scene
from rle_splat.pipeline.render import render
from rle_splat.pipeline.scan_source import classify_and_shade
from rle_splat.read.formats import read_volume
from rle_splat.runtime.jit import compiled
from rle_splat.runtime.steps import Clock
from rle_splat.scene import Camera, Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.axes import AXES
from rle_splat.volume.volume import Volume
from tests.encoded import to_volume_order, validate
from tests.stability.scenes import unlike
from tests.unit.test_encode import ALL_TABLES, CASES, classified_from, dense_from
from tests.ways import WAYS, both, by

TABLES_ARE_WHOLE = "whole numbers"
QUALITY = Quality.preset("standard", classification="pre")
FUNCTION = TransferFunction(opacity=((80, 0.0), (250, 0.5)), color=((80, 1.0, 0.3, 0.1), (250, 0.4, 0.6, 0.9)))
FAINT = replace(FUNCTION, opacity=((80, 0.0), (250, 0.15)), shade=None)
FINE = replace(QUALITY, depth_rule="midpoint-8", sheet_density=4.0, termination=0.0)
LONG = 70_000  # more than 16 bits count
# More voxels than 31 bits count, in rows, columns and sheets that are short enough for the kernels of the package.
LARGE = (16_000, 16_000, 9)
every_axis = pytest.mark.parametrize("axis", (0, 1, 2))
needs_kernels = pytest.mark.skipif(not compiled(), reason="too slow without kernels")


def speckled(shape) -> np.ndarray:
    """Voxels in runs of one and more, some of them transparent."""
    return np.random.default_rng(8).integers(0, 256, shape).astype(np.uint8)


def looking(axis, middle, height) -> Camera:
    """An orthographic camera that looks along +``axis`` at ``middle``, from 60 before it."""
    forward = np.eye(3)[axis]
    up = np.eye(3)[(axis + 2) % 3]
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack((np.cross(forward, up), up, -forward), axis=1)
    matrix[:3, 3] = np.asarray(middle) - 60.0 * forward
    return Camera(matrix, "ORTHO", ortho_scale=height)


def close_up(volume, axis, middle) -> Scene:
    """A picture, 32 pixels a side, of the 16 voxels about a place."""
    return Scene(volume, FUNCTION, looking(axis, middle, 16.0), 32, 32, headlight=False)


def tables_unlike(one, two) -> int:
    return sum(unlike(getattr(one, table), getattr(two, table)) for table in ALL_TABLES)


# --- encodings ------------------------------------------------------------------------------------------------


@every_axis
@pytest.mark.parametrize("name", CASES)
def test_S1_S8_decoding_gives_the_volume_back(record, name, axis):
    """By either encoder and either decoder, of every principal axis: so the three axes decode to one volume."""
    mask = CASES[name]
    classified = classified_from(mask)
    dense = dense_from(mask, classified, "extinction")
    for encoder in WAYS:
        with by(encoder):
            encoded, again = (encode(classified, classified.color, axis) for _ in range(2))
        wrong = sum(unlike(to_volume_order(found, axis), dense) for found in both(partial(decode, encoded)))
        why = "records are copied"
        record("S1", "numbers that differ after encoding and decoding", wrong, 0, "either", why)
        record("S8", "numbers in which an axis' encoding differs from the volume", wrong, 0, "either", why)
        record("S1", "entries that differ when encoded twice", tables_unlike(encoded, again), 0, "either", why)


@every_axis
@pytest.mark.parametrize("seed", range(6))
def test_S1_random_masks_in_canonical_form(record, seed, axis, way):
    rng = np.random.default_rng(seed)
    mask = rng.random(rng.integers(1, 24, 3)) < rng.choice((0.02, 0.3, 0.7, 0.98))
    encoded = encode(classified_from(mask, seed), np.ones((int(mask.sum()), 3), np.float32), axis)
    validate(encoded)
    pointers = encoded.scanline_pointers.reshape(-1)
    starts = pointers[pointers >= 0]
    sums = np.add.reduceat(encoded.runs.astype(np.int64), starts) if len(starts) else np.zeros(0, np.int64)
    off = int((sums != encoded.width).sum()) + abs(len(encoded.voxel_data) - int(mask.sum()))
    record(
        "S1", "scanlines whose runs miss the width, and records too many or too few", off, 0, "either", TABLES_ARE_WHOLE
    )


@pytest.mark.parametrize(
    "shape",
    ((1, 7, 6), (7, 1, 6), (7, 6, 1), (1, 1, 9), (1, 9, 1), (9, 1, 1), (1, 1, 1), (2, 2, 2), (5, 7, 11), (13, 3, 17)),
)
def test_S2_flat_thin_and_prime_sizes_equal_the_oracle(record, shape):
    voxels = np.random.default_rng(8).integers(100, 256, shape).astype(np.uint8)
    camera, matrix = turntable(Volume(voxels, np.eye(4)), 35, 25)
    scene = Scene(Volume(voxels, np.eye(4)), FAINT, camera, 32, 32, matrix, headlight=False)
    true = truth(scene, "T1", tolerance=1e-6)[0].reshape(32, 32, 4)
    found = difference(render(scene, replace(FINE, sheet_density=8.0)).rgba, true)
    assert true[..., 3].max() > 0.05
    record("S2", "largest difference from the oracle, steps of 255", found.largest, 0.3)


def test_S2_a_volume_without_voxels_is_refused(record):
    sentences = 0
    for shape in ((0, 4, 5), (4, 0, 5), (4, 5, 0), (0, 0, 0)):
        with pytest.raises(RleSplatError, match="at least one voxel") as problem:
            Volume(np.zeros(shape, np.uint8), np.eye(4))
        sentences += str(problem.value).endswith(".") and "\n" not in str(problem.value)
    record("S2", "volumes without voxels that give no clear error", 4 - sentences, 0, "either", TABLES_ARE_WHOLE)


# --- the worst runs -------------------------------------------------------------------------------------------


def checkerboard(n) -> Volume:
    """Every other voxel: as many runs as there are voxels, and one more in every other scanline."""
    return Volume((np.indices((n, n, n)).sum(axis=0) % 2 * 250).astype(np.uint8), np.eye(4))


def solid(n) -> Volume:
    return Volume(np.random.default_rng(1).integers(100, 256, (n, n, n)).astype(np.uint8), np.eye(4))


@every_axis
def test_S3_a_checkerboard_has_one_run_per_voxel_and_the_empty_first(record, axis, way):
    n = 8
    mask = np.indices((n, n, n)).sum(axis=0) % 2 == 0
    encoded = encode(classified_from(mask), np.ones((int(mask.sum()), 3)), axis)
    lengths = np.diff(np.append(encoded.scanline_pointers.reshape(-1), len(encoded.runs))).reshape(n, n)
    expected = n + np.indices((n, n)).sum(axis=0) % 2  # those that begin transparent have an empty run less
    off = np.abs(lengths - (2 * n + 1 - expected)).sum()
    record("S3", "runs too many or too few in scanlines of a checkerboard", off, 0, "either", TABLES_ARE_WHOLE)


@pytest.mark.parametrize("axis, view", ((0, (79, 12)), (1, (11, 14)), (2, (20, 77))))
@pytest.mark.parametrize("make", (checkerboard, solid))
def test_S3_the_worst_runs_are_drawn_right(record, make, axis, view):
    """Against the truth, from within the block's outline, with four sheet pixels to a picture's."""
    volume = make(14)
    camera, matrix = turntable(volume, *view, fit=0.5)
    scene = Scene(volume, FAINT, camera, 32, 32, matrix, headlight=False)
    if make is checkerboard:
        tables = encode_scene(scene, QUALITY, (axis,)).axes[axis]
        assert len(tables.runs) == 14**3 + 14**2 // 2
    rendering, true = render(scene, FINE), truth(scene, "T1", tolerance=1e-6)[0].reshape(32, 32, 4)
    assert rendering.report["plan"]["base_planes"][0]["principal_axis"].endswith("xyz"[axis])
    found, moved = (difference(rendering.rgba, picture) for picture in (true, np.roll(true, 1, axis=1)))
    assert moved.rmse > 20.0 * found.rmse
    record("S3", "RMSE of the worst runs from the oracle, steps of 255", found.rmse, 0.05)
    record("S3", "largest difference of the worst runs from the oracle, steps of 255", found.largest, 0.3)


@pytest.mark.parametrize("make", (checkerboard, solid))
def test_S3_the_worst_runs_are_in_the_estimate(record, make):
    scene = replace(close_up(make(64), 2, (32.0, 32.0, 32.0)), headlight=True)
    encode_scene(scene, QUALITY)  # whatever is made once
    tracemalloc.start()
    try:
        stored = encode_scene(scene, QUALITY)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    wanted = quick_estimate.estimate_memory(scene.volume, FUNCTION, QUALITY, axes=3)
    tables = sum(one.runs.nbytes for one in stored.axes.values())
    assert wanted.records == sum(one.voxel_data.nbytes for one in stored.axes.values())
    assert tables <= wanted.runs and wanted.needed <= 1.8 * peak
    record("S3", "bytes needed over bytes estimated", peak / wanted.needed, 1 / 0.9, "either", "bytes")


@pytest.mark.parametrize("make", (checkerboard, solid))
def test_S3_the_worst_runs_are_refused_when_they_do_not_fit(record, make, monkeypatch):
    scene = close_up(make(64), 2, (32.0, 32.0, 32.0))
    wanted = quick_estimate.estimate_memory(scene.volume, FUNCTION, QUALITY).needed
    for module in ("pipeline.memory_estimate", "pipeline.stage_cache", "runtime.memory"):
        monkeypatch.setattr(f"rle_splat.{module}.available_bytes", lambda: wanted // 2)
    with pytest.raises(RleSplatError, match="are free") as problem:
        render(scene, QUALITY)
    has_sentence = str(problem.value).endswith(".")
    record(
        "S3", "volumes too large for memory that give no clear error", 1 - has_sentence, 0, "either", TABLES_ARE_WHOLE
    )


# --- long dimensions, and more than 32 bits count ---------------------------------------------------------------


@pytest.mark.parametrize("length", (65535, 65536, 70000))
@pytest.mark.parametrize("axis", (0, 2))
def test_S4_long_runs_are_not_wrapped(record, length, axis, way):
    shape = (1, 2, length) if axis == 2 else (1, length, 2)
    full, last = np.ones(shape, bool), np.zeros(shape, bool)
    np.moveaxis(last, 2 if axis == 2 else 1, 0)[-1] = True
    for mask, line in ((full, [0, length]), (last, [length - 1, 1])):
        classified = classified_from(mask)
        encoded = encode(classified, classified.color, axis)
        assert encoded.runs.dtype == (np.uint16 if length <= 65535 else np.uint32)
        validate(encoded)
        dense = to_volume_order(decode(encoded), axis)
        off = unlike(encoded.runs, line + line) + unlike(dense, dense_from(mask, classified, "extinction"))
        record("S4", "runs and voxels that differ in scanlines of 65,535 to 70,000", off, 0, "either", TABLES_ARE_WHOLE)


def test_S4_columns_grow_with_the_width(record, way):
    shown = TransferFunction(opacity=((100, 0.0), (120, 1.0)), color=((0, 1, 1, 1),))
    for length, stored_type in ((65536, np.uint16), (65537, np.int32), (70000, np.int32)):
        voxels = np.zeros((1, 1, length), np.uint8)
        voxels[0, 0, [0, 65535, length - 1]] = 255
        classified = classify(Volume(voxels, np.eye(4)), shown, np.eye(4))
        assert classified.column.dtype == stored_type
        off = unlike(classified.column, sorted({0, 65535, length - 1}))
        record("S4", "visible voxels of a long row at a wrong position", off, 0, "either", TABLES_ARE_WHOLE)


@pytest.mark.parametrize("way", ("numpy", pytest.param("numba", marks=pytest.mark.deep)), indirect=True)
@every_axis
@pytest.mark.parametrize("long", (0, 1, 2))
def test_S4_the_far_end_of_a_long_volume_is_drawn_as_if_it_were_all(record, long, axis, way):
    """The last voxels of 70,000, behind a transparent run that 16 bits cannot hold, against the same voxels alone."""
    shape = [3, 3, 3]
    shape[2 - long] = 12
    end = speckled(shape)
    start = LONG - 12
    shape[2 - long] = LONG
    voxels = np.zeros(shape, np.uint8)
    np.moveaxis(voxels, 2 - long, 0)[start:] = np.moveaxis(end, 2 - long, 0)
    shift, middle = np.eye(4), np.full(3, 1.0)
    shift[long, 3], middle[long] = start, start + 5.0
    alone = render(close_up(Volume(end, shift), axis, middle), QUALITY)
    whole = render(close_up(Volume(voxels, np.eye(4)), axis, middle), QUALITY)
    assert whole.report["plan"]["base_planes"][0]["principal_axis"].endswith("xyz"[axis])
    assert whole.report["volume"]["visible_voxels"] == alone.report["volume"]["visible_voxels"] > 20
    assert alone.rgba[..., 3].max() > 0.3
    off = 255.0 * np.abs(whole.rgba - alone.rgba).max()
    record("S4", "the end of 70,000 voxels against the same alone, steps of 255", off, 1.0, "float32",
           "positions are float64 in either, sums as chosen by the number of sheets")  # fmt: skip


def test_S5_offsets_go_beyond_32_bits(record):
    offsets = row_offsets(np.full(5, 2**31 - 1, dtype=np.int32))
    assert offsets.dtype == np.int64
    counts = np.array([[2**30, 0], [2**30, 2**30]], dtype=np.int64)
    starts, total = pointers_from_counts(counts)
    pointers, n_runs = scanline_pointers_from_counts(counts)
    assert starts.dtype == pointers.dtype == np.int64
    assert scanline_pointers_from_counts(counts // 4)[0].dtype == np.int32
    off = abs(int(offsets[-1]) - 5 * (2**31 - 1)) + abs(total - 3 * 2**30) + abs(n_runs - 3 * 2**30)
    off += unlike(starts, [[0, 2**30], [2**30, 2**31]]) + unlike(pointers, [[0, -1], [2**30, 2**31]])
    record("S5", "error of offsets beyond 2^31", off, 0, "either", TABLES_ARE_WHOLE)


def sparse(path, size):
    """A file of ``size`` zero bytes that takes no room on the disk; the test is left out where it would."""
    if sys.platform == "win32":
        pytest.skip("files are not sparse here unless told")
    with open(path, "wb") as file:
        file.truncate(size)
    if os.stat(path).st_blocks * 512 > size // 100:
        pytest.skip("files are not sparse here")
    return path


@needs_kernels
def test_S5_a_volume_of_more_than_32_bits_of_voxels(record, tmp_path):
    """A file that is nearly all holes: its last voxels, against the same ones alone."""
    path = sparse(tmp_path / "large.raw", int(np.prod(LARGE)))
    corner = np.array(LARGE) - (12, 10, 2)
    end = speckled((2, 10, 12))
    with open(path, "r+b") as file:
        for z in range(2):
            for y in range(10):
                file.seek(((int(corner[2]) + z) * LARGE[1] + int(corner[1]) + y) * LARGE[0] + int(corner[0]))
                file.write(end[z, y].tobytes())
    volume = read_volume(path, shape=LARGE, dtype="uint8", spacing=(1.0, 1.0, 1.0))
    assert volume.voxels.size > 1 << 31
    shift = np.eye(4)
    shift[:3, 3] = corner
    tracemalloc.start()
    try:
        stored = encode_scene(close_up(volume, 2, corner + 5.0), QUALITY)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < (0.1 + 1.0 / 8.0) * volume.voxels.size  # with a bit of every voxel
    for axis, tables in stored.axes.items():
        assert tables.visible_voxels == (end > 80).sum()
        alone, whole = (render(close_up(one, axis, corner + 5.0), QUALITY).rgba for one in (Volume(end, shift), stored))
        assert alone[..., 3].max() > 0.3
        off = 255.0 * np.abs(whole - alone).max()
        record("S5", "the end of 2^31 voxels against the same alone, steps of 255", off, 1.0, "float32",
               "positions are float64 in either, sums as chosen by the number of sheets")  # fmt: skip


@pytest.mark.deep
@needs_kernels
@pytest.mark.parametrize("record_bytes", (16, 8))
@every_axis
def test_S5_tables_with_more_than_32_bits_of_runs_and_records(record, axis, record_bytes, tmp_path):
    """The tables of a small volume behind 2^31 runs and 2^31 records of holes: the picture keeps its bits."""
    volume = Volume(speckled((14, 15, 16)), np.eye(4))
    scene = close_up(volume, axis, (8.0, 7.0, 7.0))
    classified, colors = classify_and_shade(scene, QUALITY, Clock())
    tables = encode(classified, colors, axis, record=record_bytes)
    beyond = (1 << 31) + 5

    def behind_holes(table, name):
        shape = (beyond + len(table), *table.shape[1:])
        path = sparse(tmp_path / name, int(np.prod(shape)) * table.itemsize)
        mapped = np.memmap(path, table.dtype, "r+", shape=shape)
        mapped[beyond:] = table
        return np.asarray(mapped)

    pointers = tables.scanline_pointers.astype(np.int64)
    far = replace(
        tables, runs=behind_holes(tables.runs, "runs"), voxel_data=behind_holes(tables.voxel_data, "records"),
        scanline_pointers=np.where(pointers < 0, -1, pointers + beyond), data_pointers=tables.data_pointers + beyond,
        scanline_data_pointers=tables.scanline_data_pointers + beyond,
    )  # fmt: skip
    near, moved = (
        render(
            replace(scene, volume=StoredVolume.of({axis: one}, volume.affine)), replace(QUALITY, record=record_bytes)
        ).rgba
        for one in (tables, far)
    )
    assert near[..., 3].max() > 0.3
    record("S5", "bits that differ behind 2^31 runs and records", unlike(moved, near), 0, "float32", TABLES_ARE_WHOLE)


# --- memory layout --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", (np.uint8, np.int16, np.float32))
def test_S6_memory_layout_does_not_matter(record, tmp_path, dtype, way):
    """Strided, transposed, Fortran-ordered, read-only, mapped and masked arrays: tables and picture."""
    values = np.random.default_rng(1).integers(0, 250, (6, 5, 9)).astype(dtype)
    path = tmp_path / "odd.raw"
    path.write_bytes(b"\0" + values.tobytes())  # one header byte: mapped 16-bit voxels are not aligned
    frozen = values.copy()
    frozen.setflags(write=False)
    layouts = {
        "mapped": np.memmap(path, dtype=dtype, mode="r", offset=1, shape=values.shape),
        "frozen": frozen, "strided": np.repeat(values, 2, axis=2)[:, :, ::2], "Fortran": np.asfortranarray(values),
        "backwards": values[::-1, ::-1, ::-1].copy()[::-1, ::-1, ::-1],
        "transposed": np.ascontiguousarray(values.transpose(2, 0, 1)).transpose(1, 2, 0),
        "masked": np.ma.masked_array(values, mask=values > 200),
    }  # fmt: skip
    quality = replace(QUALITY)

    def drawn(voxels):
        scene = replace(close_up(Volume(voxels, np.eye(4)), 2, (4.0, 2.0, 3.0)), headlight=True)
        return encode_scene(scene, quality), render(scene, quality).rgba

    tables, picture = drawn(values)
    assert picture[..., 3].max() > 0.3
    for voxels in layouts.values():
        same_tables, same_picture = drawn(voxels)
        off = sum(tables_unlike(same_tables.axes[axis], tables.axes[axis]) for axis in AXES)
        record("S6", "entries of tables and picture that differ from those of a contiguous copy",
               off + unlike(same_picture, picture), 0, "either", "the same sums in any width")  # fmt: skip


# --- damage ---------------------------------------------------------------------------------------------------


def encoded(axis=2, density=0.4, shape=(5, 4, 6), record_bytes=16):
    mask = np.random.default_rng(4).random(shape) < density
    classified = classified_from(mask, 4)
    return encode(classified, classified.color, axis, record=record_bytes)


def damaged():
    """(what, table, new content): each breaks one rule of the canonical form."""
    e = encoded()

    def changed(table, at, value):
        array = getattr(e, table).copy()
        array.reshape(-1)[at] = value
        return table, array

    yield "sum", *changed("runs", 1, e.runs[1] + 1)
    yield "sum far too large", *changed("runs", 0, 65535)
    yield "no length", *changed("runs", 1, 0)
    yield "pointer beyond", *changed("scanline_pointers", -1, 10**6)
    yield "pointer below", *changed("scanline_pointers", 0, -7)
    yield "pointers swapped", *changed("scanline_pointers", 0, e.scanline_pointers.reshape(-1)[1])
    yield "flag lost", *changed("scanline_pointers", 0, -1)
    yield "data pointer", *changed("data_pointers", 1, 10**9)
    yield "data pointer below", *changed("data_pointers", 0, -1)
    yield "derived", *changed("scanline_data_pointers", 3, 0)
    yield "nan", *changed("voxel_data", 5, np.nan)
    yield "infinite", *changed("voxel_data", 5, np.inf)
    yield "negative", *changed("voxel_data", 5, -1.0)
    yield "too dense", *changed("voxel_data", 7, 1e38)
    yield "cut data", "voxel_data", e.voxel_data[:-1].copy()
    yield "cut runs", "runs", e.runs[:-1].copy()
    yield "no runs", "runs", e.runs[:0].copy()
    yield "type of runs", "runs", e.runs.astype(np.int64)
    yield "type of data", "voxel_data", e.voxel_data.astype(np.float64)
    yield "shape of pointers", "scanline_pointers", e.scanline_pointers[:, :-1].copy()
    yield "shape of data", "voxel_data", e.voxel_data[:, :3].copy()
    yield "layout", "voxel_data", np.asfortranarray(e.voxel_data)


def is_sentence(text) -> bool:
    return text.endswith(".") and "\n" not in text and len(text) < 400


@pytest.mark.parametrize("what, table, content", list(damaged()), ids=lambda v: v if isinstance(v, str) else "")
def test_S7_damage_is_found_before_any_kernel_runs(record, what, table, content):
    validate(encoded())
    with pytest.raises(RleSplatError, match="damaged") as problem:
        validate(dataclasses.replace(encoded(), **{table: content}))
    record("S7", "damages of a named kind without a clear error", not is_sentence(str(problem.value)), 0, "either",
           TABLES_ARE_WHOLE)  # fmt: skip


def test_S7_random_damage_never_passes_as_another_volume(record):
    rng = np.random.default_rng(9)
    e = encoded()
    passed = 0
    for _ in range(300):
        table = rng.choice(["runs", "scanline_pointers", "data_pointers"])
        array = getattr(e, table).copy()
        at = rng.integers(array.size)
        array.reshape(-1)[at] += rng.choice([1, 2, 5]) * rng.choice([-1, 1]).astype(array.dtype)
        try:
            validate(dataclasses.replace(e, **{table: array}))
            passed += 1
        except RleSplatError:
            pass
    record("S7", "random damages of 300 that pass", passed, 0, "either", TABLES_ARE_WHOLE)


@pytest.mark.parametrize("record_bytes, scale", ((8, 1e38), (8, np.inf), (8, np.nan), (8, -1.0)))
def test_S7_scales_that_overflow_are_refused(record, tmp_path, record_bytes, scale):
    """Short records are codes times scales: each a number of its own, and their product one that float32 holds."""
    e = encoded(record_bytes=record_bytes)
    decoding = e.decoding.copy()
    decoding[:] *= np.float32(scale)
    stored = StoredVolume.of({2: dataclasses.replace(e, decoding=decoding)}, np.eye(4))
    write_encoded(stored, tmp_path / "v.rle")
    with pytest.raises(RleSplatError) as problem:
        assert read_encoded(tmp_path / "v.rle").axes
    record("S7", "files with scales beyond float32 without a clear error", not is_sentence(str(problem.value)), 0,
           "either", TABLES_ARE_WHOLE)  # fmt: skip
