"""A real Blender executable: found, or set up from the distribution's own packages in a folder of this clone.

Set up, it lives in a small system of its own (debootstrap and chroot), because only Debian's newest suite has a
Blender that is new enough; nothing of the machine's own system is changed.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from .places import ENVIRONMENTS, Failure, clean_environ, run_quietly, say
from .system_libraries import apt_install, can_apt

SUITE = "sid"
CHROOT = ENVIRONMENTS / f"blender-{SUITE}"
STAMP = CHROOT / "ready"
OLDEST = (4, 5)
IDENTIFY_SECONDS = 1800  # a Blender that says nothing for so long hangs

# Blender; what its extensions need; openvdb; OpenGL and Vulkan in software; a virtual screen, a mouse and a camera for
# it.
PACKAGES = (
    "blender", "python3-numpy", "python3-requests", "python3-cattr", "python3-openvdb",
    "libgl1-mesa-dri", "libegl1", "mesa-vulkan-drivers", "xvfb", "xdotool", "imagemagick", "fonts-dejavu-core",
)  # fmt: skip

_READY = f"{SUITE}: {' '.join(PACKAGES)}\n"  # what the stamp says

_INSIDE = {
    "HOME": "/root",  # of the small system, not of this machine
    "PATH": "/usr/sbin:/usr/bin:/sbin:/bin",
    "LANG": "C.UTF-8",
    "DEBIAN_FRONTEND": "noninteractive",
}


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


def _in_chroot(*command: str) -> tuple[str, ...]:
    return ("chroot", str(CHROOT), *command)


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
    return {**_INSIDE, **extra} if blender.root else clean_environ(**extra)


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
    if STAMP.is_file() and can_apt():
        return _identify(_in_chroot("blender"), f"Debian {SUITE}'s blender", _INSIDE, CHROOT)
    remarks.append("no blender in $BLENDER, on PATH or set up by 'python3 dev.py blender'")
    raise Failure("; ".join(remarks))


def ensure_blender() -> Blender:
    """The user's own Blender; where there is none and nobody has to be asked, the one of ``set_up``."""
    own = os.environ.get("BLENDER") or shutil.which("blender")
    return find_blender() if own or not can_apt() else set_up()


def set_up() -> Blender:
    """Make the small system with Debian's Blender in it (1.3 GB, one to three minutes); root on Debian only."""
    if not STAMP.is_file() or STAMP.read_text() != _READY:
        if not can_apt():
            raise Failure(
                "dev.py blender needs root and apt-get; elsewhere install Blender 4.5 or newer yourself and put it "
                "on PATH or into $BLENDER."
            )
        if shutil.which("debootstrap") is None:
            apt_install(["debootstrap"])
        say(f"Setting up Debian {SUITE}'s Blender in {CHROOT.name} (1.3 GB)")
        if (CHROOT / "debootstrap").exists() or not (CHROOT / "usr/bin/apt-get").exists():
            shutil.rmtree(CHROOT, ignore_errors=True)  # half made: debootstrap cannot take it up again
            CHROOT.mkdir(parents=True)
            bootstrap = ["debootstrap", "--variant=minbase", SUITE, CHROOT]
            run_quietly(bootstrap, "debootstrap could not make the small system.")
        settings = CHROOT / "etc"
        (settings / "apt/apt.conf.d/99novaliduntil").write_text('Acquire::Check-Valid-Until "false";\n')
        (settings / "dpkg/dpkg.cfg.d/01nodoc").write_text(
            "".join(f"path-exclude /usr/share/{name}/*\n" for name in ("doc", "man", "locale"))
        )
        for command, sentence in (
            (("apt-get", "update"), "The package lists of the small system could not be fetched."),
            (("apt-get", "install", "-y", "--no-install-recommends", *PACKAGES), "Blender could not be installed."),
            (("apt-get", "clean"), "apt-get clean failed in the small system."),
        ):
            run_quietly(_in_chroot(*command), sentence, env=_INSIDE)
        STAMP.write_text(_READY)
    blender = find_blender()
    say(f"{blender.label}: {blender.version[0]}.{blender.version[1]}, Python {blender.python}")
    return blender
