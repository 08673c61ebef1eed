"""Stored tables, R3: whatever their header and their tables say, with checksums that fit, there is a picture or one
sentence.

The reference implementation renders: it raises where compiled kernels would read beyond an array."""

import json
import zipfile
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.encode.members import HEADER
from rle_splat.encode.store import read_encoded
from rle_splat.pipeline import encode_folder
from rle_splat.pipeline.render import render
from rle_splat.scene import Light, Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from tests.stability.fuzz import examples
from tests.stability.test_reader_fuzz import ANY_JSON, GOOD_FUNCTION, altered, outcome, places, says

SHAPE = (7, 6, 5)  # z, y, x
PLANES = 3  # of a chunk
FILE = "file"  # name of what is not a folder
VIEWS = {0: (90.0, 10.0), 1: (5.0, 10.0), 2: (20.0, 80.0)}  # principal axis -> azimuth, elevation
LAMP = Light(type="POINT", energy=900.0, matrix_world=np.diag((1.0, 1.0, 1.0, 1.0)) + np.eye(4, k=3) * 20.0)
TABLES = {"records": ("pre", ()), "surface": ("post", (LAMP,))}  # -> classification, lights


def view_of(volume, axis):
    camera, matrix = turntable(volume, *VIEWS[axis])
    return Scene(volume, TransferFunction.from_json(GOOD_FUNCTION), camera, 8, 8, matrix, headlight=False)


@pytest.fixture
def whole(tmp_path, monkeypatch, request):
    """A folder of three chunks."""
    monkeypatch.setattr(encode_folder._Chunks, "planes_at_once", lambda *_: PLANES)
    classification, lights = TABLES[request.param]
    voxels = np.random.default_rng(2).integers(0, 101, SHAPE, dtype=np.uint8)
    scene = replace(view_of(Volume(voxels, np.eye(4)), 1), lights=lights, headlight=True)
    encode_folder.encode_folder(scene, tmp_path / "a.rle", Quality(classification=classification))
    names = {path.name.rpartition(".")[2] for path in (tmp_path / "a.rle").iterdir()}
    assert request.param in names
    return tmp_path / "a.rle"


def pieces_of(folder, chunks) -> dict:
    """(Name of a table, chunk) -> its bytes."""
    pieces = {}
    for name in sorted(chunks[0][1]):
        content, at = (folder / name).read_bytes(), 0
        for number, (_, tables) in enumerate(chunks):
            pieces[name, number] = content[at : at + tables[name][0]]
            at += tables[name][0]
    return pieces


@st.composite
def damage(draw, header, pieces):
    """A header and pieces of tables, one of which lies."""
    pieces = dict(pieces)
    if draw(st.integers(0, 2)) == 0:
        return altered(header, draw(st.sampled_from(list(places(header)))), draw(ANY_JSON)), pieces
    for _ in range(draw(st.integers(1, 2))):
        key = draw(st.sampled_from(sorted(pieces)))
        content = bytearray(pieces[key])
        at = draw(st.integers(0, max(len(content) // 4 - 1, 0))) * 4
        kind = draw(st.sampled_from(["word", "byte", "cut", "longer"]))
        if kind == "cut":
            del content[at:]
        elif kind == "longer":
            content += bytes(4 * draw(st.integers(1, 9)))
        elif content:
            content[at : at + (4 if kind == "word" else 1)] = draw(st.binary(min_size=1, max_size=4))
        pieces[key] = bytes(content)
    return with_sizes(header, pieces), pieces


def write(path, header, pieces) -> int:
    """Write a folder, or a file if the name says so; return the bytes of its members."""
    files = {}
    for (name, _), content in sorted(pieces.items()):
        files[name] = files.get(name, b"") + content
    text = json.dumps(header)
    files[HEADER] = f"{zlib.crc32(text.encode()):08x}{text}".encode()
    if path.stem == FILE:
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in files.items():
                archive.writestr(name, content)
    else:
        path.mkdir(exist_ok=True)
        for name, content in files.items():
            (path / name).write_bytes(content)
    return sum(map(len, files.values()))


def rendered(path, axis, planes=None):
    """The picture of a folder, of its planes z [first, last) alone if they are given."""
    stored = read_encoded(path)
    scene = replace(view_of(stored, axis), volume=stored.of_planes(*planes) if planes else stored)
    return render(scene, Quality(classification=stored.classification, depth_rule="slice", warp_filter="bilinear",
                                threads=1, rays=0.0, sheet_density=1.0))  # fmt: skip


def with_sizes(header, pieces) -> dict:
    """The header with the sizes and checksums of ``pieces``."""
    chunks = [[planes, {name: [len(pieces[name, number]), zlib.crc32(pieces[name, number])] for name in tables}]
             for number, (planes, tables) in enumerate(header["slabs"])]  # fmt: skip
    return {**header, "slabs": chunks}


@pytest.mark.parametrize(
    "whole, table, chunk, change, planes, said",
    [
        ("surface", "rows.surface", 0, lambda content: b"", (PLANES, 2 * PLANES), "an entry for each voxel"),
        ("surface", "rows.surface", 2, lambda content: content[:-6], None, "an entry for each voxel"),
        ("surface", "rows.surface", 2, lambda content: content[:-2], None, "rows.surface is cut within an entry"),
        ("records", "rows.counts", 0, lambda content: content[:-8] + b"\4" + content[-7:], None, "counts do not fit"),
    ],
    indirect=["whole"],
)  # fmt: skip
def test_R3_one_table_that_does_not_fit(record, whole, tmp_path, table, chunk, change, planes, said):
    """What is beyond the chunks that a picture needs, too: all others begin behind it."""
    header = json.loads((whole / HEADER).read_text()[8:])
    pieces = pieces_of(whole, header["slabs"])
    for name, number in pieces:
        if name == table and number == chunk:
            pieces[name, number] = change(pieces[name, number])
    write(tmp_path / "b.rle", with_sizes(header, pieces), pieces)
    with pytest.raises(RleSplatError, match=said):
        rendered(tmp_path / "b.rle", 2, planes)
    says(record, "R3", "folders with one table that does not fit")


@pytest.mark.parametrize("whole", ["surface"], indirect=True)
@pytest.mark.parametrize(
    "lights",
    [
        {}, {"lights": 3}, {"lights": [3]}, {"lights": [{"color": 1}]}, {"lights": [], "world": "red"},
        {"lights": [], "world": [1.0] * 3, "environment": 3},
        {"lights": [], "world": [1.0] * 3, "environment": {"a": 1}},
    ],
    ids=str,
)  # fmt: skip
def test_R3_lights_that_are_none(record, whole, tmp_path, lights):
    header = json.loads((whole / HEADER).read_text()[8:])
    header["lighting"] = {"headlight_direction": None, **lights}
    write(tmp_path / "b.rle", header, pieces_of(whole, header["slabs"]))
    with pytest.raises(RleSplatError):
        rendered(tmp_path / "b.rle", 2)
    says(record, "R3", "folders with lights that are none")


@pytest.mark.parametrize("name", ["b", FILE])
@pytest.mark.parametrize("whole", TABLES, indirect=True)
def test_R3_folders(record, whole, tmp_path, name):
    header = json.loads((whole / HEADER).read_text()[8:])
    pieces = pieces_of(whole, header["slabs"])

    path = tmp_path / f"{name}.rle"
    write(path, header, pieces)
    if name != FILE:
        assert all((path / file.name).read_bytes() == file.read_bytes() for file in whole.iterdir())
    for axis in VIEWS:
        np.testing.assert_array_equal(rendered(path, axis).rgba, rendered(whole, axis).rgba)
        assert rendered(path, axis).rgba[..., 3].max() > 0.1

    @given(damage(header, pieces), st.sampled_from(sorted(VIEWS)), st.sampled_from([None, (PLANES, 2 * PLANES)]))
    @examples(100 if name != FILE else 35)  # a file differs from a folder only in how its members are found
    def search(content, axis, planes):
        size = write(path, *content)
        picture, _ = outcome(lambda: rendered(path, axis, planes if axis == 2 else None), size, 1e4)
        assert picture is None or np.isfinite(picture.rgba).all()

    search()
    says(record, "R3", "stored tables that lie")
