"""dev.py demo: the main job in real Blender, headless; pictures, .blend and report go to out/."""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import time
from pathlib import Path

from .build import build, shipped
from .environments import any_bpy, ensure_bpy
from .places import BUILD, OUT, ROOT, Failure, clean_environ, say
from .sample import sample
from .wheels import WHEEL_PINS, this_platform

SECONDS = 900
SCAN_TITLE = "RLE SPLAT"


def _source_digest() -> str:
    """A hash of everything that goes into the zip, so that an unchanged extension is not installed again."""
    total = hashlib.sha256(WHEEL_PINS.read_bytes())
    for path in (Path("blender_manifest.toml"), *shipped()):
        total.update(path.as_posix().encode())
        total.update((ROOT / path).read_bytes())
    return total.hexdigest()


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


def install_for(version: str):
    """(folder of a Blender user, zip to install there or None where it is installed already, what to call when a
    Blender has installed it)."""
    user = BUILD / f"demo-user-{version}"
    user.mkdir(parents=True, exist_ok=True)
    stamp, digest = user / "installed.sha256", _source_digest()
    zip_path = None
    if not stamp.is_file() or stamp.read_text() != digest:
        stamp.unlink(missing_ok=True)
        zip_path = build((this_platform(),), output=BUILD / "zip-demo")[this_platform()]
    return user, zip_path, lambda: stamp.write_text(digest)


def _show(name: str, volume: Path, options: dict, version: str) -> Path:
    """One volume in one scene, in a Blender process of its own; returns the folder with the results."""
    python = ensure_bpy(version)
    user, zip_path, finish = install_for(version)
    folder = OUT / "demo" / name
    folder.mkdir(parents=True, exist_ok=True)
    job = {"zip": str(zip_path or ""), "install": zip_path is not None, "volume": str(volume), "options": options,
           "folder": str(folder), "title": SCAN_TITLE}  # fmt: skip
    log = folder / "blender.log"
    say(f"Blender {version} shows {volume.name} ...")
    command = [str(python), str(ROOT / "devtools" / "demo_scene.py"), json.dumps(job)]
    environ = clean_environ(BLENDER_USER_RESOURCES=str(user), LIBGL_ALWAYS_SOFTWARE="1")
    with log.open("w", encoding="utf-8", errors="replace") as output:
        try:
            code = subprocess.run(
                command, env=environ, stdout=output, stderr=subprocess.STDOUT, timeout=SECONDS
            ).returncode
        except subprocess.TimeoutExpired:
            raise Failure(f"Blender took longer than {SECONDS} s; its words are in {log}.") from None
    if code != 0:
        say(log.read_text(encoding="utf-8", errors="replace")[-1500:])
        raise Failure(f"The demo did not succeed (exit code {code}); Blender's words are above and in {log}.")
    finish()
    return folder


def demo(volumes) -> int:
    """Show the files given, or the sample."""
    started = time.monotonic()
    version = any_bpy()
    jobs = []
    for path in map(Path, volumes):
        if not path.is_file():
            raise Failure(f"{path} is not a file; give volumes such as scan.raw.gz or smoke.vdb.")
        jobs.append((re.sub(r"\W+", "_", path.name.split(".")[0]), path.resolve(), {}))
    if not jobs:
        path, facts = sample()
        say(f"The sample is {facts['title']}.")
        jobs.append((path.stem, path, _sample_options(facts)))
    for name, path, options in jobs:
        folder = _show(name, path, options, version)
        report = json.loads((folder / "report.json").read_text())
        taken = ", ".join(f"{key.replace('_', ' ')} {value:.1f} s" for key, value in report["seconds"].items())
        say(f"  {taken}")
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
