"""The option --clip: planes and boxes cut the volume where they lie; what is none gives a clear error."""

import json

import numpy as np
import pytest

TO_THE_RIGHT = [[0, 0, 1, 8], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]  # its +Z is the world's +X, at x = 8
MIDDLE = [[6, 0, 0, 9.5], [0, 6, 0, 7.5], [0, 0, 3, 5.5], [0, 0, 0, 1]]


@pytest.fixture
def picture(call, raw, raw_options, tmp_path):
    def run(*words, volume=None):
        out, report = tmp_path / "out.npy", tmp_path / "out.json"
        given = [raw, *raw_options] if volume is None else [volume]
        assert call("render", *given, "--size", "60x50", "-o", out, "--json", report, *words).code == 0
        return np.load(out), json.loads(report.read_text())

    return run


@pytest.mark.parametrize("encoded", (False, True), ids=("raw", "rle"))
def test_a_plane_keeps_the_side_its_normal_points_away_from(
    call, picture, raw, raw_options, write_json, tmp_path, encoded
):
    volume = tmp_path / "ball.rle" if encoded else None
    if encoded:
        assert call("encode", raw, *raw_options, "-o", volume).code == 0
    clip = write_json([{"kind": "plane", "matrix_world": TO_THE_RIGHT}])
    whole, _ = picture(volume=volume)
    cut, report = picture("--clip", clip, volume=volume)
    # 20 voxels of 25 across 50 rows: two pixels a voxel, the middle at x = 9.5
    edge = 30 + 2 * (8.0 - 9.5)
    assert cut[:, int(edge) + 2 :].max() < 0.05 < 0.5 < whole[:, int(edge) + 2 :].max()
    assert cut[:, int(edge) + 6 :].max() < 1e-3, "beyond what the warp's spline makes of an edge"
    np.testing.assert_allclose(cut[:, : int(edge) - 8], whole[:, : int(edge) - 8], atol=1e-3)
    effect = next(effect for effect in report["effects"] if effect["name"] == "clip objects")
    assert effect["on"] and effect["reason"] == "1 plane cuts the volume"


def test_a_box_and_its_outside_share_the_volume(picture, write_json, function_file):
    words = "--transfer-function", function_file, "--no-shading"
    parts = [
        picture("--clip", write_json([{"kind": "box", "matrix_world": MIDDLE, "keep": keep}]), *words)[0]
        for keep in ("inside", "outside")
    ]
    whole = picture(*words)[0]
    assert all(0.05 < part[..., 3].max() <= whole[..., 3].max() + 0.02 for part in parts)
    passed = 1.0 - np.stack([*parts, whole])[:, 24:27, 27:33, 3]
    np.testing.assert_allclose(passed[0] * passed[1], passed[2], atol=6e-3)


@pytest.mark.parametrize(
    ("clips", "says"),
    [
        ({}, "list of planes and boxes"),
        ([{"kind": "ball"}], "plane or box"),
        ([{"kind": "box", "matrix_world": [[1, 0], [0, 1]]}], "4x4"),
        ([{"kind": "box", "matrix_world": [[0, 0, 0, 0]] * 3 + [[0, 0, 0, 1]]}], "flat"),
        ([{"kind": "box", "size": 3}], "size"),
        ("[", "not valid JSON"),
    ],
)
def test_what_is_no_clip_object_is_refused_before_anything_is_read(refused, write_json, tmp_path, clips, says):
    words = "--clip", write_json(clips), "-o", tmp_path / "x.npy"
    assert says in refused("render", tmp_path / "missing.raw", *words)
