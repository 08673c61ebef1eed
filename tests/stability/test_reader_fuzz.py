"""Readers, R1 to R4: whatever a file holds and whatever is said of it, there is a picture's worth of numbers or one
sentence; no crash, no hang, and no more memory than the file's size justifies."""

from __future__ import annotations

import gzip
import io
import json
import string
import struct
import time
import tracemalloc
import zipfile

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rle_splat.classify.default import default_transfer_function
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.encode.encode import encode
from rle_splat.encode.store import read_encoded, write_encoded
from rle_splat.encode.stored import StoredVolume
from rle_splat.pipeline.render import render
from rle_splat.read.formats import read_volume
from rle_splat.read.vdb_header import MAGIC, check_header
from rle_splat.scene import Camera, Light, Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import STORED_TYPES, Volume
from tests.stability.fuzz import examples
from tests.unit.test_encode import classified_from

SENTENCES = "sentences"
OWN_BYTES = 4 << 20  # whatever the file: buffers, modules, a table of 16-bit values
HANG = 20.0  # seconds; everything here takes milliseconds
DEFLATED = 1100  # times as large as the file: what gzip can make of it, and what holds it


def outcome(act, file_bytes: int, times: float):
    """(what ``act`` returns or None, the refusal's sentence or None); at most ``times`` the file's bytes are taken."""
    tracemalloc.start()
    begun = time.process_time()
    try:
        result, refusal = act(), None
    except RleSplatError as problem:
        result, refusal = None, str(problem)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert time.process_time() - begun < HANG, "it hangs"
    assert peak <= OWN_BYTES + times * file_bytes, f"{peak} bytes for a file of {file_bytes}"
    if refusal is not None:
        assert refusal.endswith(".") and "\n" not in refusal and len(refusal) < 2000, refusal
        assert "Traceback" not in refusal and "<" not in refusal[:1], refusal
    return result, refusal


def says(record, case, claim):
    """Note that the search ended without a failure: any failure ends the test before."""
    record(case, claim, 0, 0, "either", SENTENCES)


# --- raw files --------------------------------------------------------------------------------------------------

ODD_NUMBERS = st.one_of(
    st.integers(-3, 70000), st.integers(-(10**400), 10**400), st.floats(), st.booleans(), st.none(),
    st.text(max_size=4),
    st.sampled_from([0, -1, 1e300, float("nan"), float("inf"), 2**31, 2**63, 65536, 65537]),
)  # fmt: skip
RAW_NAMES = st.one_of(
    st.text(string.ascii_lowercase + string.digits + "_-x.^ ", max_size=24),
    st.builds(
        "{}x{}x{}_{}".format, *[st.integers(0, 99999)] * 3, st.sampled_from([*STORED_TYPES, "int16be", "header9"])
    ),
)  # fmt: skip
RAW_OPTIONS = st.fixed_dictionaries(
    {},
    optional={
        "shape": st.one_of(st.tuples(*[st.integers(1, 6)] * 3), st.lists(ODD_NUMBERS, max_size=4), ODD_NUMBERS),
        "dtype": st.one_of(st.sampled_from(STORED_TYPES), st.text(max_size=6), ODD_NUMBERS),
        "byte_order": st.one_of(st.sampled_from(["little", "big"]), ODD_NUMBERS),
        "header_bytes": st.one_of(st.integers(0, 40), ODD_NUMBERS),
        "spacing": st.one_of(st.tuples(*[st.floats(0.1, 3)] * 3), st.lists(ODD_NUMBERS, max_size=4), ODD_NUMBERS),
        "slope": ODD_NUMBERS, "intercept": ODD_NUMBERS,
    },
)  # fmt: skip


@given(st.binary(max_size=300), RAW_NAMES, RAW_OPTIONS)
@example(b"\0" * 8, "a", {"shape": (10**400, 1, 1), "dtype": "uint8"})
@example(b"\0" * 8, "a", {"shape": (2, 2, 2), "dtype": "uint8", "slope": 10**400})
@example(b"\0" * 8, "a", {"shape": (2, 2, 2), "dtype": "uint8", "spacing": (1, 1, 10**400)})
@example(b"\0" * 8, "a", {"shape": 5, "dtype": ["uint8"]})
@examples(100)
def search_raw(folder, content, name, options):
    path = folder / (name.replace("/", "") + ".raw")
    path.write_bytes(content)
    volume, refusal = outcome(lambda: read_volume(path, **options), len(content), 8)
    path.unlink()
    if refusal is None:
        assert volume.voxels.nbytes <= len(content)
        assert np.isfinite(volume.value_range).all() or volume.voxels.dtype.kind == "f"


@given(st.binary(max_size=2000), st.integers(0, 60), st.data())
@examples(50)
def search_gzip(folder, content, repeat, data):
    """Packed files, whole, cut, flipped, joined and of content that unpacks to far more."""
    packed = bytearray(gzip.compress(content * (1 + repeat**2)))
    for _ in range(data.draw(st.integers(0, 3))):
        damage = data.draw(st.sampled_from(["cut", "flip", "join", "more"]))
        at = data.draw(st.integers(0, max(len(packed) - 1, 0)))
        if damage == "cut":
            del packed[at:]
        elif damage == "flip" and packed:
            packed[at] ^= data.draw(st.integers(1, 255))
        elif damage == "join":
            packed += bytes(packed)
        else:
            packed += b"\0" * at
    path = folder / "packed.raw.gz"
    path.write_bytes(packed)
    shape = data.draw(st.tuples(*[st.integers(1, 65536)] * 3))
    outcome(lambda: read_volume(path, shape=shape, dtype="uint16"), len(packed), DEFLATED)
    outcome(lambda: read_volume(path), len(packed), DEFLATED)


def test_R1_raw_files(record, tmp_path):
    search_raw(tmp_path)
    search_gzip(tmp_path)
    says(record, "R1", "raw and packed files that are neither read nor rejected with a clear error")


def first_picture(values, slope, intercept, dtype):
    with np.errstate(over="ignore"):
        voxels = np.array(values).reshape(2, 2, 2).astype(dtype)
    volume = Volume(voxels, np.eye(4), slope=slope, intercept=intercept)
    function, _ = default_transfer_function(volume)
    camera, matrix = turntable(volume, 20, 10)
    return render(Scene(volume, function, camera, 8, 8, matrix), Quality(threads=1, classification="pre"))


@given(
    st.lists(st.floats(width=64), min_size=8, max_size=8), st.floats(allow_nan=False, allow_infinity=False),
    st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(["float32", "float64"]),
)  # fmt: skip
@example([1.7e308] * 4 + [-1.7e308] * 4, 1e10, 0.0, "float64")
@example([5e-324] * 4 + [0.0] * 4, 1e-300, 0.0, "float64")
@example([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0], 1.0, 1.7e308, "float64")
@example([0.0] * 6 + [2.096e16, 2.146e19], 2.094e288, 0.0, "float32")
@examples(50)
def search_values(values, slope, intercept, dtype):
    """A volume of any values at all: its first picture is finite, or it gives a clear error."""

    picture, _ = outcome(lambda: first_picture(values, slope, intercept, dtype), 64, 1e6)
    assert picture is None or np.isfinite(picture.rgba).all()


def test_R1_volumes_of_any_values(record):
    for dtype in ("float32", "float64"):  # kernels are compiled before anything is timed
        first_picture(range(8), 1.0, 0.0, dtype)
    search_values()
    says(record, "R1", "volumes of any 64-bit values without a finite first picture or a clear error")


@pytest.mark.parametrize("slope", (1e-300, 1e-150, 1e150, 1e280, 2e288))
def test_R1_an_automatic_transfer_function_of_values_of_any_size(record, slope):
    """The squares of values next to the largest there are left float64's range, and no threshold was found."""
    values = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 5e16, 2e19, 2.1e19]).reshape(2, 2, 2)
    one, other = (default_transfer_function(Volume(values, np.eye(4), slope=s))[0].opacity for s in (1.0, slope))
    off = max(abs(a[0] - b[0] / slope) / 2.1e19 + abs(a[1] - b[1]) for a, b in zip(one, other, strict=True))
    claim = "change of an automatic transfer function where all values are scaled"
    record("R1", claim, off, 1e-6, "either", "points are float64")


# --- JSON -------------------------------------------------------------------------------------------------------

SCALARS = st.one_of(
    st.none(), st.booleans(), st.floats(), st.integers(-10, 10), st.integers(-(10**400), 10**400), st.text(max_size=6),
    st.sampled_from([1e-300, 1e300, 1e39, -1e39, 5e-324, "PERSP", "ORTHO", "SUN", "AREA", "HU", ""]),
)  # fmt: skip
ANY_JSON = st.recursive(
    SCALARS,
    lambda part: st.one_of(st.lists(part, max_size=5), st.dictionaries(st.text(max_size=8), part, max_size=4)),
    max_leaves=12,
)
GOOD_FUNCTION = {
    "name": "x", "unit": "HU", "opacity": [[0, 0], [50, 0.2], [100, 0.9]], "color": [[0, 1, 0, 0], [100, 0.2, 0.5, 1]],
    "opacity_unit_distance": 1.5, "shade": {"ambient": 0.3, "diffuse": 0.7, "specular": 0.1, "shininess": 9},
}  # fmt: skip
GOOD_CAMERA = {
    "matrix_world": [[1, 0, 0, 2], [0, 1, 0, 2], [0, 0, 1, 12], [0, 0, 0, 1]], "type": "PERSP", "lens": 50,
    "sensor_width": 36, "sensor_height": 24, "sensor_fit": "AUTO", "ortho_scale": 6, "shift_x": 0, "shift_y": 0,
    "clip_start": 0.1, "clip_end": 100, "pixel_aspect": [1, 1],
}  # fmt: skip
GOOD_LIGHTS = [
    {"type": kind, "color": [1, 0.5, 0], "energy": 10, "matrix_world": GOOD_CAMERA["matrix_world"], "radius": 0.1,
     "angle": 0.1, "size": 1, "size_y": 2, "shape": "SQUARE", "spot_size": 0.7, "spot_blend": 0.1, "casts_shadow": True}
    for kind in ("SUN", "POINT", "SPOT", "AREA")
]  # fmt: skip
VOLUME = Volume(np.random.default_rng(2).integers(0, 100, (5, 5, 5)).astype(np.uint8), np.eye(4))


def places(tree, path=()):
    """Every place in a JSON value, as the keys that lead there."""
    yield path
    parts = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, part in parts:
        yield from places(part, (*path, key))


def altered(tree, path, value):
    if not path:
        return value
    copy = dict(tree) if isinstance(tree, dict) else list(tree)
    copy[path[0]] = altered(copy[path[0]], path[1:], value)
    return copy


@st.composite
def nearly(draw, good):
    """A good JSON value with up to three places changed, seldom something else altogether."""
    tree = good if draw(st.integers(0, 9)) else draw(ANY_JSON)
    for _ in range(draw(st.integers(0, 3))):
        tree = altered(tree, draw(st.sampled_from(list(places(tree)))), draw(ANY_JSON))
    return tree


NOT_JSON = [
    b"",
    b"{",
    b"\xff\xfe",
    b"[" * 100_000,
    b'{"a":' * 100_000,
    b"1" * 10_000,
    b"nan",
    b"\0" * 9,
    b'"' + b"x" * 99,
]


def from_file(folder, content, read):
    path = folder / "file.json"
    path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    return outcome(lambda: read(path), path.stat().st_size, 200)


def lit(function=None, camera=None, lights=()):
    """The picture, or the refusal, of a small scene."""
    return outcome(lambda: small_picture(function, camera, lights), 1000, 1e6)


def small_picture(function=None, camera=None, lights=()):
    scene_camera, matrix = turntable(VOLUME, 20, 10)
    function = function or TransferFunction.from_json(GOOD_FUNCTION)
    scene = Scene(
        VOLUME,
        function,
        camera or scene_camera,
        8,
        8,
        np.eye(4) if camera else matrix,
        lights=tuple(lights),
        headlight=False,
    )
    quality = Quality(classification="pre", depth_rule="slice", sheet_density=0.0, warp_filter="bilinear", threads=1)
    return render(scene, quality)


@given(nearly(GOOD_FUNCTION))
@example(altered(GOOD_FUNCTION, ("opacity_unit_distance",), 10**400))
@example(altered(GOOD_FUNCTION, ("opacity", 1, 0), 10**400))
@example(altered(GOOD_FUNCTION, ("shade", "shininess"), 10**400))
@example(altered(GOOD_FUNCTION, ("opacity",), [[-1.7e308, 0.5], [1.7e308, 0.1]]))
@examples(80)
def search_functions(folder, tree):
    function, _ = from_file(folder, tree, TransferFunction.from_json)
    if function is None:
        return
    assert TransferFunction.from_json(json.loads(json.dumps(function.to_json()))) == function
    values = np.array([-np.inf, -1e308, 0.0, 50.0, 1e308, np.inf, np.nan])
    assert np.isfinite(function.table(values)).all()
    picture, _ = lit(function=function)
    assert picture is None or np.isfinite(picture.rgba).all()


@given(nearly(GOOD_CAMERA))
@example(altered(GOOD_CAMERA, ("lens",), 10**400))
@example(altered(GOOD_CAMERA, ("shift_x",), 10**400))
@example(altered(GOOD_CAMERA, ("matrix_world", 0, 3), 10**400))
@example(altered(GOOD_CAMERA, ("pixel_aspect",), [1e300, 1e-300]))
@examples(50)
def search_cameras(folder, tree):
    camera, _ = from_file(folder, tree, Camera.from_json)
    if camera is not None:
        picture, _ = lit(camera=camera)
        assert picture is None or np.isfinite(picture.rgba).all()


@given(nearly(GOOD_LIGHTS))
@example(altered(GOOD_LIGHTS, (1, "energy"), 10**400))
@example(altered(GOOD_LIGHTS, (0, "color", 1), 10**400))
@example(altered(GOOD_LIGHTS, (3, "matrix_world", 0, 0), 1e300))
@examples(50)
def search_lights(folder, tree):
    lights, _ = from_file(folder, tree, Light.list_from_json)
    if lights is not None:
        picture, _ = lit(lights=lights)
        assert picture is None or np.isfinite(picture.rgba).all()


@pytest.mark.parametrize("search", (search_functions, search_cameras, search_lights))
def test_R2_json_files(record, tmp_path, search):
    for lights in ((), Light("SUN"), Light("POINT")):  # kernels are compiled before anything is timed
        small_picture(lights=(lights,) if lights else ())
    search(tmp_path)
    for read in (TransferFunction.from_json, Camera.from_json, Light.list_from_json):
        for content in NOT_JSON:
            assert from_file(tmp_path, content, read)[1] is not None
    says(record, "R2", "files of settings that are neither read nor rejected with a clear error")


# --- .rle files -------------------------------------------------------------------------------------------------


def rle_file(folder) -> bytes:
    """What lies within its members is searched in test_folder_fuzz.py."""
    classified = classified_from(np.random.default_rng(4).random((5, 4, 6)) < 0.4, 4)
    axes = {axis: encode(classified, classified.color, axis, record=8) for axis in (1, 2)}
    place = np.diag((0.5, 0.5, 2.0, 1.0)), "mm", 0.001
    write_encoded(StoredVolume.of(axes, *place, GOOD_FUNCTION, {}, "head.raw", ("one",)), folder / "whole.rle")
    return (folder / "whole.rle").read_bytes()


def zipped(members) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return file.getvalue()


@st.composite
def rle_damage(draw, whole):
    """A `.rle` file that was cut or flipped, or lacks a member."""
    kind = draw(st.sampled_from(["cut", "flip", "splice", "lost"]))
    if kind == "cut":
        return whole[: draw(st.integers(0, len(whole)))]
    if kind in ("flip", "splice"):
        content = bytearray(whole)
        at = draw(st.integers(0, len(content) - 1))
        content[at : at + (0 if kind == "splice" else 4)] = draw(st.binary(min_size=1, max_size=4))
        return bytes(content)
    with zipfile.ZipFile(io.BytesIO(whole)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    del members[draw(st.sampled_from(sorted(members)))]
    return zipped(members)


def rendered(stored):
    """The picture of what was read, by the reference implementation, which raises where kernels would read anywhere."""
    assert [tables.axis for tables in stored.axes.values()] == list(stored.principal_axes)
    camera, matrix = turntable(stored, 20, 10)
    scene = Scene(stored, None, camera, 8, 8, matrix, headlight=False)
    quality = Quality(
        classification="pre",
        record=stored.record,
        model=stored.model,
        depth_rule="slice",
        warp_filter="bilinear",
        threads=1,
    )
    return render(scene, quality)


@pytest.mark.usefixtures("by_numpy")
def test_R3_rle_files(record, tmp_path):
    whole = rle_file(tmp_path)

    @given(rle_damage(whole))
    @examples(100)
    def search(content):
        path = tmp_path / "damaged.rle"
        path.write_bytes(content)
        stored, _ = outcome(lambda: read_encoded(path), len(content), 20)
        if stored is not None:
            picture, _ = outcome(lambda: rendered(stored), len(content), 1e4)
            assert picture is None or np.isfinite(picture.rgba).all()

    search()
    says(record, "R3", "damaged files that are neither drawn finite nor rejected with a clear error")


# --- OpenVDB files ----------------------------------------------------------------------------------------------


def vdb_text(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


def vdb_file() -> bytes:
    """What OpenVDB writes before the voxels: enough for everything that is read before its own library is asked."""
    head = MAGIC + struct.pack("<IIIB", 224, 11, 0, 1) + b"0" * 36
    head += struct.pack("<I", 2) + (vdb_text(b"creator") + vdb_text(b"string") + vdb_text(b"somebody")) * 2
    head += struct.pack("<I", 2)
    delayed = struct.pack("<Iqq", 1, 0, 0) + b"\0" * 8
    tree = struct.pack("<II", 6, 2) + vdb_text(b"file_delayed_load") + vdb_text(b"__delayedload") + vdb_text(delayed)
    tree += vdb_text(b"name") + vdb_text(b"string") + vdb_text(b"density") + vdb_text(b"UniformScaleMap") + b"\0" * 120
    tree += struct.pack("<IfIIiii", 1, 0.0, 0, 1, 4096, 0, -4096) + b"\0" * 100
    for name in (b"density", b"heat"):
        entry = vdb_text(name) + vdb_text(b"Tree_float_5_4_3") + vdb_text(b"")
        begin = len(head) + len(entry) + 24
        head += entry + struct.pack("<qqq", begin, begin + len(tree), begin + len(tree) + 50) + tree + b"\0" * 50
    return head


@given(st.data())
@examples(130)
def search_vdb(folder, data):
    content = bytearray(vdb_file())
    for _ in range(data.draw(st.integers(0, 4))):
        at = data.draw(st.integers(0, max(len(content) - 1, 0)))
        kind = data.draw(st.sampled_from(["cut", "flip", "number"]))
        if kind == "cut":
            del content[at:]
        elif kind == "flip" and content:
            content[at] ^= data.draw(st.integers(1, 255))
        else:
            number = data.draw(st.sampled_from([0, 1, 2**16, 2**31, 2**32 - 1]))
            content[at : at + 4] = struct.pack("<I", number)
    path = folder / "smoke.vdb"
    path.write_bytes(content)
    outcome(lambda: check_header(path), len(content), 8)
    outcome(lambda: read_volume(path), len(content), 8)


def test_R4_openvdb_headers(record, tmp_path):
    path = tmp_path / "whole.vdb"
    path.write_bytes(vdb_file())
    check_header(path)
    for stable, damaged in (
        (struct.pack("<II", 6, 2), struct.pack("<II", 6, 2**30)),  # metadata of a grid
        (struct.pack("<Iqq", 1, 0, 0), struct.pack("<Iqq", 2**30, 0, 0)),  # leaves to take memory for
        (struct.pack("<fII", 0.0, 0, 1), struct.pack("<fII", 0.0, 0, 2**30)),  # children of the root
        (struct.pack("<iii", 4096, 0, -4096), struct.pack("<iii", 4097, 0, -4096)),  # where the first of them lies
        (b"density", b"densi\xff\xfe"),  # no text
    ):
        whole = vdb_file()
        assert stable in whole
        path.write_bytes(whole.replace(stable, damaged))
        with pytest.raises(RleSplatError, match="damaged"):
            check_header(path)
    search_vdb(tmp_path)
    says(record, "R4", "headers that are neither followed nor rejected with a clear error")
