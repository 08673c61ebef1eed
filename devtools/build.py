"""The extension zips, packaged and validated by Blender's own tool.

The zip is made from a staged copy that holds only what is wanted: the tool packs every file of the folder that
it is given.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tomllib
import zipfile
from pathlib import Path

from .environments import BPY, CORE, any_bpy, ensure, ensure_bpy
from .places import BUILD, DIST, PYTHONS, ROOT, Failure, clean_environ, executable, say
from .wheels import TAG_PATTERNS, wheels_for

MANIFEST = ROOT / "blender_manifest.toml"
SHIPPED_FILES = ("__init__.py", "LICENSE")
SHIPPED_FOLDERS = ("rle_splat", "bridge", "operators", "panels")
# The comparison methods are for the command line of a clone; the extension does without them.
NOT_SHIPPED = ("rle_splat/comparison", "rle_splat/cli/compare.py")
SHIPPED_SUFFIXES = (".py", ".json", ".svg", ".png")

# The Extensions platform refuses larger files; and nobody likes to wait.
LARGEST_ZIP_BYTES = 200 * 1000 * 1000

# Inside Blender's scripts folder: its packaging tool, and the tags that the Extensions platform knows.
TOOL = "addons_core/bl_pkg/cli/blender_ext.py"
TAGS = "modules/_bpy_internal/extensions/tags.py"


def shipped() -> list[Path]:
    """Every file that goes into the zip, relative to the root, but for the manifest and the wheels."""
    found = [Path(name) for name in SHIPPED_FILES if (ROOT / name).is_file()]
    for folder in SHIPPED_FOLDERS:
        found += [
            path.relative_to(ROOT)
            for path in sorted((ROOT / folder).rglob("*"))
            if path.is_file() and path.suffix in SHIPPED_SUFFIXES and "__pycache__" not in path.parts
        ]
    return [path for path in found if not any(path.is_relative_to(excluded) for excluded in NOT_SHIPPED)]


def version() -> str:
    return tomllib.loads(MANIFEST.read_text(encoding="utf-8"))["version"]


def filled_manifest(platforms, wheel_names) -> str:
    """The manifest's text with its platforms and wheels, in place of the comment that announces them."""
    lines = ["platforms = [" + ", ".join(f'"{name}"' for name in platforms) + "]", "wheels = ["]
    lines += [f'    "./wheels/{name}",' for name in wheel_names] + ["]"]
    text, count = re.subn(
        r"^# dev\.py build adds.*$", lambda _: "\n".join(lines), MANIFEST.read_text(encoding="utf-8"), flags=re.M
    )
    if count != 1:
        raise Failure("blender_manifest.toml has lost the comment line 'dev.py build adds' where the wheels go.")
    return text


def blender_script(name: str) -> Path:
    """A file of Blender's own scripts folder, out of a bpy environment; TOOL is plain Python."""
    version = any_bpy()
    ensure_bpy(version)
    found = next((BPY[version].folder / ("Lib" if os.name == "nt" else "lib")).glob(f"**/scripts/{name}"), None)
    if found is None:
        raise Failure(f"bpy {version} has no {name}, which packaging needs.")
    return found


def _tool(*arguments) -> str:
    """Run Blender's packaging tool; returns what it printed."""
    command = [str(executable(CORE.folder)), str(blender_script(TOOL)), *map(str, arguments)]
    done = subprocess.run(command, env=clean_environ(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode != 0:
        say(done.stdout)
        raise Failure(f"Blender's tool refused to {arguments[0]} the extension; its words are above.")
    return done.stdout


def validate(path: Path) -> None:
    """Blender's own check of a zip or a folder, tags included."""
    _tool("validate", path, "--valid-tags", blender_script(TAGS))


def stage(platforms, wheels, folder: Path) -> None:
    """Copy what is shipped into ``folder``, with the manifest filled in; wheels are linked where that works."""
    if folder.exists():
        shutil.rmtree(folder)
    for path in shipped():
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / path, target)
    (folder / "wheels").mkdir()
    for wheel in wheels:
        try:
            os.link(wheel, folder / "wheels" / wheel.name)
        except OSError:
            shutil.copyfile(wheel, folder / "wheels" / wheel.name)
    manifest = filled_manifest(platforms, [wheel.name for wheel in wheels])
    (folder / "blender_manifest.toml").write_text(manifest, encoding="utf-8")


def unwanted(path: Path) -> list[str]:
    """Members of a zip that have no business there."""
    allowed = {part.as_posix() for part in shipped()} | {"blender_manifest.toml"}
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if not name.endswith("/")]
    return [name for name in names if name not in allowed and not re.fullmatch(r"wheels/[\w.+-]+\.whl", name)]


def build(platforms=tuple(TAG_PATTERNS), pythons=PYTHONS, output: Path = DIST) -> dict[str, Path]:
    """One validated zip for each platform; returns platform -> zip."""
    ensure(CORE)
    tool_output = BUILD / "zips"
    shutil.rmtree(tool_output, ignore_errors=True)
    tool_output.mkdir(parents=True)
    folder = BUILD / "extension"
    stage(platforms, wheels_for(CORE.python, platforms, pythons), folder)
    _tool("build", "--source-dir", folder, "--output-dir", tool_output, "--split-platforms")
    output.mkdir(parents=True, exist_ok=True)
    made = {}
    for where in platforms:
        built = tool_output / f"rle_splat-{version()}-{where.replace('-', '_')}.zip"
        if not built.is_file():
            raise Failure(f"Blender's tool made no {built.name}.")
        validate(built)
        size = built.stat().st_size
        if size >= LARGEST_ZIP_BYTES:
            raise Failure(f"{built.name} has {size / 1e6:.0f} MB; {LARGEST_ZIP_BYTES / 1e6:.0f} MB is the most.")
        if unwanted(built):
            raise Failure(f"{built.name} holds files that do not belong there: {', '.join(unwanted(built)[:5])}.")
        made[where] = output / built.name
        os.replace(built, made[where])
        say(f"{made[where].relative_to(ROOT)}: {size / 1e6:.1f} MB, validated")
    shutil.rmtree(folder)
    return made
