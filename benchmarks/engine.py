"""Time and error of a frame by quality, shading and projection, compared with VTK and VolPack.

Times are milliseconds, medians over the views of the fastest of a few frames of a camera that moves; "whole" is the
whole call, measured from outside, and ratios are of whole calls within this run.  Errors are
levels of 1/255 of premultiplied scene-linear RGBA at random probe pixels of all views.  T2 (interpolate, then classify)
is the truth for the qualities and VTK.  T1 (classify, then interpolate) is the truth for the paper's order and VolPack;
the others are not expected to match it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np

from rle_splat.accuracy.lighting import shading_of
from rle_splat.accuracy.metrics import difference
from rle_splat.accuracy.truths import truth
from rle_splat.comparison.medium import scene_medium
from rle_splat.comparison.probe_truth import TOLERANCE, probe_truth
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.steps import FRAME
from rle_splat.scene import Quality

from .accuracy import fill
from .data_sets import PAPER
from .engine_words import NOTES, header, line, markdown, ratios
from .frames import VIEWS, frame_ms, moved_scenes, quickest_call, time_by_processor, view_scene
from .peers import PEERS, Peer
from .run import Run, make_parser
from .scenes import REAL, scenes

PAGE = Path(__file__).resolve().parents[1] / "docs" / "explanation" / "benchmarks.md"
REPEATS = 3
PROBES = 64  # per view
PAPER_LIKE = "paper-like"
QUALITIES = ("draft", PAPER_LIKE, "standard", "fine", "strict")


def quality_of(name: str, threads: int) -> Quality:
    """A preset, or the paper's pipeline (one sheet pixel per voxel, slice planes) with the extinction model."""
    if name == PAPER_LIKE:
        return replace(Quality.paper(threads=threads), model="extinction", length_correction=True, name=PAPER_LIKE)
    return Quality.preset(name, threads=threads)


def measure(
    volume, tf, *, size: int, threads: int, perspective: bool, shaded: bool, qualities=QUALITIES, views=VIEWS,
    repeats: int = REPEATS, probes: int = PROBES, peers=(),
) -> list[dict]:  # fmt: skip
    """Measure one volume.

    ``qualities`` are names for ``quality_of``; of ``repeats`` frames the fastest counts, and ``probes`` are pixels per
    view.  One JSON-ready row per quality, then one per peer that is installed and supports the projection.
    """
    cache = StageCache()
    beside = [_Beside(peer, shaded) for peer in peers if not peer.absence(perspective)]
    reports = {name: [] for name in qualities}
    pictures = {name: [] for name in qualities}
    kept_fractions, truths = {}, {"t1": [], "t2": []}
    for number, view in enumerate(views):
        scene = view_scene(volume, tf, view, size, perspective, shaded)
        columns, rows, true = probe_truth(scene_medium(scene, quality_of(PAPER_LIKE, threads)), probes, seed=number)
        truths["t1"].append(true)
        truths["t2"].append(scalar_truth(scene, columns, rows))
        for name in qualities:
            quality = quality_of(name, threads)
            picture = render(scene, quality, cache=cache).rgba  # makes the tables and compiles kernels
            moved = moved_scenes(volume, tf, view, size, perspective, shaded, repeats)
            rendering, whole = quickest_call(moved, quality, cache)
            reports[name].append({**rendering.report, "whole_ms": whole})
            kept_fractions[name] = rendering.report["volume"]["visible_fraction"]
            pictures[name].append(picture[rows, columns])
        for other in beside:
            other.draw(scene, rendering.report["threads"], repeats, (rows, columns))
    for other in beside:
        other.caster.close()
    common = {"size": size, "threads": rendering.report["threads"], "perspective": perspective, "shaded": shaded}
    prepared = {
        classification: _preparation(scene, Quality(classification=classification, threads=threads))
        for classification in {quality_of(name, threads).classification for name in qualities}
    }
    absent = {peer.name: peer.absence(perspective) for peer in peers if peer.absence(perspective)}
    ours = [
        _row(name, reports[name], pictures[name], truths, beside, absent, {
            "classification": quality_of(name, threads).classification, "kept_fraction": kept_fractions[name],
            **common, **prepared[quality_of(name, threads).classification],
        })
        for name in qualities
    ]  # fmt: skip
    return ours + [other.row(truths, common) for other in beside]


class _Beside:
    """The measurement of one peer on one volume."""

    def __init__(self, peer: Peer, shaded: bool):
        self.peer, self._shaded = peer, shaded
        self.caster, self.spent, self._pictures = None, [], []

    def draw(self, scene, threads: int, repeats: int, probes) -> None:
        self.caster = self.caster or self.peer.make(scene, self._shaded, threads)
        picture, spent = self.caster.draw(scene, repeats)
        self._pictures.append(picture[probes])
        self.spent.append(spent)

    def row(self, truths, common) -> dict:
        comparable = self.peer.same_colors or not self._shaded
        return {
            "quality": self.peer.name, "peer": True, "classification": self.peer.classification, "kept_fraction": None,
            **common, "against": {}, "whole_ms": median(one.whole for one in self.spent),
            "frame_ms": median(one.frame for one in self.spent),
            **dict.fromkeys(f"{stage}_ms" for stage in FRAME),
            "shade_ms": None, "encode_ms": getattr(self.caster, "classify_ms", None),
            **{name: _error(self._pictures, true) if comparable else None for name, true in truths.items()},
        }  # fmt: skip


def _preparation(scene, quality) -> dict:
    """Milliseconds of the stages before a frame: classify, shade, and encode for one axis (the mean of three).

    Kernels are loaded and the stage cache is empty.  Writing light into the records counts as shading.
    """
    best = {}
    for _ in range(2):
        report = render(scene, quality, cache=StageCache()).report
        spent = {stage: report["stages_ms"][stage] for stage in ("classify", "shade", "encode")}
        spent["encode"] /= len(report["memory_bytes"]["axes_held"])
        best = {f"{stage}_ms": min(ms, best.get(f"{stage}_ms", ms)) for stage, ms in spent.items()}
    return best


def _row(name, reports, pictures, truths, beside, absent, common) -> dict:
    wholes = [report["whole_ms"] for report in reports]
    stages = {f"{stage}_ms": median(r["stages_ms"][stage] for r in reports) for stage in FRAME}
    return {
        "quality": name, "peer": False, **common,
        "whole_ms": median(wholes), "frame_ms": median(frame_ms(report) for report in reports), **stages,
        "against": {
            other.peer.name: median(ours / theirs.whole for ours, theirs in zip(wholes, other.spent))
            for other in beside
        } | absent,
        "t1": _error(pictures, truths["t1"]), "t2": _error(pictures, truths["t2"]),
    }  # fmt: skip


def _error(pictures, truths) -> dict:
    """RMSE and largest error, levels, over the probes of all views."""
    found = difference(np.concatenate(pictures), np.concatenate(truths))
    return {"rmse": found.rmse, "largest": found.largest}


def scalar_truth(scene, columns, rows) -> np.ndarray:
    """(n, 4) float64: truth T2 at probe pixels, premultiplied scene-linear."""
    pixels = (columns + 0.5, rows + 0.5)
    return truth(scene, "T2", pixels=pixels, tolerance=TOLERANCE, **shading_of(scene, "T2"))[0]


def of_paper(names):
    """As ``scenes``: the shells, and the data sets of bench paper with their own transfer functions."""
    if not names or "shells" in names:
        yield from scenes(("shells",))
    yield from (data.load() for data in PAPER if not names or data.name in names)


def main(arguments) -> int:
    names = tuple(dict.fromkeys(("shells", *(data.name for data in PAPER), *REAL)))
    parser = make_parser(
        "dev.py bench engine", __doc__, volume={"choices": names}, views=len(VIEWS), repeats=REPEATS, probes=PROBES,
        quality={"choices": QUALITIES, "default": QUALITIES},
        size={"nargs": "*", "default": [512], "help": "pixels a side, one table each"},
        threads={"nargs": "*", "default": [2], "help": "one table each; 1 alone is timed by the processor"},
    )  # fmt: skip
    parser.add_argument(
        "--presets", action="store_true", help="use presets instead of bench paper's data sets and transfer functions"
    )
    parser.add_argument("--projection", nargs="*", choices=("orthographic", "perspective"))
    parser.add_argument("--colors", dest="colors", nargs="*", choices=("unshaded", "shaded"))
    parser.add_argument("--peers", nargs="*", choices=PEERS, default=tuple(PEERS), help="only these, or none")
    parser.add_argument("--write-docs", metavar="NAME", help="write the table into the block NAME of the page")
    options = parser.parse_args(arguments)
    peers = [PEERS[name] for name in options.peers]
    if options.threads == [1]:
        time_by_processor()
    for peer in {peer.problem: peer for peer in reversed(peers) if peer.problem}.values():
        print(f"{peer.name} is not installed ({peer.problem}); run {peer.remedy}")
    key = ("volume", "quality", "size", "threads", "perspective", "shaded")
    run = Run("engine", arguments, max(options.threads), key=key, time="whole_ms")
    for threads in options.threads:
        for size in options.size:
            print(f"\n{size} x {size}, {threads} thread(s), {options.views} view(s), {options.probes} probes a view")
            print(header())
            for name, volume, tf in scenes(options.volume) if options.presets else of_paper(options.volume):
                for projection in options.projection or ("orthographic", "perspective"):
                    for colors in options.colors or ("unshaded", "shaded"):
                        rows = measure(
                            volume, tf, size=size, threads=threads, perspective=projection == "perspective",
                            shaded=colors == "shaded", qualities=tuple(options.quality),
                            views=VIEWS[: max(options.views, 1)], repeats=options.repeats, probes=options.probes,
                            peers=peers,
                        )  # fmt: skip
                        for row in rows:
                            run.rows.append({"volume": name, **row})
                            print(line(name, row), flush=True)
    print(NOTES)
    for text in ratios(run.rows):
        print(text)
    run.keep()
    if options.write_docs:
        filled = fill(PAGE.read_text(encoding="utf-8"), {options.write_docs: markdown(run.rows, run.where)})
        PAGE.write_text(filled, encoding="utf-8")
    return 0
