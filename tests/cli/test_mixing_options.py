"""The options --labels and --channel: what they show, and what gives a clear error before anything is read."""

import json

import numpy as np
import pytest


@pytest.fixture
def picture(call, raw, raw_options, function_file, tmp_path):
    def run(*words):
        out, report = tmp_path / "out.npy", tmp_path / "out.json"
        result = call(
            "render", raw, *raw_options, "--transfer-function", function_file, "--no-shading", "--size", "40x36", "-o",
            out, "--json", report, *words,
        )  # fmt: skip
        assert result.code == 0, result.err
        return np.load(out), json.loads(report.read_text())

    return run


@pytest.fixture
def labels(tmp_path, voxels):
    """1 in the half with x below 8, 2 in the rest, as bare 16-bit voxels."""
    path = tmp_path / "labels.raw"
    found = np.ones(voxels.shape, np.uint16)
    found[:, :, 8:] = 2
    found.tofile(path)
    return path


def test_labels_hide_and_color_what_they_name(picture, labels, write_json):
    functions = write_json([{"label": 1, "name": "left", "hidden": True}, {"label": 2, "color": [0.0, 1.0, 0.0]}])
    rgba, report = picture("--labels", labels, "--label-functions", functions)
    whole, _ = picture()
    assert rgba[:, :8, 3].max() < 0.02 < whole[:, 12:16, 3].max() and rgba[..., [0, 2]].max() < 1e-6
    np.testing.assert_allclose(rgba[:, 22:, 3], whole[:, 22:, 3], atol=0.02)
    np.testing.assert_allclose(rgba[..., 1], rgba[..., 3], atol=1e-5)
    effect = next(effect for effect in report["effects"] if effect["name"] == "labels")
    assert effect["reason"] == "1 segment(s) with a transfer function, 1 hidden"
    assert report["plan"]["classification"] == "post"


def test_edges_of_labels_show_voxels_where_that_is_wanted(picture, labels, write_json):
    words = "--labels", labels, "--label-functions", write_json([{"label": 1, "hidden": True}])
    smooth, by_default, voxels = (
        picture(*words, *more)[0] for more in (("--label-edges", "smooth"), (), ("--label-edges", "voxels"))
    )
    np.testing.assert_array_equal(smooth, by_default)
    assert np.abs(smooth - voxels).max() > 0.02


def test_a_label_by_preset_or_by_function(picture, labels, write_json, function_file):
    own = json.loads(function_file.read_text())
    functions = [{"label": 1, "preset": "faint"}, {"label": 2, "transfer_function": own}]
    rgba, report = picture("--labels", labels, "--label-functions", write_json(functions))
    whole, _ = picture()
    np.testing.assert_allclose(rgba[:, 22:], whole[:, 22:], atol=0.02)
    assert np.abs(rgba - whole).max() > 0.1
    effect = next(effect for effect in report["effects"] if effect["name"] == "labels")
    assert effect["reason"] == "1 segment(s) with a transfer function, 0 hidden", "that of 2 is the volume's own"


def test_a_channel_is_added(picture, voxels, tmp_path, write_json):
    other = tmp_path / "other.raw"
    np.full(voxels.shape, 7, np.uint8).tofile(other)
    blue = write_json({"opacity": [[0, 0.02]], "color": [[0, 0, 0, 1]], "shade": False}, "blue.json")
    rgba, report = picture("--channel", other, "--channel-function", blue)
    alone, _ = picture("--classification", "pre")
    middle = (18, 20)
    assert rgba[middle][3] > alone[middle][3] and rgba[..., 2].max() > alone[..., 2].max() + 0.02
    corner = np.abs(rgba - alone).max(axis=-1)[12, 8]
    assert corner > 0.1, "where the first channel shows nothing"
    effect = next(effect for effect in report["effects"] if effect["name"] == "channels")
    assert effect["on"] and effect["reason"] == "1 further channel(s) are added"


def test_a_channel_by_preset_or_automatic(picture, voxels, tmp_path):
    """A preset is fitted to the channel; without one a channel gets what it would get as a volume."""
    other = tmp_path / "smoke.raw"
    np.random.default_rng(0).integers(0, 255, voxels.shape, np.uint8).tofile(other)
    alone, _ = picture()
    by_preset, automatic = (picture("--channel", other, *more)[0] for more in (("--channel-function", "smoke"), ()))
    np.testing.assert_array_equal(by_preset, automatic)
    assert np.abs(by_preset - alone).max() > 0.1


@pytest.mark.parametrize(
    ("entries", "says"),
    [
        ({}, "list of labels"),
        ([{"name": "liver"}], "label"),
        ([{"label": 1.5}], "whole number"),
        ([{"label": 1}, {"label": 1}], "twice"),
        ([{"label": 1, "color": [1, 2]}], "three finite numbers"),
        ([{"label": 1, "preset": "no-such"}], "no preset"),
        ([{"label": 1, "preset": "smoke", "transfer_function": {"opacity": [[0, 1]], "color": [[0, 1, 1, 1]]}}], "one"),
        ([{"label": 1, "hidden": "yes"}], "true or false"),
        ([{"label": 1, "shown": True}], "shown"),
    ],
)
def test_bad_label_files_are_refused(refused, write_json, labels, tmp_path, entries, says):
    words = "--labels", labels, "--label-functions", write_json(entries), "-o", tmp_path / "x.npy"
    assert says in refused("render", tmp_path / "missing.raw", *words)


def test_options_that_do_not_fit_together(refused, labels, write_json, tmp_path, function_file):
    words = "render", tmp_path / "missing.raw", "-o", tmp_path / "x.npy"
    assert "give both" in refused(*words, "--label-functions", write_json([]))
    assert "each channel its function" in refused(
        *words, "--channel", labels, "--channel", labels, "--channel-function", function_file
    )
    assert "no-such" in refused(*words, "--channel", labels, "--channel-function", "no-such")
    rle = "render", tmp_path / "missing.rle", "-o", tmp_path / "x.npy"
    assert "classified already" in refused(*rle, "--channel", labels, "--channel-function", function_file)


def test_labels_on_another_grid(refused, raw, raw_options, write_json, tmp_path):
    small = tmp_path / "small.raw"
    np.ones(99, np.uint8).tofile(small)
    words = "--labels", small, "--label-functions", write_json([{"label": 1, "hidden": True}])
    refused("render", raw, *raw_options, *words, "-o", tmp_path / "x.npy")


def test_a_flipped_label_map_gives_the_same_picture(call, function_file, tmp_path):
    """Labels in another order of voxels, with names and colors of their own, from the command line."""
    import nibabel

    from rle_splat.read.formats import write_volume
    from rle_splat.volume.volume import PATIENT, Volume

    values = np.full((12, 14, 16), 200, np.uint8)
    affine = np.array([(1.0, 0, 0, -8), (0, 1, 0, -7), (0, 0, 1, 3), (0, 0, 0, 1)])
    write_volume(Volume(values, affine, space=PATIENT), tmp_path / "scan.nii.gz")
    labels = np.zeros((16, 14, 12), np.uint8)  # x, y, z
    labels[:5], labels[5:] = 1, 2
    (tmp_path / "names.txt").write_text('1 255 0 0 1 1 1 "a"\n2 0 0 255 1 1 1 "b"\n')
    pictures = []
    for name, stored, flip in (("same", labels, np.eye(4)), ("flipped", labels[::-1], np.diag((-1.0, 1, 1, 1)))):
        flip[0, 3] = 15.0 if name == "flipped" else 0.0
        nibabel.save(nibabel.Nifti1Image(stored, np.diag((-1.0, -1, 1, 1)) @ affine @ flip), tmp_path / f"{name}.nii")
        out = tmp_path / f"{name}.npy"
        result = call(
            "render", tmp_path / "scan.nii.gz", "--transfer-function", function_file, "--no-shading", "--size", "40x36",
            "--labels", tmp_path / f"{name}.nii", "--label-functions", tmp_path / "names.txt", "-o", out,
        )  # fmt: skip
        assert result.code == 0, result.err
        assert ("another order; they were reordered" in result.out) == (name == "flipped")
        pictures.append(np.load(out))
    np.testing.assert_array_equal(*pictures)
    assert pictures[0][18, 10, 0] > 0.1 > 1e-6 > pictures[0][18, 10, 2]  # red at the patient's right, the viewer's left
    assert pictures[0][18, 28, 2] > 0.1 > 1e-6 > pictures[0][18, 28, 0]


def test_channels_are_matched_by_their_places(call, refused, function_file, tmp_path):
    """The same channel stored in another order is the same picture; one of another place is refused."""
    from rle_splat.read.formats import write_volume
    from rle_splat.volume.volume import PATIENT, Volume

    values = np.random.default_rng(1).integers(0, 255, (12, 14, 16)).astype(np.uint8)
    affine = np.array([(1.0, 0, 0, -8), (0, 1, 0, -7), (0, 0, 1, 3), (0, 0, 0, 1)])
    flip = np.diag((-1.0, 1, 1, 1))
    flip[0, 3] = 15.0
    away = affine.copy()
    away[2, 3] = 500.0
    for name, stored, place in (
        ("same", values, affine), ("flipped", values[:, :, ::-1], affine @ flip), ("away", values, away),
        ("half", values[:, :, ::2], affine @ np.diag((2.0, 1, 1, 1))),
    ):  # fmt: skip
        write_volume(Volume(np.ascontiguousarray(stored), place, space=PATIENT), tmp_path / f"{name}.nii")

    def words(name):
        return (
            "render", tmp_path / "same.nii", "--transfer-function", function_file, "--size", "40x36", "--channel",
            tmp_path / f"{name}.nii", "--channel-function", function_file, "-o", tmp_path / f"{name}.npy",
        )  # fmt: skip

    told = {name: call(*words(name)) for name in ("same", "flipped", "half")}
    assert [one.code for one in told.values()] == [0, 0, 0], told
    pictures = {name: np.load(tmp_path / f"{name}.npy") for name in told}
    np.testing.assert_array_equal(pictures["flipped"], pictures["same"])
    assert "The channel stores its voxels in another order; they were reordered." in told["flipped"].out
    assert "has another grid (8 x 14 x 12 voxels); its values were interpolated" in told["half"].out
    assert 0.01 < np.abs(pictures["half"] - pictures["same"]).max() < 1.0
    assert "The channel lies elsewhere" in refused(*words("away"))


def test_labels_without_names_have_distinct_colors(picture, labels, voxels, tmp_path):
    """As instances of nuclei: solid, whatever the values are, and voxels of no label hidden."""
    found = np.fromfile(labels, np.uint16).reshape(voxels.shape)
    found[:, :, :4] = 0
    found.tofile(labels)
    rgba, _ = picture("--labels", labels)
    left, right = (rgba[10:26, columns].reshape(-1, 4).mean(axis=0) for columns in (slice(13, 17), slice(24, 30)))
    assert rgba[10:26, :8, 3].max() < 0.05 and min(left[3], right[3]) > 0.9
    assert np.abs(left[:3] - right[:3]).max() > 0.3


def test_a_scan_in_place_of_labels(call, raw, raw_options, tmp_path):
    """More values than labels can have."""
    scan = tmp_path / "scan.raw"
    np.arange(20 * 16 * 12, dtype=np.uint16).tofile(scan)
    result = call("render", raw, *raw_options, "--labels", scan, "-o", tmp_path / "x.npy")
    assert result.code == 2 and "The label map scan has more than 512 different values" in result.err


def test_channels_of_a_file(call, refused, tmp_path):
    """Each in its color: with the other channel a picture has both, and a figure is made again from its sidecar."""
    tifffile = pytest.importorskip("tifffile")
    values = np.zeros((20, 2, 20, 20), np.uint16)  # z, channel, y, x
    values[6:14, 0, 4:9, 6:14] = 900
    values[6:14, 1, 12:17, 6:14] = 5000
    tifffile.imwrite(tmp_path / "cells.tif", values, imagej=True, metadata={"axes": "ZCYX"})
    words = ["render", tmp_path / "cells.tif", "--size", "40", "--elevation", "90", "--no-shading", "-o"]
    alone, both = tmp_path / "alone.npy", tmp_path / "both.npy"
    assert call(*words, alone).code == 0
    assert call(*words, both, "--file-channels").code == 0
    green, magenta = (np.load(path)[..., :3].reshape(-1, 3).max(axis=0) for path in (alone, both))
    assert green[1] > 0.3 > 1e-6 > green[0] and magenta[0] > 0.3 and magenta[1] == pytest.approx(green[1], abs=0.02)
    tifffile.imwrite(tmp_path / "one.tif", values[:, 0], imagej=True, metadata={"axes": "ZYX"})
    assert "no further channels" in refused("render", tmp_path / "one.tif", "--file-channels", "-o", alone)


def test_a_table_is_hidden_where_a_scan_is_first_seen(call, tmp_path, write_json):
    """A box, and a plate behind it that is no part of it; seen from above the plate is in the upper rows."""
    values = np.full((20, 64, 64), -1000, np.int16)
    values[:, 16:44, 12:52], values[:, 54:57, 4:60] = 700, 700
    values.tofile(tmp_path / "ct.raw")
    words = (
        "--shape 64 64 20 --dtype int16 --value-unit HU --unit mm --spacing 5 5 5 --no-shading --size 64 --elevation 89"
    )
    function = write_json({"opacity": [[300, 0.0], [500, 0.8]], "color": [[0, 1.0, 1.0, 1.0]]})

    def shows(*more):
        """Whether the picture has the plate, and whether it has the box; the sentence is there if a table is hidden."""
        out = tmp_path / "out.npy"
        result = call("render", tmp_path / "ct.raw", *words.split(), "-o", out, *more)
        assert result.code == 0, result.err
        alpha = np.load(out)[..., 3]
        assert ("--keep-table" in result.out) == (alpha[:18].max() < 0.01)
        return alpha[:18].max() > 0.9, alpha[32, 32] > 0.9

    assert shows() == shows("--preset", "ct-bone") == shows("--transfer-function", function) == (False, True)
    assert shows("--keep-table") == shows("--keep-table", "--transfer-function", function) == (True, True)
    assert shows("--tolerance", "8") == (True, True), "which works without labels alone"

    figure, again = tmp_path / "figure.png", tmp_path / "again.png"
    scan = words.replace("--size 64 ", "--width-cm 4 --dpi 60 ").split()
    made = [call("figure", tmp_path / "ct.raw", *scan, "-o", figure, *more) for more in ((), ("--keep-table",), ())]
    assert [("--keep-table" in one.out, one.code) for one in made] == [(True, 0), (False, 0), (True, 0)]
    result = call("figure", figure.with_suffix(".figure.json"), "-o", again)
    assert result.code == 0 and "bit-identical" in result.out and figure.read_bytes() == again.read_bytes()
    (tmp_path / "ct.raw").rename(tmp_path / "moved.raw")
    result = call("figure", figure.with_suffix(".figure.json"), "-o", again, "--data", tmp_path / "moved.raw")
    assert result.code == 0 and "bit-identical" in result.out


@pytest.mark.parametrize("scan, organs, sentence", [
    (3, 2, "has 2 volumes and the scan 3; beyond them the last one is shown"),
    (1, 3, "has 3 volumes and the scan 1; the first is shown"), (3, 1, ""), (3, 3, ""),
])  # fmt: skip
def test_labels_of_another_number_of_frames_are_said(scan, organs, sentence, call, tmp_path):
    nibabel = pytest.importorskip("nibabel")
    for name, frames in (("beat", scan), ("organs", organs)):
        voxels = np.ones((8, 8, 8, frames), np.uint8) * np.arange(1, frames + 1, dtype=np.uint8)
        image = nibabel.Nifti1Image(voxels if frames > 1 else voxels[..., 0], np.eye(4))
        nibabel.save(image, tmp_path / f"{name}.nii.gz")
    more = ("--frame", "3") if scan == 3 else ()
    result = call("render", tmp_path / "beat.nii.gz", "--labels", tmp_path / "organs.nii.gz", "--preset", "gray",
                  "--size", "16", "-o", tmp_path / "out.png", *more)  # fmt: skip
    assert result.code == 0 and sentence in result.out and bool(sentence) == ("The segmentation file has" in result.out)
