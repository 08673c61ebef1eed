"""Encodings into a folder of tables that are killed at random moments, and the pictures from what they go on with.

After a kill the same command is killed again, or let to its end: then the pictures along all three axes must be those
of an undisturbed run, to the bit, and nothing else may be left.  The process ends with code 1 where this does not hold.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from rle_splat.encode.store import read_encoded
from rle_splat.pipeline.render import render

from .beyond_memory import FUNCTION, VIEWS, make_volume, quality_of, scene_of

SIDE, LIMIT = 128, "200MiB"  # voxels along each side, encoded in several slabs because all of them are visible
VISIBLE = {**FUNCTION, "opacity": [[0, 0.01], [40000, 0.6]]}
STARTED = 0.4  # of a run: before that, Python and the kernels are loaded


def words_of(folder: Path, classification: str) -> list:
    """The command."""
    words = [sys.executable, "-m", "rle_splat", "encode", folder / "volume.raw", "-o", folder / "volume.rle"]
    words += ["--folder", "--shape", *[SIDE] * 3, "--dtype", "uint16", "--headlight"]
    words += ["--transfer-function", folder / "wall.json", "--classification", classification]
    words += ["--memory-limit", LIMIT, "--threads", 1, "--no-progress"]
    return [str(word) for word in words]


def digest_of(path: Path, classification: str) -> str:
    """Hash of the pictures along all axes."""
    found = hashlib.sha256()
    for view in VIEWS:
        shown = render(scene_of(read_encoded(path), view, headlight=False), quality_of(classification))
        found.update(shown.rgba.tobytes())
    return found.hexdigest()


def killed(words, seconds: float, chance: random.Random) -> str:
    """Run the command and kill it somewhere in its ``seconds``; return what became of it."""
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    time.sleep(chance.uniform(STARTED * seconds, seconds))
    process.send_signal(signal.SIGKILL)
    _, told = process.communicate()
    if process.returncode == -signal.SIGKILL:
        return "killed"
    return "ended first" if process.returncode == 0 else f"REFUSED: {told}"


def measure(args, folder: Path, classification: str) -> Counter:
    """Kill so often; count what became of it. Words in capitals are faults."""
    words, path, chance = words_of(folder, classification), folder / "volume.rle", random.Random(args.seed)
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    wanted, began = digest_of(path, classification), time.perf_counter()
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)  # kernels are there: so long does a run take
    seconds, counted = time.perf_counter() - began, Counter()
    shutil.rmtree(path)
    for _ in range(args.kills):
        counted[killed(words, seconds, chance)] += 1
        if not path.exists() and chance.random() < 0.5:
            continue  # the next run goes on
        done = subprocess.run(words, capture_output=True, text=True)
        counted["then went on" if "Planes up to" in done.stdout else "then began anew"] += 1
        if done.returncode or digest_of(path, classification) != wanted:
            counted["A WRONG PICTURE"] += 1
        if {one.name for one in folder.iterdir()} != {"volume.raw", "volume.rle", "wall.json"}:
            counted["SOMETHING LEFT"] += 1
        shutil.rmtree(path)
    return counted


def main(arguments=None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.encode_kills", description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=50, help="of each classification")
    parser.add_argument("--seed", type=int, default=1)
    args, faults = parser.parse_args(arguments), 0
    for classification in ("pre", "post"):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            make_volume(folder / "volume.raw", (SIDE,) * 3)
            (folder / "wall.json").write_text(json.dumps(VISIBLE))
            counted = measure(args, folder, classification)
        print(f"{classification}: " + ", ".join(f"{many} {what}" for what, many in sorted(counted.items())), flush=True)
        faults += sum(many for what, many in counted.items() if what[:2].isupper())
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
