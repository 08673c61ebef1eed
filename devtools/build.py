"""The extension zips: packed here, and validated by Blender's own tool where one is at hand.

The tool is a script inside Blender's Python module, of 374 MB packed: too much to install for packing files.
"dev.py test" installs the module anyway, and validates the zip with the tool of each version of Blender.
"""

from __future__ import annotations

import os
import re
import zipfile
from pathlib import Path

from .environments import BPY, Environment
from .kernels import is_made, made_under_wine, make_kernels
from .licenses import license_texts
from .places import BLENDERS, DIST, PYTHONS, ROOT, Failure, run_quietly, say
from .wheels import TAG_PATTERNS, this_platform, wheels_for

MANIFEST = ROOT / "blender_manifest.toml"
SHIPPED_FILES = ("__init__.py", "LICENSE")
SHIPPED_FOLDERS = ("rle_splat", "bridge", "operators", "panels")
# The comparison methods and clusters are for the command line; the extension does without them.
NOT_SHIPPED = (
    "rle_splat/comparison", "rle_splat/cli/compare.py", "rle_splat/cli/cluster.py", "rle_splat/cli/cluster_worker.py",
)  # fmt: skip
SHIPPED_SUFFIXES = (".py", ".pyi", ".json", ".svg", ".png", ".txt")

# The Extensions platform refuses larger files; and nobody likes to wait.
LARGEST_ZIP_BYTES = 110 * 1000 * 1000

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
    """The extension's version, from its manifest; by a pattern, because Python 3.10 has no reader of TOML."""
    found = re.search(r'^version = "([\w.]+)"$', MANIFEST.read_text(encoding="utf-8"), re.MULTILINE)
    if not found:
        raise Failure('blender_manifest.toml has no line such as version = "1.2.3".')
    return found[1]


def _newest(python: str) -> str:
    """The first Blender that has another Python, or "" where none is known."""
    return BLENDERS.get(python, ("", ""))[1]


def filled_manifest(platform: str, python: str, wheel_names) -> str:
    """The manifest's text with its platform, the Blenders that have this Python, and its wheels."""
    text = MANIFEST.read_text(encoding="utf-8")
    if python in BLENDERS:  # a Blender that a distribution builds may have any other
        text = re.sub(r"^(blender_version_min) = .*$", rf'\1 = "{BLENDERS[python][0]}"', text, flags=re.M)
    lines = [f'blender_version_max = "{_newest(python)}"'] if _newest(python) else []
    lines += [f'platforms = ["{platform}"]', "wheels = ["]
    lines += [f'    "./wheels/{name}",' for name in wheel_names] + ["]"]
    text, count = re.subn(r"^# dev\.py build adds.*$", lambda _: "\n".join(lines), text, flags=re.M)
    if count != 1:
        raise Failure("blender_manifest.toml has lost the comment line 'dev.py build adds' where the wheels go.")
    return text


def pack(platform: str, python: str, wheels, path: Path, kernels=()) -> None:
    """Write the extension's zip for a platform and a Python, with wheels and files of kernels; ``path`` appears only
    when it is complete."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".part")
    with zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        archive.writestr("blender_manifest.toml", filled_manifest(platform, python, [wheel.name for wheel in wheels]))
        for file in shipped():
            archive.write(ROOT / file, file.as_posix())
        for name, text in license_texts(wheels).items():
            archive.writestr(name, text)
        for file in kernels:  # compressed already, as wheels are
            archive.write(file, f"rle_splat/kernels/{file.name}", zipfile.ZIP_STORED)
        for wheel in wheels:
            archive.write(wheel, f"wheels/{wheel.name}", zipfile.ZIP_STORED)
    os.replace(partial, path)


def _tool_of(environment: Environment) -> tuple[Path, Path] | None:
    """Blender's packaging tool and its list of tags in a bpy environment, or None where they are not."""
    libraries = environment.folder / ("Lib" if os.name == "nt" else "lib/python*") / "site-packages/bpy/*/scripts"
    pattern = libraries.relative_to(ROOT).as_posix()
    found = [next(ROOT.glob(f"{pattern}/{name}"), None) for name in (TOOL, TAGS)]
    return None if None in found else (found[0], found[1])


def _validate(path: Path) -> str:
    """Run Blender's own check of a zip where a bpy environment is there; returns what was done."""
    version, tool = next(((v, tool) for v, e in reversed(BPY.items()) if (tool := _tool_of(e))), (None, None))
    if tool is None:
        return "to be validated by dev.py test"
    command = [BPY[version].python, tool[0], "validate", path, "--valid-tags", tool[1]]
    run_quietly(command, f"The tool of Blender {version} refused {path.name}; its words are above.")
    return f"validated by the tool of Blender {version}"


def zip_name(platform: str, python: str) -> str:
    """The name of the zip for a platform and a Python, which says what Blender it is for."""
    oldest = BLENDERS[python][0].rpartition(".")[0] if python in BLENDERS else ""
    where = f"blender{oldest}" if oldest else f"python{python}"
    return f"rle_splat-{version()}-{platform.replace('-', '_')}-{where}.zip"


def _kernels_of_others(platform: str, python: str) -> list[Path]:
    """The kernels that are made here for another platform and a Python."""
    made = made_under_wine(python)
    return [made] if platform == "windows-x64" and is_made(made) else []


def build(
    platforms=tuple(TAG_PATTERNS), pythons=PYTHONS, output: Path = DIST, find_kernels=make_kernels
) -> dict[tuple[str, str], Path]:
    """Make one zip for each platform and Python; returns (platform, Python) -> zip.

    Those of this platform bring the kernels that ``find_kernels`` finds for a list of Pythons, and those of Windows the
    ones that ``dev.py kernels --windows`` has made of these sources.  With the others, kernels are compiled when they
    are first needed.
    """
    made = {}
    for platform in platforms:
        for python in pythons:
            path = output / zip_name(platform, python)
            kernels = find_kernels([python]) if platform == this_platform() else _kernels_of_others(platform, python)
            pack(platform, python, wheels_for([platform], [python]), path, kernels)
            size = path.stat().st_size
            if size >= LARGEST_ZIP_BYTES:
                raise Failure(f"{path.name} has {size / 1e6:.0f} MB; {LARGEST_ZIP_BYTES / 1e6:.0f} MB is the most.")
            without = "" if kernels else ", without compiled code"
            say(f"{path.relative_to(ROOT)}: {size / 1e6:.1f} MB{without}, {_validate(path)}")
            made[platform, python] = path
    return made


def build_here(python: str, output: Path, find_kernels=make_kernels) -> Path:
    """The zip for this platform and a Python, to be tried here."""
    return build((this_platform(),), (python,), output, find_kernels)[this_platform(), python]
