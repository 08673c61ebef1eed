"""The catalogue keeps what it is told: bounds are asserted, the table has no empty cell and no missing case."""

import json

import pytest

from devtools.catalogue import table
from devtools.places import Failure
from tests.stability.catalogue import CASES, Catalogue, ids_in


def full():
    catalogue = Catalogue()
    for case in CASES:
        catalogue.record(case, "something", 0.0, 1.0, "either", why="whole numbers")
    return catalogue


def page(catalogue, path):
    catalogue.save(path)
    return table(path)


def test_a_figure_above_its_bound_or_no_number_fails():
    with pytest.raises(AssertionError, match="V4"):
        Catalogue().record("V4", "error", 2.0, 1.0, "float32", why="x")
    with pytest.raises(AssertionError, match="nan"):
        Catalogue().record("V4", "error", float("nan"), 1.0, "float32", why="x")
    with pytest.raises(AssertionError, match="no name"):
        Catalogue().record("V99", "error", 0.0, 1.0, "float32", why="x")


def test_the_worst_figure_of_each_width_is_shown(tmp_path):
    catalogue = full()
    for width, figure in (("float32", 0.25), ("float32", 0.5), ("float64", 0.125)):
        catalogue.record("A1", "error | level", figure, 1.0, width)
    assert "| A1 | 1e3 to 1e7 thin sheets | error \\| level | 1 | 0.5 | 0.12 |" in page(catalogue, tmp_path / "f.json")


def test_an_empty_cell_or_a_missing_case_is_refused(tmp_path):
    catalogue = full()
    catalogue.record("C2", "jump", 0.5, 1.0, "float64")
    with pytest.raises(Failure, match="C2, jump: measured in float64 only"):
        page(catalogue, tmp_path / "f.json")
    catalogue = full()
    catalogue.record("C2", "error", 0.5, 1.0)
    assert "| error | 1 | 0.5 | - |" in page(catalogue, tmp_path / "f.json")
    catalogue.record("A1", "sum", 0.5, 1.0)
    with pytest.raises(Failure, match="A1, sum: measured in float32 only"):
        page(catalogue, tmp_path / "f.json")
    (tmp_path / "f.json").write_text(json.dumps({"cases": CASES, "rows": []}))
    with pytest.raises(Failure, match="for V1, V2"):
        table(tmp_path / "f.json")


def test_ids_are_read_from_a_tests_name():
    assert ids_in("test_V4_opacity_correction[numba]") == {"V4"} and ids_in("test_S1_S8_decoding") == {"S1", "S8"}
    assert not ids_in("test_A15x_nothing")
