"""The package: manifest, requirements, wheels, the zip, and the tools that make them."""

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from types import SimpleNamespace

import pytest
from packaging.requirements import Requirement

from devtools import bootstrap, build, environments, kernels, places, uv, wheels

ROOT = Path(__file__).resolve().parents[2]
REQUIREMENTS = sorted((ROOT / "requirements").glob("*.txt"))
PYTHONS = ("3.9", "3.10", "3.11", "3.12", "3.13", "3.14")  # that dev.py can be started with


def manifest():
    return tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))


def unwanted(path: Path) -> list[str]:
    """Members of a zip that have no business there."""
    known = re.compile(r"wheels/[\w.+-]+\.whl|licenses/[\w.-]+|rle_splat/kernels/[\w.-]+\.zip")
    allowed = {part.as_posix() for part in build.shipped()} | {"blender_manifest.toml"}
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if not name.endswith("/")]
    return [name for name in names if name not in allowed and not known.fullmatch(name)]


@pytest.fixture
def fakes(tmp_path):
    """Stand-ins for the wheels of one platform and Python."""
    made = []
    for package, version in wheels.packages().items():
        made.append(tmp_path / f"{package}-{version}-cp311-cp311-manylinux_2_28_x86_64.whl")
        with zipfile.ZipFile(made[-1], "w") as wheel:
            wheel.writestr(f"{package}-{version}.dist-info/licenses/LICENSE", f"terms of {package}")
    return made


@pytest.mark.parametrize(("python", "blenders"), [
    ("3.11", {"blender_version_min": "4.5.0", "blender_version_max": "5.1.0"}),
    ("3.13", {"blender_version_min": "5.1.0"}), ("3.14", {"blender_version_min": "4.5.0"})])  # fmt: skip
def test_the_zip_holds_what_is_shipped_its_wheels_and_a_manifest_that_names_them(fakes, tmp_path, python, blenders):
    brought = tmp_path / "kernels-of-x.zip"
    brought.write_bytes(b"kernels")
    build.pack("linux-x64", python, fakes, tmp_path / "out" / "x.zip", [brought])
    with zipfile.ZipFile(tmp_path / "out" / "x.zip") as archive:
        facts = tomllib.loads(archive.read("blender_manifest.toml").decode())
        wanted = {file.as_posix(): (ROOT / file).read_bytes() for file in build.shipped()}
        wanted |= {f"wheels/{fake.name}": fake.read_bytes() for fake in fakes}
        wanted["rle_splat/kernels/kernels-of-x.zip"] = b"kernels"
        wanted |= {f"licenses/{package}-LICENSE": f"terms of {package}".encode() for package in wheels.packages()}
        assert {name: archive.read(name) for name in archive.namelist() if name != "blender_manifest.toml"} == wanted
    assert facts["platforms"] == ["linux-x64"]
    assert facts["wheels"] == [f"./wheels/{fake.name}" for fake in fakes]
    assert {key: value for key, value in facts.items() if key not in ("platforms", "wheels")} == manifest() | blenders
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["x.zip"]


def test_kernels_that_are_made_need_no_python(tmp_path, monkeypatch):
    """As those of 3.14, which the Python of a small system has packed: this machine may have none."""
    monkeypatch.setattr(kernels, "FOLDER", tmp_path)
    asked = []
    monkeypatch.setattr(kernels, "_is_ready", asked.append)
    path = tmp_path / kernels.kernel_file("3.14")
    for comment, wanted in ((b"of other sources", []), (kernels.source_digest(), [path])):
        with zipfile.ZipFile(path, "w") as archive:
            archive.comment = comment
        assert kernels.make_kernels(["3.14"]) == wanted
    assert asked == ["3.14"]


@pytest.mark.parametrize(("platform", "level"), kernels.LEVELS.items())
def test_one_python_compiles_kernels_for_the_level_of_their_platform(tmp_path, monkeypatch, platform, level):
    """The other Pythons take what it has compiled."""
    monkeypatch.setattr(kernels, "this_platform", lambda: platform)
    monkeypatch.setattr(kernels, "FOLDER", tmp_path)
    monkeypatch.setattr(kernels, "ROOT", tmp_path)
    monkeypatch.setattr(kernels, "_is_ready", lambda version: True)
    monkeypatch.setattr(kernels, "core_of", lambda version: SimpleNamespace(python=version))

    asked = []

    def compiles(command, sentence, **options):
        assert options["env"]["NUMBA_CPU_NAME"] == level
        asked.append((command[0], *command[5:]))
        Path(command[3]).write_bytes(b"kernels")
        return "1"

    monkeypatch.setattr(kernels, "run_quietly", compiles)
    (tmp_path / "of-another-numba.zip").touch()
    made = kernels.make_kernels(["3.11", "3.13"])
    assert sorted(tmp_path.iterdir()) == made and all(path.stem.endswith(f"-{level}") for path in made)
    assert asked == [("3.13",), ("3.11", made[1])]


def test_each_blender_of_the_tests_takes_one_zip_of_its_python():
    """And no zip fits two Pythons: the first Blender without one is the first with the next."""
    for version, python in places.BPY_PYTHON.items():
        number = tuple(map(int, version.split(".")))
        takes = [
            other for other, (oldest, newer) in places.BLENDERS.items()
            if tuple(map(int, oldest.split("."))) <= (*number, 0)
            and not (newer and (*number, 0) >= tuple(map(int, newer.split("."))))
        ]  # fmt: skip
        assert takes == [python]
    assert build.zip_name("linux-x64", "3.11") == f"rle_splat-{build.version()}-linux_x64-blender4.5.zip"
    assert len({build.zip_name("linux-x64", python) for python in (*places.PYTHONS, "3.14")}) == 3


def test_a_zip_that_blenders_tool_refuses_ends_the_build(tmp_path, monkeypatch):
    tool = tmp_path / "tool.py"
    tool.write_text("import sys; sys.exit('no such tag')")
    monkeypatch.setattr(build, "_tool_of", lambda environment: (tool, tool))
    monkeypatch.setattr(environments.Environment, "python", Path(sys.executable))
    with pytest.raises(places.Failure, match=r"refused x\.zip"):
        build._validate(tmp_path / "x.zip")
    tool.write_text("")
    assert build._validate(tmp_path / "x.zip") == "validated by the tool of Blender 5.3"
    monkeypatch.setattr(build, "_tool_of", lambda environment: None)
    assert "dev.py test" in build._validate(tmp_path / "x.zip")


def test_the_manifest_is_what_was_promised():
    facts = manifest()
    assert facts["id"] == "rle_splat"
    assert facts["blender_version_min"] == "4.5.0"
    assert facts["license"] == ["SPDX:GPL-3.0-or-later"]
    assert list(facts["permissions"]) == ["files"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["scripts"]["rle-splat"] == "rle_splat.cli.main:run_process"


def test_numba_is_pinned_in_the_zip_and_ranged_for_others():
    """Kernels come for one version; any other is used plainly (test_plain_numba.py)."""
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    (numba,) = (found for found in map(Requirement, listed) if found.name == "numba")
    source = (ROOT / "rle_splat" / "runtime" / "numba_internals.py").read_text(encoding="utf-8")
    known = re.findall(r'"([\d.]+)"', re.search(r"^KNOWN_VERSIONS = \((.*)\)$", source, re.MULTILINE)[1])
    assert wheels.packages()["numba"] in known and all(map(numba.specifier.contains, known))
    assert numba.specifier.contains("0.99.0") and not any(map(numba.specifier.contains, ("0.59.0", "1.0.0")))


def test_the_manifest_packs_nothing_but_what_is_shipped(tmp_path):
    """Packed by Blender's tool from the whole clone, as a user might: no tests, no tools."""
    tool = next(filter(None, map(build._tool_of, environments.BPY.values())), None)
    if tool is None:
        pytest.skip("no bpy environment in this clone yet, so no packaging tool of Blender's")
    command = [sys.executable, tool[0], "build", "--source-dir", ROOT, "--output-dir", tmp_path]
    answer = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    assert answer.returncode == 0, answer.stdout + answer.stderr
    made = next(tmp_path.glob("*.zip"))
    assert set(unwanted(made)) <= {"README.md", "LICENSE"}
    with zipfile.ZipFile(made) as archive:
        assert {"__init__.py", "blender_manifest.toml", "rle_splat/scene/scene.py"} <= set(archive.namelist())


def test_a_zip_with_strangers_is_noticed(tmp_path):
    with zipfile.ZipFile(tmp_path / "x.zip", "w") as archive:
        for name in ("__init__.py", "tests/unit/test_x.py", ".git/config", "wheels/numba.whl", "wheels/notes.txt"):
            archive.writestr(name, "")
    assert unwanted(tmp_path / "x.zip") == ["tests/unit/test_x.py", ".git/config", "wheels/notes.txt"]


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


@pytest.fixture
def staged(fakes, tmp_path):
    """A folder with what the zip holds."""
    build.pack("linux-x64", "3.11", fakes, tmp_path / "x.zip")
    with zipfile.ZipFile(tmp_path / "x.zip") as archive:
        archive.extractall(tmp_path / "staged")
    return tmp_path / "staged"


def test_the_command_line_of_what_is_shipped_has_all_commands_but_compare(staged):
    def run(*words):
        command = [sys.executable, "-m", "rle_splat", *words]
        return subprocess.run(command, cwd=staged, capture_output=True, text=True)

    answer = run("--help")
    assert answer.returncode == 0 and "accuracy" in answer.stdout and "compare" not in answer.stdout, answer.stderr
    answer = run("compare")
    assert answer.returncode == 2 and "There is no command 'compare'; choose render, info" in answer.stderr
    program = (
        "import sys; from rle_splat.cli.main import main; sys.exit(any([main([name, '-h']) for name in sys.argv[1:]]))"
    )
    names = ("render", "info", "encode", "convert", "accuracy", "prepare")
    done = subprocess.run([sys.executable, "-c", program, *names], cwd=staged, capture_output=True, text=True)
    assert done.returncode == 0 and all(f"usage: rle-splat {name}" in done.stdout for name in names), done.stderr


def test_missing_wheels_are_named(monkeypatch):
    """llvmlite without numba of the same Python installs in Blender without a word and fails at import."""
    pure = ["pydicom-3.0.2-py3-none-any.whl"]
    monkeypatch.setattr(wheels, "packages", lambda: {"numba": "0.68.1", "llvmlite": "0.50.0", "pydicom": "3.0.2"})
    complete = pure + [
        f"{package}-{version}-{python}-{python}-{tag}.whl"
        for package, version in wheels.packages().items()
        if package != "pydicom"
        for python in ("cp311", "cp313")
        for tag in ("manylinux_2_27_x86_64.manylinux_2_28_x86_64", "win_amd64", "macosx_12_0_arm64")
    ]
    assert wheels.missing(complete, wheels.TAG_PATTERNS) == []
    for name in complete:
        gaps = wheels.missing([other for other in complete if other != name], wheels.TAG_PATTERNS)
        assert len(gaps) == (6 if name in pure else 1) and name.split("-")[0] in gaps[0]
    older = [name.replace("numba-0.68.1", "numba-0.64.0") for name in complete]
    assert len(wheels.missing(older, wheels.TAG_PATTERNS)) == 6


@pytest.mark.parametrize("path", REQUIREMENTS, ids=lambda path: path.name)
def test_requirements_are_pinned_with_hashes_and_name_no_host(path):
    text = path.read_text()
    logical = [line for line in text.replace("\\\n", " ").splitlines() if not line.startswith("#")]
    assert logical
    for line in logical:
        assert re.match(r"^[a-z0-9][a-z0-9._-]*==[\w.]+( ; [^-]+)?( +--hash=sha256:[0-9a-f]{64})+$", line), line
    assert not re.search(r"://|index[-_]url|find[-_]links|trusted-host|\.(org|com|io|net)\b", text)


def test_every_environment_has_its_requirements_and_every_pinned_set_its_source():
    wanted = {
        name
        for environment in (
            environments.CORE, environments.BENCH, environments.CLUSTER, *environments.BPY.values()
        )
        for name in environment.files
    }  # fmt: skip
    names = {path.stem for path in REQUIREMENTS}
    assert {Path(name).stem for name in wanted} | {bootstrap.PINS.stem, wheels.WHEEL_PINS.stem} <= names
    assert names == {path.stem for path in bootstrap.PINS.parent.glob("*.in")} and set(uv.LOCKS) <= names


def test_what_is_asked_for_is_what_is_pinned():
    """Each pin in NAME.in stands in NAME.txt, so nobody has forgotten to lock."""
    for source in bootstrap.PINS.parent.glob("*.in"):
        pins = re.findall(r"^([\w-]+==[\w.]+)", source.read_text(), re.MULTILINE)
        locked = source.with_suffix(".txt").read_text()
        assert pins or "-r " in source.read_text()
        assert [pin for pin in pins if not re.search(rf"^{re.escape(pin.lower())} ", locked, re.MULTILINE)] == []


def test_wheels_are_the_same_everywhere():
    """The wheels in the zip, the command line's environment and each bpy's hold one numba, one pydicom, and so on."""
    assert {"numba", "llvmlite", "pydicom", "pylibjpeg_openjpeg", "nibabel", "pynrrd", "tifffile"} <= set(
        wheels.packages()
    )
    for name in ("core.txt", *(f"bpy-{version}.txt" for version in environments.BPY)):
        path = environments.REQUIREMENTS / name
        pins = {
            name.replace("-", "_"): version
            for name, version in re.findall(r"^([\w.-]+)==(\S+)", path.read_text(), re.MULTILINE)
        }
        assert {package: pins.get(package) for package in wheels.packages()} == wheels.packages(), path.name


@pytest.fixture
def environment(tmp_path, monkeypatch):
    """An environment in a clone of its own, and the calls of uv that it takes, which do not run; those whose first
    word is in the set ``fails`` fail."""
    calls, fails = [], set()

    def run(command, sentence, env):
        words = [str(word) for word in command[1:]]
        calls.append(words)
        if words[0] in fails:
            raise places.Failure(sentence)
        if words[0] == "venv":
            places.executable(folder).parent.mkdir(parents=True)
            places.executable(folder).write_bytes(b"")
            (folder / "pyvenv.cfg").write_text("home = x\nversion_info = 3.13.0\n")

    folder = tmp_path / ".venvs" / "x"
    monkeypatch.setattr(environments, "ROOT", tmp_path)
    monkeypatch.setattr(environments, "REQUIREMENTS", tmp_path)
    (tmp_path / "core.txt").write_text("numpy==2.4.6\n")
    monkeypatch.setattr(environments, "find_python", lambda *versions: "3.13" in versions and "/bin/python3.13")
    monkeypatch.setattr(uv, "run_quietly", run)
    monkeypatch.setattr(uv, "_settings_of_pip", dict)
    return environments.Environment("x", folder, ("3.11", "3.13"), ("core.txt",)), calls, fails


def test_an_environment_is_made_once_from_hashed_files(environment):
    environment, calls, _ = environment
    assert environments.ensure(environment) == environment.python == environments.ensure(environment)
    made, sync = calls
    assert made[0] == "venv" and "/bin/python3.13" in made
    assert {"--require-hashes", "--no-build"} <= set(sync) and sync[-1].endswith("core.txt")


def test_an_environment_is_completed_when_any_byte_of_its_requirements_has_changed(environment, tmp_path):
    environment, calls, _ = environment
    environments.ensure(environment)
    (tmp_path / "core.txt").write_text("numpy==2.4.7\n")
    environments.ensure(environment)
    assert [call[0] for call in calls] == ["venv", "pip", "pip"]


def test_an_interrupted_set_up_is_taken_up_again(environment):
    environment, calls, fails = environment
    fails.add("pip")
    with pytest.raises(places.Failure, match=r"for x\. Check the network"):
        environments.ensure(environment)
    fails.clear()
    environments.ensure(environment)
    assert [call[0] for call in calls] == ["venv", "pip", "pip"]


def test_an_environment_without_a_python_says_what_to_install(environment, monkeypatch):
    monkeypatch.setattr(environments, "find_python", lambda *versions: None)
    with pytest.raises(places.Failure, match=r"Python 3\.11 or 3\.13 .* install it"):
        environments.ensure(environment[0])


def test_a_blender_that_is_set_up_goes_before_one_whose_python_is_installed_or_downloaded(monkeypatch):
    made, installed, downloaded = set(), {}, {}
    monkeypatch.setattr(environments, "is_made", lambda environment: environment.name in made)
    monkeypatch.setattr(environments, "installed_python", installed.get)
    monkeypatch.setattr(environments, "find_python", downloaded.get)
    with pytest.raises(places.Failure, match=r"Python 3\.11 or 3\.13 .* install it"):
        environments.any_bpy()
    downloaded["3.11"] = "x"
    assert environments.any_bpy() == "5.0"
    installed["3.13"] = "x"
    assert environments.any_bpy() == "5.3"
    made.add("bpy 4.5")
    assert environments.any_bpy() == "4.5"


def test_an_environment_whose_python_is_gone_is_made_again(environment):
    environment = environment[0]
    environments.ensure(environment)
    assert environments.is_made(environment) and environment.version == "3.13"
    environment.python.unlink()
    assert not environments.is_made(environment)


def test_a_command_that_fails_shows_its_output_and_is_a_sentence(capsys):
    with pytest.raises(places.Failure, match=r"^It broke$"):
        places.run_quietly([sys.executable, "-c", "import sys; sys.exit('no network')"], "It broke")
    assert "no network" in capsys.readouterr().out
    assert places.run_quietly([sys.executable, "-c", "print('fine')"], "It broke") == "fine\n"
    assert not capsys.readouterr().out


def test_pips_settings_are_uvs_as_well():
    """A machine with a mirror or certificates for pip alone; what is set in the environment wins."""
    listing = """:env:.find-links='/a /b'\n:env:.cert='/etc/own.pem'\nglobal.cert='x'\nglobal.index-url='mirror'\n
global.timeout='9'"""
    assert uv.pip_settings(listing) == {
        "UV_FIND_LINKS": "/a,/b", "SSL_CERT_FILE": "/etc/own.pem", "UV_DEFAULT_INDEX": "mirror",
    }  # fmt: skip
    assert uv.pip_settings("") == {}


def test_an_installed_python_goes_before_a_better_one_that_must_be_downloaded(monkeypatch):
    installed = {"3.13": "/bin/python3.13"}
    asked = []
    monkeypatch.setattr(uv, "installed_python", installed.get)
    monkeypatch.setattr(uv, "_downloaded_python", lambda version: asked.append(version) or {"3.11": "got"}.get(version))
    assert uv.find_python("3.11", "3.13") == "/bin/python3.13" and not asked
    assert uv.find_python("3.12", "3.11") == "got" and asked == ["3.12", "3.11"]
    assert uv.find_python("3.12") is None


def test_pyenvs_interpreters_are_found_though_its_own_entry_on_the_path_fails(tmp_path, monkeypatch):
    """pyenv puts a python3.13 on PATH that says only that it is not switched on."""
    names = ("3.13.0", "3.13.2", "3.11.7")
    for name in names:
        (tmp_path / "versions" / name).mkdir(parents=True)
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path))
    monkeypatch.setenv("PATH", "shims")
    found = uv._search_path("3.13")
    assert all((f"versions/{name}" in Path(found).as_posix()) == name.startswith("3.13") for name in names)
    assert found.endswith("shims")


def test_the_tools_run_on_every_python_that_may_start_them():
    """All of devtools that noxfile.py imports, by this interpreter and by the others that are installed."""
    others = map(uv.installed_python, PYTHONS) if places.executable(places.TOOLS, "uv").exists() else ()
    names = re.findall(r"^from devtools(?:\.(\w+))? import (.*)$", (ROOT / "noxfile.py").read_text(), re.MULTILINE)
    modules = [name or part.split()[0] for name, parts in names for part in parts.split(", ")]
    assert {"uv", "testing", "build"} <= set(modules)
    code = "".join(f"import devtools.{name}\n" for name in ("bootstrap", *modules))
    for python in (sys.executable, *filter(None, others)):
        answer = subprocess.run([python, "-c", code], cwd=ROOT, capture_output=True, text=True)
        assert answer.returncode == 0, f"{python}: {answer.stderr}"


def test_dev_py_can_be_read_by_a_much_older_python():
    """So that it can say which Python it needs: no syntax newer than 3.0 before that sentence."""
    import ast

    ast.parse((ROOT / "dev.py").read_text(), feature_version=(3, 4))
    assert "from __future__ import annotations" not in (ROOT / "dev.py").read_text()


def test_without_a_job_dev_py_lists_the_jobs():
    assert bootstrap.nox_words([])[-1] == bootstrap.nox_words(["--help"])[-1] == "--list"


def test_a_python_without_venv_is_told_what_to_install(monkeypatch):
    monkeypatch.setattr(bootstrap, "_can_make_environments", lambda: False)
    monkeypatch.setattr(bootstrap, "can_apt", lambda: False)
    with pytest.raises(places.Failure, match=r"apt-get install .* python3-venv"):
        bootstrap._make_tools()


def test_root_on_debian_gets_the_package_that_venv_is_in(monkeypatch):
    asked, runs = [], []
    monkeypatch.setattr(bootstrap, "_can_make_environments", lambda: bool(asked))
    monkeypatch.setattr(bootstrap, "can_apt", lambda: True)
    monkeypatch.setattr(bootstrap, "apt_install", asked.append)
    monkeypatch.setattr(bootstrap, "run_quietly", lambda command, sentence: runs.append(command))
    monkeypatch.setattr(bootstrap, "TOOLS", bootstrap.ROOT / ".venvs" / "no-such-tools")
    bootstrap._make_tools()
    assert asked == [["python3-venv"]] and [command[2] for command in runs] == ["venv", "pip"]
    assert "--require-hashes" in runs[1] and bootstrap.PINS in runs[1]


def test_the_tools_are_made_once_and_again_when_their_pins_change(monkeypatch, tmp_path):
    made = []
    monkeypatch.setattr(bootstrap, "_make_tools", lambda: made.append(1))
    monkeypatch.setattr(bootstrap, "TOOLS", tmp_path)
    monkeypatch.setattr(bootstrap, "STAMP", tmp_path / "ready.sha256")
    monkeypatch.setattr(bootstrap, "PINS", tmp_path / "tools.txt")
    places.executable(tmp_path).parent.mkdir()
    places.executable(tmp_path).write_bytes(b"")
    for pins, times in (("uv==1", 1), ("uv==1", 1), ("uv==2", 2)):
        bootstrap.PINS.write_text(pins)
        bootstrap.ensure_tools()
        assert len(made) == times
