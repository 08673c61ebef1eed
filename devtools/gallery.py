"""dev.py gallery: five scenes made by script in Blender, headless, each with its picture, .blend and priced effects."""

from __future__ import annotations

import json
import shutil
import time

from .blender_job import run_job
from .environments import any_bpy
from .places import OUT, ROOT, Failure, pixels, say

FOLDER = OUT / "gallery"
SECONDS = 400  # of one scene
SCRIPTS = ("gallery_scene.py", "gallery_sets.py", "gallery_data.py", "demo_scene.py", "phantom.py")
# Name -> what the page says of it.
SCENES = {
    "plate": "CT head with a titanium plate",
    "chest": "chest CT with a clip box and organ labels",
    "brain": "MR brain under three lights",
    "angiography": "angiography, the largest value along each ray",
    "smoke": "smoke around a mesh",
}


def gallery(names=(), size: str = "960x720") -> int:
    """Make the scenes named, all when none is; the pictures and a page that lists them go to out/gallery."""
    unknown = [name for name in names if name not in SCENES]
    if unknown:
        raise Failure(f"The gallery has no scene {unknown[0]!r}; choose {', '.join(SCENES)}.")
    width, height = pixels(size)
    started = time.monotonic()
    version = any_bpy()
    for name in names or SCENES:
        _make(name, version, width, height)
    page = FOLDER / "README.md"
    page.write_text(_page(), encoding="utf-8")
    say(f"{page}\nDone in {time.monotonic() - started:.0f} s.")
    return 0


def _make(name: str, version: str, width: int, height: int) -> None:
    """One scene, in a Blender process of its own."""
    began, folder = time.monotonic(), FOLDER / name
    folder.mkdir(parents=True, exist_ok=True)
    for script in SCRIPTS:  # what makes the .blend, beside it
        shutil.copyfile(ROOT / "devtools" / script, folder / script)
    say(f"{SCENES[name]} ...")
    run_job(version, "gallery_scene.py", folder, SECONDS, scene=name, size=[width, height])
    say(f"  {folder / 'render.png'}  {time.monotonic() - began:.0f} s")


def _page() -> str:
    """Every scene that is there, with its picture and its effects."""
    parts = ["# Gallery\n"]
    for name, title in SCENES.items():
        report = FOLDER / name / "report.json"
        if report.is_file():
            found = json.loads(report.read_text(encoding="utf-8"))
            parts.append(f"## {title}\n\n![{title}]({name}/render.png)\n\n{effect_table(found)}\n")
    return "\n".join(parts)


def effect_table(report: dict) -> str:
    """A report's effects for people: a table of those that are on, and the names of those that are off."""
    lines = ["| effect | ms | why it is on |", "|---|---:|---|"]
    for effect in report["effects"]:
        if effect["on"]:
            spent = "within another" if effect["ms"] is None else f"{effect['ms']:.1f}"
            lines.append(f"| {effect['name']} | {spent} | {effect['reason']} |")
    off = [effect["name"] for effect in report["effects"] if not effect["on"]]
    lines.append(
        f"\n{report['stages_ms']['total']:.0f} ms for {report['image']['width']} x {report['image']['height']} pixels "
        f"of {report['source']}, {report['threads']} thread(s). Off, for nothing: {', '.join(off)}."
    )
    return "\n".join(lines)
