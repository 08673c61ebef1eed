"""The system's shared libraries: what Blender's Python module loads on Linux, and what benchmarks compare us with."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys

from .places import Failure, clean_environ, say

# Shared object -> Debian's and Ubuntu's package.  The first seven are needed to import bpy at all; without
# libEGL the GPU compositor of Blender 5.2 aborts the process; numba's threads want libgomp.
BPY_LIBRARIES = {
    "libX11.so.6": "libx11-6",
    "libXrender.so.1": "libxrender1",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libgomp.so.1": "libgomp1",
}

# What benchmarks can do without, and then say so.
PEER_LIBRARIES = {"libvolpack.so.1": "libvolpack1"}


def _loads(name: str) -> bool:
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


def apt_line(packages) -> str:
    return "apt-get install -y --no-install-recommends " + " ".join(packages)


def can_apt() -> bool:
    """Whether packages can be installed without asking anyone: root, on a system with apt-get."""
    return hasattr(os, "geteuid") and os.geteuid() == 0 and shutil.which("apt-get") is not None


def apt_install(packages) -> None:
    """Install Debian packages, or say which line does it."""
    line = apt_line(packages)
    if not can_apt():
        raise Failure(f"These system packages are missing; install them with:  sudo {line}")
    say(f"Installing system packages: {' '.join(packages)}")
    environ = clean_environ(DEBIAN_FRONTEND="noninteractive")
    for command in (["apt-get", "update"], line.split()):
        done = subprocess.run(command, env=environ, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode != 0:
        say(done.stdout[-2000:])
        raise Failure(f"apt-get could not install the system packages; see above, then run:  {line}")


def ensure_bpy_libraries() -> None:
    """Make sure that what Blender's module loads is there (Linux; other systems bring it)."""
    if not sys.platform.startswith("linux"):
        return
    missing = _missing(BPY_LIBRARIES)
    if missing:
        apt_install(missing)


def try_peer_libraries() -> None:
    """Install the programs that benchmarks compare us with, where that takes nobody's leave; else go without."""
    missing = _missing(PEER_LIBRARIES)
    if missing and can_apt():
        try:
            apt_install(missing)
        except Failure as problem:
            say(f"{problem} Going on without.")


def _missing(libraries) -> list[str]:
    return [package for name, package in libraries.items() if not _loads(name)]
