"""The script of the documentation's figures: its clip planes, and a command line that the command takes."""

import json

import numpy as np
import pytest

from devtools import docs_reference, example_figures


def test_a_plane_cuts_toward_its_direction():
    for _, away in example_figures.CUTS:
        rotation = example_figures.turned_to(away)
        assert np.allclose(rotation.T @ rotation, np.eye(3)) and np.linalg.det(rotation) == pytest.approx(1.0)
        assert np.allclose(rotation[:, 2] * np.linalg.norm(away), away)


@pytest.mark.parametrize("source", ["made of numbers", "scan.raw.gz"])
def test_the_command_line_is_understood(monkeypatch, tmp_path, source):
    path = tmp_path / "head.raw"
    path.write_bytes(np.zeros((4, 5, 6), np.int16).tobytes())
    options = {"shape": (6, 5, 4), "dtype": "int16", "byte_order": "little", "spacing": (1.0, 1.0, 2.0),
               "use_calibration": True, "intercept": -1024.0, "value_unit": "HU", "preset": "ct-bone"}  # fmt: skip
    monkeypatch.setattr(example_figures.gallery_data, "head", lambda folder: (path, options, source))
    command, *words = example_figures.head_words(tmp_path)
    args = docs_reference.command_parser(command).parse_args([*words, "-o", "head.svg"])
    assert args.shape == [6, 5, 4] and args.intercept == -1024.0 and args.compare == list(example_figures.COMPARED)
    assert (args.clip is None) == (source == "made of numbers")
    camera = json.loads((tmp_path / "camera.json").read_text())
    assert camera["type"] == "ORTHO" and len(camera["matrix_world"]) == 4
