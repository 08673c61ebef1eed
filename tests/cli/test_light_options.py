"""Shadows, the world's light and ambient occlusion on the command line: they reach the picture, or are refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

import rle_splat
from rle_splat.cli.images import writer_for
from rle_splat.cli.main import main

pytestmark = pytest.mark.usefixtures("by_numpy")  # no kernels to compile

SUN = {"type": "SUN", "energy": 4.0, "matrix_world": [[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]]}
SHADE = {"ambient": 0.2, "diffuse": 0.8, "specular": 0.0, "shininess": 10}


@pytest.fixture
def render(tmp_path):
    """Renders a soft ball with more options: (rgba, effects by name), or what was refused on stderr as exit code 2."""
    ball = np.clip(200 - 30 * np.sqrt(sum((axis - 5.0) ** 2 for axis in np.mgrid[:11, :11, :11])), 0, 255)
    (tmp_path / "ball.raw").write_bytes(ball.astype(np.uint8).tobytes())
    (tmp_path / "tf.json").write_text(
        json.dumps({"opacity": [[60, 0], [120, 0.5]], "color": [[0, 1, 0.8, 0.6]], "shade": SHADE, "unit": None})
    )
    (tmp_path / "lights.json").write_text(json.dumps([SUN]))

    def run(*options, volume="ball.raw", shape=("--shape", "11", "11", "11", "--dtype", "uint8"), lights=True):
        out = tmp_path / "out.npy"
        lit = ("--lights", str(tmp_path / "lights.json")) if lights else ()
        code = main([
            "render", str(tmp_path / volume), *shape, "--transfer-function", str(tmp_path / "tf.json"), "--size", "24",
            "-o", str(out), "--json", str(tmp_path / "report.json"), *lit, *options,
        ])  # fmt: skip
        if code:
            return code
        report = json.loads((tmp_path / "report.json").read_text())
        return np.load(out), {effect["name"]: effect for effect in report["effects"]}

    return run


def test_each_option_changes_the_light_and_nothing_else(render):
    plain, off = render()
    for name in ("shadows", "world light", "ambient occlusion"):
        assert not off[name]["on"]
    for options, name, brighter in (
        (["--shadows"], "shadows", False),
        (["--world", "0.2", "0.1", "0"], "world light", True),
        (["--ambient-occlusion", "0.8"], "ambient occlusion", False),
    ):
        rgba, effects = render(*options)
        assert [n for n in effects if effects[n]["on"] != off[n]["on"]] == [name]
        np.testing.assert_array_equal(rgba[..., 3], plain[..., 3])
        gained = (rgba - plain)[..., 0] * (1 if brighter else -1)
        assert gained.max() > 0.02 and gained.min() > -5e-3  # the warp overshoots at edges
    np.testing.assert_allclose(render("--world", "0.2", "0.1", "0")[0][..., 2], plain[..., 2], atol=1e-3)


def test_an_environment_lights_by_direction_in_place_of_the_headlight(render, tmp_path):
    picture = np.zeros((16, 32, 4), np.float32)
    picture[:8, :, :3], picture[..., 3] = 2.0, 1.0  # light from above
    writer_for("sky.exr")(tmp_path / "sky.exr", picture, picture[..., 0])
    rgba, effects = render("--environment", str(tmp_path / "sky.exr"), lights=False)
    assert effects["world light"]["on"] and "order 2" in effects["world light"]["reason"]
    assert not effects["headlight"]["on"]
    assert rgba[5:9, 10:14, 0].mean() > 1.5 * rgba[15:19, 10:14, 0].mean() > 0.0
    world, environment = rle_splat.read_environment(tmp_path / "sky.exr")
    assert world == pytest.approx((1.0, 1.0, 1.0))
    np.testing.assert_allclose(environment.first, [[0.0] * 3, [0.0] * 3, [0.5] * 3], atol=0.01)  # 2 cos over a half
    both, effects = render("--environment", str(tmp_path / "sky.exr"), "--headlight", lights=False)
    assert effects["headlight"]["on"] and both.sum() > rgba.sum()


@pytest.mark.parametrize("recipe", ["three", "skin"])
def test_a_light_recipe_lights_as_in_python_and_other_options_go_before_it(render, tmp_path, recipe):
    rgba, effects = render("--light-recipe", recipe, "--azimuth", "40", lights=False)
    assert effects["shadows"]["on"] and effects["ambient occlusion"]["on"] and not effects["headlight"]["on"]
    volume = rle_splat.read_volume(tmp_path / "ball.raw", shape=(11, 11, 11), dtype="uint8")
    function = rle_splat.TransferFunction.from_json(tmp_path / "tf.json")
    camera, matrix = rle_splat.turntable(volume, azimuth=40)
    hidden = rle_splat.Labels(replace(volume, voxels=np.ones((11, 11, 11), np.uint8)), {1: function})
    for labels in (None, hidden):
        scene = rle_splat.Scene(volume, function, camera, 24, 24, volume_matrix=matrix, labels=labels)
        lit = rle_splat.add_lights(scene, recipe)
        np.testing.assert_allclose(rle_splat.render(lit).rgba, rgba, atol=1e-5)
    _, effects = render("--light-recipe", recipe, "--ambient-occlusion", "0", lights=False)
    assert effects["shadows"]["on"] and not effects["ambient occlusion"]["on"]


def test_a_light_recipe_turns_with_the_camera(render, tmp_path):
    ball = f"{tmp_path}/ball.raw --shape 11 11 11 --dtype uint8 --transfer-function {tmp_path}/tf.json --size 24"
    turned = "--light-recipe bone --frames 1 2 --turn 180"
    assert main(f"render {ball} {turned} -o {tmp_path}/out.npy".split()) == 0
    first, second = (np.load(tmp_path / f"out_{n:04}.npy") for n in (1, 2))
    assert np.abs(first - second).mean() < 0.01 < 0.1 * first.mean()  # a ball looks the same from both sides


def test_the_shadow_pass_is_the_share_of_light_that_is_gone(render, tmp_path):
    plain, _ = render()
    rgba, _ = render("--shadows", "--shadow-pass", str(tmp_path / "pass.npy"))
    taken = np.load(tmp_path / "pass.npy")
    np.testing.assert_array_equal(taken[..., 3], rgba[..., 3])
    seen = rgba[..., 3] > 0.05
    share = taken[seen][:, 1] / rgba[seen][:, 3]
    left = rgba[seen][:, :3].sum(axis=1) / plain[seen][:, :3].sum(axis=1)
    np.testing.assert_allclose(1.0 - share, np.minimum(left, 1.0), atol=1e-5)
    assert share.max() > 0.2


@pytest.mark.parametrize(
    ("options", "more", "sentence"),
    [
        (["--shadows"], {"lights": False}, "a headlight casts none"),
        (["--world", "-1", "0", "0"], {}, "three finite numbers"),
        (["--environment", "none.exr"], {"volume": "none.raw"}, "Cannot read none.exr"),  # before the volume is read
        (["--environment", "none.exr", "--world", "1", "1", "1"], {}, "give one of the two"),
        (["--ambient-occlusion", "1.5"], {}, "a number from 0 to 1"),
        *((["--shadows", "--indirect-light", bad], {}, "a number from 0 to 1") for bad in ("-1", "2", "nan")),
        (["--indirect-light", "1"], {}, "add --shadows"),
        (["--ambient-occlusion", "1", "--no-shading"], {"lights": False}, "contradict each other"),
        (["--shadows", "--tolerance", "2", "--classification", "pre"], {}, "turn off shadows"),
        (["--shadows", "--tolerance", "2", "--shadow-pass", "x.npy"], {}, "made by a quality"),
        (["--smoothness", "1", "--no-shading"], {"lights": False}, "contradict each other"),
        (["--smoothness", "-1"], {}, "from 0 to 100 mm"),
        (["--light-recipe", "three"], {}, "give one of the two"),
        (["--light-recipe", "three", "--no-shading"], {"lights": False}, "contradict each other"),
        (["--shadow-pass", "x.npy"], {}, "add --shadows or --ambient-occlusion"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(render, capsys, options, more, sentence):
    assert render(*options, **more) == 2
    said = capsys.readouterr().err
    assert sentence in said and said.count("\n") == 1 and "Traceback" not in said
