"""The background of a picture: a name or three numbers, before and after the volume."""

import numpy as np
import pytest

from rle_splat.classify.presets import PRESETS
from rle_splat.runtime.cache_folder import RELEASE
from rle_splat.scene.display import to_bytes

SIZE = 24  # pixels


@pytest.mark.parametrize(
    ("words", "color"),
    [(("white",), (1.0, 1.0, 1.0)), (("black",), (0.0, 0.0, 0.0)), (("transparent",), None), (("0", ".5", "1e-1"),
     (0.0, 0.5, 0.1))],
)  # fmt: skip
@pytest.mark.parametrize("before", [False, True])
def test_a_background_is_a_name_or_three_numbers(call, tmp_path, raw, raw_options, words, color, before):
    Image = pytest.importorskip("PIL.Image")
    png, pixels = tmp_path / "p.png", tmp_path / "p.npy"
    given = ("--background", *words, raw) if before else (raw, "--background", *words)
    assert call("render", *given, *raw_options, "--size", SIZE, "-o", png, "-o", pixels).code == 0
    rgba = np.load(pixels)
    assert rgba[..., 3].max() > 0.5 and rgba[..., 3].min() == 0.0
    assert np.array_equal(np.asarray(Image.open(png)), to_bytes(rgba, color))


def test_a_wrong_background_is_named(call, tmp_path, raw, raw_options):
    result = call("render", raw, *raw_options, "-o", tmp_path / "p.png", "--background", "red")
    assert result.code == 2 and "must be white, black, transparent or three" in result.err and "'red'" in result.err


def test_version_and_presets_are_printed(call):
    assert call("--version").out == f"rle-splat {RELEASE}\n"
    shown = " ".join(call("render", "--help").out.replace("-\n", "-").split()).replace("- ", "-")
    assert all(name in shown for name in PRESETS)
