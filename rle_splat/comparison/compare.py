"""All systems on one scene: time, memory, and error against the truth T1 at probe pixels."""

from __future__ import annotations

import time

from ..accuracy.metrics import difference
from ..runtime.jit import thread_count
from ..runtime.steps import Progress, drain
from ..scene import Quality, RleSplatError, Scene
from .medium import ShadedScene, scene_medium
from .probe_truth import probe_truth
from .system import System
from .table import SYSTEMS, system_of

PROBES = 256
REPEATS = 3  # frames timed after one that compiles and warms up; the best counts


def compare(scene: Scene, quality: Quality, names=None, probes: int = PROBES, repeats: int = REPEATS) -> dict:
    """The report of ``compare_steps``, without progress."""
    return drain(compare_steps(scene, quality, names, probes, repeats))


def compare_steps(scene: Scene, quality: Quality, names=None, probes: int = PROBES, repeats: int = REPEATS):
    """Compare systems on one scene.  Generator of Progress.

    Parameters
    ----------
    names : sequence of str, optional
        Of SYSTEMS, by default all.  The others are measured against the first one.
    probes : int
        Probe pixels.
    repeats : int
        Frames timed.

    Returns
    -------
    dict
        JSON-ready report.  A system that cannot draw the scene has the reason in its entry, under ``refused``.  Errors
        are in levels, 1/255: of the channels that the system claims to draw as T1, ``judged``, and of alpha.

    Raises
    ------
    RleSplatError
        For unknown systems, and scenes that the systems cannot draw.
    """
    systems = [system_of(name) for name in (SYSTEMS if names is None else names)]
    if probes < 1 or repeats < 1:
        raise RleSplatError("Comparing takes one sample pixel and one repeat at least.")
    yield Progress(0.0, "Classifying")
    scene_medium(scene, quality)  # compiles the kernels, so that the times of the shared stages are without that
    medium = scene_medium(scene, quality)
    yield Progress(0.05, "Integrating the reference")
    began = time.perf_counter()
    truth = probe_truth(medium, probes)
    truth_ms = 1e3 * (time.perf_counter() - began)
    entries = []
    for number, system in enumerate(systems):
        yield Progress(0.15 + 0.85 * number / len(systems), system.title)
        entries.append(_measure(system, medium, quality, truth, repeats))
    reference = next((entry for entry in entries if "refused" not in entry), None)
    for entry in entries:
        if "refused" not in entry:
            entry["time_ratio"] = entry["draw_ms"] / reference["draw_ms"]
            entry["memory_ratio"] = entry["memory_bytes"]["total"] / max(reference["memory_bytes"]["total"], 1)
    classified = medium.classified
    return {
        "image": {"width": scene.width, "height": scene.height},
        "volume": {
            "shape_xyz": list(classified.shape_xyz), "visible_voxels": classified.visible_voxels,
            "visible_fraction": classified.visible_fraction,
        },
        "quality": quality.name, "threads": thread_count(quality.threads), "repeats": repeats,
        "truth": {"name": "T1", "probes": len(truth[0]), "ms": truth_ms},
        "shared_ms": medium.stages_ms, "measured_against": None if reference is None else reference["name"],
        "systems": entries,
    }  # fmt: skip


def _measure(system: System, medium: ShadedScene, quality: Quality, truth, repeats: int) -> dict:
    """One system's entry of the report."""
    entry = {
        "name": system.name, "title": system.title, "reference": system.reference, "differs": system.differs,
        "judged": system.channels,
    }  # fmt: skip
    try:
        system.prepare(medium, quality).draw()  # compiles the kernels and warms up
    except RleSplatError as refusal:
        return {**entry, "refused": str(refusal)}
    began = time.perf_counter()
    prepared = system.prepare(medium, quality)
    prepare_ms = 1e3 * (time.perf_counter() - began)
    best = None
    for _ in range(repeats):
        began = time.perf_counter()
        rendering = prepared.draw()
        spent = 1e3 * (time.perf_counter() - began)
        best = spent if best is None else min(best, spent)
    columns, rows, true = truth
    found = rendering.rgba[rows, columns]
    channels = slice(0, 4) if system.channels == "rgba" else slice(3, 4)
    error, alpha = difference(found[:, channels], true[:, channels]), difference(found[:, 3], true[:, 3])
    return {
        **entry, "prepare_ms": prepare_ms, "draw_ms": best,
        "memory_bytes": {**prepared.memory_bytes, "total": prepared.total_bytes},
        "error": {"rmse": error.rmse, "largest": error.largest, "alpha_rmse": alpha.rmse}, "notes": prepared.notes,
    }  # fmt: skip


def table_lines(report: dict) -> list[str]:
    """The report as lines of text for people."""
    volume, image = report["volume"], report["image"]
    lines = [
        f"{' x '.join(map(str, volume['shape_xyz']))} voxels, {volume['visible_fraction']:.1%} not transparent; "
        f"{image['width']} x {image['height']} pixels; {report['threads']} thread(s).",
        f"{'system':<20}{'prepare ms':>12}{'frame ms':>10}{'x':>8}{'memory MiB':>12}{'x':>8}{'RMSE':>8}{'max':>8}"
        f"{'of':>6}{'alpha':>8}",
    ]
    for entry in report["systems"]:
        if "refused" in entry:
            lines.append(f"{entry['name']:<20}  {entry['refused']}")
            continue
        error, memory = entry["error"], entry["memory_bytes"]["total"] / 2**20
        lines.append(
            f"{entry['name']:<20}{entry['prepare_ms']:12.1f}{entry['draw_ms']:10.1f}{entry['time_ratio']:8.2f}"
            f"{memory:12.1f}{entry['memory_ratio']:8.2f}{error['rmse']:8.2f}{error['largest']:8.1f}"
            f"{entry['judged']:>6}{error['alpha_rmse']:8.2f}"
        )
    lines.append(
        f"x: against {report['measured_against']}. Errors in 8-bit steps against T1 at {report['truth']['probes']} "
        f"random pixels. Frame: the best of {report['repeats']}, compiled and warm."
    )
    return lines
