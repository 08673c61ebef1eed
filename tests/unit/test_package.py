"""The package: manifest, requirements, wheels and the zip, judged by Blender's own tool where it is at hand."""

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from devtools import build, environments, lock, places, pythons, wheels

ROOT = Path(__file__).resolve().parents[2]
REQUIREMENTS = sorted((ROOT / "requirements").glob("*.txt"))


def manifest():
    return tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))


def tool(name):
    """A file of Blender's scripts folder in any bpy environment of this clone; skips when there is none."""
    found = sorted((ROOT / ".venvs").glob(f"bpy-*/[lL]ib*/**/scripts/{name}"))
    if not found:
        pytest.skip("no bpy environment in this clone yet, so no packaging tool of Blender's")
    return found[-1]


def validate(path):
    command = [sys.executable, tool(build.TOOL), "validate", path, "--valid-tags", tool(build.TAGS)]
    return subprocess.run(list(map(str, command)), capture_output=True, text=True)


@pytest.fixture
def staged(tmp_path):
    """The folder that Blender's tool packs, for one platform, with stand-ins for the wheels."""
    fakes = []
    for package, version in wheels.packages().items():
        for python in ("cp311", "cp313"):
            fake = tmp_path / f"{package}-{version}-{python}-{python}-manylinux_2_28_x86_64.whl"
            fake.write_bytes(b"")
            fakes.append(fake)
    build.stage(("linux-x64",), fakes, tmp_path / "extension")
    return tmp_path / "extension"


def test_blenders_tool_accepts_the_manifest(staged):
    answer = validate(staged)
    assert answer.returncode == 0, answer.stdout + answer.stderr


@pytest.mark.parametrize(
    ("good", "bad"),
    [("\"Camera\"", "\"Medical\""), ("kernel cache\"", "kernel cache.\""), ("version = \"0", "version = \"x")],
)  # fmt: skip
def test_blenders_tool_would_refuse_a_bad_manifest(staged, good, bad):
    path = staged / "blender_manifest.toml"
    text = path.read_text(encoding="utf-8")
    assert good in text
    path.write_text(text.replace(good, bad), encoding="utf-8")
    assert validate(staged).returncode != 0


def test_the_manifest_is_what_was_promised():
    facts = manifest()
    assert facts["id"] == "rle_splat"
    assert facts["blender_version_min"] == "4.5.0"
    assert facts["license"] == ["SPDX:GPL-3.0-or-later"]
    assert list(facts["permissions"]) == ["files"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["version"] == facts["version"]
    assert project["scripts"]["rle-splat"] == "rle_splat.cli.main:run_process"


def test_the_manifest_packs_nothing_but_what_is_shipped(staged, tmp_path):
    """Packed by Blender's tool from the staged folder, and from the whole clone as a user might: no tests, no tools."""
    for source in (staged, ROOT):
        out = tmp_path / f"packed_{source.name}"
        out.mkdir()
        command = [sys.executable, tool(build.TOOL), "build", "--source-dir", source, "--output-dir", out]
        answer = subprocess.run(list(map(str, command)), capture_output=True, text=True)
        assert answer.returncode == 0, answer.stdout + answer.stderr
        made = next(out.glob("*.zip"))
        allowed = {"README.md", "LICENSE"}
        assert [name for name in build.unwanted(made) if name not in allowed] == []
        with zipfile.ZipFile(made) as archive:
            assert {"__init__.py", "blender_manifest.toml", "rle_splat/scene/scene.py"} <= set(archive.namelist())


def test_a_zip_with_strangers_is_noticed(tmp_path):
    with zipfile.ZipFile(tmp_path / "x.zip", "w") as archive:
        for name in ("__init__.py", "tests/unit/test_house.py", ".git/config", "wheels/numba.whl", "wheels/notes.txt"):
            archive.writestr(name, "")
    assert build.unwanted(tmp_path / "x.zip") == ["tests/unit/test_house.py", ".git/config", "wheels/notes.txt"]


def test_presets_and_licence_are_shipped():
    names = {path.as_posix() for path in build.shipped()}
    presets = {path.relative_to(ROOT).as_posix() for path in (ROOT / "rle_splat").rglob("presets/*.json")}
    assert presets and presets <= names
    assert {"LICENSE", "__init__.py"} <= names
    assert not any("__pycache__" in name or name.startswith(("tests", "devtools")) for name in names)


def test_the_comparison_methods_are_not_shipped():
    names = {path.as_posix() for path in build.shipped()}
    assert not any(name.startswith("rle_splat/comparison/") or name == "rle_splat/cli/compare.py" for name in names)
    assert (ROOT / "rle_splat/comparison/compare.py").is_file() and "rle_splat/cli/main.py" in names


def test_the_command_line_of_what_is_shipped_has_all_commands_but_compare(staged):
    def run(*words):
        command = [sys.executable, "-m", "rle_splat", *words]
        return subprocess.run(command, cwd=staged, capture_output=True, text=True)

    answer = run("--help")
    assert answer.returncode == 0 and "accuracy" in answer.stdout and "compare" not in answer.stdout, answer.stderr
    answer = run("compare")
    assert answer.returncode == 2 and "There is no command 'compare'; choose render, info" in answer.stderr
    for name in ("render", "info", "encode", "convert", "accuracy"):
        assert run(name, "--help").returncode == 0


def test_missing_wheels_are_named():
    """llvmlite without numba of the same Python installs in Blender without a word and fails at import."""
    complete = [
        f"{package}-{version}-{python}-{python}-{tag}.whl"
        for package, version in wheels.packages().items()
        for python in ("cp311", "cp313")
        for tag in ("manylinux_2_27_x86_64.manylinux_2_28_x86_64", "win_amd64", "macosx_12_0_arm64")
    ]
    assert wheels.missing(complete, wheels.TAG_PATTERNS) == []
    for name in complete:
        gaps = wheels.missing([other for other in complete if other != name], wheels.TAG_PATTERNS)
        assert len(gaps) == 1 and name.split("-")[0] in gaps[0]
    older = [name.replace("numba-0.68.1", "numba-0.64.0") for name in complete]
    assert len(wheels.missing(older, wheels.TAG_PATTERNS)) == 6


@pytest.mark.parametrize("where", wheels.TAG_PATTERNS)
def test_every_wheel_is_pinned_for_every_platform_and_python(where):
    """Three Pythons on three platforms: nine hashes for each package in requirements/wheels.txt."""
    text = wheels.WHEEL_PINS.read_text()
    assert set(wheels.packages()) == {"numba", "llvmlite"}
    assert text.count("--hash=sha256:") == 2 * 9
    assert where in text.splitlines()[0]


@pytest.mark.parametrize("path", REQUIREMENTS, ids=lambda path: path.name)
def test_requirements_are_pinned_with_hashes_and_name_no_host(path):
    text = path.read_text()
    logical = text.replace("\\\n", " ").splitlines()[1:]
    assert logical
    for line in logical:
        assert re.match(r"^[a-z0-9][a-z0-9._-]*==[\w.]+(; [^-]+)?( +--hash=sha256:[0-9a-f]{64})+$", line), line
    assert not re.search(r"://|index[-_]url|find[-_]links|trusted-host|\.(org|com|io|net)\b", text)


def test_every_environment_has_its_requirements_and_every_lock_its_file():
    wanted = {
        name for environment in (environments.CORE, environments.SAMPLE, *environments.BPY.values())
        for name in environment.files
    }  # fmt: skip
    assert wanted <= {path.name for path in REQUIREMENTS}
    assert {f"{name}.txt" for name in lock.LOCKS} == {path.name for path in REQUIREMENTS}


def test_numba_is_the_same_everywhere():
    """The wheels in the zip, the command line's environment and each bpy's hold one numba and one llvmlite."""
    for package, version in wheels.packages().items():
        for path in REQUIREMENTS:
            found = re.search(rf"^{package}==(\S+)", path.read_text(), re.MULTILINE)
            assert found is None or found[1] == version, path.name


def test_the_stamp_follows_every_byte_of_the_requirements(tmp_path, monkeypatch):
    monkeypatch.setattr(environments, "REQUIREMENTS", tmp_path)
    for name in environments.CORE.files:
        (tmp_path / name).write_text("numpy==2.4.6\n")
    before = environments.CORE.digest("3.11")
    assert environments.CORE.digest("3.13") != before
    (tmp_path / "test.txt").write_text("pytest==9.2.1\n")
    assert environments.CORE.digest("3.11") != before


def test_a_python_is_recognised_by_running_it(tmp_path):
    """pyenv's shims are on PATH and still fail; a file that is no Python must not be taken for one."""
    assert pythons.works_as(sys.executable, places.running_python())
    assert not pythons.works_as(sys.executable, "3.9")
    shim = tmp_path / "python3.13"
    shim.write_text("#!/bin/sh\necho 'not installed' >&2\nexit 127\n")
    shim.chmod(0o755)
    assert not pythons.works_as(shim, "3.13")
    assert not pythons.works_as(tmp_path / "absent", "3.13")


def test_dev_py_can_be_read_by_a_much_older_python():
    """So that it can say which Python it needs: no syntax newer than 3.0 before that sentence."""
    import ast

    ast.parse((ROOT / "dev.py").read_text(), feature_version=(3, 4))
    assert "from __future__ import annotations" not in (ROOT / "dev.py").read_text()
