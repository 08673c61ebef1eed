"""The four commands do what they say, on small volumes; pictures are compared with those of the Python interface."""

from __future__ import annotations

import json

import numpy as np
import pytest

import rle_splat
from rle_splat.scene import NO_DEPTH
from rle_splat.scene.display import to_bytes
from tests.ways import both

SIZE = ("--size", "40", "30")


@pytest.fixture
def picture(call, tmp_path, raw, raw_options, function_file):
    """Render the ball with these options to .npy; returns the pixels and the report."""

    def run(*extra, volume=raw, options=tuple(raw_options), function=True):
        output, report = tmp_path / "p.npy", tmp_path / "p.json"
        chosen = ("--transfer-function", function_file) if function else ()
        result = call("render", volume, *options, *chosen, *SIZE, "-o", output, "--json", report, *extra)
        assert result.code == 0 and result.err == "", result
        return np.load(output), json.loads(report.read_text())

    return run


# --- render -------------------------------------------------------------------------------------------------------


def test_render_is_the_python_interface(picture, raw, shape_xyz, function_file):
    rgba, _ = picture("--azimuth", "35", "--elevation", "-20", "--fit", "1.1", "--spacing", "1", "1", "1.5")
    volume = rle_splat.read_volume(raw, shape=shape_xyz, dtype="uint8", spacing=(1, 1, 1.5))
    camera, matrix = rle_splat.turntable(volume, 35.0, -20.0, 1.1)
    function = rle_splat.TransferFunction.from_json(function_file)
    scene = rle_splat.Scene(volume, function, camera, 40, 30, volume_matrix=matrix)
    expected = rle_splat.render(scene, rle_splat.Quality.preset("standard"))
    assert rgba.shape == (30, 40, 4) and rgba[..., 3].max() > 0.5
    assert np.array_equal(rgba, expected.rgba)


def test_a_motion_file_moves_what_it_names_while_the_shutter_is_open(picture, tmp_path):
    moved = np.eye(4)
    moved[0, 3] = 6.0
    path = tmp_path / "motion.json"
    path.write_text(json.dumps([{}, {"volume_matrix": moved.tolist()}]))
    (still, _), (blurred, _) = picture(), picture("--motion", path)
    across = [np.flatnonzero(rgba[..., 3].max(axis=0) > 0.01) for rgba in (still, blurred)]
    per_unit = 30 / (1.25 * 20)  # pixels: the view is 1.25 times the volume's 20 voxels high
    # Five pictures, each in the middle of a fifth of the time.
    assert np.ptp(across[1]) - np.ptp(across[0]) == pytest.approx(0.8 * 6.0 * per_unit, abs=1.01)
    assert blurred.sum() == pytest.approx(still.sum(), rel=0.02)


def test_every_suffix_shows_the_same_picture(call, tmp_path, raw, raw_options, function_file):
    Image, OpenEXR = pytest.importorskip("PIL.Image"), pytest.importorskip("OpenEXR")
    outputs = [tmp_path / name for name in ("p.npy", "p.exr", "p.png", "over.png")]
    words = ["render", raw, *raw_options, "--transfer-function", function_file, *SIZE]
    assert call(*words, *(word for path in outputs[:3] for word in ("-o", path))).code == 0
    assert call(*words, "-o", outputs[3], "--background", "0.1", "0.2", "0.3").code == 0
    rgba = np.load(outputs[0])
    with OpenEXR.File(str(outputs[1]), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    assert np.array_equal(np.stack([channels[name] for name in "RGBA"], axis=-1), rgba)
    seen = rgba[..., 3] > 0.9
    assert seen.any() and (channels["Depth.Z"][seen] < NO_DEPTH).all()
    assert (channels["Depth.Z"][rgba[..., 3] == 0.0] == np.float32(NO_DEPTH)).all()
    assert np.array_equal(np.asarray(Image.open(outputs[2])), to_bytes(rgba))
    assert np.array_equal(np.asarray(Image.open(outputs[3])), to_bytes(rgba, (0.1, 0.2, 0.3)))


def test_the_report_has_every_key(picture, shape_xyz):
    _, report = picture("--threads", "1", "--background", "0", "0", "1")
    assert report["image"] == {"width": 40, "height": 30}
    assert set(report["volume"]) >= {"shape_xyz", "visible_voxels", "visible_fraction"}
    assert report["volume"]["shape_xyz"] == list(shape_xyz)
    stages = report["stages_ms"]
    assert set(stages) >= {"read", "classify", "shade", "encode", "splat", "warp", "total"}
    assert stages["total"] >= sum(stages[name] for name in ("read", "classify", "shade", "encode", "splat", "warp"))
    assert set(report["memory_bytes"]) >= {
        "voxel_data", "runs", "scanline_pointers", "data_pointers", "total", "axes_held",
    }  # fmt: skip
    assert report["memory_bytes"]["axes_held"] == ["y"]  # azimuth 0 looks along +y
    assert all(set(effect) == {"name", "on", "reason", "ms"} for effect in report["effects"])
    assert set(report["error"]) >= {"tolerance", "predicted", "measured", "truth", "probes"}
    assert report["plan"]["quality"] == "standard" and report["threads"] == 1
    assert report["background"] == [0.0, 0.0, 1.0]


def test_a_camera_file_with_the_turntables_camera(picture, write_json, raw, shape_xyz):
    rgba, _ = picture("--azimuth", "50", "--perspective", "--fov", "30", "--no-headlight")
    volume = rle_splat.read_volume(raw, shape=shape_xyz, dtype="uint8")
    camera, _ = rle_splat.turntable(volume, 50.0, perspective=True, fov=30.0)
    described = {name: getattr(camera, name) for name in camera.__dataclass_fields__}
    described["matrix_world"] = camera.matrix_world.tolist()
    same, _ = picture("--camera", write_json(described, "camera.json"))  # no headlight unless it is asked for
    assert np.array_equal(same, rgba)
    lit, _ = picture("--camera", write_json(described, "camera.json"), "--headlight")
    assert not np.array_equal(lit, rgba)


def test_scene_scale_changes_depth_only(picture):
    rgba, _ = picture("--azimuth", "20")
    scaled, _ = picture("--azimuth", "20", "--scene-scale", "0.001")
    assert np.abs(scaled - rgba).max() < 1e-5


def test_a_volume_matrix_turns_the_volume_before_the_turntable(picture, write_json):
    """A volume turned by 90 degrees about z, seen from azimuth 90: the picture of the volume as it was."""
    as_it_was, _ = picture("--azimuth", "10", "--no-shading")
    quarter = [[0, -1, 0, 7], [1, 0, 0, -3], [0, 0, 1, 5], [0, 0, 0, 1]]
    turned, _ = picture("--azimuth", "100", "--no-shading", "--volume-matrix", write_json(quarter, "matrix.json"))
    assert np.abs(turned - as_it_was).max() < 1e-5


def test_lights_options(picture, write_json):
    from_the_camera, _ = picture()
    unlit, report = picture("--no-shading")
    assert not np.array_equal(from_the_camera, unlit)
    assert np.array_equal(picture("--no-headlight")[0], unlit)
    shading = next(effect for effect in report["effects"] if effect["name"] == "shading")
    assert not shading["on"] and shading["reason"]
    sun = [{"type": "SUN", "energy": np.pi, "matrix_world": [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]}]
    lit, _ = picture("--lights", write_json(sun, "lights.json"))
    # A sun of strength pi along the view is what a headlight is.
    assert np.abs(lit - from_the_camera).max() < 1e-5


def test_an_effect_is_forced_by_its_name(picture):
    unlit, _ = picture("--no-shading")
    forced, report = picture("--effect", "shading=off")
    assert np.array_equal(forced, unlit)
    effects = {effect["name"]: effect for effect in report["effects"]}
    assert effects["shading"] == {"name": "shading", "on": False, "reason": "by hand", "ms": 0.0}
    matt, report = picture("--effect", "mesh-occlusion=off", "--effect", "specular=on", "--effect", "specular=off")
    assert not np.array_equal(matt, picture()[0]) and not np.array_equal(matt, unlit)
    assert np.array_equal(picture("--effect", "specular=auto")[0], picture()[0])


def test_a_mode_shows_what_it_says_whatever_the_classification(picture):
    composite, _ = picture()
    largest, report = picture("--mode", "mip")
    effects = {effect["name"]: effect for effect in report["effects"]}
    effect = effects["mode"]
    assert effect["on"] and effect["reason"] == "mode MIP" and effect["ms"] > 0.0
    assert not effects["shading"]["on"] and not np.array_equal(largest, composite)
    by_pre, report = picture("--mode", "mip", "--classification", "pre", "--depth-rule", "slice")
    assert report["plan"]["classification"] == "post" and any("post was used, not pre" in r for r in report["remarks"])
    assert np.array_equal(by_pre, picture("--mode", "mip", "--classification", "post", "--depth-rule", "slice")[0])
    assert np.array_equal(picture("--mode", "mip", "--effect", "mode=off")[0], composite)


def test_qualities_reach_the_plan(picture):
    plan = picture("--quality", "draft")[1]["plan"]
    assert (plan["depth_rule"], plan["sheet_density"]) == ("preintegrated", 0.45)
    assert picture("--quality", "draft", "--classification", "pre")[1]["plan"]["depth_rule"] == "slice"
    plan = picture("--paper")[1]["plan"]
    assert plan["model"] == "opacity" and plan["quality"] == "paper" and not plan["length_correction"]
    plan = picture("--sheet-density", "2", "--termination", "0.01")[1]["plan"]
    assert (plan["quality"], plan["sheet_density"], plan["termination"]) == ("custom", 2.0, 0.01)
    assert both(lambda: picture()[1]["plan"]["backend"])[1] == "numpy"
    assert picture("--minification", "widen")[1]["plan"]["minification"] == "widen"


def test_post_is_the_default_and_the_papers_classification_is_chosen_by_name(picture):
    """By --classification beside a quality or knobs, or by a knob whose value post does not have; the report tells."""
    rgba, report = picture()
    plan = report["plan"]
    assert plan["classification"] == "post" and report["error"]["truth"] == "T2"
    assert not any("Classified by" in remark for remark in report["remarks"])
    for words in ((), ("--quality", "fine"), ("--sheet-density", "2")):
        before, report = picture(*words, "--classification", "pre")
        assert report["plan"]["classification"] == "pre" and report["error"]["truth"] == "T1"
        assert report["plan"]["depth_rule"] == "simpson" and (before != rgba).any()
        assert report["plan"]["quality"] == {"--quality": "fine", "--sheet-density": "custom"}.get(
            words[0] if words else None, "standard"
        )
        assert not any("Classified by" in remark for remark in report["remarks"])
    for knob, value in (("kernel", "bspline3"), ("model", "opacity"), ("minification", "widen"), ("record", "8")):
        _, report = picture(f"--{knob}", value)
        assert report["plan"]["classification"] == "pre" and str(report["plan"][knob]) == value
        assert [r for r in report["remarks"] if f"--{knob} {value}" in r and "Classified by pre" in r]
    assert picture("--paper")[1]["plan"]["classification"] == "pre"


def test_a_classification_that_was_removed_is_replaced_and_a_sentence_says_so(
    call, refused, picture, raw, raw_options, tmp_path
):
    """By every command that takes it; the same knobs have the same picture."""
    sentence = "The classification 'refined' was removed; 'post' is used instead."
    expected, _ = picture("--quality", "draft")
    found, report = picture("--quality", "draft", "--classification", "refined")
    assert np.array_equal(found, expected) and report["plan"]["classification"] == "post"
    assert report["remarks"].count(sentence) == 1
    short = picture("--classification", "refined", "--record", "8", "--kernel", "bspline3")[1]
    assert "'post' with the kernel tent and the record 16 is used" in " ".join(short["remarks"])
    remarks = picture("--minification", "pool", "--sheet-density", "0.5")[1]["remarks"]
    assert "The minification 'pool' was removed; 'widen' is used instead." in remarks
    assert "Classified by pre, because post does not support --minification widen." in remarks
    words = (raw, *raw_options, "--classification", "refined", "-o", tmp_path / "x.png")
    for command in (
        ("render", *words, "--size", "16", "--tolerance", "9"), ("figure", *words, "--width-cm", "2", "--dpi", "60"),
        ("accuracy", *words, "--size", "16", "--repeats", "1", "--probes", "20"),
    ):  # fmt: skip
        done = call(*command)
        assert done.code == 0 and done.err == "" and done.out.count(sentence) == 1, done


def test_the_default_transfer_function_is_explained_and_not_blank(picture, call, raw, raw_options, tmp_path):
    rgba, report = picture(function=False)
    assert rgba[..., 3].max() > 0.1 and len(report["transfer_function"]["reason"]) > 10
    result = call("render", raw, *raw_options, *SIZE, "-o", tmp_path / "q.npy")
    assert report["transfer_function"]["reason"] in result.out
    fitted, report = picture("--preset", "smoke", function=False)
    assert fitted[..., 3].max() > 0.0 and "Smoke" in report["transfer_function"]["reason"]


def test_a_gzip_and_a_size_before_the_volume(call, tmp_path, raw, raw_options, picture):
    import gzip

    packed = tmp_path / "ball.raw.gz"
    packed.write_bytes(gzip.compress(raw.read_bytes()))
    expected, _ = picture()
    found, _ = picture(volume=packed)
    assert np.array_equal(found, expected)
    output = tmp_path / "s.npy"
    assert call("render", "--size", "20", raw, *raw_options, "-o", output).code == 0
    assert np.load(output).shape == (20, 20, 4)


# --- encode, and rendering what it wrote -----------------------------------------------------------------------------


@pytest.fixture
def encoded(call, tmp_path, raw, raw_options, function_file):
    def run(*extra):
        path, report = tmp_path / "ball.rle", tmp_path / "e.json"
        words = ("--transfer-function", function_file, "-o", path, "--json", report)
        result = call("encode", raw, *raw_options, *words, *extra)
        assert result.code == 0 and result.err == "", result
        return path, json.loads(report.read_text()), result.out

    return run


def test_encode_tells_the_sizes_of_the_tables(encoded, voxels, shape_xyz):
    path, report, text = encoded()
    kept = int((voxels > 20).sum())
    assert report["volume"]["visible_voxels"] == kept
    assert set(report["axes"]) == {"x", "y", "z"}
    nx, ny, nz = shape_xyz
    for name, (slices, scanlines) in {"x": (nx, nz), "y": (ny, nz), "z": (nz, ny)}.items():
        memory = report["axes"][name]["memory_bytes"]
        assert memory["voxel_data"] == kept * 16
        assert memory["scanline_pointers"] == slices * scanlines * 4
        assert memory["data_pointers"] == (slices + 1) * 8
        assert memory["runs"] == report["axes"][name]["runs"] * 2
    assert path.stat().st_size == report["output"]["bytes"]
    for word in ("scanline pointers", "data pointers", "runs", "voxel data", f"{kept} of the voxels"):
        assert word in text


@pytest.mark.parametrize("record", ("16", "8"))
def test_records_of_fewer_bytes(encoded, picture, call, tmp_path, voxels, record):
    kept = int((voxels > 20).sum())
    expected, report = picture("--quality", "draft", "--classification", "pre", "--record", record)
    assert report["memory_bytes"]["voxel_data"] == kept * int(record) and report["plan"]["record"] == int(record)
    path, report, _ = encoded("--record", record)
    assert report["record"] == int(record)
    assert report["axes"]["y"]["memory_bytes"]["voxel_data"] == kept * int(record)
    found, _ = picture("--quality", "draft", volume=path, options=(), function=False)
    assert np.array_equal(found, expected)
    result = call("render", path, "-o", tmp_path / "x.npy", "--record", "8" if record != "8" else "16")
    assert result.code == 2 and f"records of {record} bytes" in result.err
    if record == "8":
        result = call("render", path, "-o", tmp_path / "x.npy", "--size", "8", "--record", "6")
        assert result.code == 0 and "The record 6 was removed; 8 is used instead." in result.out
    result = call("encode", path, "-o", tmp_path / "x.rle", "--record", "7")
    assert result.code == 2 and "16, 8 bytes" in result.err


@pytest.mark.parametrize("view", [("--azimuth", "25", "--elevation", "30"), ("--azimuth", "80", "--perspective")])
def test_rendering_the_tables_is_rendering_the_volume(encoded, picture, view):
    path, _, _ = encoded(*view)
    expected, _ = picture(*view, "--classification", "pre")
    found, report = picture(*view, volume=path, options=(), function=False)
    assert np.array_equal(found, expected)
    assert report["stages_ms"]["classify"] == 0.0 and len(report["memory_bytes"]["axes_held"]) == 1
    scaled, _ = picture(*view, "--scene-scale", "0.01", volume=path, options=(), function=False)
    assert np.abs(scaled - expected).max() < 1e-5


def test_tables_of_the_opacity_model(encoded, picture):
    path, report, _ = encoded("--model", "opacity", "--no-shading")
    assert report["model"] == "opacity"
    expected, _ = picture("--paper", "--no-shading")
    found, _ = picture("--paper", volume=path, options=(), function=False)
    assert np.array_equal(found, expected)
    assert picture(volume=path, options=(), function=False)[1]["plan"]["model"] == "opacity"


def test_tables_refuse_another_transfer_function(encoded, refused, write_json, tmp_path, function_file, picture):
    path, _, _ = encoded("--azimuth", "30")
    words = ("render", path, "-o", tmp_path / "x.npy")
    lights = write_json([{"type": "SUN"}], "lights.json")
    other = write_json({"opacity": [[0, 1]], "color": [[0, 1, 1, 1]]}, "other.json")
    for option in (
        ("--lights", lights), ("--no-shading",), ("--no-headlight",), ("--headlight",), ("--preset", "smoke"),
        ("--transfer-function", other), ("--spacing", "1", "1", "1"), ("--model", "opacity"), ("--paper",),
    ):  # fmt: skip
        refused(*words, *option)
    for late in ("post", "refined"):
        assert f"leave --classification {late} out" in refused(*words, "--classification", late)
    assert not (tmp_path / "x.npy").exists()
    same, _ = picture("--headlight", "--azimuth", "30", volume=path, options=(), function=False)
    again, _ = picture("--azimuth", "30", "--transfer-function", function_file, volume=path, options=(), function=False)
    assert np.array_equal(same, again)


def test_tables_of_one_axis(encoded, refused, picture, tmp_path):
    path, report, _ = encoded("--axes", "y")
    assert set(report["axes"]) == {"y"}
    picture(volume=path, options=(), function=False)
    assert "axis x" in refused("render", path, "-o", tmp_path / "x.npy", "--azimuth", "90")


def test_tables_that_are_damaged(encoded, refused, tmp_path):
    path, _, _ = encoded()
    content = path.read_bytes()
    broken = tmp_path / "broken.rle"
    for damaged in (content[: len(content) // 2], b"no tables", b""):
        broken.write_bytes(damaged)
        assert "broken.rle" in refused("render", broken, "-o", tmp_path / "x.npy")


# --- info and convert ---------------------------------------------------------------------------------------------


def test_info_counts_right(call, raw, raw_options, voxels, shape_xyz, tmp_path):
    report_file = tmp_path / "i.json"
    scaling = ("--spacing", "1", "2", "3", "--slope", "2", "--intercept", "-100", "--value-unit", "HU")
    result = call("info", raw, *raw_options, *scaling, "--json", report_file)
    assert result.code == 0 and result.err == ""
    report = json.loads(report_file.read_text())
    assert report["shape_xyz"] == list(shape_xyz) and report["type"] == "uint8"
    assert report["spacing"] == [1.0, 2.0, 3.0] and report["affine"][1][1] == 2.0
    assert report["range"] == [2.0 * voxels.min() - 100.0, 2.0 * voxels.max() - 100.0]
    assert report["percentiles"]["50"] == 2.0 * np.percentile(voxels, 50, method="inverted_cdf") - 100.0
    assert sum(report["histogram"]["counts"]) == voxels.size
    assert report["transfer_function"]["reason"] in result.out
    for text in ("20 x 16 x 12", "uint8", "1 x 2 x 3 mm", "HU", "histogram", "memory"):
        assert text in result.out


@pytest.mark.parametrize("written", ["-1.5e3", "-15E+2", "-1500.", "-.15e4"])
def test_negative_numbers_are_numbers_however_they_are_written(call, raw, raw_options, tmp_path, written):
    report_file = tmp_path / "i.json"
    assert call("info", raw, *raw_options, "--intercept", written, "--json", report_file).code == 0
    assert json.loads(report_file.read_text())["intercept"] == -1500.0


def test_info_sees_what_is_odd(call, tmp_path, raw_options):
    values = np.zeros((4, 5, 6), dtype=np.float32)
    values[0, 0, :3] = np.nan
    values[1, 1, 1] = 7.0
    path = tmp_path / "odd.raw"
    values.tofile(path)
    shape = ("--shape", "6", "5", "4", "--dtype", "float32", "--byte-order", "little")
    text = call("info", path, *shape, "--spacing", "1", "1", "9").out
    assert "3 voxels (2.50%) are NaN" in text and "97%" in text and "very uneven" in text
    np.full((4, 5, 6), 3.0, dtype=np.float32).tofile(path)
    assert "same value, 3" in call("info", path, *shape).out
    np.full((4, 5, 6), np.nan, dtype=np.float32).tofile(path)
    result = call("info", path, *shape)
    assert result.code == 0 and "No voxel holds a finite number" in result.out


def test_convert_keeps_the_voxels_and_says_what_is_lost(call, tmp_path, raw, raw_options, voxels):
    packed = tmp_path / "out.raw.gz"
    result = call("convert", raw, packed, *raw_options, "--spacing", "1", "2", "0.3", "--json", tmp_path / "c.json")
    assert result.code == 0 and "Read it back with: --shape 20 16 12 --dtype uint8" in result.out
    options = result.out.split("Read it back with: ")[1].split()
    back = tmp_path / "back.raw"
    assert call("convert", packed, back, *options).code == 0
    assert np.array_equal(np.fromfile(back, dtype=np.uint8).reshape(voxels.shape), voxels)
    report = json.loads((tmp_path / "c.json").read_text())
    assert report["lost"] and report["read_back_with"]["spacing"] == [1.0, 2.0, 0.3]
    assert call("info", packed, *options).out.count("1 x 2 x 0.3 mm") == 1


@pytest.mark.parametrize("header, text", [
    ("a.mhd", "NDims = 3\nDimSize = 2 2 2\nElementType = MET_SHORT\nBinaryDataByteOrderMSB = True\n"
     "ElementDataFile = a.raw\n"),
    ("a.nhdr", "NRRD0004\ntype: short\ndimension: 3\nsizes: 2 2 2\nendian: big\nencoding: raw\ndata file: a.raw\n"),
])  # fmt: skip
def test_convert_does_not_write_over_the_voxels_of_a_header(call, refused, tmp_path, header, text):
    """The header says that they are big-endian."""
    (tmp_path / header).write_text(text)
    (tmp_path / "a.raw").write_bytes(bytes(range(16)))
    assert "a.raw is read by this command" in refused("convert", tmp_path / header, tmp_path / "a.raw")
    assert (tmp_path / "a.raw").read_bytes() == bytes(range(16))
    assert call("convert", tmp_path / header, tmp_path / "b.raw").code == 0


def test_convert_swaps_big_endian(call, tmp_path):
    values = (np.arange(2 * 3 * 4).reshape(2, 3, 4) * 1000).astype(">u2")
    source, target = tmp_path / "big.raw", tmp_path / "little.raw"
    values.tofile(source)
    shape = ("--shape", "4", "3", "2", "--dtype", "uint16", "--byte-order", "big")
    assert call("convert", source, target, *shape).code == 0
    assert np.array_equal(np.fromfile(target, dtype="<u2"), values.ravel())


def test_memory_is_told_beforehand(call, raw, raw_options, function_file, tmp_path, voxels):
    words = (*raw_options, "--transfer-function", function_file)
    report = tmp_path / "info.json"
    told = call("info", raw, *words, "--json", report)
    assert told.code == 0 and "are free" in told.out and "by --record: 16:" in told.out
    known = json.loads(report.read_text())
    kept = int((voxels > 20).sum())
    assert known["transfer_function"]["visible_fraction"] == kept / voxels.size
    assert set(known["records"]) == {"16", "8"} and known["memory_bytes"]["available"] > 0
    assert known["records"]["8"]["encode"] < known["records"]["16"]["encode"]
    drawn = tmp_path / "render.json"
    words = (raw, *words, "--classification", "pre", "-o", tmp_path / "x.npy")
    result = call("render", *words, "--size", "32", "--json", drawn, "--progress")
    assert result.code == 0 and f"Classifying {kept} voxels, about" in result.err
    needed = json.loads(drawn.read_text())["memory_estimate_bytes"]
    assert needed["volume"] == voxels.size and needed["records"] == 16 * kept and needed["needed"] > needed["picture"]
