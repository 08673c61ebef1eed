"""Reads paths from standard input and says for each, as a line of JSON, how reading ended and what it cost.

A program of its own, so that a signal or a hang is seen by the test that started it.
"""

import json
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from rle_splat.read.formats import read_volume
from rle_splat.scene import RleSplatError

STATUS = Path("/proc/self/status")
CLEAR = Path("/proc/self/clear_refs")  # writing 5 resets the peak of the resident memory (Linux)


def peak_bytes() -> int:
    """Peak resident memory since the last reset; 0 on systems that do not say."""
    try:
        return next(1024 * int(line.split()[1]) for line in STATUS.read_text().splitlines() if line.startswith("VmHWM"))
    except OSError:
        return 0


def main() -> None:
    for line in sys.stdin:
        path, began = line.rstrip("\n"), time.perf_counter()
        try:
            CLEAR.write_text("5")
        except OSError:
            pass
        try:
            volume = read_volume(path)
            outcome, text = "read", f"{volume.shape_xyz} {volume.voxels.dtype}"
        except RleSplatError as problem:
            outcome, text = "refused", str(problem)
        except Exception as problem:
            outcome, text = "failed", f"{type(problem).__name__}: {problem}"
        answer = {"path": path, "outcome": outcome, "text": text, "seconds": time.perf_counter() - began}
        print(json.dumps({**answer, "peak": peak_bytes()}), flush=True)


if __name__ == "__main__":
    main()
