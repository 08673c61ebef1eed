"""From an edit to the picture, at a tiny size: every edit redoes what it is named for.  No time is asserted."""

import pytest

from benchmarks import editing
from rle_splat.runtime.jit import compiled
from rle_splat.scene import Quality, Scene
from rle_splat.view.turntable import turntable

pytestmark = pytest.mark.skipif(not compiled(), reason="slow without kernels")
REDONE = {
    "pre": {
        "camera": set(),
        "camera, unshaded": set(),
        "camera, headlight": {"records"},
        "light": {"records"},
        "colors": {"properties", "records"},
        "opacities": {"properties", "records"},
        "wider range": {"visible", "properties", "normals", "runs", "records"},
    },
    "post": {
        "camera": set(),
        "camera, unshaded": set(),
        "camera, headlight": set(),
        "light": set(),
        "colors": {"table"},
        "opacities": {"table"},
        "wider range": {"relevant", "table", "surfaces", "normals", "codes", "runs", "scalars"},
    },
}


@pytest.fixture(scope="module", params=REDONE)
def classification(request):
    return request.param


@pytest.fixture(scope="module")
def rows(classification):
    ((_, volume, tf),) = editing.volumes(["shells"], 48)
    camera, matrix = turntable(volume, *editing.VIEW)
    scene = Scene(volume, tf, camera, 24, 24, matrix, headlight=True)
    quality = Quality.preset("draft", classification=classification, threads=1)
    return {row["edit"]: row for row in editing.measure(scene, quality, edits=3)}


def test_every_edit_redoes_what_it_is_named_for(rows, classification):
    assert list(rows) == [editing.FIRST, *REDONE[classification]]
    for name, stages in REDONE[classification].items():
        assert rows[name]["made"] == dict.fromkeys(stages, 1.0), name


def test_only_a_wider_range_shows_more(rows):
    first = rows[editing.FIRST]["visible_voxels"]
    assert rows["wider range"]["visible_voxels"] > first > 0
    assert {row["visible_voxels"] for name, row in rows.items() if name != "wider range"} == {first}


def test_shells_as_large_as_the_limits_are_stated_for():
    ((_, volume, tf),) = editing.volumes(["shells"], 64)
    shown = (tf.alpha_at(volume.physical(volume.voxels)) > 0.0).mean()
    assert shown * 256**3 == pytest.approx(1.6e6, rel=0.15)


def test_table_and_report(read_rows, capsys, classification):
    arguments = ["--volume", "shells", "--side", "24", "--size", "16", "--quality", "draft", "--edits", "1"]
    arguments += ["--classification", classification]
    assert editing.main([*arguments, "--threads", "1"]) == 0
    rows = read_rows("editing")
    records = (16, 8) if classification == "pre" else (16,)
    edits = (editing.FIRST, *REDONE[classification])
    assert [(row["record"], row["edit"]) for row in rows] == [(record, edit) for record in records for edit in edits]
    said = capsys.readouterr().out.splitlines()
    assert sum("wider range" in line and f"{rows[7]['whole']:.1f}" in line for line in said) >= 1
    for row in rows:
        assert row["whole"] >= row["splat"] > 0.0 and row["setup"] > 0.0
