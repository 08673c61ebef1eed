"""Small volumes on disk, and the command line called in this process."""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rle_splat.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
SHAPE_XYZ = (20, 16, 12)


def ball(shape_xyz=SHAPE_XYZ) -> np.ndarray:
    """(nz, ny, nx) uint8: a soft ball, off the middle so that mirrored pictures differ."""
    nx, ny, nz = shape_xyz
    z, y, x = np.mgrid[:nz, :ny, :nx]
    radius = np.sqrt((x - 0.4 * nx) ** 2 + (y - 0.5 * ny) ** 2 + (z - 0.6 * nz) ** 2)
    return np.clip(255.0 * (1.3 - radius / (0.3 * min(shape_xyz))), 0, 255).astype(np.uint8)


@pytest.fixture
def shape_xyz() -> tuple:
    return SHAPE_XYZ


@pytest.fixture
def voxels() -> np.ndarray:
    return ball()


@pytest.fixture
def raw(tmp_path) -> Path:
    """A ball as raw voxels, in a folder that holds nothing else."""
    folder = tmp_path / "data"
    folder.mkdir()
    path = folder / "ball.raw"
    ball().tofile(path)
    return path


@pytest.fixture
def raw_options() -> list[str]:
    return ["--shape", *map(str, SHAPE_XYZ), "--dtype", "uint8"]


@pytest.fixture
def call(capsys):
    """``call("info", path)`` -> code, out, err of one command line."""

    def run(*words):
        code = main([str(word) for word in words])
        captured = capsys.readouterr()
        return SimpleNamespace(code=code, out=captured.out, err=captured.err)

    return run


@pytest.fixture
def refused(call):
    """Check the error policy on one command line and return its sentence."""

    def run(*words, code=2):
        result = call(*words)
        assert result.code == code, result
        assert result.err.count("\n") == 1 and result.err.endswith(".\n"), result.err
        assert "Traceback" not in result.err
        return result.err.strip()

    return run


@pytest.fixture
def write_json(tmp_path):
    """Write an object to a new JSON file and return its path."""

    def write(content, name="input.json") -> Path:
        path = tmp_path / name
        path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
        return path

    return write


@pytest.fixture
def function_file(write_json):
    """A transfer function whose color changes with the value, shaded."""
    content = {
        "name": "test", "unit": None, "opacity": [[20, 0.0], [200, 0.6]],
        "color": [[0, 1.0, 0.2, 0.1], [255, 0.1, 0.4, 1.0]],
        "shade": {"ambient": 0.3, "diffuse": 0.7, "specular": 0.2, "shininess": 10},
    }  # fmt: skip
    return write_json(content, "function.json")


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real scans; tests that need it are skipped where it is absent."""
    folder = Path(os.environ.get("RLE_SPLAT_DATA") or ROOT / "../shared/data")
    if not folder.is_dir():
        pytest.skip(f"the real scans are not at {folder}; set RLE_SPLAT_DATA to their folder")
    return folder
