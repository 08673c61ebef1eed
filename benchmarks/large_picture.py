"""A picture of 32768 x 32768 pixels in tiles: memory watched from outside, parts of it compared with their own renders.

The volume is that of ``beyond_memory``, in 256^3 voxels.  The picture is written as a `.tif`; a few parts of it are
rendered again by ``--crop``, alone and without tiles, and must have the same levels.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from rle_splat.cli.options import memory_size
from rle_splat.runtime.memory import bytes_text

from .beyond_memory import FUNCTION, add_folder_options, make_volume, measured_in_folder, watched
from .run import make_parser

SIDE, VOXELS = 32768, 256
PART = 1000, 700  # pixels of a part; not a multiple of a tile's side
# Left top corners of parts, as shares of what the picture leaves: corners, the middle, and across tiles beside it.
CORNERS = (0.0, 0.0), (1.0, 1.0), (0.5, 0.5), (0.31, 0.62), (0.64, 0.27)


def rows_of(path: Path, top: int, bottom: int) -> np.ndarray:
    """(bottom - top, W, samples) uint16: rows of a `.tif` picture; only their strips are read."""
    import tifffile

    with tifffile.TiffFile(path) as file:
        page, found = file.pages[0], []
        each = page.rowsperstrip
        for strip in range(top // each, -(-bottom // each)):
            file.filehandle.seek(page.dataoffsets[strip])
            found.append(page.decode(file.filehandle.read(page.databytecounts[strip]), strip)[0][0])
    first = top // each * each
    return np.concatenate(found)[top - first : bottom - first]


def measure(args, folder: Path) -> dict:
    """The picture, and its parts; files go to ``folder``."""
    volume, picture = folder / "volume.raw", folder / "picture.tif"
    make_volume(volume, (VOXELS,) * 3)
    (folder / "wall.json").write_text(json.dumps(FUNCTION))
    words = ["-m", "rle_splat", "render", volume, "--shape", *[VOXELS] * 3, "--dtype", "uint16", "--quality", "draft"]
    words += ["--transfer-function", folder / "wall.json", "--headlight", "--azimuth", 30, "--elevation", 20]
    words += ["--size", args.side]
    report = folder / "report.json"
    limit = f"{args.memory_limit / 2**20:.0f}MiB"
    found = watched([*words, "-o", picture, "--memory-limit", limit, "--json", report])
    tiles, size = json.loads(report.read_text())["tiles"], picture.stat().st_size
    print(
        f"{args.side} x {args.side} pixels, {tiles['count']} tiles of {tiles['side']}: {found['seconds']:.0f} s, "
        f"{found['processor']:.0f} s of processor time, anonymous {bytes_text(found['anonymous'])}, "
        f"resident {bytes_text(found['resident'])}, file {bytes_text(size)}", flush=True)  # fmt: skip
    same = []
    for across, down in CORNERS:
        left, top = int(across * (args.side - PART[0])), int(down * (args.side - PART[1]))
        crop, alone = (left, top, left + PART[0], top + PART[1]), folder / "part.tif"
        watched([*words, "-o", alone, "--crop", *crop])
        wanted = rows_of(alone, 0, PART[1])
        same.append(bool(np.array_equal(rows_of(picture, crop[1], crop[3])[:, crop[0] : crop[2]], wanted)))
        shown = np.count_nonzero(wanted[..., 3]) / wanted[..., 3].size
        print(f"  the part {crop}: the same bits: {same[-1]}; {shown:.0%} of its pixels show something", flush=True)
    return {"side": args.side, "limit": args.memory_limit, "tiles": tiles, "bytes": size, **found, "same": same}


def main(arguments) -> int:
    side = {"default": SIDE, "help": f"of the picture in pixels (default {SIDE})"}
    parser = make_parser("dev.py bench large-picture", __doc__.splitlines()[0], side=side)
    parser.add_argument("--memory-limit", type=memory_size, default="2GiB")
    add_folder_options(parser)
    args = parser.parse_args(arguments)
    return measured_in_folder(measure, args, "large-picture", arguments)
