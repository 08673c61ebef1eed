"""The methods that the paper names on each volume: time, memory and error in one run."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from rle_splat.comparison.compare import PROBES, REPEATS, compare, table_lines
from rle_splat.comparison.table import SYSTEMS
from rle_splat.scene import QUALITY_PRESETS, Quality, Scene
from rle_splat.view.turntable import turntable

from .scenes import REAL, scenes

VIEW = (35.0, 25.0)  # azimuth and elevation in degrees, oblique to all principal axes


def main(arguments) -> int:
    parser = argparse.ArgumentParser(prog="dev.py bench systems", description=__doc__)
    parser.add_argument("--volume", nargs="*", choices=("shells", *REAL), help="only these")
    parser.add_argument("--system", nargs="*", choices=list(SYSTEMS), help="only these; the first is the reference")
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--quality", choices=list(QUALITY_PRESETS), default="standard")
    parser.add_argument("--perspective", action="store_true")
    parser.add_argument("--no-shading", action="store_true")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--probes", type=int, default=PROBES)
    parser.add_argument("--repeats", type=int, default=REPEATS)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    quality = Quality.preset(options.quality, classification="pre", threads=options.threads)
    reports = {}
    for name, volume, tf in scenes():
        if options.volume and name not in options.volume:
            continue
        size = (options.size, options.size)
        camera, matrix = turntable(volume, *VIEW, perspective=options.perspective, width=size[0], height=size[1])
        scene = Scene(volume, tf, camera, *size, volume_matrix=matrix, headlight=not options.no_shading)
        reports[name] = compare(scene, quality, options.system, options.probes, options.repeats)
        print(f"{name}, {options.quality}: " + "\n".join(table_lines(reports[name])) + "\n", flush=True)
    if options.json:
        options.json.write_text(json.dumps(reports, indent=1) + "\n", encoding="utf-8")
    return 0
