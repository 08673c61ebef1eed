"""Transfer functions of other programs: 3D Slicer's presets, color maps of niivue and FSL.

The files are written here by hand after the formats' own sources (see the readers); no file of theirs is copied.
"""

import json

import numpy as np
import pytest

from rle_splat.classify.foreign import scene_linear_points
from rle_splat.classify.presets import RELATIVE
from rle_splat.classify.transfer_files import choose_function, fit_function, read_transfer_functions
from rle_splat.classify.transfer_function import GradientOpacity, Shade, TransferFunction
from rle_splat.scene import RleSplatError
from rle_splat.scene.color import linear, to_display
from rle_splat.volume.volume import Volume

PLAIN = {
    "name": "Plain", "interpolation": "1", "shade": "1", "ambient": "0.1", "diffuse": "0.9", "specular": "0.3",
    "specularPower": "12", "scalarOpacity": "8 -100 0 50 0 50 0.4 900 0.8", "gradientOpacity": "4 0 1 255 1",
    "colorTransfer": "8 -100 0.2 0.1 0.1 900 0.2 0.15 0.1",
}  # fmt: skip


def written(folder, content, name="file.xml"):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def mrml(*properties):
    """An MRML file of volume properties, between other nodes as a scene has them."""
    rows = ["<VolumeProperty " + " ".join(f'{k}="{v}"' for k, v in one.items()) + "/>" for one in properties]
    return f'<?xml version="1.0" encoding="utf-8"?>\n<MRML><Camera name="c"/>{"".join(rows)}</MRML>\n'


def only(folder, content, name="file.xml"):
    (found,) = read_transfer_functions(written(folder, content, name))
    return found


def refusal(path):
    with pytest.raises(RleSplatError) as caught:
        read_transfer_functions(path)
    sentence = str(caught.value)
    assert sentence.endswith(".") and "\n" not in sentence and "Traceback" not in sentence
    return sentence


# --- 3D Slicer ------------------------------------------------------------------------------------------------


def test_a_volume_property_of_slicer(tmp_path):
    found = only(tmp_path, mrml(PLAIN))
    function = found.function
    assert found.remarks == ()
    assert (function.name, function.unit, function.opacity_unit_distance) == ("Plain", None, 1.0)
    assert function.opacity == ((-100, 0), (50, 0), (50, 0.4), (900, 0.8))
    assert function.shade == Shade(0.1, 0.9, 0.3, 48.0), "four times Slicer's, whose highlights are Phong's"
    assert function.gradient_opacity is None
    np.testing.assert_allclose(function.color_at(-100.0), linear((0.2, 0.1, 0.1)))


def test_opacity_is_per_millimeter(tmp_path):
    """VTK: the opacity of a step of length d is 1 - (1 - alpha)^(d / unit distance); ours is 1 - exp(-sigma d)."""
    function = only(tmp_path, mrml(PLAIN)).function
    alpha, step = float(function.alpha_at(50.0)), 0.3
    sigma = -np.log1p(-alpha) / function.opacity_unit_distance
    assert 1.0 - np.exp(-sigma * step) == pytest.approx(1.0 - (1.0 - 0.4) ** (step / 1.0))


def test_values_that_do_not_ascend_are_steps(tmp_path):
    """Slicer moves a value that is not above the one before it just above that one."""
    function = only(tmp_path, mrml({**PLAIN, "scalarOpacity": "8 0 0 100 0.2 90 0.5 200 1"})).function
    assert function.opacity == ((0, 0), (100, 0.2), (100, 0.5), (200, 1))


def test_unshaded(tmp_path):
    assert only(tmp_path, mrml({**PLAIN, "shade": "0"})).function.shade is None


@pytest.mark.parametrize("text, ramp", [
    ("4 0 1 255 1", None),
    ("4 10 0 60 1", GradientOpacity(10, 60)),
    ("8 0 0 10 0 60 1 255 1", GradientOpacity(10, 60)),
    ("6 10 0 35 0.5 60 1", GradientOpacity(10, 60)),
    ("4 30 0 30 1", GradientOpacity(30, 30)),
    ("4 0 0.5 255 1", GradientOpacity(0, 255, ((0, 0.5), (1, 1)))),
    ("4 0 1 255 0", GradientOpacity(0, 255, ((0, 1), (1, 0)))),
    ("6 10 0 30 0.9 60 1", GradientOpacity(10, 60, ((0, 0), (0.4, 0.9), (1, 1)))),
    ("4 30 0.2 30 0.7", GradientOpacity(0, 30, ((1, 0.2), (1, 0.7)))),
    ("4 0 0.3 9 0.3", GradientOpacity(0, 9, ((1, 0.3),))),
    ("4 -9 0 9 1", GradientOpacity(0, 9, ((0, 0.5), (1, 1)))),
])  # fmt: skip
def test_the_curve_of_gradient_opacity_is_read(tmp_path, text, ramp):
    found = only(tmp_path, mrml({**PLAIN, "gradientOpacity": text}))
    assert found.function.gradient_opacity == ramp
    assert len(found.remarks) == (ramp is not None), "a curve comes with the remark about its unit"
    if ramp is not None:
        values, heights = np.array(text.split()[1:], float).reshape(-1, 2).T
        sizes = np.setdiff1d(np.linspace(0.0, 100.0, 500), values)  # not at a step
        np.testing.assert_allclose(ramp.factor(sizes), np.interp(sizes, values, heights), atol=1e-6)


def test_nearest_neighbors_are_remarked(tmp_path):
    assert "nearest" in only(tmp_path, mrml({**PLAIN, "interpolation": "0"})).remarks[0]


def test_a_file_of_many_presets_names_them_apart(tmp_path):
    path = written(tmp_path, mrml(PLAIN, {**PLAIN, "name": "Other"}, PLAIN, {**PLAIN, "name": ""}))
    found = read_transfer_functions(path)
    names = [one.function.name for one in found]
    assert names[:2] == ["Plain", "Other"] and len(set(names)) == 4 and all(names)
    assert choose_function(found, "Other", path, "--transfer-name") is found[1]
    with pytest.raises(RleSplatError, match="--transfer-name: Plain, Other"):
        choose_function(found, None, path, "--transfer-name")
    with pytest.raises(RleSplatError, match="no transfer function 'Third'; choose one of Plain, Other"):
        choose_function(found, "Third", path, "--transfer-name")


@pytest.mark.parametrize("change, words", [
    ({"scalarOpacity": "8 -100 0 50 0 50 0.4 900"}, "announces 8 numbers, but 7 follow"),
    ({"scalarOpacity": "8 -100 0 50 0 50 0.4 900 0.8 7"}, "announces 8 numbers, but 9 follow"),
    ({"scalarOpacity": "3 0 0 1"}, "must have 2 numbers for each point, but has 3"),
    ({"scalarOpacity": "0"}, "must have 2 numbers for each point, but has 0"),
    ({"scalarOpacity": "4 0 0 100 many"}, "must be a finite number, not 'many'"),
    ({"scalarOpacity": "4 0 0 nan 1"}, "must be a finite number, not 'nan'"),
    ({"scalarOpacity": "4 0 0 1e999 1"}, "must be a finite number"),
    ({"scalarOpacity": "4 0 0 100 1.5"}, "opacity at 100 is 1.5"),
    ({"scalarOpacity": ""}, "has no scalarOpacity"),
    ({"scalarOpacity": "many 0 0"}, "The count of"),
    ({"colorTransfer": "4 0 0.1 0.2 1.2"}, "must be from 0 to 1"),
    ({"colorTransfer": "2 0 0.1"}, "must have 4 numbers"),
    ({"ambient": "much"}, "ambient must be a finite number"),
    ({"specular": "-1"}, "must not be below zero"),
])  # fmt: skip
def test_bad_volume_properties_get_one_sentence(tmp_path, change, words):
    sentence = refusal(written(tmp_path, mrml({**PLAIN, **change})))
    assert words in sentence and "'Plain'" in sentence and "file.xml" in sentence


@pytest.mark.parametrize(
    "content, words",
    [
        ('<!DOCTYPE a [<!ENTITY b "c">]><MRML><VolumeProperty name="&b;"/></MRML>', "DOCTYPE"),
        ('<!DOCTYPE a SYSTEM "file:///etc/hostname"><MRML/>', "DOCTYPE"),
        ("<MRML><VolumeProperty></MRML>", "not well-formed XML"),
        ('<?xml version="1.0" encoding="no-such"?><MRML/>', "not well-formed XML"),
        ("<MRML/>", "has no VolumeProperty element"),
    ],
)
def test_bad_xml_gets_one_sentence(tmp_path, content, words):
    assert words in refusal(written(tmp_path, content))


def test_a_vp_file(tmp_path):
    names = ("interpolation", "shade", "diffuse", "ambient", "specular", "specularPower", "scalarOpacity",
             "gradientOpacity", "colorTransfer")  # fmt: skip
    lines = [PLAIN[name] for name in names]
    by_xml = only(tmp_path, mrml({**PLAIN, "name": "head"})).function
    assert only(tmp_path, "\n".join(lines) + "\n", "head.vp").function == by_xml
    assert "ends after 8 lines" in refusal(written(tmp_path, "\n".join(lines[:8]), "short.vp"))


def vp_json(**changes):
    component = {
        "shade": True, "lighting": {"ambient": 0.1, "diffuse": 0.9, "specular": 0.3, "specularPower": 12},
        "scalarOpacityUnitDistance": 2.5,
        "scalarOpacity": {"points": [{"x": 9, "y": 1, "midpoint": 0.5, "sharpness": 0}, {"x": 1, "y": 0}]},
        "rgbTransferFunction": {"points": [{"x": 1, "color": [0, 0.5, 1], "midpoint": 0.5, "sharpness": 0}]},
        "gradientOpacity": {"points": [{"x": 5, "y": 0}, {"x": 15, "y": 1}]}, **changes,
    }  # fmt: skip
    return {"@schema": "volume-property-schema-v1.0.0.json#", "volumeProperties": [{"components": [component]}]}


def test_a_vp_json_file(tmp_path):
    function = only(tmp_path, json.dumps(vp_json()), "a.vp.json").function
    assert function.name == "a" and function.opacity == ((1, 0), (9, 1)) and function.opacity_unit_distance == 2.5
    assert function.color == ((1.0, *linear((0, 0.5, 1))),)
    assert function.gradient_opacity == GradientOpacity(5, 15) and function.shade == Shade(0.1, 0.9, 0.3, 48)
    off = only(tmp_path, json.dumps(vp_json(disableGradientOpacity=True)), "a.vp.json").function
    assert off.gradient_opacity is None


@pytest.mark.parametrize(
    "content, words",
    [
        ({"volumeProperties": []}, "no volume properties"),
        ({"volumeProperties": 3}, "must be a list"),
        ({"volumeProperties": [7]}, "must be an object"),
        ({"volumeProperties": [{"components": []}]}, "without components"),
        (vp_json(scalarOpacity={"points": [{"x": 1}]}), "must be a finite number"),
        (vp_json(scalarOpacity={"points": []}), "has no points"),
        (vp_json(rgbTransferFunction={"points": [{"x": 1, "color": [1, 1]}]}), "three numbers"),
        (vp_json(scalarOpacityUnitDistance=0), "above zero"),
        (vp_json(lighting=[]), "must be an object"),
    ],
)
def test_bad_vp_json_gets_one_sentence(tmp_path, content, words):
    assert words in refusal(written(tmp_path, json.dumps(content), "a.vp.json"))


def test_bent_curves_are_remarked(tmp_path):
    bent = vp_json(scalarOpacity={"points": [{"x": 0, "y": 0, "sharpness": 0.5}, {"x": 1, "y": 1}]})
    assert any("Midpoints" in remark for remark in only(tmp_path, json.dumps(bent), "a.vp.json").remarks)


# --- color maps -----------------------------------------------------------------------------------------------

NIIVUE = {"min": -10, "max": 245, "R": [0, 255], "G": [0, 51], "B": [0, 0], "A": [0, 102], "I": [0, 255]}


def test_a_color_map_of_niivue(tmp_path):
    function = only(tmp_path, json.dumps(NIIVUE), "warm.json").function
    assert (function.name, function.unit, function.span) == ("warm", None, (-10.0, 245.0))
    assert function.opacity == ((-10, 0), (245, 0.4))
    np.testing.assert_allclose(function.color_at(245.0), linear((1.0, 0.2, 0.0)))
    np.testing.assert_allclose(to_display(function.color_at(117.5)), (0.5, 0.1, 0.0), atol=2 / 255)


def test_a_color_map_of_niivue_without_values(tmp_path):
    """It spans the window; alpha is 64 of 255 but for the first; positions are even."""
    bare = {"R": [0, 128, 255], "G": [0, 0, 0], "B": [0, 0, 0]}
    function = only(tmp_path, json.dumps(bare), "red.json").function
    assert function.unit == RELATIVE and function.opacity == ((0, 0), (0.5, 64 / 255), (1, 64 / 255))


@pytest.mark.parametrize("change, words", [
    ({"G": [0]}, "equal length"),
    ({"R": [0, 256]}, "from 0 to 255"),
    ({"R": [0, "x"]}, "finite number"),
    ({"R": []}, "list of numbers"),
    ({"B": None}, "list of numbers"),
    ({"I": [255, 0]}, "ascend from 0"),
    ({"I": [3, 255]}, "ascend from 0"),
    ({"min": 300}, "above max"),
    ({"max": "high"}, "finite number"),
])  # fmt: skip
def test_bad_color_maps_of_niivue_get_one_sentence(tmp_path, change, words):
    assert words in refusal(written(tmp_path, json.dumps({**NIIVUE, **change}), "warm.json"))


def test_a_color_map_of_fsl(tmp_path):
    found = only(tmp_path, "# one color a line\n1 0.25 0\n\n0 0.75 1  # the middle\n0.5 0 1\n", "my.cmap")
    function = found.function
    assert (function.name, function.unit, function.span) == ("my", RELATIVE, (0.0, 1.0))
    for value, color in ((0.0, (1, 0.25, 0)), (0.5, (0, 0.75, 1)), (1.0, (0.5, 0, 1))):
        np.testing.assert_allclose(function.color_at(value), linear(color))
    np.testing.assert_allclose(to_display(function.color_at(0.25)), (0.5, 0.5, 0.5), atol=2 / 255)
    assert function.alpha_at(0.0) == 0.0 and "no opacities" in found.remarks[0]


@pytest.mark.parametrize("content, words", [
    ("0 0 1\n1 1\n", "line 2 has 2 words"),
    ("0 0 255\n", "from 0 to 1"),
    ("0 0 blue\n", "finite number, not 'blue'"),
    ("# nothing\n", "has no colors"),
    ("", "has no colors"),
    (b"\xff\xd8\xff\x00\x01", "is not text"),
])  # fmt: skip
def test_bad_rows_get_one_sentence(tmp_path, content, words):
    assert words in refusal(written(tmp_path, content, "my.cmap"))


def test_a_relative_function_is_moved_to_the_values(tmp_path):
    function = only(tmp_path, "0 0 0\n1 1 1\n", "gray.cmap").function
    volume = Volume(np.linspace(100, 1100, 1000).astype(np.uint16).reshape(10, 10, 10), np.eye(4), value_unit="HU")
    moved = fit_function(function, volume)
    assert moved.unit == "HU"
    np.testing.assert_allclose(moved.span, np.percentile(volume.voxels, (1.0, 99.9)), atol=2.5)
    absolute = only(tmp_path, mrml(PLAIN)).function
    assert fit_function(absolute, volume) is absolute


# --- what all share -------------------------------------------------------------------------------------------


def test_our_own_file(tmp_path):
    function = TransferFunction("own", "HU", ((0, 0), (9, 1)), ((0, 1, 2, 3),), 2.0, None, GradientOpacity(1, 2))
    function.save(tmp_path / "own.json")
    (found,) = read_transfer_functions(tmp_path / "own.json")
    assert found.function == function and found.remarks == ()


def test_files_that_are_not_there_or_too_large(tmp_path):
    assert "check the path" in refusal(tmp_path / "gone.xml")
    with open(tmp_path / "large.xml", "wb") as file:
        file.truncate((1 << 26) + 1)
    assert "too large" in refusal(tmp_path / "large.xml")


@pytest.mark.parametrize("first, last", [
    ((0, 0, 0), (1, 1, 1)), ((0.5, 0, 0.1), (0, 1, 1)), ((0.9, 0.2, 0.2), (0.85, 0.2, 0.3)),
    ((0, 0.03, 0), (0.04, 0, 0)),
])  # fmt: skip
def test_display_colors_are_interpolated_as_a_display_does(first, last):
    points = scene_linear_points([(-5.0, *first), (3.0, *last)])
    assert points[0][0] == -5.0 and points[-1][0] == 3.0 and len(points) <= 33
    values = np.linspace(-5.0, 3.0, 500)
    columns = np.array(points).T
    shown = to_display(np.stack([np.interp(values, columns[0], channel) for channel in columns[1:]], axis=1))
    share = (values[:, None] + 5.0) / 8.0
    np.testing.assert_allclose(shown, (1 - share) * np.array(first) + share * np.array(last), atol=2.5 / 255)


def test_a_step_of_color_stays_a_step():
    points = scene_linear_points([(0.0, 0, 0, 0), (1.0, 0, 0, 0), (1.0, 1, 1, 1)])
    assert [value for value, *_ in points] == [0.0, 1.0, 1.0]
