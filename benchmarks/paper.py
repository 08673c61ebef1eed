"""The paper's Table 1 and Table 2 next to ours: memory of the run-length tables, and the speedup by skipping.

Memory is given for every size of voxel record, with its error in levels.  "Without" run lengths means the same compiled
loops, threads and termination on tables in which every voxel counts as visible.  "Westover" is his splatting with
footprint tables, voxel by voxel.
"""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from statistics import median

import numpy as np

from rle_splat.comparison.medium import scene_medium
from rle_splat.comparison.ours import every_voxel
from rle_splat.comparison.westover import prepare as prepare_westover
from rle_splat.encode.encode import encode
from rle_splat.encode.stored import StoredVolume
from rle_splat.pipeline.scan_source import classify_and_shade
from rle_splat.runtime.steps import Clock
from rle_splat.scene import QUALITY_PRESETS, RECORDS, Quality
from rle_splat.splat.pixel_block import BLOCK
from rle_splat.view.eye import index_view
from rle_splat.view.principal_axis import dominant_axis
from rle_splat.volume.axes import AXES

from .data_sets import PAPER, DataSet
from .frames import VIEWS, best_frame, frame_ms, same_view, view_scene
from .paper_words import explain, record_errors, table_1, table_2
from .records import compare_records
from .run import Run, make_parser

REPEATS = 3
SLOW_REPEATS = 2  # for frames that take a large part of a second
# The quality for the errors of short records; the paper's own pipeline has far larger errors by itself.
ERROR_QUALITY = "standard"


def quality_of(name: str, threads: int) -> Quality:
    """The paper's own pipeline, or a pre-classified preset."""
    made = Quality.paper if name == "paper" else partial(Quality.preset, name, classification="pre")
    return made(threads=threads)


def measure(
    data: DataSet, volume, tf, quality: Quality, size: int, views=VIEWS, repeats: int = REPEATS, westover: bool = True,
    errors: bool = True,
) -> dict:  # fmt: skip
    """Measure one data set for both tables; of ``repeats`` frames the fastest counts.

    JSON-ready; milliseconds are medians over the views.  ``memory_bytes`` maps a record size to the bytes of each
    table, and their total, for three principal axes.
    """
    scenes = [view_scene(volume, tf, view, size) for view in views]
    clock = Clock()
    classified, colors = classify_and_shade(scenes[0], quality, clock)
    unlimited = replace(quality, termination=0.0)
    memory, times, tables = {record: {} for record in RECORDS}, [], None
    for axis in range(3):
        for record, sizes in memory.items():
            made = encode(classified, colors, axis, quality.model, record=record, threads=quality.threads)
            tables = made if record == quality.record else tables
            for name, count in (*made.table_bytes.items(), ("total", made.nbytes)):
                sizes[name] = sizes.get(name, 0) + count
        mine = [scene for scene in scenes if principal_axis(scene) == axis]
        if not mine:
            continue
        began = time.perf_counter()
        encode(classified, colors, axis, quality.model, record=quality.record, threads=quality.threads)
        encode_ms = 1e3 * (time.perf_counter() - began)
        dense = every_voxel(tables)
        for scene in mine:
            view = {"axis": axis, "encode_ms": encode_ms}
            for name, encoded, count in (("rle", tables, repeats), ("all", dense, min(repeats, SLOW_REPEATS))):
                for ending, knobs in (("ms", quality), ("unlimited_ms", unlimited)):
                    report = _frame(volume, classified, tf, scene, encoded, knobs, count)
                    view[f"{name}_{ending}"] = frame_ms(report)
                    view[f"{name}_splat_{ending}"] = report["stages_ms"]["splat"]
            times.append(view)
        del dense
    row = {name: median(view[name] for view in times) for name in times[0] if name != "axis"}
    # Ratios are computed per view, where both sides draw the same pixels.
    for name, part in (
        ("speedup", "ms"), ("splat_speedup", "splat_ms"), ("unlimited_splat_speedup", "splat_unlimited_ms")
    ):  # fmt: skip
        row[name] = median(view[f"all_{part}"] / view[f"rle_{part}"] for view in times)
    kept = classified.visible_voxels
    return {
        "name": data.name, "shape_xyz": list(volume.shape_xyz), "voxels": volume.voxels.size, "kept_voxels": kept,
        "kept_fraction": classified.visible_fraction, "bound": 1.0 / max(classified.visible_fraction, 1e-12),
        "covered_fractions": covered_fractions(classified),
        "memory_bytes": memory, **({"record_errors": _record_errors(scenes, quality)} if errors else {}),
        **row, **(_westover(volume, tf, quality, size, views) if westover else {}), "views": times,
    }  # fmt: skip


def _record_errors(scenes, quality) -> list[dict]:
    """``compare_records`` at the default quality, with the same threads."""
    exact = Quality.preset(ERROR_QUALITY, classification="pre", threads=quality.threads)
    return compare_records(scenes, exact, repeats=1)


def principal_axis(scene) -> int:
    """The principal axis (0, 1, 2 for x, y, z) of a scene with parallel rays."""
    view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    return int(dominant_axis(-view.eye[:3])[0])


def covered_fractions(classified) -> dict:
    """The fraction of the sheets that the footprints of kept voxels cover, with one sheet pixel per voxel.

    ``pixels``: fraction of the pixels with something to composite.  ``blocks``: fraction of the blocks of BLOCK pixels
    along a scanline that hold such a pixel.  The loop composites whole blocks, so this is the lower bound of its work.
    Both are means over the three principal axes.
    """
    nx, ny, nz = classified.shape_xyz
    rows = np.repeat(np.arange(nz * ny), np.diff(classified.row_start))
    kept = np.zeros((nz * ny, nx), bool)
    kept[rows, classified.column] = True
    kept = kept.reshape(nz, ny, nx)
    pixels, blocks = [], []
    for along, across, principal in AXES.values():
        cells = kept.transpose(2 - principal, 2 - across, 2 - along)  # slices, scanlines, voxels
        for axis in (1, 2):
            nothing = np.zeros_like(cells.take([0], axis))
            cells = np.concatenate((cells, nothing), axis) | np.concatenate((nothing, cells), axis)
        pixels.append(cells.mean())
        cells = np.pad(cells, ((0, 0), (0, 0), (0, -cells.shape[2] % BLOCK)))
        blocks.append(cells.reshape(*cells.shape[:2], -1, BLOCK).any(axis=3).mean())
    return {"pixels": float(np.mean(pixels)), "blocks": float(np.mean(blocks))}


def _frame(volume, classified, tf, scene, tables, quality, repeats) -> dict:
    """The report of one view's best frame, from ready-made tables."""
    stored = StoredVolume.of({tables.axis: tables}, volume.affine, volume.unit, classified.unit_length, tf.to_json())
    scene = same_view(scene, stored)
    best_frame(scene, quality, 1)  # compiles kernels
    return best_frame(scene, quality, repeats)[0].report


def _westover(volume, tf, quality, size, views) -> dict:
    """Milliseconds of Westover's splatting, of all voxels and of the visible ones; one view, because it is slow.

    It supports only the extinction model, and no early termination.
    """
    quality = Quality(classification="pre", threads=quality.threads)
    medium = scene_medium(view_scene(volume, tf, views[min(1, len(views) - 1)], size), quality)
    result = {}
    for name, cull in (("westover_all_ms", False), ("westover_visible_ms", True)):
        draw = prepare_westover(medium, quality, cull=cull).draw
        spent = []
        for _ in range(SLOW_REPEATS):
            began = time.perf_counter()
            draw()
            spent.append(1e3 * (time.perf_counter() - began))
        result[name] = min(spent)
    return result


def main(arguments) -> int:
    parser = make_parser(
        "dev.py bench paper", __doc__, size=512, threads=0, views=len(VIEWS), repeats=REPEATS,
        quality={"nargs": None, "choices": ("paper", *QUALITY_PRESETS), "default": "paper"},
    )  # fmt: skip
    parser.add_argument("--data", nargs="*", choices=[data.name for data in PAPER], help="only these data sets")
    parser.add_argument("--no-westover", action="store_true", help="skip Westover's splatting, which is slow")
    parser.add_argument("--no-errors", action="store_true", help="skip the errors of short voxel records")
    options = parser.parse_args(arguments)
    quality = quality_of(options.quality, options.threads)
    run, rows = Run("paper", arguments, options.threads), []
    for data in PAPER:
        if options.data and data.name not in options.data:
            continue
        called, volume, tf = data.load()
        row = measure(
            data, volume, tf, quality, options.size, VIEWS[: max(options.views, 1)], options.repeats,
            not options.no_westover, not options.no_errors,
        )  # fmt: skip
        rows.append((data, {**row, "called": called}))
        print(f"measured {called}", flush=True)
    print("\n" + "\n".join((
        f"Quality {quality.name}, {options.size} x {options.size}, orthographic, "
        f"median of {min(options.views, len(VIEWS))} view(s).",
        "", *table_1(rows), *([] if options.no_errors else ["", *record_errors(rows, ERROR_QUALITY)]),
        "", *table_2(rows), "",
        *(line for data, row in rows for line in explain(data, row)),
    )))  # fmt: skip
    run.rows = [row for _, row in rows]
    run.keep(quality=quality.name, size=options.size)
    return 0
