"""The benchmark of repeated plans finds plans that differ, and none where they do not."""

import numpy as np

from benchmarks import repeats
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.scene import QUALITY_PRESETS, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume


def test_what_differs_is_told(monkeypatch, capsys):
    field = np.random.default_rng(0).random((12, 12, 12), np.float32)
    volume = Volume(field, np.eye(4))
    camera, matrix = turntable(volume, 30.0, 20.0, width=24, height=24)
    function = TransferFunction(opacity=((0.3, 0.0), (1.0, 0.5)), color=((0.0, 1.0, 1.0, 1.0),))
    scene = Scene(volume, function, camera, 24, 24, matrix)
    monkeypatch.setattr(repeats, "measured_scenes", lambda names: [("noise", scene)])
    choices = 2 * len(repeats.TOLERANCES) + len(QUALITY_PRESETS)
    assert repeats.main(["--runs", "2"]) == 0
    assert f"{choices} choices, 2 runs each, every second one busy: 0 have several plans." in capsys.readouterr().out

    runs = iter(range(2))
    monkeypatch.setattr(repeats, "plans_of", lambda scene: {"draft": ("slice", next(runs))})
    assert repeats.main(["--runs", "2"]) == 1
    assert "noise: draft: ('slice', 0); ('slice', 1)" in capsys.readouterr().out
