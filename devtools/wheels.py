"""The wheels that go into the extension: numba and the readers of medical formats, for every platform and Python.

pip downloads them, the one of .venvs/tools: uv installs packages, and has no command that keeps their wheels.
"""

from __future__ import annotations

import platform as machine
import re
import sys
from pathlib import Path

from .places import AGAIN, PYTHONS, REQUIREMENTS, TOOLS, WHEELS, Failure, executable, run_quietly, say

WHEEL_PINS = REQUIREMENTS / "wheels.txt"

# What pip calls the platforms; several tags where a package's wheels carry an older one.
PLATFORMS = {
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux_2_27_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_12_0_arm64", "macosx_11_0_arm64", "macosx_10_13_universal2"),
}

# A Blender platform -> how the platform tag of its wheels looks (blender: linux-x64, PEP 425: manylinux_2_27_x86_64).
TAG_PATTERNS = {
    "linux-x64": re.compile(r"manylinux\w*_x86_64"),
    "windows-x64": re.compile(r"win_amd64"),
    "macos-arm64": re.compile(r"macosx_\d+_\d+_(arm64|universal2)"),
}


def this_platform() -> str:
    """Blender's name of the platform that runs now."""
    name = {"linux": "linux", "win32": "windows", "darwin": "macos"}.get(sys.platform, sys.platform)
    cpu = {"x86_64": "x64", "amd64": "x64", "arm64": "arm64", "aarch64": "arm64"}.get(machine.machine().lower(), "?")
    if f"{name}-{cpu}" not in TAG_PATTERNS:
        raise Failure(f"There is no extension for {name}-{cpu}: its wheels are made for {', '.join(TAG_PATTERNS)}.")
    return f"{name}-{cpu}"


def packages() -> dict[str, str]:
    """Package -> pinned version, from requirements/wheels.txt; names as in the names of wheels."""
    pins = re.findall(r"^([\w.-]+)==([\w.]+)", WHEEL_PINS.read_text(), re.MULTILINE)
    return {name.replace("-", "_"): version for name, version in pins}


def missing(names, platforms, pythons=PYTHONS) -> list[str]:
    """What is not covered by the wheel file names, as "llvmlite 0.50.0 for windows-x64, Python 3.13".

    Blender skips a wheel that does not fit without a word, so an incomplete set installs and fails later.
    """
    have = set()
    for name in names:
        package, version, python, _abi, tag = Path(name).name.removesuffix(".whl").split("-")
        if tag == "any":  # no compiled code: one wheel for every Python and platform
            have |= {(package, version, "cp" + p.replace(".", ""), where) for p in pythons for where in TAG_PATTERNS}
        have |= {(package, version, python, where) for where, tags in TAG_PATTERNS.items() if tags.search(tag)}
    return [
        f"{package} {version} for {where}, Python {python}"
        for package, version in packages().items()
        for where in platforms
        for python in pythons
        if (package, version, "cp" + python.replace(".", ""), where) not in have
    ]


def _download(where: str, python: str, folder: Path) -> None:
    """Download the wheels for a platform and a Python; pip checks them against the hashes of the pins."""
    say(f"Downloading the wheels for {where}, Python {python}")
    command = [executable(TOOLS), "-m", "pip", "--disable-pip-version-check", "--no-input", "download", "--quiet"]
    command += ["--progress-bar", "off", "--require-hashes", "--only-binary=:all:", "--no-deps"]
    command += ["--python-version", python, *(word for tag in PLATFORMS[where] for word in ("--platform", tag))]
    command += ["-r", WHEEL_PINS, "-d", folder]
    run_quietly(command, f"pip could not download the wheels for {where}, Python {python}. {AGAIN}")


def wheels_for(platforms, pythons=PYTHONS) -> list[Path]:
    """The wheel files, each name once, downloaded into build/wheels/ where they are not there yet."""
    chosen: dict[str, Path] = {}
    for where in platforms:
        for python in pythons:
            folder = WHEELS / where / python
            names = [path.name for path in folder.glob("*.whl")]
            if missing(names, [where], [python]):
                _download(where, python, folder)
            pinned = tuple(f"{package}-{version}-" for package, version in packages().items())
            chosen.update((path.name, path) for path in sorted(folder.glob("*.whl")) if path.name.startswith(pinned))
    gaps = missing(chosen, platforms, pythons)
    if gaps:
        raise Failure(f"The set of wheels is incomplete: {'; '.join(gaps)}.")
    return list(chosen.values())
