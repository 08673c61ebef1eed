"""Every mistake on the command line: one sentence, exit code 2, no traceback, no output file."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

from rle_splat.runtime.jit import use_reference

TRANSFER_FUNCTION = {"name": "t", "unit": None, "opacity": [[10, 0], [200, 0.5]], "color": [[0, 1, 1, 1]]}


@pytest.fixture
def render_refused(refused, tmp_path, raw, raw_options):
    """Check that rendering with these extra options is refused and writes nothing; returns the sentence."""

    def run(*extra, volume=raw, options=tuple(raw_options)):
        outputs = [tmp_path / name for name in ("out.png", "out.npy", "out.json")]
        words = ["render", volume, *options, "--size", "24", "-o", outputs[0], "-o", outputs[1], "--json", outputs[2]]
        before = sorted(tmp_path.rglob("*"))
        sentence = refused(*words, *extra)
        assert sorted(tmp_path.rglob("*")) == before
        return sentence

    return run


# --- the volume ---------------------------------------------------------------------------------------------------


def test_missing_file(render_refused, tmp_path):
    assert "no.raw" in render_refused(volume=tmp_path / "no.raw")


def test_a_folder(render_refused, tmp_path):
    assert "folder" in render_refused(volume=tmp_path)


def test_unknown_format(render_refused, tmp_path):
    path = tmp_path / "volume.docx"
    path.write_bytes(b"12345678")
    assert "format" in render_refused(volume=path, options=())


def test_wrong_size_names_what_would_fit(render_refused, shape_xyz):
    nx, ny, nz = shape_xyz
    sentence = render_refused(options=("--shape", nx, ny, nz + 1, "--dtype", "uint8"))
    assert f"{nx} x {ny} x {nz}" in sentence and str(nx * ny * nz) in sentence


def test_truncated_gzip(render_refused, tmp_path, raw):
    path = tmp_path / "ball.raw.gz"
    packed = gzip.compress(raw.read_bytes())
    path.write_bytes(packed[: len(packed) // 2])
    assert "ball.raw.gz" in render_refused(volume=path)


def test_not_gzip_at_all(render_refused, tmp_path, raw):
    path = tmp_path / "ball.raw.gz"
    path.write_bytes(raw.read_bytes())
    assert "gzip" in render_refused(volume=path)


def test_unknown_type(render_refused):
    assert "uint16" in render_refused("--dtype", "complex64")


@pytest.mark.parametrize("spacing", [("0", "1", "1"), ("1", "-2", "1"), ("1", "1", "nan"), ("1", "inf", "1")])
def test_impossible_spacing(render_refused, spacing):
    assert "pacing" in render_refused("--spacing", *spacing)


@pytest.mark.parametrize(
    "options",
    [
        ("--shape", "0", "16", "12"), ("--shape", "20", "-16", "12"), ("--slope", "0"), ("--slope", "nan"),
        ("--intercept", "inf"), ("--header-bytes", "-4"), ("--byte-order", "middle"), ("--grid", "density"),
    ],
)  # fmt: skip
def test_impossible_volume_options(render_refused, options):
    render_refused(*options)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("glitter=on", "no effect called 'glitter'; choose mode, gradient-opacity"), ("specular", "NAME=off"),
        ("specular=maybe", "NAME=auto"), ("mesh occlusion=on", "the scene has no meshes"),
    ],
)  # fmt: skip
def test_effects_that_cannot_be_forced(render_refused, given, said):
    assert said in render_refused("--effect", given)


def test_a_mode_there_is_none_of(render_refused):
    assert "no mode called 'xrays'; choose composite, xray, mip" in render_refused("--mode", "xrays")
    assert "the mode mip" in render_refused("--mode", "mip", "--tolerance", "2")


def test_nothing_but_nan(render_refused, tmp_path, voxels):
    path = tmp_path / "nan.raw"
    np.full(voxels.shape, np.nan, dtype=np.float32).tofile(path)
    sentence = render_refused("--dtype", "float32", volume=path)
    assert "No voxel of the volume holds a finite number" in sentence  # as the import in Blender says it


def test_vdb_without_a_reader_or_damaged(render_refused, tmp_path):
    path = tmp_path / "not.vdb"
    path.write_bytes(b"this is no grid")
    assert "VDB" in render_refused(volume=path, options=())


# --- transfer functions ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change",
    [
        {"opacity": []}, {"color": []}, {"opacity": [[0, 2.0]]}, {"opacity": [[0, "x"]]}, {"opacity": 3},
        {"color": [[0, 1, 1]]}, {"shade": {"ambient": -1}}, {"opacity_unit_distance": 0}, {"colour": []},
    ],
)  # fmt: skip
def test_transfer_functions_that_say_nothing(render_refused, write_json, change):
    render_refused("--transfer-function", write_json({**TRANSFER_FUNCTION, **change}))


def test_files_that_are_missing_or_not_json(render_refused, write_json, tmp_path):
    for option in ("--transfer-function", "--lights", "--camera", "--volume-matrix", "--motion"):
        assert "none.json" in render_refused(option, tmp_path / "none.json")
    broken = write_json("{not json", "broken.json")
    for option in ("--transfer-function", "--lights", "--camera", "--volume-matrix", "--motion"):
        assert "JSON" in render_refused(option, broken)


def test_unknown_preset_lists_them(render_refused):
    sentence = render_refused("--preset", "ct-brick")
    assert "ct-bone" in sentence and "smoke" in sentence


def test_preset_and_file_contradict(render_refused, write_json):
    render_refused("--preset", "ct-bone", "--transfer-function", write_json(TRANSFER_FUNCTION))


@pytest.mark.parametrize(
    "lights", [{}, [{"type": "LASER"}], [{"color": [1, 1]}], [{"energy": -1}], [{"watts": 3}], [4]]
)
def test_impossible_lights(render_refused, write_json, lights):
    render_refused("--lights", write_json(lights))


@pytest.mark.parametrize("background", [("-1", "0", "0"), ("nan", "0", "0"), ("red", "0", "0"), ("1", "1")])
def test_impossible_background(render_refused, background):
    render_refused("--background", *background)


# --- the view -----------------------------------------------------------------------------------------------------


def look_at_ball(**change) -> dict:
    """A camera 100 units above the ball, looking down at it."""
    matrix = np.eye(4)
    matrix[:3, 3] = (9.5, 7.5, 100.0)
    return {"matrix_world": matrix.tolist(), "type": "ORTHO", "ortho_scale": 30.0, "clip_end": 1000.0, **change}


@pytest.mark.parametrize(
    "change",
    [
        {"type": "PANO"}, {"matrix_world": [[1, 0], [0, 1]]}, {"lens": 0}, {"clip_start": 5, "clip_end": 1},
        {"sensor_fit": "BEST"}, {"ortho_scale": -1}, {"focal": 3}, {"pixel_aspect": [1, 0]}, {"shift_x": "a"},
        {"aperture_radius": "wide"}, {"focus_distance": 0}, {"aperture_blades": -3},
    ],
)  # fmt: skip
def test_impossible_cameras(render_refused, write_json, change):
    render_refused("--camera", write_json(look_at_ball(**change)))


@pytest.mark.parametrize("poses", [{}, [{}], [4, 4], [{"matrix": []}, {}], [{"volume_matrix": [[1]]}, {}]])
def test_impossible_motion(render_refused, write_json, poses):
    render_refused("--motion", write_json(poses))


def test_no_tolerance_of_blurred_pictures(render_refused, write_json):
    lens = {"aperture_radius": 20.0, "focus_distance": 50.0, "type": "PERSP"}
    assert "depth of field" in render_refused("--camera", write_json(look_at_ball(**lens)), "--tolerance", "1")


def test_a_panoramic_camera_is_named(render_refused, write_json):
    assert "PANO" in render_refused("--camera", write_json(look_at_ball(type="PANO")))


def test_a_camera_that_sees_nothing(render_refused, write_json):
    away = np.diag((1.0, -1.0, -1.0, 1.0))  # looking up instead of down
    away[:3, 3] = (9.5, 7.5, 100.0)
    render_refused("--camera", write_json(look_at_ball(matrix_world=away.tolist())))


def test_a_camera_with_a_singular_matrix(render_refused, write_json):
    render_refused("--camera", write_json(look_at_ball(matrix_world=np.diag((0.0, 1.0, 1.0, 1.0)).tolist())))


@pytest.mark.parametrize("diagonal", [(0.0, 1.0, 1.0, 1.0), (1.0, 1.0, 1.0, 2.0)])
def test_singular_or_projective_volume_matrix(render_refused, write_json, diagonal):
    matrix = write_json(np.diag(diagonal).tolist(), "matrix.json")
    render_refused("--volume-matrix", matrix)
    render_refused("--volume-matrix", matrix, "--camera", write_json(look_at_ball()))


@pytest.mark.parametrize(
    "options",
    [
        ("--fit", "0"), ("--fit", "nan"), ("--perspective", "--fov", "180"), ("--perspective", "--fov", "-1"),
        ("--fov", "40"), ("--azimuth", "inf"), ("--elevation", "up"), ("--scene-scale", "0"),
        ("--scene-scale", "nan"), ("--size", "0"), ("--size", "-5"), ("--size", "100000"), ("--size", "wide"),
        ("--size", "12x12x12"), ("--threads", "-1"), ("--threads", "many"),
    ],
)  # fmt: skip
def test_impossible_view_numbers(render_refused, options):
    render_refused(*options)


def test_camera_and_turntable_contradict(render_refused, write_json):
    camera = write_json(look_at_ball())
    assert "--azimuth" in render_refused("--camera", camera, "--azimuth", "10")
    render_refused("--camera", camera, "--perspective")


def test_shading_contradicts_no_shading(render_refused, write_json):
    render_refused("--no-shading", "--headlight")
    render_refused("--no-shading", "--lights", write_json([{"type": "SUN"}]))


# --- quality ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options, expected",
    [
        (("--quality", "perfect"), "standard"), (("--classification", "late"), "pre"),
        (("--depth-rule", "guess"), "simpson"), (("--kernel", "bspline9"), "tent"),
        (("--minification", "blur"), "widen"), (("--classification", "post", "--kernel", "bspline3"), "tent only"),
        (("--classification", "post", "--model", "opacity"), "extinction only"),
        (("--classification", "post", "--record", "8"), "16 only"),
        (("--paper", "--classification", "post"), "--paper"),
        (("--warp-filter", "sharp"), "bilinear"), (("--model", "light"), "extinction"),
        (("--axis-fade", "16"), "0 to 15 degrees"),
        (("--sheet-density", "-1"), "density"), (("--termination", "0.9"), "termination"),
        (("--quality", "fine", "--paper"), "--paper"), (("--quality", "fine", "--model", "opacity"), "--model"),
        (("--paper", "--depth-rule", "slice"), "--depth-rule"), (("--tolerance", "0"), "above zero"),
        (("--tolerance", "1", "--quality", "fine"), "--quality"), (("--tolerance", "1", "--paper"), "--paper"),
        (("--tolerance", "1", "--depth-rule", "slice"), "--depth-rule"), (("--probes", "9"), "--tolerance"),
        (("--tolerance", "nan"), "above zero"), (("--tolerance", "1", "--probes", "-1"), "--probes"),
        (("--record", "5"), "16, 8 bytes"), (("--record", "small"), "--record"),
    ],
)  # fmt: skip
def test_quality_that_does_not_exist_or_contradicts(render_refused, options, expected):
    assert expected in render_refused(*options)


def test_numba_missing_is_said_beside_the_slow_picture(call, raw, raw_options, tmp_path, monkeypatch):
    monkeypatch.setattr("rle_splat.pipeline.report.NUMBA_PROBLEM", "ImportError: no numba here")
    with use_reference():
        result = call("render", raw, *raw_options, "--size", "12", "-o", tmp_path / "slow.npy")
    assert result.code == 0 and (tmp_path / "slow.npy").exists()
    assert "without compiled code (ImportError: no numba here)" in result.out + result.err


# --- the command line itself --------------------------------------------------------------------------------------


def test_commands_and_words(refused, raw):
    assert "render, info, figure, encode, convert" in refused("measure", raw)
    assert "render, info, figure, encode, convert" in refused()
    assert "--nonsense" in refused("info", raw, "--nonsense", "3")
    assert "extra" in refused("info", raw, "extra")
    assert "VOLUME" in refused("render")
    assert "--output" in refused("render", raw)
    refused("info", raw, "--shape", "4", "5")
    refused("info", raw, "--sha", "4", "5", "6")  # no abbreviations: a later option must not change their meaning


def test_outputs_are_checked_before_the_work(refused, raw, raw_options, tmp_path):
    for output, expected in (
        (tmp_path / "out.jpg", ".png"), (tmp_path / "out", ".png"), (tmp_path / "no" / "out.png", "folder"),
        (tmp_path, "suffix"), (raw / "out.png", "folder"),
    ):  # fmt: skip
        assert expected in refused("render", raw, *raw_options, "-o", output)
    (tmp_path / "dir.png").mkdir()
    assert "folder" in refused("render", raw, *raw_options, "-o", tmp_path / "dir.png")
    same = tmp_path / "a.png"
    assert "twice" in refused("render", raw, *raw_options, "-o", same, "-o", same)
    assert "read by" in refused("convert", raw, raw, *raw_options)
    assert "suffix" in refused("convert", raw, tmp_path / "a.mha", *raw_options)
    assert "suffix" in refused("encode", raw, "-o", tmp_path / "a.raw", *raw_options)
    assert "read by" in refused("info", raw, *raw_options, "--json", raw)


def test_encode_axes(refused, raw, raw_options, tmp_path):
    for axes in ("w", "", "xx"):
        assert "axes" in refused("encode", raw, *raw_options, "-o", tmp_path / "a.rle", "--axes", axes)
    assert not (tmp_path / "a.rle").exists()


def test_no_memory_and_our_own_failures(refused, raw, raw_options, monkeypatch):
    def fail(problem):
        def read(*_, **__):
            raise problem

        monkeypatch.setattr("rle_splat.read.formats.read_steps", read)

    fail(MemoryError("Unable to allocate 8 TiB"))
    assert "memory" in refused("info", raw, *raw_options, code=1)
    fail(ZeroDivisionError("oh"))
    assert "ZeroDivisionError" in refused("info", raw, *raw_options, code=1)
    fail(KeyboardInterrupt())
    assert refused("info", raw, *raw_options, code=130).startswith("Stopped")


def test_too_little_memory_is_told_beforehand(render_refused, refused, raw, raw_options, tmp_path, monkeypatch):
    def short_of_memory(free):
        for module in ("pipeline.memory_estimate", "pipeline.stage_cache", "runtime.memory", "cli.info"):
            monkeypatch.setattr(f"rle_splat.{module}.available_bytes", lambda: free)

    short_of_memory(1 << 30)
    sentence = render_refused("--size", "60000x50000")
    assert "60000 x 50000 pixels" in sentence and "GiB" in sentence and "would fit" in sentence
    short_of_memory(45_000)
    assert "are free" in render_refused()
    assert "are free" in refused("encode", raw, *raw_options, "-o", tmp_path / "x.rle")
    short_of_memory(1000)
    sentence = refused(
        "info", raw, *raw_options, "--header-bytes", "0", "--byte-order", "big", "--dtype", "uint16",
        "--shape", "20", "16", "6",
    )  # fmt: skip
    assert "close other programs, or write a coarser file" in sentence


def test_debug_shows_the_traceback(call, tmp_path):
    for words in (("--debug", "info", tmp_path / "no.raw"), ("info", tmp_path / "no.raw", "--debug")):
        result = call(*words)
        assert result.code == 2 and "Traceback" in result.err
