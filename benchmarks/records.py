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
from rle_splat.comparison.medium import scene_medium
from rle_splat.comparison.probe_truth import probe_truth
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.scene import RECORDS, Quality

from .frames import best_frame

REPEATS = 3
PROBES = 64  # per view


def compare_records(scenes, quality: Quality, probes: int = PROBES, repeats: int = REPEATS) -> list[dict]:
    """Compare the record sizes on several views of one volume; of ``repeats`` frames the fastest counts.

    One JSON-ready row per record size.  ``against_16`` and ``t1``: RMSE and largest error in levels.  ``frame``: time
    of a frame over that with 16 bytes, the median over the views.
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
