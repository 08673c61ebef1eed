"""dev.py gallery: scenes made by script in Blender, headless, each with its picture, .blend and priced effects."""

from __future__ import annotations

import json
import shutil
import time
from dataclasses import dataclass

from .blender_job import run_job
from .environments import CORE, any_bpy, ensure
from .places import OUT, ROOT, Failure, clean_environ, run, say

FOLDER = OUT / "gallery"
PARTS = ("scene", "sets", "flat", "light", "skull", "studio", "data", "grids", "meshes")
SCRIPTS = ("demo_scene.py", "phantom.py", *(f"gallery_{part}.py" for part in PARTS))


@dataclass(frozen=True)
class Shot:
    """One picture of the gallery: what the page says of it, its pixels, the samples of Cycles, and how many times as
    wide it is rendered, for smooth edges."""

    title: str
    size: tuple[int, int]
    samples: int = 6
    finer: int = 1


SHOTS = {
    "skull": Shot("a skull of plastic, cut open, with a titanium plate", (1600, 1200), 3, finer=2),
    "heart": Shot("a heart and a dissected aorta after surgery, on a slice of the same CT", (1400, 1050), 6, finer=2),
    "nuclei": Shot("nuclei above a slice of their own confocal stack, one in mitosis", (1400, 1050), 12),
    "cortex": Shot("two channels of fluorescence in mouse cortex", (1200, 960), 12),
    "pet": Shot("a PET from two sides with its tumors in color and a bar in SUV", (1500, 1000), 12, finer=2),
    "light": Shot("six scans as they are imported, and under the light of a recipe", (480, 420), 1, finer=2),
    "lamps": Shot("a brain as it is imported, and with a key, a fill and a rim light", (480, 456), 1, finer=2),
    "worlds": Shot(
        "a brain under two HDRIs; a skull before a backdrop, and cut out with its shadow", (480, 420), 64, finer=2
    ),
    "shadows": Shot("the shadow of a foot by Cycles and by EEVEE", (480, 540), 48),
    "meshes": Shot("a brain among meshes", (960, 640), 64),
    "baked": Shot("a brain by RLE Splat, and baked to Cycles' own volume", (320, 320), 128),
}


def gallery(names=(), percent: float = 100.0) -> int:
    """Make the scenes named, all when none is; the pictures and a page that lists them go to out/gallery."""
    unknown = [name for name in names if name not in SHOTS]
    if unknown:
        raise Failure(f"The gallery has no scene {unknown[0]!r}; choose {', '.join(SHOTS)}.")
    if not 1.0 <= percent <= 400.0:
        raise Failure(f"--percent takes a number from 1 to 400, not {percent:g}.")
    started = time.monotonic()
    version = any_bpy()
    for name in names or SHOTS:
        _make(name, version, percent)
    page = FOLDER / "README.md"
    page.write_text(_page(), encoding="utf-8")
    say(f"{page}\nDone in {time.monotonic() - started:.0f} s.")
    return 0


def _make(name: str, version: str, percent: float) -> None:
    """One scene, in a Blender process of its own."""
    began, folder, shot = time.monotonic(), FOLDER / name, SHOTS[name]
    folder.mkdir(parents=True, exist_ok=True)
    for script in SCRIPTS:  # what makes the .blend, beside it
        shutil.copyfile(ROOT / "devtools" / script, folder / script)
    say(f"{shot.title} ...")
    size = [max(round(0.01 * percent * pixels), 1) * shot.finer for pixels in shot.size]
    run_job(version, "gallery_scene.py", folder, scene=name, size=size, samples=shot.samples)
    picture = FOLDER / f"{name}.jpg"
    run(
        [ensure(CORE), "-m", "devtools.gallery_pictures", folder, picture, str(shot.finer)],
        f"{picture.name} could not be put together.", cwd=ROOT, env=clean_environ(),
    )  # fmt: skip
    say(f"  {picture}  {time.monotonic() - began:.0f} s")


def _page() -> str:
    """Every scene that is there, with its picture and its effects."""
    parts = ["# Gallery\n"]
    for name, shot in SHOTS.items():
        report = FOLDER / name / "report.json"
        if report.is_file():
            found = json.loads(report.read_text(encoding="utf-8"))
            parts.append(f"## {shot.title}\n\n![{shot.title}]({name}.jpg)\n\n{effect_table(found)}\n")
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
