"""The paper's rows: committed transfer functions, and stand-ins as sparse as the scans they stand for."""

import numpy as np
import pytest

from benchmarks import data_sets
from benchmarks.data_sets import PAPER, STAND_IN, stand_in


def kept(volume, function) -> float:
    """The share of the voxels that the function shows; each value is looked up once."""
    counts = np.bincount(volume.voxels.ravel())
    return float(counts[function.alpha_at(volume.physical(np.arange(len(counts)))) > 0.0].sum() / counts.sum())


@pytest.mark.parametrize("data", PAPER, ids=lambda data: data.name)
class TestDataSets:
    def test_speedup_is_the_papers_own_quotient(self, data):
        without, with_ = data.paper_seconds
        assert without / with_ == pytest.approx(data.paper_speedup, rel=0.01)

    def test_transfer_function_is_there_and_shades(self, data):
        function = data.transfer_function()
        assert function.shade is not None
        assert function.alpha_at(0.0) == 0.0, "air must stay transparent"

    def test_kept_fraction_is_within_the_papers_range(self, data):
        assert 0.05 <= data.kept <= 0.30

    def test_stand_in_keeps_what_the_scan_keeps(self, data):
        small = tuple(n // 4 for n in data.shape_xyz)
        function = data.transfer_function()
        volume = stand_in(small, data.spacing, data.kept, function)
        assert volume.shape_xyz == small
        assert kept(volume, function) == pytest.approx(data.kept, rel=0.15)

    def test_scan_keeps_the_stated_fraction(self, data):
        if not data.path.exists():
            pytest.skip(f"{data.file} is not at hand")
        called, volume, function = data.load()
        assert called == data.name
        assert volume.shape_xyz == data.shape_xyz
        assert np.allclose(volume.spacing, data.spacing)
        assert kept(volume, function) == pytest.approx(data.kept, rel=0.02)


def test_an_absent_scan_is_named_a_stand_in(tmp_path, monkeypatch):
    monkeypatch.setattr(data_sets, "DATA", tmp_path)
    called, volume, _ = PAPER[0].load()
    assert called == f"CT head {STAND_IN}"
    assert volume.shape_xyz == PAPER[0].shape_xyz
