"""dev.py demo: the main job in real Blender, headless; pictures, .blend and report go to out/."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

from .blender_job import run_job
from .environments import any_bpy, ensure_bpy
from .places import OUT, Failure, say
from .sample import sample

SCAN_TITLE = "RLE SPLAT"


def _sample_options(facts: dict) -> dict:
    """The properties of rle_splat.import_volume for the sample's facts."""
    return {
        "shape": facts["shape"],
        "dtype": facts["dtype"],
        "byte_order": facts["byte_order"],
        "header_bytes": 0,
        "spacing": facts["spacing"],
        "modality": facts["modality"],
        "value_unit": facts.get("value_unit", ""),
        "preset": facts["preset"],
    }


def _show(name: str, volume: Path, options: dict, version: str) -> Path:
    """One volume in one scene, in a Blender process of its own; returns the folder with the results."""
    folder = OUT / "demo" / name
    say(f"Blender {version} shows {volume.name} (the first time, the kernels that the picture needs are compiled) ...")
    run_job(version, "demo_scene.py", folder, volume=str(volume), options=options, title=SCAN_TITLE)
    return folder


def demo(volumes) -> int:
    """Show the files given, or the sample."""
    started = time.monotonic()
    version = any_bpy()
    jobs = []
    for path in map(Path, volumes):
        if not path.exists():
            raise Failure(f"There is no {path}; give volumes such as scan.nii.gz, scan.raw.gz or smoke.vdb.")
        jobs.append((re.sub(r"\W+", "_", path.name.split(".")[0]), path.resolve(), {}))
    if not jobs:
        path, facts = sample(ensure_bpy(version))
        say(f"The sample is {facts['title']}.")
        jobs.append((path.stem, path, _sample_options(facts)))
    for name, path, options in jobs:
        folder = _show(name, path, options, version)
        report = json.loads((folder / "report.json").read_text())
        seconds = report["seconds"]
        say("  " + ", ".join(f"{key.replace('_', ' ')} {value:.1f} s" for key, value in seconds.items()))
        for remark in report.get("remarks", ()):
            say(f"  {remark}")
        for file, what in (
            ("render.png", "the scan among the meshes, rendered by Cycles and composited"),
            ("splat.png", "the scan alone"),
            ("scene.blend", "the scene, to be opened in Blender with the extension installed"),
            ("report.json", "what it took and how exact it is"),
        ):
            say(f"  {folder / file}  {what}")
    say(f"Done in {time.monotonic() - started:.1f} s.")
    return 0
