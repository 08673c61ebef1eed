"""The methods that the paper names on each volume: time, memory and error in one run."""

from __future__ import annotations

from rle_splat.comparison.compare import PROBES, REPEATS, compare, table_lines
from rle_splat.comparison.table import SYSTEMS
from rle_splat.scene import Quality, Scene
from rle_splat.view.turntable import turntable

from .run import Run, make_parser
from .scenes import REAL, scenes

VIEW = (35.0, 25.0)  # azimuth and elevation in degrees, oblique to all principal axes


def main(arguments) -> int:
    parser = make_parser(
        "dev.py bench systems", __doc__, volume={"choices": ("shells", *REAL)}, size=512, threads=0, probes=PROBES,
        repeats=REPEATS, quality={"nargs": None, "default": "standard"},
    )  # fmt: skip
    parser.add_argument("--system", nargs="*", choices=list(SYSTEMS), help="only these; the first is the reference")
    parser.add_argument("--perspective", action="store_true")
    parser.add_argument("--no-shading", action="store_true")
    options = parser.parse_args(arguments)
    quality = Quality.preset(options.quality, classification="pre", threads=options.threads)
    run, reports = Run("systems", arguments, options.threads), {}
    for name, volume, tf in scenes():
        if options.volume and name not in options.volume:
            continue
        size = (options.size, options.size)
        camera, matrix = turntable(volume, *VIEW, perspective=options.perspective)
        scene = Scene(volume, tf, camera, *size, volume_matrix=matrix, headlight=not options.no_shading)
        reports[name] = compare(scene, quality, options.system, options.probes, options.repeats)
        print(f"{name}, {options.quality}: " + "\n".join(table_lines(reports[name])) + "\n", flush=True)
    run.keep(volumes=reports)
    return 0
