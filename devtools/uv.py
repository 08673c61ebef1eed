"""uv as this repository calls it: the one of .venvs/tools, with the settings of pip as well."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path

from .places import AGAIN, ENVIRONMENTS, REQUIREMENTS, TOOLS, Failure, clean_environ, executable, run_quietly, say

# pip's name of a setting -> uv's variable, and the separator of several values.  uv does not read pip's settings, and
# some machines have a mirror, a proxy or certificates set for pip alone.
SETTINGS = {
    "index-url": ("UV_DEFAULT_INDEX", " "),
    "extra-index-url": ("UV_INDEX", " "),
    "find-links": ("UV_FIND_LINKS", ","),
    "no-index": ("UV_NO_INDEX", " "),
    "trusted-host": ("UV_INSECURE_HOST", " "),
    "proxy": ("ALL_PROXY", " "),
    "cert": ("SSL_CERT_FILE", " "),
}
UV = executable(TOOLS, "uv")
HOME = os.path.expanduser("~")
DOWNLOAD_SECONDS = 300  # for an interpreter of about 30 MB

# The JPEG decoders ask for numpy 2, but their modules run with Blender's numpy 1.26 as well (compiled with numpy 2
# headers, which serve both); dev.py test decodes with them there.
BLENDERS_NUMPY = ("3.11", "--override", REQUIREMENTS / "blenders-numpy.override")

# The lowest Python and further words of `uv pip compile` for a set; all others: 3.11, none.
LOCKS = {
    "tools": ("3.9",),
    "bpy-4.5": BLENDERS_NUMPY,
    "bpy-5.0": BLENDERS_NUMPY,
    "bpy-5.2": ("3.13",),
    "bpy-5.3": ("3.13",),
    "wheels": ("3.11", "--no-deps"),
    "sample-data": ("3.11", "--no-deps"),
}


def pip_settings(listing: str) -> dict[str, str]:
    """uv's variables for what `pip config list` printed; of two values the one from pip's environment counts."""
    found = {}
    for line in sorted(listing.splitlines(), key=lambda line: line.startswith(":env:")):
        key, equals, value = line.partition("=")
        variable, separator = SETTINGS.get(key.rpartition(".")[2], ("", ""))
        if equals and variable:
            found[variable] = separator.join(ast.literal_eval(value).split())
    return found


@cache
def _settings_of_pip() -> dict[str, str]:
    listing = subprocess.run(
        [str(executable(TOOLS)), "-m", "pip", "config", "list"], env=clean_environ(), capture_output=True, text=True
    )
    return pip_settings(listing.stdout)


def _environ() -> dict[str, str]:
    """The environment of uv; what the user has set for it counts before what is set here."""
    usual = {
        # Only find_python downloads an interpreter, into this clone.
        "UV_PYTHON_DOWNLOADS": "manual",
        "UV_PYTHON_INSTALL_DIR": str(ENVIRONMENTS / "pythons"),
        "UV_NO_PROGRESS": "1",
        # uv looks in every index, as pip does; the hashes decide which files are right.
        "UV_INDEX_STRATEGY": "unsafe-best-match",
    }
    if not os.access(os.environ.get("XDG_CACHE_HOME") or HOME, os.W_OK):
        usual["UV_CACHE_DIR"] = str(ENVIRONMENTS / "cache")  # a user without a home
    return {**usual, **clean_environ()}


def uv(sentence: str, *words) -> None:
    """Run uv with its output held back; a failure is shown, and raised as a Failure that begins with ``sentence``."""
    run_quietly([UV, *words], f"{sentence} {AGAIN}", env={**_settings_of_pip(), **_environ()})


def _search_path(version: str) -> str:
    """PATH, after the folders of pyenv's interpreters of this version.

    pyenv puts a python3.13 on PATH that fails unless this version is switched on, and uv stops at it.
    """
    roots = dict.fromkeys([os.environ.get("PYENV_ROOT"), os.environ.get("PYENV"), os.path.join(HOME, ".pyenv")])
    homes = [home for root in roots if root for home in Path(root, "versions").glob(f"{version}.*")]
    folders = [home if os.name == "nt" else home / "bin" for home in homes]
    return os.pathsep.join([*map(str, folders), os.environ.get("PATH", "")])


def installed_python(version: str) -> str | None:
    """Path of an installed Python ``version``: on PATH, of pyenv, of the py launcher, or one that uv has downloaded."""
    done = subprocess.run(
        [str(UV), "python", "find", "--system", "--no-project", "--offline", version],
        env={**_environ(), "PATH": _search_path(version)}, capture_output=True, text=True,
    )  # fmt: skip
    return done.stdout.strip() or None


@cache
def _downloaded_python(version: str) -> str | None:
    """Path of a Python ``version`` that uv downloads, or None where it cannot."""
    say(f"Python {version} is not installed; trying to download it with uv")
    # Without a network each further try would only make the user wait.
    environ = {"UV_HTTP_RETRIES": "0", **_settings_of_pip(), **_environ()}
    command = [str(UV), "python", "install", "--no-bin", version]
    with suppress(subprocess.TimeoutExpired):
        subprocess.run(command, env=environ, capture_output=True, timeout=DOWNLOAD_SECONDS)
    return installed_python(version)


def find_python(*versions: str) -> str | None:
    """Path of a Python of one of these versions, best first: an installed one, else a downloaded one, else None."""
    for find in (installed_python, _downloaded_python):
        found = next(filter(None, map(find, versions)), None)
        if found:
            return found
    return None


def lock(names=()) -> None:
    """Write requirements/NAME.txt from NAME.in: versions and hashes for every platform, no address of an index."""
    for name in names or sorted(path.stem for path in REQUIREMENTS.glob("*.in")):
        source = REQUIREMENTS / f"{name}.in"
        if not source.is_file():
            raise Failure(f"There is no {source.name} in requirements.")
        python, *further = LOCKS.get(name, ("3.11",))
        words = ["--universal", "--python-version", python, "--upgrade", "--generate-hashes", "--no-emit-index-url"]
        words += ["--no-build", "--no-annotate", "--custom-compile-command", "python3 dev.py lock", *further]
        uv(
            f"uv could not resolve {source.name}.",
            "pip", "compile", *words, source, "--output-file", source.with_suffix(".txt"), "--python", sys.executable,
        )  # fmt: skip
        say(f"requirements/{name}.txt")
