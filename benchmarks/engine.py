"""The engine's table: time and error of a frame by quality, shading and projection, beside VTK's ray caster.

Times are milliseconds, medians over the views of the best of a few frames; ratios are within this run.  Errors are
levels, 1/255, of premultiplied scene-linear RGBA at random probe pixels of all views: against T2, the interpolated
scalar classified, which is what the qualities and VTK claim; and against T1, the classified medium interpolated, which
is what the paper's order claims, and what no other should be expected to show.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np

from rle_splat.accuracy.lighting import shading_of
from rle_splat.accuracy.metrics import difference
from rle_splat.accuracy.truths import truth
from rle_splat.kept import Kept
from rle_splat.named_systems.judge import TOLERANCE, probe_truth
from rle_splat.named_systems.medium import scene_medium
from rle_splat.render import render
from rle_splat.scene import Quality

from .accuracy import fill
from .data_sets import PAPER
from .frames import VIEWS, Neighbours, best_frame, circumstances, describe, view_scene
from .scenes import REAL, scenes
from .vtk_caster import VTK_PROBLEM, VtkCaster

PAGE = Path(__file__).resolve().parents[1] / "docs" / "benchmarks.md"
REPEATS = 3
PROBES = 64  # per view
PAPER_LIKE = "paper-like"
QUALITIES = ("draft", PAPER_LIKE, "standard", "fine", "strict")
COLUMNS = (
    ("frame", "frame_ms"), ("splat", "splat_ms"), ("warp", "warp_ms"), ("encode", "encode_ms"), ("shade", "shade_ms"),
)  # fmt: skip


def quality_of(name: str, threads: int) -> Quality:
    """A preset; or the paper's pipeline, one sheet pixel per voxel in slice planes, on the convergent model."""
    if name == PAPER_LIKE:
        return replace(Quality.paper(threads=threads), model="extinction", length_correction=True, name=PAPER_LIKE)
    return Quality.preset(name, threads=threads)


def measure(
    volume, tf, *, size: int, threads: int, perspective: bool, shaded: bool, qualities=QUALITIES, views=VIEWS,
    repeats: int = REPEATS, probes: int = PROBES, with_vtk: bool = True,
) -> list[dict]:
    """One JSON-ready row per quality."""
    kept = Kept()
    times = {name: [] for name in qualities}
    pictures = {name: [] for name in (*qualities, "vtk")}
    kept_fractions, truths = {}, {"t1": [], "t2": []}
    caster, vtk_ms = None, []
    for number, view in enumerate(views):
        scene = view_scene(volume, tf, view, size, perspective, shaded)
        columns, rows, true = probe_truth(scene_medium(scene, quality_of(PAPER_LIKE, threads)), probes, seed=number)
        truths["t1"].append(true)
        truths["t2"].append(scalar_truth(scene, columns, rows))
        for name in qualities:
            quality = quality_of(name, threads)
            render(scene, quality, kept=kept)  # tables are made, and whatever compiles lazily
            rendering, _ = best_frame(scene, quality, repeats, kept)
            times[name].append(rendering.report["stages_ms"])
            kept_fractions[name] = rendering.report["volume"]["visible_fraction"]
            pictures[name].append(rendering.rgba[rows, columns])
        if with_vtk and not VTK_PROBLEM:
            caster = caster or VtkCaster(scene, shaded, quality.threads or rendering.report["threads"])
            picture, spent = caster.draw(scene, repeats)
            pictures["vtk"].append(picture[rows, columns])
            vtk_ms.append(spent)
    if caster:
        caster.close()
    common = {
        "size": size, "threads": rendering.report["threads"], "perspective": perspective, "shaded": shaded,
        "vtk_ms": median(vtk_ms) if vtk_ms else None,
        "vtk_t2": _error(pictures["vtk"], truths["t2"]) if vtk_ms and not shaded else None,
    }
    prepared = {
        classification: _preparation(scene, Quality(classification=classification, threads=threads))
        for classification in {quality_of(name, threads).classification for name in qualities}
    }
    return [
        _row(name, times[name], pictures[name], truths, vtk_ms, {
            "classification": quality_of(name, threads).classification, "kept_fraction": kept_fractions[name],
            **common, **prepared[quality_of(name, threads).classification],
        })
        for name in qualities
    ]  # fmt: skip


def _preparation(scene, quality) -> dict:
    """Milliseconds of what comes before a frame, compiled and warm: classify, shade, encode one axis (their mean).

    As the road does it, in a picture of which nothing is kept: with ``pre``, light falls on voxels while their records
    are written, so that shading them is in part the encoding's.
    """
    best = {}
    for _ in range(2):
        report = render(scene, quality, kept=Kept()).report
        spent = {stage: report["stages_ms"][stage] for stage in ("classify", "shade", "encode")}
        spent["encode"] /= len(report["memory_bytes"]["axes_held"])
        best = {f"{stage}_ms": min(ms, best.get(f"{stage}_ms", ms)) for stage, ms in spent.items()}
    return best


def _row(name, stages, pictures, truths, vtk_ms, common) -> dict:
    frames = [view["splat"] + view["warp"] for view in stages]
    return {
        "quality": name, **common,
        "frame_ms": median(frames), "splat_ms": median(view["splat"] for view in stages),
        "warp_ms": median(view["warp"] for view in stages),
        "against_vtk": median(ours / theirs for ours, theirs in zip(frames, vtk_ms)) if vtk_ms else None,
        "t1": _error(pictures, truths["t1"]), "t2": _error(pictures, truths["t2"]),
    }  # fmt: skip


def _error(pictures, truths) -> dict | None:
    """RMSE and largest error, levels, over the probes of all views; None without a truth."""
    if not truths:
        return None
    found = difference(np.concatenate(pictures), np.concatenate(truths))
    return {"rmse": found.rmse, "largest": found.largest}


def scalar_truth(scene, columns, rows) -> np.ndarray:
    """T2 at probe pixels, (N, 4) float64."""
    pixels = (columns + 0.5, rows + 0.5)
    return truth(scene, "T2", pixels=pixels, tolerance=TOLERANCE, **shading_of(scene, "T2"))[0]


def header() -> str:
    """The table's first line."""
    return (
        f"{'volume':<12}{'p':>6}  {'projection':<13}{'colours':<10}{'quality':<11}{'classified':<11}"
        + "".join(f"{title:>8}" for title, _ in COLUMNS)
        + f"   {'T1 RMSE':>8}{'max':>7}{'T2 RMSE':>9}{'max':>7}   {'VTK':>8}{'ours/VTK':>10}{'VTK T2':>8}"
    )


def line(name: str, row: dict) -> str:
    """One row of the table."""

    def cell(value, width, digits=1):
        return f"{'-':>{width}}" if value is None else f"{value:{width}.{digits}f}"

    def errors(found, width):
        found = found or {"rmse": None, "largest": None}
        return cell(found["rmse"], width, 2) + cell(found["largest"], 7)

    vtk = f"{'not here':>26}"
    if row["vtk_ms"] is not None:
        rmse = (row["vtk_t2"] or {"rmse": None})["rmse"]
        vtk = cell(row["vtk_ms"], 8) + cell(row["against_vtk"], 10, 2) + cell(rmse, 8, 2)
    return (
        f"{name:<12}{row['kept_fraction']:6.1%}  {'perspective' if row['perspective'] else 'orthographic':<13}"
        f"{'shaded' if row['shaded'] else 'unshaded':<10}{row['quality']:<11}{row['classification']:<11}"
        + "".join(cell(row[key], 8) for _, key in COLUMNS)
        + f"   {errors(row['t1'], 8)}{errors(row['t2'], 9)}   {vtk}"
    )


def of_paper(names):
    """Like ``scenes``: the shells, and the data sets of bench paper with the transfer functions committed for them."""
    if not names or "shells" in names:
        yield from scenes(("shells",))
    yield from (data.load() for data in PAPER if not names or data.name in names)


def markdown(table, where: dict) -> str:
    """The rows of a table, one line for each volume, projection and colours, and where they came about."""
    qualities = list(dict.fromkeys(row["quality"] for row in table))
    heads = ["", "p", "px", "threads", *qualities, "VTK", "encode"]
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    groups: dict = {}
    for row in table:
        name = ", ".join((
            row["volume"], "perspective" if row["perspective"] else "orthographic",
            "shaded" if row["shaded"] else "unshaded",
        ))  # fmt: skip
        groups.setdefault((name, row["size"], row["threads"]), {})[row["quality"]] = row
    for (name, size, threads), rows in groups.items():
        first = next(iter(rows.values()))
        cells = [
            "-" if quality not in rows else f"{rows[quality]['frame_ms']:.1f}"
            + (f" ({rows[quality]['against_vtk']:.2f})" if rows[quality]["against_vtk"] is not None else "")
            for quality in qualities
        ]  # fmt: skip
        vtk = "-" if first["vtk_ms"] is None else f"{first['vtk_ms']:.0f}"
        encode = ", ".join(dict.fromkeys(f"{row['encode_ms']:.1f}" for row in rows.values()))
        cells = [name, f"{first['kept_fraction']:.1%}", str(size), str(threads), *cells, vtk, encode]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + f"\n\n{describe(where)} Others kept {where['others_busy_cores'] or 0.0:.2f} cores busy."


def main(arguments) -> int:
    parser = argparse.ArgumentParser(prog="dev.py bench engine", description=__doc__)
    names = tuple(dict.fromkeys(("shells", *(data.name for data in PAPER), *REAL)))
    parser.add_argument("--volume", nargs="*", choices=names, help="only these")
    parser.add_argument(
        "--presets", action="store_true", help="presets in place of bench paper's data sets and transfer functions"
    )
    parser.add_argument("--quality", nargs="*", choices=QUALITIES, default=QUALITIES)
    parser.add_argument("--projection", nargs="*", choices=("orthographic", "perspective"))
    parser.add_argument("--colours", nargs="*", choices=("unshaded", "shaded"))
    parser.add_argument("--size", type=int, nargs="*", default=[512], help="pixels a side, one table each")
    parser.add_argument("--threads", type=int, nargs="*", default=[2], help="one table each")
    parser.add_argument("--views", type=int, default=len(VIEWS), help="how many of the views")
    parser.add_argument("--repeats", type=int, default=REPEATS)
    parser.add_argument("--probes", type=int, default=PROBES, help="probe pixels a view")
    parser.add_argument("--no-vtk", action="store_true")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--write-docs", metavar="NAME", help="put the table between the marks NAME of the docs' page")
    options = parser.parse_args(arguments)
    if VTK_PROBLEM and not options.no_vtk:
        print(f"VTK is not here ({VTK_PROBLEM}); its columns stay empty.")
    table, where, neighbours = [], circumstances(max(options.threads)), Neighbours()
    print(describe(where))
    for threads in options.threads:
        for size in options.size:
            print(f"\n{size} x {size}, {threads} thread(s), {options.views} view(s), {options.probes} probes a view")
            print(header())
            for name, volume, tf in scenes(options.volume) if options.presets else of_paper(options.volume):
                for projection in options.projection or ("orthographic", "perspective"):
                    for colours in options.colours or ("unshaded", "shaded"):
                        rows = measure(
                            volume, tf, size=size, threads=threads, perspective=projection == "perspective",
                            shaded=colours == "shaded", qualities=tuple(options.quality),
                            views=VIEWS[: max(options.views, 1)], repeats=options.repeats, probes=options.probes,
                            with_vtk=not options.no_vtk,
                        )  # fmt: skip
                        for row in rows:
                            table.append({"volume": name, **row})
                            print(line(name, row), flush=True)
    print(
        "\nframe = splat + warp. VTK: vtkFixedPointVolumeRayCastMapper, one sample a voxel, rays only. It shades what "
        "has no gradient by ambient light alone, so shaded, it is compared in time and not in error."
    )
    print(neighbours.describe())
    where["others_busy_cores"] = neighbours.cores()
    if options.write_docs:
        filled = fill(PAGE.read_text(encoding="utf-8"), {options.write_docs: markdown(table, where)})
        PAGE.write_text(filled, encoding="utf-8")
    if options.json:
        options.json.write_text(json.dumps({"circumstances": where, "rows": table}, indent=1) + "\n", encoding="utf-8")
    return 0
