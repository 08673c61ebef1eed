"""What record sizes cost, at a tiny size: what must hold whatever the machine does.  No time is asserted."""

import pytest

from benchmarks import records
from benchmarks.frames import view_scene
from rle_splat.runtime.jit import compiled
from rle_splat.scene import Quality

pytestmark = pytest.mark.skipif(not compiled(), reason="slow without kernels")
THIN = next(records.fields())


@pytest.fixture(scope="module")
def rows():
    _, volume, tf = THIN
    scenes = [view_scene(volume, tf, view, 24, shaded=False) for view in ((0, 0), (20, 10))]
    return records.compare_records(scenes, Quality.preset("standard", threads=1), probes=9, repeats=1)


def test_shorter_records_err_little(rows):
    assert [row["record"] for row in rows] == [16, 8]
    best, short = (row["against_16"]["largest"] for row in rows)
    assert best == 0.0 < short < 1.0  # where a linear alpha of 8 bits is 59 levels off
    assert rows[0]["frame"] == 1.0


def test_the_truth_is_not_the_picture_of_16_bytes(rows):
    best = rows[0]["t1"]["largest"]
    assert best > 0.0
    for row in rows:
        assert abs(row["t1"]["largest"] - best) <= row["against_16"]["largest"] + 1e-9


def test_the_thin_medium_is_as_deep_as_it_says():
    _, volume, tf = THIN
    assert volume.shape_xyz[1] == records.THIN_SLICES
    assert tf.alpha_at(volume.physical(volume.voxels)) == pytest.approx(records.THIN_ALPHA)


def test_table_and_report(read_rows, capsys, monkeypatch):
    monkeypatch.setattr(records, "fields", lambda: [THIN])
    assert records.main(["--data", "--size", "16", "--views", "1", "--probes", "4"]) == 0
    (row,) = read_rows("records")
    assert row["volume"] == "thin medium" and [entry["record"] for entry in row["records"]] == [16, 8]
    said = capsys.readouterr().out
    assert "8 B against 16" in said and f"{row['records'][1]['against_16']['largest']:.2f}" in said
