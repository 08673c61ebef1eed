"""Transfer functions of other programs on the command line: they reach the picture, or give a clear error."""

import json

import numpy as np
import pytest

pytestmark = pytest.mark.usefixtures("by_numpy")  # no kernels to compile

MRML = """<MRML>
<VolumeProperty name="Red" shade="0" scalarOpacity="4 60 0 200 0.5" gradientOpacity="4 0 1 255 1"
 colorTransfer="4 0 1 0 0"/>
<VolumeProperty name="Blue" shade="0" scalarOpacity="4 60 0 200 0.5" gradientOpacity="4 0 0.5 255 1"
 colorTransfer="4 0 0 0 1"/>
</MRML>"""


@pytest.fixture
def picture(call, raw, raw_options, tmp_path):
    """``picture(*words)``: (the result of the call, rgba or None, the report's transfer function or None)."""

    def render(*words):
        out, report = tmp_path / "out.npy", tmp_path / "report.json"
        done = call("render", raw, *raw_options, *words, "--size", "16", "-o", out, "--json", report)
        if done.code:
            return done, None, None
        return done, np.load(out), json.loads(report.read_text())["transfer_function"]

    return render


@pytest.fixture
def presets(tmp_path):
    path = tmp_path / "presets.xml"
    path.write_text(MRML)
    return path


def test_one_of_slicers_presets_by_name(picture, presets):
    done, rgba, function = picture("--transfer-function", presets, "--transfer-name", "Blue")
    assert done.code == 0 and function["name"] == "Blue"
    assert "read from" in function["reason"] and "gradient opacity" in function["reason"], "what differs is said"
    assert rgba[..., 2].max() > 0.3 and rgba[..., :2].max() == 0.0
    _, other, function = picture("--transfer-function", presets, "--transfer-name", "Red")
    assert function["reason"] == f"read from {presets}"
    assert (rgba[..., 2] < other[..., 0] + 1.0 / 255.0).all() and (rgba[..., 2] < other[..., 0] - 0.1).any()


@pytest.mark.parametrize("words, said", [
    ((), "name one of them with --transfer-name: Red, Blue"),
    (("--transfer-name", "Green"), "no transfer function 'Green'; choose one of Red, Blue"),
])  # fmt: skip
def test_a_name_is_needed_and_must_be_there(picture, presets, words, said):
    done, _, _ = picture("--transfer-function", presets, *words)
    assert done.code == 2 and said in done.err and len(done.err.strip().splitlines()) == 1


def test_a_name_without_a_file_is_refused(picture):
    done, _, _ = picture("--transfer-name", "Red")
    assert done.code == 2 and "--transfer-function" in done.err


def test_a_color_map_spans_the_values(picture, tmp_path):
    (tmp_path / "map.cmap").write_text("0 0 0\n1 1 0\n")
    done, rgba, function = picture("--transfer-function", tmp_path / "map.cmap", "--no-shading")
    assert done.code == 0 and function["name"] == "map"
    assert rgba[..., 0].max() > 0.1 and rgba[..., 2].max() == 0.0


def test_a_coarser_level_is_as_dense(call, tmp_path, write_json):
    z, y, x = np.mgrid[:32, :32, :32] - 15.5
    np.where(x**2 + y**2 + z**2 < 12.0**2, 200, 0).astype(np.uint8).tofile(tmp_path / "ball.raw")
    function = write_json({"opacity": [[100, 0.0], [101, 0.03]], "color": [[0, 1, 1, 1]], "shade": False})
    words = "--shape", 32, 32, 32, "--dtype", "uint8", "--transfer-function", function, "--size", 32
    inside = []
    for level in (0, 2):
        out = tmp_path / f"{level}.npy"
        done = call("render", tmp_path / "ball.raw", *words, "--level", level, "-o", out)
        assert done.code == 0 and ("one was read" in done.out) == (level == 2)
        inside.append(np.load(out)[14:18, 14:18, 3].mean())
    assert inside[0] == pytest.approx(1.0 - 0.97**24, abs=0.05) and inside[1] == pytest.approx(inside[0], abs=0.05)
