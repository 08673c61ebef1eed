"""Seconds to compile the kernels of a first picture, kernel by kernel; writes docs/explanation/kernels.md."""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.runtime.jit import compiled
from rle_splat.scene import Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "explanation" / "kernels.md"
SIZE = 48  # voxels along each axis: the time is that of compiling, not of rendering
TEXT = """# Kernels of a first picture

A *kernel* is a function that numba compiles to machine code. Kernels are compiled when a picture first needs them and
kept on disk, so only the first picture ever waits for them. `rle-splat prepare` compiles those of usual pictures ahead,
and the extension's zip brings them compiled ([Prepare kernels](../how-to/prepare-kernels.md)).

The table lists what the default first picture compiles: a uint8 volume, post-classified, quality `standard`, shaded by
a headlight. The seconds are processor time of one thread, and those of a kernel include the functions that only it
uses. `python3 dev.py bench kernels` measures them: a process with an empty folder of kernels renders a small volume and
adds up the time between numba's events "compilation begins" and "compilation ends". The last line adds loading Python
modules and rendering.

{table}

The machine: {machine}, Python {python}, numba {numba}.

The largest parts of these, each without the functions that it uses in turn:

{parts}

How many versions of a kernel there are is a choice, too. Light makes versions of the splat's kernel: what a picture
does not have is not compiled, since tests within the loops would cost time in every picture. Ray intervals and mist
make none: each version has two loops over the blocks of pixels, one with them and one without, and takes one of the two
for each sheet. (With a single loop for both, a frame without them took up to a fifth longer.) Nor does the stored type:
the kernel branches once for each run of voxels, which cost no time that could be measured.

## Kernels in the extension's zip

`dev.py kernels` runs `rle-splat prepare` in a process for which numba compiles for a level of processors in place of
its own (`NUMBA_CPU_NAME=x86-64-v3`), and packs the kernels that the process has used into one zip file for each version
of Python (`devtools/pack_kernels.py`). An entry's name is a digest of the types of the arguments, of LLVM's name of the
system, and of the digest below. A kernel that does not fit its source is never found. The digest does not depend on the
name of the package: Blender imports the extension under a name of its own, and the reader replaces the package's name
in what an entry refers to (`rle_splat/runtime/shipped_kernels.py`).

A kernel is looked for in the user's folder, then in this file if the processor has all features of the level, and is
compiled otherwise. A damaged entry is noticed by the zip's checksum.

No kernel in it estimates a reciprocal or a root, which processors of different makers round differently; a test
disassembles them. Kernels of two levels still round differently: pictures of x86-64-v3 and of a processor with AVX-512
differed by up to 4e-6.

## What is kept on disk, and when it is compiled again

A kernel on disk is used when the following are the same: the types of the arguments, the processor and its features,
the versions of RLE Splat, numba and LLVM, numba's settings that change machine code (such as `NUMBA_OPT`), and the code
and constants of the kernel and of all that it uses (`rle_splat/runtime/kernel_digest.py`). Comments, docstrings and
code that the kernel does not use do not count.

RLE Splat relies on internals of numba for the files on disk, for loops that are shared among threads, and for the names
of kernels in the report. They are in `rle_splat/runtime/`, behind one check of numba's version
(`numba_internals.py`). With a version that is not known there, only numba's public interface is used: pictures are the
same, kernels run on one thread and are compiled again in each session, and the report says so. Without numba, pictures
are made by the reference implementations in numpy, which takes many times as long; the report says so, and so does the
panel in Blender.

No setting of numba or of the process is changed.
"""


def compile_here() -> dict[str, str]:
    """Environment variables with which a process compiles for this processor, whatever kernels the package brings."""
    from llvmlite.binding import get_host_cpu_name
    from numba.core.codegen import get_host_cpu_features

    return {"NUMBA_CPU_NAME": get_host_cpu_name(), "NUMBA_CPU_FEATURES": get_host_cpu_features()}


def first_picture() -> dict:
    """Render the picture in this process, and note what is compiled.

    Returns
    -------
    dict
        ``kernels``: for each compilation, in order of its end, module, name, seconds with and without those inside it,
        and how many it is inside of.  ``seconds``: processor time of the process until the picture is done.
    """
    from numba.core import event

    rows, begun = [], []

    class Listener(event.Listener):
        def on_start(self, _):
            begun.append([time.process_time(), 0.0])

        def on_end(self, about):
            start, inside = begun.pop()
            seconds = time.process_time() - start
            if begun:
                begun[-1][1] += seconds
            function = about.data["dispatcher"].py_func
            rows.append((function.__module__, function.__name__, seconds, seconds - inside, len(begun)))

    grid = np.linspace(-1.0, 1.0, SIZE)
    radius = np.sqrt(sum(axis**2 for axis in np.meshgrid(grid, grid, grid)))
    volume = Volume((255.0 * np.clip(1.2 - radius, 0.0, 1.0)).astype(np.uint8), np.eye(4))
    camera, matrix = turntable(volume, 30, 20, width=64, height=64)
    tf = TransferFunction(opacity=((60, 0.0), (250, 0.6)), color=((0, 0.2, 0.4, 0.8), (255, 1.0, 0.9, 0.8)))
    scene = Scene(volume, tf, camera, 64, 64, matrix, headlight=True)
    with event.install_listener("numba:compile", Listener()):
        render(scene, Quality.preset("standard"))
    return {"kernels": rows, "seconds": time.process_time()}


def _table(rows, head) -> str:
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * (len(head) - 1)}---:|"]
    return "\n".join(lines + [f"| {' | '.join(row)} |" for row in rows])


def page(measured: dict) -> str:
    """The text of docs/explanation/kernels.md."""
    import numba

    outer, inside = [], []
    for module, name, seconds, own, depth in measured["kernels"]:
        inside.append((module, name, own))
        if depth == 0:
            outer.append((module, name, len(inside) - 1, seconds))
            measured.setdefault("parts", []).extend(inside)
            inside = []
    outer.sort(key=lambda row: -row[3])
    rows = [(f"`{m.removeprefix('rle_splat.')}`", f"`{n}`", str(parts), f"{s:.2f}") for m, n, parts, s in outer]
    rows.append(("", "all kernels", str(sum(row[2] for row in outer)), f"{sum(row[3] for row in outer):.2f}"))
    rows.append(("", "the whole process", "", f"{measured['seconds']:.2f}"))
    parts = sorted(measured["parts"], key=lambda row: -row[2])[:15]
    return TEXT.format(
        table=_table(rows, ("module", "kernel", "functions inside", "seconds")),
        parts=_table(
            [(f"`{m.removeprefix('rle_splat.')}`", f"`{n}`", f"{s:.2f}") for m, n, s in parts],
            ("module", "function", "seconds"),
        ),
        machine=f"{platform.machine()}, {os.cpu_count()} cores", python=platform.python_version(),
        numba=numba.__version__,
    )


def main(arguments) -> int:
    parser = argparse.ArgumentParser(prog="dev.py bench kernels", description=__doc__)
    parser.add_argument("--repeats", type=int, default=3, help="processes of which the quickest counts (3)")
    parser.add_argument("--json", action="store_true", help="measure in this process alone, and print it")
    options = parser.parse_args(arguments)
    if not compiled():
        raise RleSplatError("Nothing is compiled without numba.")
    if options.json:
        print(json.dumps(first_picture()))
        return 0
    runs = []
    for _ in range(options.repeats):
        with tempfile.TemporaryDirectory() as folder:
            done = subprocess.run(
                [sys.executable, "-m", "benchmarks", "kernels", "--json"], cwd=ROOT, check=True, capture_output=True,
                text=True, env={**os.environ, "RLE_SPLAT_CACHE": folder, "NUMBA_CACHE_DIR": "", **compile_here()},
            )  # fmt: skip
        runs.append(json.loads(done.stdout))
    best = min(runs, key=lambda run: run["seconds"])
    PAGE.write_text(page(best), encoding="utf-8")
    print(f"{best['seconds']:.1f} s of processor time; see {PAGE.relative_to(ROOT)}")
    return 0
