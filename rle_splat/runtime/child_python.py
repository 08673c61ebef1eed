"""How to start Python itself as a child process, inside Blender too."""

import os
import sys
from importlib.util import find_spec
from pathlib import Path


def is_python(program: str) -> bool:
    """Whether a program is a Python by its name: in Blender ``sys.executable`` is its own, where it has one."""
    return Path(program).stem.lower().startswith("python")


def command(script, *words: str) -> list[str]:
    """Command line that runs a script.

    -P keeps the script's folder, whose modules are ours, out of the names that Python imports; -s what the user has
    installed for another Python.
    """
    return [sys.executable, "-P", "-s", str(script), *words]


def environ(*packages: str) -> dict[str, str]:
    """Environment variables of a child that imports ``packages`` from where this process has them.

    Python's own variables, which Blender does not read, are left out. Packages that are not installed are, too.
    """
    found = [find_spec(name) for name in packages]
    folders = dict.fromkeys(str(Path(spec.origin).parents[1]) for spec in found if spec is not None)
    own = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    return {**own, "PYTHONPATH": os.pathsep.join(folders)}
