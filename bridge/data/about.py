"""What the extension says about itself: purpose, license, and the packages that its zip brings."""

from __future__ import annotations

import json
from pathlib import Path

NOT_FOR_DIAGNOSIS = (
    "RLE Splat makes pictures for illustration and research. It is not a medical device and not for diagnosis"
)
LICENSE = "GPL-3.0-or-later. The texts of all licenses are in the folder licenses of the extension"
BUNDLED = Path(__file__).with_name("bundled.json")


def bundled() -> tuple[tuple[str, str], ...]:
    """(name, license) of each package in the zip."""
    return tuple((one["name"], one["license"]) for one in json.loads(BUNDLED.read_text(encoding="utf-8")))
