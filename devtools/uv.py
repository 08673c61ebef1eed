"""uv as this repository calls it: the one of .venvs/tools, with the settings of pip as well."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

from .places import ENVIRONMENTS, REQUIREMENTS, TOOLS, Failure, clean_environ, executable, say

# pip's name of a setting -> uv's variable, and what separates several values in it.  uv does not read pip's settings,
# and a machine that has a mirror, a proxy or certificates set for pip alone would not find its packages.
SETTINGS = {
    "index-url": ("UV_DEFAULT_INDEX", " "),
    "extra-index-url": ("UV_INDEX", " "),
    "find-links": ("UV_FIND_LINKS", ","),
    "no-index": ("UV_NO_INDEX", " "),
    "trusted-host": ("UV_INSECURE_HOST", " "),
    "proxy": ("ALL_PROXY", " "),
    "cert": ("SSL_CERT_FILE", " "),
}
DOWNLOAD_SECONDS = 300  # for an interpreter of about 30 MB

# The lowest Python and further words of `uv pip compile` for a set; all others: 3.11, none.
LOCKS = {
    "tools": ("3.9",),
    "bpy-5.2": ("3.13",),
    "wheels": ("3.11", "--no-deps"),
    "sample-data": ("3.11", "--no-deps"),
}


def pip_settings(listing: str) -> dict[str, str]:
    """uv's variables for what `pip config list` printed; later lines of pip's (its environment) go before earlier."""
    found = {}
    for line in listing.splitlines():
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


def _environ(network: bool, **extra: str) -> dict[str, str]:
    """The environment of a call; what the user has set for uv counts before what is set here."""
    usual = {
        # A download of an interpreter is asked for in one place, find_python; it stays in this clone.
        "UV_PYTHON_DOWNLOADS": "manual",
        "UV_PYTHON_INSTALL_DIR": str(ENVIRONMENTS / "pythons"),
        "UV_NO_PROGRESS": "1",
        # As pip does; else each process compiles numba's modules where PYTHONDONTWRITEBYTECODE is set: 1.3 s, not 0.4.
        "UV_COMPILE_BYTECODE": "1",
        # Hashes decide which files are right; this only lets uv look in every index, as pip does.
        "UV_INDEX_STRATEGY": "unsafe-best-match",
    }
    if not os.access(os.environ.get("XDG_CACHE_HOME") or Path.home(), os.W_OK):
        usual["UV_CACHE_DIR"] = str(ENVIRONMENTS / "cache")  # a user without a home
    if network:
        usual.update(_settings_of_pip())
    return {**usual, **clean_environ(**extra)}


def uv(*words, network: bool = True, seconds: float | None = None, **extra: str) -> subprocess.CompletedProcess:
    """Run uv with its output held back; ``network``: whether it may use it; ``extra``: variables of its environment."""
    command = [executable(TOOLS, "uv"), *words, *([] if network else ["--offline"])]
    environ = _environ(network, **extra)
    return subprocess.run([str(word) for word in command], env=environ, capture_output=True, text=True, timeout=seconds)


def uv_or_failure(sentence: str, *words) -> None:
    """Run uv; when it fails, show its output and raise a Failure that begins with ``sentence``."""
    done = uv(*words)
    if done.returncode != 0:
        say(done.stderr[-3000:])
        raise Failure(f"{sentence} Check the network and the disk, then run the same command again: it goes on.")


def _search_path(version: str) -> str:
    """PATH, with the interpreters that pyenv has of this version before it: its own entry on PATH runs only those that
    are switched on, and fails for the others."""
    roots = dict.fromkeys([os.environ.get("PYENV_ROOT"), os.environ.get("PYENV"), str(Path.home() / ".pyenv")])
    homes = [home for root in roots if root for home in Path(root, "versions").glob(f"{version}.*")]
    folders = [home if os.name == "nt" else home / "bin" for home in homes]
    return os.pathsep.join([*map(str, folders), os.environ.get("PATH", "")])


def _installed(version: str) -> str | None:
    done = uv("python", "find", "--system", "--no-project", version, network=False, PATH=_search_path(version))
    return done.stdout.strip() or None


@cache
def find_python(version: str) -> str | None:
    """Path of a Python ``version`` ("3.13"): an installed one, else one that uv downloads, else None."""
    found = _installed(version)
    if not found:
        say(f"Python {version} is not installed; trying to download it with uv")
        try:
            # Without a network each further try would only make the user wait.
            uv("python", "install", "--no-bin", version, seconds=DOWNLOAD_SECONDS, UV_HTTP_RETRIES="0")
        except subprocess.TimeoutExpired:
            return None
        found = _installed(version)
    return found


def lock(names=()) -> None:
    """Write requirements/NAME.txt from NAME.in: exact versions and hashes for every platform, no address of an index.

    Parameters
    ----------
    names : sequence of str
        The sets to resolve; all when empty.
    """
    for name in names or sorted(path.stem for path in REQUIREMENTS.glob("*.in")):
        source = REQUIREMENTS / f"{name}.in"
        if not source.is_file():
            raise Failure(f"There is no {source.name} in requirements.")
        python, *further = LOCKS.get(name, ("3.11",))
        words = ["--universal", "--python-version", python, "--upgrade", "--generate-hashes", "--no-emit-index-url"]
        words += ["--no-build", "--no-annotate", "--custom-compile-command", "python3 dev.py lock", *further]
        uv_or_failure(
            f"uv could not resolve {source.name}.",
            "pip", "compile", *words, source, "--output-file", source.with_suffix(".txt"), "--python", sys.executable,
        )  # fmt: skip
        say(f"requirements/{name}.txt")
