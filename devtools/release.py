"""dev.py release: a folder with all that a release consists of, in dist/.

The zips with their checksums, the changes since the last tag, and the text and pictures for the Extensions platform.
"""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from pathlib import Path

from .build import build, version
from .places import DIST, ROOT, Failure, say

LISTING = ROOT / "devtools" / "listing.md"
PICTURES = ("panel.png", *(f"gallery-{name}.jpg" for name in ("brain", "plate", "vessels", "engine", "smoke")))
CHECKSUMS = "SHA256SUMS"


def checksum_lines(files) -> str:
    """The lines that ``sha256sum --check`` takes, for files in one folder."""
    return "".join(f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in sorted(files))


def _git(*words: str) -> str:
    """What a command of git prints; a Failure without git or its history."""
    try:
        done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        raise Failure("The list of changes is made from git's history; make a release in a clone, with git.") from None
    return done.stdout.strip()


def changelog() -> str:
    """What has changed since the last tag, a line for each commit, the newest first; without a tag, all of it."""
    earlier = _git("tag", "--list", "--merged", "HEAD", "--sort=-creatordate").split()
    earlier = [tag for tag in earlier if tag.lstrip("v") != version()]
    span = [f"{earlier[0]}..HEAD"] if earlier else ["HEAD"]
    changes = _git("log", "--no-merges", "--format=- %s", *span)
    since = f"since {earlier[0]}" if earlier else "from the beginning"
    return f"# RLE Splat {version()}\n\nChanges {since}:\n\n{changes}\n"


def release(output: Path | None = None, make_zips=build) -> Path:
    """Make the folder; returns it.  ``make_zips``: as ``build``."""
    folder = output or DIST / f"release-{version()}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    zips = list(make_zips(output=folder).values())
    (folder / CHECKSUMS).write_text(checksum_lines(zips), encoding="utf-8")
    (folder / "CHANGELOG.md").write_text(changelog(), encoding="utf-8")
    listing = folder / "listing"
    listing.mkdir()
    shutil.copyfile(LISTING, listing / LISTING.name)
    for name in PICTURES:
        shutil.copyfile(ROOT / "docs" / "images" / name, listing / name)
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        say(f"{file.relative_to(folder).as_posix()}: {file.stat().st_size / 1e6:.3f} MB")
    say(f"The release is in {folder.relative_to(ROOT) if folder.is_relative_to(ROOT) else folder.name}.")
    return folder
