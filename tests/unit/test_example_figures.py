"""The script of the documentation's figure: its boxes, and a command line that the command takes."""

import json

import numpy as np
import pytest

from devtools import docs_reference, example_figures, practice_ct


def inside(box, point):
    """Whether a point of the world lies in a box given by its matrix, from -1 to 1."""
    return np.abs(np.linalg.inv(box["matrix_world"]) @ (*point, 1.0)).max() <= 1.0


def test_the_boxes_hold_the_skull_but_not_its_holder():
    middle = np.array(example_figures.MIDDLE)
    for place, is_held in (((65, 0, 0), True), ((0, 92, 0), True), ((50, 60, 0), True), ((73, 94, 0), False),
                           ((0, 110, 0), False)):  # fmt: skip
        assert all(inside(box, middle + place) for box in example_figures.boxes()) == is_held


@pytest.mark.parametrize("has_scan", [True, False])
def test_the_command_lines_are_understood(monkeypatch, tmp_path, has_scan):
    monkeypatch.setattr(example_figures, "data_folder", lambda: tmp_path / "data")
    monkeypatch.setattr(practice_ct, "write_series", lambda folder: folder.mkdir())
    if has_scan:
        (tmp_path / "data" / example_figures.SKULL).mkdir(parents=True)
    for command, *words in example_figures.command_lines(tmp_path):
        args = docs_reference.command_parser(command).parse_args(words)
        # The pictures of the page on the first render show the scan by a preset, with its head holder; a heart turns.
        is_turned = getattr(args, "turn", None) is not None
        assert (args.clip is not None) == (has_scan and args.preset is None and not is_turned)
    if has_scan:
        assert json.loads((tmp_path / "boxes.json").read_text()) == example_figures.boxes()
