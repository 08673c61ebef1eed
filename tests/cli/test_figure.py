"""Figures on the command line: made, made again from their sidecar bit for bit, and refused in one sentence."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import PureWindowsPath
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

from rle_splat.cli import figure as figure_command
from rle_splat.cli.main import main
from rle_splat.figure.sidecar import HELD, missing_of, read_sidecar
from rle_splat.read.channels import level_options
from rle_splat.scene import Camera, Environment, Light, RleSplatError, Scene
from rle_splat.scene.plain import plain as as_json

from .conftest import SHAPE_XYZ, ball

PAGE = ("--width-cm", "2.5", "--dpi", "80", "--font-size", "4", "--quality", "draft")
SIDECAR = "fig.figure.json"
LIT = Environment(np.arange(9.0).reshape(3, 3) / 7.0, np.zeros((3, 3, 3)))


@pytest.fixture(scope="session")
def made_once(tmp_path_factory):
    """A folder with a figure without options, and its data."""
    folder = tmp_path_factory.mktemp("figure")
    ball().tofile(folder / "ball.raw")
    shape = ["--shape", *map(str, SHAPE_XYZ), "--dtype", "uint8"]
    outputs = ["-o", folder / "fig.svg", "-o", folder / "fig.png"]
    assert main([str(word) for word in ("figure", folder / "ball.raw", *shape, *PAGE, *outputs)]) == 0
    return folder


@pytest.fixture
def plain(made_once, raw):
    """A copy of it, in the folder of ``raw``."""
    folder = raw.parent
    for name in ("fig.svg", "fig.png"):
        shutil.copy(made_once / name, folder)
    sidecar = (made_once / SIDECAR).read_text().replace(made_once.as_posix(), folder.as_posix())
    (folder / SIDECAR).write_text(sidecar)
    return folder


def test_a_sidecar_keeps_paths_that_every_system_finds(monkeypatch):
    monkeypatch.setattr(figure_command, "Path", PureWindowsPath)
    assert figure_command._use_slashes("..\\scans\\ct.nii") == "../scans/ct.nii"


def test_a_picture_that_cannot_be_written_is_named(tmp_path, monkeypatch):
    def break_off(*_):
        raise OSError("2 requested and 1 written")  # as numpy has it of a full disk

    monkeypatch.setattr(figure_command, "write_page", break_off)
    args = SimpleNamespace(output=[str(tmp_path / "fig.exr")], json=None)
    with pytest.raises(RleSplatError, match=r"^Cannot write .*fig\.exr: not all of it could be written; choose"):
        figure_command._write(args, SimpleNamespace(page=None), (), None)
    assert not list(tmp_path.iterdir())


@pytest.fixture
def figure(call, raw, raw_options, function_file):
    """Make ``fig.svg`` and ``fig.png`` beside the data; return the folder."""

    def make(*options, volume=raw, functions=("--transfer-function", function_file)):
        folder = raw.parent
        result = call(
            "figure", volume, *raw_options, *PAGE, *functions, "-o", folder / "fig.svg", "-o", folder / "fig.png",
            *options,
        )  # fmt: skip
        assert result.code == 0, result.err
        return folder

    return make


def texts_of(path) -> list[str]:
    root = ElementTree.fromstring(path.read_bytes())
    return [text.text for text in root.iter("{http://www.w3.org/2000/svg}text")]


def test_a_figure_is_made_again_bit_for_bit(call, figure, tmp_path, write_json):
    lights = write_json([{"type": "SUN", "energy": 2.7, "color": [1.0, 0.9, 0.1]}], "lights.json")
    clips = write_json([{"kind": "plane", "matrix_world": np.diag((1.0, 1.0, 1.0, 1.0)).tolist()}], "clips.json")
    folder = figure("--view", 10.3, 20, "--view", -75, 5, "--lights", lights, "--clip", clips, "--world", 0.1, 0.2, 0.3,
                    "--sides", "off")  # fmt: skip
    for name in (lights, clips, "function.json"):  # the sidecar holds them all
        (tmp_path / name).unlink()
    again = tmp_path / "again"
    again.mkdir()
    result = call("figure", folder / SIDECAR, "-o", again / "b.svg", "-o", again / "b.png", "--threads", "1")
    assert result.code == 0, result.err
    assert "Its pictures are bit-identical to those of the sidecar." in result.out
    for suffix in ("svg", "png"):
        assert (again / f"b.{suffix}").read_bytes() == (folder / f"fig.{suffix}").read_bytes()
    assert sorted(path.name for path in again.iterdir()) == ["b.png", "b.svg"]


def test_the_data_is_found_beside_a_sidecar_that_was_moved(call, refused, plain, tmp_path):
    moved = tmp_path / "moved"
    plain.rename(moved)
    assert call("figure", moved / SIDECAR, "-o", moved / "b.png", "--memory-limit", "4GiB").code == 0
    assert (moved / "b.png").read_bytes() == (moved / "fig.png").read_bytes()
    (moved / "ball.raw").rename(tmp_path / "elsewhere.raw")
    sentence = refused("figure", moved / SIDECAR, "-o", moved / "c.png")
    assert "neither there nor beside the sidecar; say where with --data FILE" in sentence
    assert call("figure", moved / SIDECAR, "--data", tmp_path / "elsewhere.raw", "-o", moved / "c.png").code == 0


@pytest.fixture
def labeled(figure, raw, write_json):
    """The folder of a figure with a colored and a hidden label and a further channel, whose options are gone."""
    folder = raw.parent
    (np.indices(ball().shape)[2] // 7).astype(np.uint16).tofile(folder / "labels.raw")
    ball()[::-1].tofile(folder / "channel.raw")
    looks = [{"label": 1, "name": "Of a patient", "color": [0.9, 0.1, 0.2]}, {"label": 2, "hidden": True}]
    options = {
        "labels": folder / "labels.raw", "label-functions": write_json(looks, "looks.json"),
        "channel": folder / "channel.raw",
        "channel-function": write_json({"opacity": [[90, 0], [255, 0.2]], "color": [[0, 0, 0, 1]]}, "blue.json"),
    }  # fmt: skip
    figure(*(word for name, value in options.items() for word in (f"--{name}", value)))
    for name in ("label-functions", "channel-function"):
        options[name].unlink()
    return folder


def test_labels_and_channels_are_made_again_from_another_folder(call, labeled, tmp_path):
    sidecar = json.loads((labeled / SIDECAR).read_text())
    assert sidecar["missing"] == [] and "Of a patient" not in json.dumps(sidecar)
    shown = sidecar["panels"][0]["scene"]["labels"]["functions"]
    assert [(one["label"], one["transfer_function"] is None) for one in shown] == [(1, False), (2, True)]
    moved = tmp_path / "moved"
    labeled.rename(moved)
    assert call("figure", moved / SIDECAR, "-o", moved / "b.svg", "-o", moved / "b.png").code == 0
    for suffix in ("svg", "png"):
        assert (moved / f"b.{suffix}").read_bytes() == (moved / f"fig.{suffix}").read_bytes()


def test_labels_and_channels_elsewhere_or_changed(call, refused, labeled, tmp_path):
    again = ("figure", labeled / SIDECAR, "-o", labeled / "b.svg")
    for name, option in (("labels.raw", "--labels"), ("channel.raw", "--channel")):
        (labeled / name).rename(tmp_path / name)
        assert f"neither there nor beside the sidecar; say where with {option} FILE" in refused(*again)
        again = (*again, option, tmp_path / name)
    assert call(*again).code == 0
    assert (labeled / "b.svg").read_bytes() == (labeled / "fig.svg").read_bytes()
    assert "shows 1 channels and --channel is given 2 times" in refused(*again, "--channel", tmp_path / "channel.raw")
    ball()[::-1].tofile(tmp_path / "labels.raw")
    assert "labels.raw is not what the figure was made of" in refused(*again)


def test_a_sidecar_without_labels_takes_none(refused, plain, raw):
    assert "shows no labels; remove --labels" in refused("figure", plain / SIDECAR, "--labels", raw, "-o",
                                                         plain / "b.png")  # fmt: skip


def test_changed_data_is_refused(refused, plain, raw):
    folder = plain
    voxels = ball()
    voxels[3, 4, 5] += 1
    voxels.tofile(raw)
    sentence = refused("figure", folder / SIDECAR, "-o", folder / "b.png")
    assert "is not what the figure was made of (its hash is" in sentence
    assert not (folder / "b.png").exists()


def test_another_version_is_remarked(call, plain):
    folder = plain
    sidecar = json.loads((folder / SIDECAR).read_text())
    sidecar["versions"]["numpy"] = "1.0"
    del sidecar["panels"][0]["scene"]["environment"]  # of a later version
    sidecar["panels"][0]["pixels"] = "0"
    (folder / SIDECAR).write_text(json.dumps(sidecar))
    result = call("figure", folder / SIDECAR, "-o", folder / "b.png")
    assert result.code == 0
    assert "The figure was made with numpy 1.0, and this is numpy" in result.out
    assert "Its pictures differ from those of the sidecar" in result.out


def test_knobs_that_were_removed(call, plain, tmp_path):
    """Sidecars of earlier versions name a refinement; where it is of no account the figure has the same bits."""
    sidecar = json.loads((plain / SIDECAR).read_text())
    removed = "The classification 'refined' was removed"
    for classification, text in (("post", "are bit-identical"), ("refined", removed)):
        sidecar["panels"][0]["quality"].update(classification=classification, refinement=2)
        (plain / SIDECAR).write_text(json.dumps(sidecar))
        result = call("figure", plain / SIDECAR, "-o", tmp_path / "b.png")
        assert result.code == 0 and result.err == "" and result.out.count(text) == 1, result


def test_a_grid_of_transfer_functions_and_views(figure):
    titles = texts_of(figure("--compare", "ct-bone", "--compare", "faint", "--view", 0, 0, "--view", -90, 0,
                             "--mode", "mip", functions=()) / "fig.svg")  # fmt: skip
    named = [text for text in titles if "zimuth" in text]
    assert " ".join(titles).count("CT Bone") == 2 and len(named) >= 2
    assert [text for text in titles if re.fullmatch("[a-z]", text)] == ["a", "b", "c", "d"]
    assert sum(text.startswith("W ") for text in titles) == 5  # below each picture, and explained in the caption


def test_letters_scale_bar_color_bar_and_caption(figure):
    texts = texts_of(figure("--orientation", "LPS", "--value-unit", "HU", "--scale-bar", "4", "--title", "Ball",
                            "--spacing", "0.5", "0.5", "0.5") / "fig.svg")  # fmt: skip
    assert {"R", "L", "S", "I", "4 mm", "Values in HU", "Ball", "Opacity per 0.5 mm"} <= set(texts)
    assert "level" not in " ".join(texts) and "Anterior view, orthographic projection." in " ".join(texts)


def test_a_transparent_figure_and_a_linear_one(call, figure, raw):
    Image, OpenEXR = pytest.importorskip("PIL.Image"), pytest.importorskip("OpenEXR")
    folder = figure("--background", "transparent", "-o", raw.parent / "fig.exr")
    png = np.asarray(Image.open(folder / "fig.png"))
    with OpenEXR.File(str(folder / "fig.exr")) as file:
        linear = file.channels()["RGBA"].pixels
        assert set(file.channels()) == {"RGBA"}
    assert png.shape == linear.shape and png[0, -1, 3] == 0
    assert np.array_equal(png[..., 3], np.rint(255.0 * np.clip(linear[..., 3], 0.0, 1.0)))


def test_names_of_segments_are_text_and_made_again(call, figure, raw):
    (ball() > 0).astype(np.uint8).tofile(raw.parent / "labels.raw")
    styles = [{"label": 1, "name": "kidney_left"}, {"label": 2, "name": "nowhere"}]
    (raw.parent / "styles.json").write_text(json.dumps(styles))
    labels = "--labels", raw.parent / "labels.raw", "--label-functions", raw.parent / "styles.json"
    folder = figure("--names", "--font-size", "3", *labels)
    drawn = [one.text for one in ElementTree.parse(folder / "fig.svg").iter("{http://www.w3.org/2000/svg}text")]
    assert drawn.count("Left kidney") == 1 and "Nowhere" not in drawn
    again = call("figure", folder / SIDECAR, "-o", folder / "again.svg")
    assert again.code == 0 and (folder / "again.svg").read_bytes() == (folder / "fig.svg").read_bytes()


@pytest.mark.extras
def test_a_pdf_has_the_texts_and_the_same_bytes_again(call, figure):
    pytest.importorskip("matplotlib")
    folder = figure("--title", "Costs $5 and $6")
    for name in ("a.pdf", "b.pdf"):
        assert call("figure", folder / SIDECAR, "-o", folder / name).code == 0
    content = (folder / "a.pdf").read_bytes()
    assert content.startswith(b"%PDF") and content == (folder / "b.pdf").read_bytes()


@pytest.mark.parametrize(
    "options, sentence",
    [
        (["--names"], "--names has no names; give --labels"),
        (["-o", "b.tif"], "b.tif has no suffix of a format of figures"),
        (["--perspective", "--scale-bar", "5"], "at one depth only"),
        (["--sides", "cube"], "not known where the patient's sides are"),
        (["--scale-bar", "5000"], "5 m is longer than the picture"),
        (["--scale-bar", "long"], "The figure's scale bar must be a length above zero, or 'auto' or 'off'"),
        (["--background", "red"], "The background must be white, black, transparent"),
        (["--compare", "ct-bone"], "--compare and --transfer-function contradict each other"),
        (["--view", "0", "0", "--azimuth", "3"], "--view and --azimuth contradict each other"),
        (["--title", "a", "--title", "b"], "--title is given 2 times for 1 panels"),
        (["--title", "頭"], "A title of the figure has the character"),
        (["--data", "x.raw"], "--data gives the place of the data of a sidecar"),
        (["--shadows"], "--shadows needs lights"),
        (["--columns", "-2"], "columns must be a whole number"),
    ],
)
def test_bad_options_are_refused(refused, raw, raw_options, function_file, options, sentence):
    folder = raw.parent
    words = [folder / word if word == "b.tif" else word for word in options]
    function = ("--transfer-function", function_file)
    told = refused("figure", raw, *raw_options, *PAGE, *function, "-o", folder / "fig.png", *words)
    assert sentence in told
    assert sorted(path.name for path in folder.iterdir()) == ["ball.raw"]


def test_a_zarr_json_is_data(refused, tmp_path):
    (tmp_path / "zarr.json").write_text("{}")
    assert "is a Zarr folder without" in refused("figure", tmp_path / "zarr.json", *PAGE, "-o", tmp_path / "fig.png")


def test_an_unknown_thing_to_compare_is_refused(refused, raw, raw_options):
    told = refused("figure", raw, *raw_options, *PAGE, "-o", raw.parent / "fig.png", "--compare", "ct-bones")
    assert "There is no preset 'ct-bones'" in told


@pytest.mark.parametrize(
    "change, sentence",
    [
        (lambda sidecar: sidecar.pop("format"), "is not the sidecar of a figure"),
        (lambda sidecar: sidecar.update(version=2), "has version 2, and this program reads version 1"),
        (lambda sidecar: sidecar["data"].pop("hash"), "has no valid 'hash'"),
        (lambda sidecar: sidecar["panels"][0]["scene"].pop("camera"), "has an unknown or no 'camera'"),
        (lambda sidecar: sidecar["panels"][0]["scene"].update(glow=1), "has an unknown or no 'glow'"),
        (lambda sidecar: sidecar["panels"][0]["scene"].update(lights=3), "has a value of the wrong type"),
        (lambda sidecar: sidecar["panels"][0]["quality"].update(kernel="x"), "There is no kernel called 'x'"),
        (lambda sidecar: sidecar["panels"][0]["scene"].update(channels=[{}]), "has other labels or channels than"),
        (lambda sidecar: sidecar.update(channels=[3]), "A channel of the sidecar"),
        (lambda sidecar: sidecar["style"].update(dpi=-1), "dpi must be from 20 to 2400"),
        (lambda sidecar: sidecar.update(panels=[3]), "A panel of the sidecar"),
        (lambda sidecar: sidecar.update(panels=[]), "needs at least one panel"),
        (lambda sidecar: sidecar.update(missing=["triangles"]), "shows more than its sidecar can hold (triangles)"),
    ],
)
def test_bad_sidecars_are_refused(refused, plain, change, sentence):
    folder = plain
    sidecar = json.loads((folder / SIDECAR).read_text())
    change(sidecar)
    (folder / SIDECAR).write_text(json.dumps(sidecar))
    assert sentence in refused("figure", folder / SIDECAR, "-o", folder / "b.png")


def test_a_sidecar_takes_no_other_options(refused, plain):
    folder = plain
    told = refused("figure", folder / SIDECAR, "--preset", "ct-bone", "-o", folder / "b.png")
    assert "so --preset cannot be given with it" in told
    told = refused("figure", folder / SIDECAR, "-o", folder / "b.png", "--json", folder / SIDECAR)
    assert "is read by this command" in told


def test_a_sidecar_names_the_level_that_was_read():
    assert level_options(SimpleNamespace(levels=((8, 8, 8), (4, 4, 4)), shape_xyz=(4, 4, 4))) == {"level": 1}
    assert level_options(SimpleNamespace(levels=(), shape_xyz=(4, 4, 4))) == {}


def test_what_a_sidecar_does_not_hold_is_named(plain, raw):
    sidecar = read_sidecar(plain / SIDECAR)
    assert sidecar.content["missing"] == [] and sidecar.sources.volume.file == raw.as_posix()
    lit = {"lights": (Light(),), "world": (1.0, 1.0, 1.0), "environment": LIT}
    held = Scene(None, None, Camera(), **lit, reasons_off={"shadows": "left out"})
    assert missing_of(held) == []
    read = HELD["environment"](json.loads(json.dumps(as_json(LIT))))
    assert np.array_equal(read.first, LIT.first) and np.array_equal(read.second, LIT.second)
    assert missing_of(Scene(None, None, Camera(), triangles=np.zeros((1, 3, 3)))) == ["triangles"]
    with pytest.raises(RleSplatError, match="Cannot read the sidecar"):
        read_sidecar(raw.parent / "nothing.json")
