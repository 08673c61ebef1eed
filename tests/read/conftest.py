"""The folder of real scans, where it is there."""

import os
from pathlib import Path

import pytest


@pytest.fixture
def data():
    """The folder that RLE_SPLAT_DATA names."""
    folder = Path(os.environ.get("RLE_SPLAT_DATA") or "/nowhere")
    if not folder.is_dir():
        pytest.skip("RLE_SPLAT_DATA names no folder of real scans")
    return folder
