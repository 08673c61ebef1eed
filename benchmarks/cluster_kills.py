"""Processes killed at random moments of renders on a local Dask cluster: a worker, the command, or all at once.

Run it where dask and distributed are installed (``requirements/cluster.txt``):

    python -m benchmarks.cluster_kills --kills 50

After each kill the picture must be absent or the one of an undisturbed run, to the bit; a command that goes on must end
with that picture or with one sentence; and no process may be left.  At the end each job is run again, undisturbed, and
nothing but its pictures may be left.  The process ends with code 1 where any of this does not hold.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import psutil

from rle_splat.cli.made import ABANDONED

from .cluster_costs import layout, table, write_tables, write_volume

SIDE = 64  # voxels
VIEW = ("--size", "400", "--tile", "64", "--threads", "1", "--dask", "--workers", "2", "--no-progress")
FRAMES = ("--frames", "1", "12", "--turn", "9")
KINDS = "worker", "command", "all"  # what is killed
LONGEST = 300.0  # seconds, of any run
SOON = 15.0  # seconds in which processes that have lost their parent end


@dataclass(frozen=True)
class Job:
    """A command; the folder of its pictures; name -> bytes and the seconds of an undisturbed run."""

    name: str
    words: tuple
    folder: Path
    whole: dict
    seconds: float


def begin(words, output: Path) -> subprocess.Popen:
    """Begin a render in a session of its own."""
    command = [sys.executable, "-m", "rle_splat", "render", *words, "-o", output]
    return subprocess.Popen(
        [str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip


def pictures(folder: Path) -> dict:
    """Name -> bytes of the pictures in a folder."""
    return {path.name: path.read_bytes() for path in folder.glob("[!.]*.npy")}


def undisturbed(words, folder: Path) -> float:
    """Run a job to its end; return its seconds from the moment when its cluster is there."""
    process = begin(words, folder / "a.npy")
    process.stdout.readline()
    began = time.monotonic()
    _, told = process.communicate(timeout=LONGEST)
    if process.returncode:
        raise SystemExit(told)
    return time.monotonic() - began


def jobs_in(folder: Path) -> list[Job]:
    """The jobs: a picture in tiles, one in slabs, and frames; each is run once, undisturbed."""
    raw, tables = folder / "shell.raw", folder / "shell.rle"
    write_volume(raw, SIDE)
    write_tables(raw, SIDE, tables)
    found = []
    for name, words in (
        ("tiles", (raw, *layout(SIDE), *VIEW)), ("slabs", (tables, *VIEW, "--slabs", "4")),
        ("frames", (raw, *layout(SIDE), *(word for word in VIEW if word not in ("--tile", "64")), *FRAMES)),
    ):  # fmt: skip
        own = folder / name
        own.mkdir()
        undisturbed(words, own)  # kernels are compiled and kept
        whole = pictures(own)
        clear(own)
        seconds = undisturbed(words, own)
        if not whole or pictures(own) != whole:
            raise SystemExit(f"Two undisturbed runs of {name} differ.")
        clear(own)
        found.append(Job(name, words, own, whole, seconds))
        print(f"{name}: {len(whole)} pictures, {seconds:.1f} s after the cluster is there", flush=True)
    return found


def clear(folder: Path) -> None:
    """Delete the pictures of a folder, but not what is left beside them."""
    for name in pictures(folder):
        (folder / name).unlink()


def kill_once(job: Job, kind: str, chance: random.Random) -> str:
    """Run a job, kill what ``kind`` says, and return what became of it; a word in capitals is a fault."""
    process = begin(job.words, job.folder / "a.npy")
    early = kind != "worker" and chance.random() < 0.3
    if early:
        time.sleep(chance.uniform(0.0, 4.0))
    else:
        process.stdout.readline()  # the cluster is there
        time.sleep(chance.uniform(0.0, job.seconds))
    others = psutil.Process(process.pid).children(recursive=True)
    workers = [one for one in others if "spawn_main" in " ".join(one.cmdline()) and one.children() == []]
    if kind == "worker" and workers:
        os.kill(chance.choice(workers).pid, signal.SIGKILL)
    elif kind == "command":
        os.kill(process.pid, signal.SIGKILL)
    elif kind == "all":
        os.killpg(process.pid, signal.SIGKILL)
    _, told = process.communicate(timeout=LONGEST)
    _, left = psutil.wait_procs(others, timeout=SOON)
    if any(one.is_running() and one.status() != psutil.STATUS_ZOMBIE for one in left):
        return "PROCESSES LEFT"
    there = pictures(job.folder)
    if any(job.whole.get(name) != content for name, content in there.items()):
        return "A WRONG PICTURE"
    if process.returncode == 0:
        return "the whole picture" if there == job.whole else "A PICTURE IS MISSING"
    if process.returncode > 0 and told.count("\n") != 1:
        return "MORE THAN A SENTENCE"
    return "one sentence" if process.returncode > 0 else "killed: whole pictures or none"


def left_behind(job: Job) -> list[str]:
    """What is left beside the pictures when a job is run again, some time after its kills, to its end."""
    old = time.time() - 2 * ABANDONED
    for path in job.folder.iterdir():
        if path.suffix == ".part":
            os.utime(path, (old, old))
    undisturbed(job.words, job.folder)
    if pictures(job.folder) != job.whole:
        return ["A WRONG PICTURE"]
    return [path.name for path in job.folder.iterdir() if path.suffix == ".part"]


def main() -> None:
    """Kill, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    chance, found, faults = random.Random(args.seed), Counter(), []
    with tempfile.TemporaryDirectory() as folder:
        jobs = jobs_in(Path(folder))
        for number in range(args.kills):
            job, kind = jobs[number % len(jobs)], KINDS[number // len(jobs) % len(KINDS)]
            if job.name != "frames" or pictures(job.folder) == job.whole:  # else they go on where they were
                clear(job.folder)
            outcome = kill_once(job, kind, chance)
            found[job.name, kind, outcome] += 1
            print(f"{number + 1}: {job.name}, {kind} killed: {outcome}", flush=True)
            if outcome.isupper():
                faults.append(outcome)
        for job in jobs:
            faults += left_behind(job)
    print("\n" + table(("job", "killed", "then", "times"), ((*row, count) for row, count in sorted(found.items()))))
    print(f"\n{len(faults)} faults" + "".join(f"\n{fault}" for fault in faults))
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
