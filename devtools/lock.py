"""Write requirements/*.txt: exact versions with the hashes of the wheels for every platform that we name.

A maintainer's command.  pip resolves each set for each platform and Python (without installing) and reports
what it chose; only names, versions and hashes are kept, never an address.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

from .environments import BPY, CORE, ensure
from .places import BPY_PYTHON, PYTHONS, REQUIREMENTS, Failure, clean_environ, say
from .pythons import find_python

# What pip calls the platforms; several tags where a package's wheels carry an older one.
PLATFORMS = {
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux_2_27_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_12_0_arm64", "macosx_11_0_arm64", "macosx_10_13_universal2"),
}

NUMBA = ("numba==0.68.1", "llvmlite==0.50.0")
PYTEST = ("pytest==9.2.0", "colorama==0.4.6")

# pip judges "only on Windows" by the machine it runs on, so such a dependency is named and marked here.
ON_LINUX = 'sys_platform == "linux" and platform_machine == "x86_64"'
MARKERS = {"colorama": 'sys_platform == "win32"', "tbb": ON_LINUX, "tcmlib": ON_LINUX}


@dataclass(frozen=True)
class Lock:
    """``pins``: what is asked for; ``pythons`` and ``platforms``: for which; ``alone``: without dependencies."""

    pins: tuple[str, ...]
    pythons: tuple[str, ...] = PYTHONS
    alone: bool = False
    platforms: tuple[str, ...] = tuple(PLATFORMS)


LOCKS = {
    "core": Lock(("numpy==2.4.6", *NUMBA, "pillow==13.0.0", "OpenEXR==3.5.3")),
    "pytest": Lock(PYTEST),  # nothing but pure Python: it is lent to whatever Python a real Blender runs on
    "test": Lock((*PYTEST, "hypothesis==6.170.15", "ruff==0.17.5")),
    "tbb": Lock(("tbb==2023.2.0",), platforms=("linux-x64",)),  # a threading layer of numba, to be tested as others are
    "bench": Lock(
        (
            "numpy==2.4.6",
            *NUMBA,
            "pillow==13.0.0",
            "OpenEXR==3.5.3",
            "vtk==9.7.2",
            "matplotlib==3.11.2",
            "contourpy==1.3.3",
            "flip-evaluator==1.7",
            *PYTEST,  # for the tests of what it alone can load
        )
    ),
    "sample": Lock(("numpy==2.4.6", "nibabel==5.4.2")),
    "sample-data": Lock(("nilearn==0.14.1",), alone=True),
    "wheels": Lock(NUMBA, ("3.11", "3.13", "3.14"), alone=True),
    "bpy-4.5": Lock(("bpy==4.5.15", *NUMBA, *PYTEST), (BPY_PYTHON["4.5"],)),
    "bpy-5.0": Lock(("bpy==5.0.1", *NUMBA, *PYTEST), (BPY_PYTHON["5.0"],)),
    "bpy-5.2": Lock(("bpy==5.2.3", *NUMBA, *PYTEST), (BPY_PYTHON["5.2"],)),
}


def _resolve(python: str, lock: Lock, platform: str, version: str) -> list[tuple[str, str, str]]:
    """What pip would install: (name, version, sha256) of each package."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [python, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed", "--target", folder]
        command += ["--report", str(report), "--only-binary=:all:", "--python-version", version]
        command += [part for tag in PLATFORMS[platform] for part in ("--platform", tag)]
        command += (["--no-deps"] if lock.alone else []) + list(lock.pins)
        done = subprocess.run(command, env=clean_environ(), capture_output=True, text=True)
        if done.returncode != 0:
            raise Failure(f"pip could not resolve {lock.pins} for {platform}, Python {version}: {done.stderr[-500:]}")
        installs = json.loads(report.read_text())["install"]
    return [
        (item["metadata"]["name"].lower().replace("_", "-"), item["metadata"]["version"],
         item["download_info"]["archive_info"]["hashes"]["sha256"])
        for item in installs
    ]  # fmt: skip


def _python_for(version: str) -> str:
    """The Python whose pip resolves for ``version``: pip also holds Requires-Python against itself."""
    if version in PYTHONS:
        environment = CORE if CORE.python.exists() and version == PYTHONS[0] else None
        bpy = next((e for e in BPY.values() if version in e.pythons and e.python.exists()), None)
        if environment or bpy:
            return str((environment or bpy).python)
        return find_python(version) or str(ensure(CORE))
    return str(ensure(CORE))


def lock(names=()) -> None:
    """Write the requirement files of the sets named (all of them when none is)."""
    for name in names or LOCKS:
        wanted = LOCKS[name]
        versions: dict[str, str] = {}
        hashes: dict[str, set[str]] = {}
        for version in wanted.pythons:
            for platform in wanted.platforms:
                for package, number, digest in _resolve(_python_for(version), wanted, platform, version):
                    if versions.setdefault(package, number) != number:
                        raise Failure(f"{package} resolves to {versions[package]} and to {number}; pin it in LOCKS.")
                    hashes.setdefault(package, set()).add(digest)
        platforms, pythons = ", ".join(wanted.platforms), ", ".join(wanted.pythons)
        lines = [f"# {name}: {platforms}; Python {pythons}.  Written by: dev.py lock"]
        for package in sorted(versions):
            marker = f"; {MARKERS[package]}" if package in MARKERS else ""
            entry = [f"{package}=={versions[package]}{marker}"]
            entry += [f"    --hash=sha256:{digest}" for digest in sorted(hashes[package])]
            lines.append(" \\\n".join(entry))
        REQUIREMENTS.mkdir(exist_ok=True)
        (REQUIREMENTS / f"{name}.txt").write_text("\n".join(lines) + "\n")
        say(f"requirements/{name}.txt: {len(versions)} packages")
