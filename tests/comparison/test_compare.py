"""All systems side by side: the probes' truth is T1, every system does what its entry says, the command shows it."""

import json

import numpy as np
import pytest

from benchmarks.phantoms import blobs
from rle_splat.accuracy.truths import truth
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.cli.main import main
from rle_splat.comparison.compare import compare, table_lines
from rle_splat.comparison.medium import scene_medium
from rle_splat.comparison.probe_truth import probe_truth
from rle_splat.comparison.table import SYSTEMS
from rle_splat.runtime.jit import numba
from rle_splat.scene import Quality, RleSplatError
from tests.ways import NUMPY

PARALLEL_ONLY = {"westover-sheet", "westover-composite", "laur-hanrahan", "totsuka-levoy"}
COMPILED_ONLY = PARALLEL_ONLY | {"levoy"}
# RMSE in levels that every system stays under on the blobs below, a tenth more than measured.
RMSE = {
    "rle": 0.051, "paper": 7.7, "unaccelerated": 0.051, "levoy": 0.116, "westover-sheet": 0.165,
    "westover-composite": 0.082, "lacroute": 1.56, "laur-hanrahan": 2.31, "ihm-lee": 0.051, "totsuka-levoy": 0.0015,
}  # fmt: skip
needs_numba = pytest.mark.skipif(numba is None, reason="half of the systems are compiled kernels: no numba here")


@pytest.fixture(scope="module")
def shaded(stand):
    function = TransferFunction(
        "shaded", None, ((0.02, 0.0), (0.6, 0.7)), ((0.0, 0.9, 0.2, 0.1), (0.5, 0.2, 0.5, 0.9)), 1.0, Shade()
    )
    return stand.scene(blobs((24, 22, 20), 12, width=(3.0, 4.0)), function=function, headlight=True, size=(56, 48))


def test_probe_truth_is_the_truth_at_its_pixels(stand):
    for perspective in (False, True):
        scene = stand.scene(blobs((14, 12, 16), 3), perspective=perspective)
        columns, rows, found = probe_truth(scene_medium(scene, stand.quality), 40)
        expected = truth(scene, pixels=(columns + 0.5, rows + 0.5))[0]
        assert len(found) > 30 and expected.max() > 0.1
        np.testing.assert_allclose(found, expected, atol=1e-6)


def test_probe_truth_of_shaded_colors(stand, shaded):
    medium = scene_medium(shaded, stand.quality)
    columns, rows, found = probe_truth(medium, 40)
    colors = np.zeros((20, 22, 24, 3))
    colors[medium.indices] = medium.colors
    expected = truth(shaded, pixels=(columns + 0.5, rows + 0.5), colors=colors)[0]
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert np.abs(found - truth(shaded, pixels=(columns + 0.5, rows + 0.5))[0]).max() > 0.05


@needs_numba
def test_every_system_is_near_what_it_claims(stand, shaded):
    report = compare(shaded, stand.quality, probes=300, repeats=1)
    assert [entry["name"] for entry in report["systems"]] == list(SYSTEMS) == list(RMSE)
    json.dumps(report)
    for entry in report["systems"]:
        assert "refused" not in entry, entry
        assert entry["error"]["rmse"] < RMSE[entry["name"]], (entry["name"], entry["error"])
        assert entry["memory_bytes"]["total"] == sum(
            size for name, size in entry["memory_bytes"].items() if name != "total"
        )
    ours = report["systems"][0]
    assert ours["time_ratio"] == ours["memory_ratio"] == 1.0
    assert len(table_lines(report)) == len(SYSTEMS) + 3


@needs_numba
def test_perspective_is_drawn_or_refused_in_a_sentence(stand):
    scene = stand.scene(blobs((16, 16, 16), 2), perspective=True, size=(32, 32))
    report = compare(scene, stand.quality, probes=30, repeats=1)
    refused = {entry["name"] for entry in report["systems"] if "refused" in entry}
    assert refused == PARALLEL_ONLY
    assert any("parallel projection" in line for line in table_lines(report))


def test_systems_share_one_medium_of_classified_voxels(stand):
    with pytest.raises(RleSplatError, match="classification pre, not post"):
        compare(stand.scene(blobs((9, 8, 7), 2), size=(12, 12)), Quality(), probes=9, repeats=1)


@NUMPY
def test_without_numba_the_rest_still_compares(stand, way):
    scene = stand.scene(blobs((9, 8, 7), 2), size=(12, 12))
    report = compare(scene, Quality.preset("draft", classification="pre"), probes=9, repeats=1)
    refused = {entry["name"]: entry["refused"] for entry in report["systems"] if "refused" in entry}
    assert set(refused) == COMPILED_ONLY and all("needs numba" in sentence for sentence in refused.values())


def test_an_empty_picture_compares_too(stand):
    report = compare(stand.scene(np.zeros((6, 7, 8)), size=(12, 12)), stand.quality, probes=9, repeats=1)
    for entry in report["systems"]:
        assert "refused" in entry or entry["error"]["largest"] < 1e-3, entry["name"]


def test_refusals(stand):
    scene = stand.scene(blobs((9, 8, 7), 2), size=(12, 12))
    with pytest.raises(RleSplatError, match="no system called 'volpack'; choose rle, "):
        compare(scene, stand.quality, ["volpack"])
    with pytest.raises(RleSplatError, match="take the meshes out"):
        compare(stand.scene(blobs((9, 8, 7), 2), triangles=np.eye(3)[None]), stand.quality)


@pytest.mark.parametrize("name", [name for name in SYSTEMS if numba is not None or name not in COMPILED_ONLY])
def test_a_picture_of_each_system(stand, name):
    scene = stand.scene(blobs((16, 14, 12), 2), size=(40, 30))
    rendering = stand.draw(SYSTEMS[name], scene)
    assert rendering.rgba.shape == (30, 40, 4) and rendering.rgba.dtype == np.float32
    assert rendering.depth.shape == (30, 40) and 0.1 < rendering.rgba[..., 3].max() <= 1.0


def test_command(tmp_path, capsys):
    path = tmp_path / "blobs.raw"
    (255 * blobs((20, 18, 16), 3)).astype(np.uint8).tofile(path)
    given = ["compare", str(path), "--shape", "20", "18", "16", "--dtype", "uint8", "--size", "24", "--no-shading"]
    command = [*given, "--system", "lacroute", "--system", "unaccelerated", "--probes", "16", "--repeats", "1"]
    assert main([*command, "--json", str(tmp_path / "out.json")]) == 0
    shown = capsys.readouterr().out
    assert "unaccelerated" in shown and "against lacroute" in shown and "levoy" not in shown
    report = json.loads((tmp_path / "out.json").read_text())
    assert report["command"] == "compare" and [e["name"] for e in report["systems"]] == ["lacroute", "unaccelerated"]
    assert main([*given, "--system", "volpack"]) == 2
    assert "no system called 'volpack'" in capsys.readouterr().err
    assert main([*given, "--probes", "0"]) == 2
