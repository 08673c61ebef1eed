"""dev.py release: a folder with all that a release consists of, in dist/.

The zips with their checksums, what CHANGELOG.md has on this version, and the text and pictures for the Extensions
platform.
"""

from __future__ import annotations

import hashlib
import re
import shutil
from pathlib import Path

from .build import build, version
from .places import DIST, ROOT, Failure, say

CHANGELOG = ROOT / "CHANGELOG.md"
LISTING = ROOT / "devtools" / "listing.md"
PICTURES = tuple(f"gallery-{name}.jpg" for name in ("skull", "window", "heart"))
CHECKSUMS = "SHA256SUMS"


def checksum_lines(files) -> str:
    """The lines that ``sha256sum --check`` takes, for files in one folder."""
    return "".join(f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in sorted(files))


def changelog() -> str:
    """What CHANGELOG.md says of this version; a Failure if it says nothing."""
    text = CHANGELOG.read_text(encoding="utf-8")
    found = re.search(rf"^## {re.escape(version())} - [\d-]+\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    if not found:
        raise Failure(f"CHANGELOG.md has no section for version {version()}: give what is under Unreleased this name.")
    return f"# RLE Splat {version()}\n{found[1].rstrip()}\n"


def release(output: Path | None = None, make_zips=build) -> Path:
    """Make the folder; returns it.  ``make_zips``: as ``build``."""
    folder = output or DIST / f"release-{version()}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    zips = list(make_zips(output=folder).values())
    (folder / CHECKSUMS).write_text(checksum_lines(zips), encoding="utf-8")
    (folder / CHANGELOG.name).write_text(changelog(), encoding="utf-8")
    listing = folder / "listing"
    listing.mkdir()
    shutil.copyfile(LISTING, listing / LISTING.name)
    for name in PICTURES:
        shutil.copyfile(ROOT / "docs" / "images" / name, listing / name)
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        say(f"{file.relative_to(folder).as_posix()}: {file.stat().st_size / 1e6:.3f} MB")
    say(f"The release is in {folder.relative_to(ROOT) if folder.is_relative_to(ROOT) else folder.name}.")
    return folder
