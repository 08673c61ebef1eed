"""Error and frame time of short voxel records, against records of 16 bytes and against the truth.

All record sizes draw the same views in alternation, so that other load affects all equally.  Errors are levels of 1/255
of premultiplied scene-linear RGBA: against the picture of 16 bytes over all pixels of all views, and against T1
(classify, then interpolate) at random probe pixels.
"""

from __future__ import annotations

from dataclasses import replace
from statistics import median

import numpy as np

from rle_splat.accuracy.metrics import difference
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.comparison.medium import scene_medium
from rle_splat.comparison.probe_truth import probe_truth
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.scene import RECORDS, Quality
from rle_splat.volume.volume import Volume

from .data_sets import PAPER
from .frames import VIEWS, best_frame, view_scene
from .phantoms import FIELDS
from .run import Run, make_parser

REPEATS = 3
PROBES = 64  # per view
FIELD_SIZE = 128  # voxels a side of the synthetic fields
THIN_ALPHA, THIN_SLICES = 0.002, 256  # a medium for which a linear 8-bit alpha has an error of 59 levels


def compare_records(scenes, quality: Quality, probes: int = PROBES, repeats: int = REPEATS) -> list[dict]:
    """Compare the record sizes on several views of one volume.

    Parameters
    ----------
    scenes : list of Scene
        The views.
    quality : Quality
        The knobs.
    probes, repeats : int
        Probe pixels per view, and frames of which the fastest counts.

    Returns
    -------
    list of dict
        One JSON-ready row per record size.  ``against_16`` and ``t1``: RMSE and largest error in levels.  ``frame``:
        time of a frame over that with 16 bytes, the median over the views.
    """
    found = {record: {"against_16": [], "t1": [], "frame": []} for record in RECORDS}
    quality = quality.classified("pre")  # only classified voxels have records of different sizes
    for number, scene in enumerate(scenes):
        cache = StageCache()
        columns, rows, truth = probe_truth(scene_medium(scene, quality), probes, seed=number)
        knobs = {record: replace(quality, record=record) for record in RECORDS}
        pictures = {record: render(scene, knobs[record], cache=cache).rgba for record in RECORDS}
        times = {record: np.inf for record in RECORDS}
        for _ in range(repeats):
            for record in RECORDS:
                times[record] = min(times[record], best_frame(scene, knobs[record], 1, cache)[1])
        for record, rows_of in found.items():
            rows_of["against_16"].append((pictures[record], pictures[RECORDS[0]]))
            rows_of["t1"].append((pictures[record][rows, columns], truth))
            rows_of["frame"].append(times[record] / times[RECORDS[0]])
    return [
        {
            "record": record, "frame": median(rows_of["frame"]),
            **{name: _levels(*zip(*rows_of[name])) for name in ("against_16", "t1")},
        }
        for record, rows_of in found.items()
    ]  # fmt: skip


def _levels(pictures, references) -> dict:
    """RMSE and largest error over some pictures of one size."""
    found = difference(np.concatenate(pictures), np.concatenate(references))
    return {"rmse": found.rmse, "largest": found.largest}


def fields():
    """Yield name, volume and transfer function of unshaded synthetic media."""
    thin = TransferFunction(  # includes opaque values, so that the codes of a record must span all densities
        "thin", None, ((0, THIN_ALPHA), (150, THIN_ALPHA), (200, 1.0)), ((0, 1.0, 0.37, 0.61),), 1.0, None
    )
    yield "thin medium", Volume(np.full((64, THIN_SLICES, 64), 100, np.uint8), np.eye(4)), thin
    own_opacity = TransferFunction(
        "opacity", None, ((0.0, 0.0), (1.0, 1.0)), ((0.0, 0.9, 0.4, 0.1), (0.3, 0.2, 0.7, 0.4), (0.6, 0.1, 0.2, 1.0)),
        1.0, None,
    )  # fmt: skip
    for name, field in FIELDS.items():
        yield f"{name} shell", Volume(field(FIELD_SIZE), np.eye(4)), own_opacity


def header() -> str:
    """The heading of the table."""
    short = [f"{record} B" for record in RECORDS[1:]]
    return (
        f"{'':<24}{'':<10}" + "".join(f"{f'{name} against 16':>18}" for name in short)
        + "".join(f"{f'T1, {record} B':>16}" for record in RECORDS)
        + f"   {'frame, against 16':>{8 * len(short)}}\n"
        + f"{'volume':<24}{'quality':<10}" + f"{'RMSE':>10}{'max':>8}" * len(short)
        + f"{'RMSE':>9}{'max':>7}" * len(RECORDS) + "   " + "".join(f"{name:>8}" for name in short)
    )  # fmt: skip


def line(name: str, quality: str, rows: list[dict]) -> str:
    """One line of the table from the result of ``compare_records``."""
    against = "".join(f"{row['against_16']['rmse']:10.3f}{row['against_16']['largest']:8.2f}" for row in rows[1:])
    truth = "".join(f"{row['t1']['rmse']:9.3f}{row['t1']['largest']:7.2f}" for row in rows)
    return f"{name:<24}{quality:<10}{against}{truth}   " + "".join(f"{row['frame']:8.2f}" for row in rows[1:])


def _volumes(options):
    """Yield name, volume, transfer function, and whether it is shaded."""
    if not options.no_fields:
        yield from ((*field, False) for field in fields())
    chosen = PAPER if options.data is None else [data for data in PAPER if data.name in options.data]
    yield from ((*data.load(), True) for data in chosen)


def main(arguments) -> int:
    parser = make_parser(
        "dev.py bench records", __doc__, quality=["standard"], size=512, threads=1, views=len(VIEWS), repeats=REPEATS,
        probes=PROBES,
    )  # fmt: skip
    parser.add_argument("--data", nargs="*", choices=[data.name for data in PAPER], help="only these data sets")
    parser.add_argument("--no-fields", action="store_true", help="skip the synthetic media")
    options = parser.parse_args(arguments)
    run = Run("records", arguments, options.threads)
    print(f"{options.size} x {options.size}, orthographic, {options.views} view(s)\n\n{header()}")
    for name, volume, tf, shaded in _volumes(options):
        scenes = [view_scene(volume, tf, view, options.size, shaded=shaded) for view in VIEWS[: options.views]]
        for quality in options.quality:
            knobs = Quality.preset(quality, threads=options.threads)
            rows = compare_records(scenes, knobs, options.probes, options.repeats)
            run.rows.append({"volume": name, "quality": quality, "records": rows})
            print(line(name, quality, rows), flush=True)
    print("\nframe: splat + warp over that of 16 bytes, drawn in alternation.")
    run.keep()
    return 0
