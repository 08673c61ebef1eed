"""The licenses of the packages in the extension's zip: their texts, taken from the wheels, and the table of them."""

from __future__ import annotations

import json
import re
import zipfile
from pathlib import Path

from .places import ROOT, Failure

BUNDLED = ROOT / "bridge" / "data" / "bundled.json"
TEXT = re.compile(r"[^/]+\.dist-info/(?:licenses/)?(?P<name>(?:LICEN[CS]E|COPYING|NOTICE)[^/]*)")
FOLDER = "licenses"  # in the zip
ELSEWHERE = ("edt",)  # wheels without a text: LGPL-3.0, whose text comes with connected-components-3d


def bundled() -> list[dict]:
    """Name, license and home page of each package, and of the font, as in bridge/data/bundled.json."""
    return json.loads(BUNDLED.read_text(encoding="utf-8"))


def license_texts(wheels) -> dict[str, bytes]:
    """Name in the zip -> text, of the licenses in some wheels; a Failure names a wheel without any."""
    found: dict[str, bytes] = {}
    for wheel in wheels:
        package = Path(wheel).name.split("-")[0]
        with zipfile.ZipFile(wheel) as archive:
            names = [name for name in archive.namelist() if TEXT.fullmatch(name)]
            if not names and package not in ELSEWHERE:
                raise Failure(f"{Path(wheel).name} holds no text of its license; add it to the zip by hand.")
            for name in names:
                found.setdefault(f"{FOLDER}/{package}-{TEXT.fullmatch(name)['name']}", archive.read(name))
    return found
