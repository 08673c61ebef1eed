"""A real Blender executable: found, or set up from the distribution's own packages in a folder of this clone.

Set up, it lives in a small system of its own, because only Debian's newest suite has a Blender that is new enough.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from .places import ENVIRONMENTS, Failure, clean_environ, say
from .small_system import INSIDE, SmallSystem
from .system_libraries import can_apt

OLDEST = (4, 5)
IDENTIFY_SECONDS = 1800  # a Blender that says nothing for so long hangs

# Blender; what its extensions need; openvdb; OpenGL and Vulkan in software; a virtual screen, a mouse and a camera for
# it.
PACKAGES = (
    "blender", "python3-numpy", "python3-requests", "python3-cattr", "python3-openvdb",
    "libgl1-mesa-dri", "libegl1", "mesa-vulkan-drivers", "xvfb", "xdotool", "imagemagick", "fonts-dejavu-core",
)  # fmt: skip

SYSTEM = SmallSystem("sid", ENVIRONMENTS / "blender-sid", PACKAGES, "Debian sid's Blender", "1.3 GB")


@dataclass(frozen=True)
class Blender:
    """``command``: what to put before Blender's arguments; ``root``: the folder that it sees as "/", if not "/"."""

    command: tuple[str, ...]
    version: tuple[int, int]
    python: str
    label: str
    root: Path | None = None

    def inside(self, path: Path) -> str:
        """A path of this machine as Blender sees it."""
        return str(path) if self.root is None else "/" + path.relative_to(self.root).as_posix()


def _identify(command, label: str, environ, root: Path | None = None) -> Blender:
    """Ask a Blender for its version and its Python's."""
    ask = "import sys, bpy; print('VERSIONS %d.%d %d.%d' % (bpy.app.version[:2] + sys.version_info[:2]))"
    try:
        answer = subprocess.run(
            [*command, "--background", "--factory-startup", "--python-expr", ask],
            capture_output=True, text=True, timeout=IDENTIFY_SECONDS, env=environ,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as problem:
        raise Failure(f"{label} does not run: {problem}.") from None
    found = re.search(r"VERSIONS (\d+)\.(\d+) ([\d.]+)", answer.stdout)
    if not found:
        raise Failure(f"{label} does not run: {(answer.stderr or answer.stdout).strip()[-200:]}")
    version = (int(found[1]), int(found[2]))
    if version < OLDEST:
        raise Failure(f"{label} is {version[0]}.{version[1]}, older than {OLDEST[0]}.{OLDEST[1]}.")
    return Blender(tuple(command), version, found[3], label, root)


def environ_for(blender: Blender, **extra: str) -> dict[str, str]:
    """The environment that a Blender is run with."""
    minutes = {name: os.environ[name] for name in ("RLE_SPLAT_TOUR",) if name in os.environ}
    return {**INSIDE, **minutes, **extra} if blender.root else clean_environ(**extra)


@cache
def find_blender() -> Blender:
    """$BLENDER, else ``blender`` on PATH, else the one that was set up here; a Failure says why none."""
    if os.environ.get("BLENDER"):
        return _identify([os.environ["BLENDER"]], "$BLENDER", clean_environ())
    remarks = []
    if shutil.which("blender"):
        try:
            return _identify([shutil.which("blender")], "blender on PATH", clean_environ())
        except Failure as problem:
            remarks.append(str(problem))
    if SYSTEM.stamp.is_file() and can_apt():
        return _identify(SYSTEM.command("blender"), "Debian sid's blender", INSIDE, SYSTEM.folder)
    remarks.append("no blender in $BLENDER, on PATH or set up by 'python3 dev.py blender'")
    raise Failure("; ".join(remarks))


def ensure_blender() -> Blender:
    """The user's own Blender; where there is none and nobody has to be asked, the one of ``set_up``."""
    own = os.environ.get("BLENDER") or shutil.which("blender")
    return find_blender() if own or not can_apt() else set_up()


def set_up() -> Blender:
    """Make the small system with Debian's Blender in it (1.3 GB, one to three minutes); root on Debian only."""
    if not can_apt():
        raise Failure(
            "dev.py blender needs root and apt-get; elsewhere install Blender 4.5 or newer yourself and put it "
            "on PATH or into $BLENDER."
        )
    SYSTEM.set_up()
    blender = find_blender()
    say(f"{blender.label}: {blender.version[0]}.{blender.version[1]}, Python {blender.python}")
    return blender
