"""The option --tolerance: the picture keeps it, the line on stdout and the report say what was predicted and what was
measured, and what cannot be promised gives a clear error."""

import json
import re

import numpy as np
import pytest

from rle_splat.accuracy.metrics import LEVEL


@pytest.mark.parametrize("classification", ("pre", "post"))
def test_a_tolerance_is_kept_and_reported(call, raw, raw_options, function_file, tmp_path, classification):
    words = (
        "render", raw, *raw_options, "--transfer-function", function_file, "--size", "40", "--azimuth", "30",
        "--elevation", "20", "--classification", classification,
    )  # fmt: skip
    pictures, reports = {}, {}
    for tolerance in ("8", "0.5"):
        picture, report = tmp_path / f"{tolerance}.npy", tmp_path / f"{tolerance}.json"
        result = call(*words, "--tolerance", tolerance, "--probes", "300", "-o", picture, "--json", report)
        assert result.code == 0, result
        said = r"predicted [\d.]+, measured [\d.]+ on \d+ sample pixels, \d+ ms \(planned and measured in [\d.]+ s\)\."
        assert re.search(r"^Error in 8-bit steps against the reference: " + said, result.out, re.MULTILINE)
        pictures[tolerance], reports[tolerance] = np.load(picture), json.loads(report.read_text())
    for tolerance, report in reports.items():
        error = report["error"]
        assert error["tolerance"] == float(tolerance) and error["kept"] and error["measured"] <= float(tolerance)
        assert error["truth"] == {"pre": "T1", "post": "T2"}[classification]
        assert report["plan"]["name"].startswith(classification)
    apart = np.abs(pictures["8"] - pictures["0.5"]).max() / LEVEL
    assert reports["8"]["plan"]["name"] != reports["0.5"]["plan"]["name"] and 0.0 < apart <= 8.5


def test_a_prediction_alone(call, raw, raw_options, tmp_path):
    words = ("render", raw, *raw_options, "--size", "24", "--tolerance", "8", "--probes", "0", "-o", tmp_path / "x.npy")
    result = call(*words)
    assert result.code == 0 and "was not measured" in result.out and " sample pixels" not in result.out
    assert re.search(r"the reference: predicted [\d.]+, \d+ ms \(planned in [\d.]+ s\)\.", result.out)


def test_what_cannot_be_promised_is_refused(refused, call, raw, raw_options, tmp_path):
    words = ("render", raw, *raw_options, "--size", "24", "-o", tmp_path / "x.npy", "--tolerance", "1")
    assert "--tolerance chooses what --quality sets" in refused(*words, "--quality", "fine")
    encoded = tmp_path / "ball.rle"
    assert call("encode", raw, *raw_options, "-o", encoded).code == 0
    assert "voxels" in refused("render", encoded, "-o", tmp_path / "x.npy", "--tolerance", "1")
