"""The workflows for the three systems: valid, and of commands that are there."""

import re
from pathlib import Path

import pytest

from devtools import kernels, testing, wheels

yaml = pytest.importorskip("yaml")
ROOT = Path(__file__).resolve().parents[2]
FILES = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
SYSTEMS = {"linux": "ubuntu", "windows": "windows", "macos": "macos"}


def jobs(file):
    return yaml.safe_load(file.read_text(encoding="utf-8"))["jobs"].values()


def commands(file):
    return [step["run"] for job in jobs(file) for step in job["steps"] if "run" in step]


def rows(job):
    """The values of a job's matrix, a dict for each run; one empty dict without a matrix."""
    matrix = job.get("strategy", {}).get("matrix", {})
    return matrix.get("include") or [{"system": system} for system in matrix.get("system", [])] or [{}]


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_each_command_runs_in_a_clone(file):
    noxfile = (ROOT / "noxfile.py").read_text(encoding="utf-8")
    of_dev = dict(re.findall(r"^@job\ndef (\w+)\(parser.*?\n((?:    .*\n|\n)+)", noxfile, re.MULTILINE))
    for command in commands(file):
        program, *words = command.split()
        if program == "python3":
            script, job, *options = words
            assert script == "dev.py" and (job in of_dev or job in testing.parts()), command
            assert all(f'"{word}"' in of_dev[job] for word in options if word.startswith("--")), command
        else:
            assert program == "apt-get" or command == "bash .ci/run", command
    assert commands(file)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_all_three_systems(file):
    runs = [row.get("system", job["runs-on"]) for job in jobs(file) for row in rows(job)]
    assert sorted(name.partition("-")[0] for name in runs) == sorted(SYSTEMS.values())


def test_each_zip_is_made_on_its_system():
    (job,) = jobs(ROOT / ".github/workflows/release.yml")
    made = {row["platform"]: row["system"] for row in rows(job)}
    assert made.keys() == wheels.TAG_PATTERNS.keys() == kernels.LEVELS.keys(), "and has kernels"
    assert all(system.startswith(SYSTEMS[platform.partition("-")[0]]) for platform, system in made.items())
