"""Scaling and turn at tiny sizes: the synthetic volumes are what they claim, the figures hang together."""

import numpy as np
import pytest

from benchmarks import scaling
from benchmarks.turn import Turn, smooth, summary
from rle_splat.runtime.jit import compiled
from rle_splat.scene import Quality, RleSplatError

needs_kernels = pytest.mark.skipif(not compiled(), reason="slow without kernels")


def volume(series: str, n: int) -> np.ndarray:
    return np.stack([scaling.slab(series, n, z) for z in range(n)])


def test_scaled_volume_keeps_three_percent():
    assert (volume("scaled", 128) > 0).mean() == pytest.approx(0.03, rel=0.1)


def test_boxed_volume_is_the_same_object_in_a_larger_box():
    inner, outer = volume("boxed", 128), volume("boxed", 160)
    assert np.array_equal(outer[16:144, 16:144, 16:144], inner)
    assert (outer > 0).sum() == (inner > 0).sum()


@needs_kernels
def test_steps_write_table_and_report(tmp_path, read_rows, capsys):
    code = scaling.main([
        "--sizes", "24", "--size", "16", "--threads", "1", "--frames-ms", "20", "--scratch", str(tmp_path),
        "--no-image",
    ])  # fmt: skip
    assert code == 0
    rows = read_rows("scaling")
    assert [row["series"] for row in rows] == list(scaling.SERIES)
    assert all(row["volume_bytes"] == 24**3 for row in rows)
    assert rows[0]["kept_voxels"] == (volume("scaled", 24) > 0).sum()
    assert [path.name for path in tmp_path.iterdir()] == ["results"], "the scratch volume stays behind"
    assert "24^3" in capsys.readouterr().out


def test_a_full_disk_is_said_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(scaling.shutil, "disk_usage", lambda folder: type("Usage", (), {"free": 1000}))
    with pytest.raises(RleSplatError, match="not enough space for 24"):
        scaling.main(["--sizes", "24", "--scratch", str(tmp_path)])


@pytest.fixture(scope="module")
def turntable():
    return Turn(*smooth(24), Quality.preset("standard", threads=1), 32, 20.0)


@needs_kernels
def test_full_turn_switches_four_times(turntable):
    frames = turntable.round(15.0)
    assert len(frames) == 24 and sum(row["switched"] for row in frames) == 4
    assert frames[-1]["azimuth"] == 360.0
    assert all(row["largest"] >= row["rmse"] >= 0.0 and row["alpha"] > 0.0 for row in frames)


@needs_kernels
def test_switch_of_a_cubic_volume_is_at_45_degrees(turntable):
    assert turntable.switch(30.0, 60.0) == pytest.approx(45.0, abs=1e-6)


@needs_kernels
def test_both_axes_show_the_same_thing(turntable):
    near = [turntable.both_axes(azimuth, 16) for azimuth in (44.0, 46.0)]
    assert [row["axes"][0] for row in near] == [1, 0]
    assert near[0]["axes"][:2] == near[1]["axes"][1::-1]
    # A mirrored or shifted picture would be some hundred levels away.
    assert all(row["largest"] < 20.0 and row["true_largest"] < 20.0 for row in near)
    assert "switches 4 times" in summary(turntable.round(15.0), near, 15.0)[0]
