"""A script in a Blender of its own, without a window, with the extension of this tree installed."""

from __future__ import annotations

import hashlib
import json
import subprocess
from pathlib import Path

from .build import build_here, shipped
from .environments import ensure_bpy
from .kernels import made_kernels
from .places import BPY_PYTHON, BUILD, ROOT, Failure, clean_environ, say
from .wheels import WHEEL_PINS


def run_job(version: str, script: str, folder: Path, **job) -> None:
    """Run ``devtools/script`` with a job in JSON: the extension's ``zip`` and whether to ``install`` it, the ``folder``
    for what is made, which gets Blender's words as well, and what else is given."""
    python, user = ensure_bpy(version), BUILD / f"demo-user-{version}"
    user.mkdir(parents=True, exist_ok=True)
    stamp, digest = user / "installed.sha256", _source_digest()
    zip_path = ""
    if not stamp.is_file() or stamp.read_text() != digest:
        stamp.unlink(missing_ok=True)
        # One picture compiles less than all that a zip brings: kernels are not made for it.
        zip_path = str(build_here(BPY_PYTHON[version], BUILD / "zip-demo", made_kernels))
    job = {"zip": zip_path, "install": bool(zip_path), "folder": str(folder), **job}
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "blender.log"
    command = [str(python), str(ROOT / "devtools" / script), json.dumps(job)]
    environ = clean_environ(BLENDER_USER_RESOURCES=str(user), LIBGL_ALWAYS_SOFTWARE="1")
    with log.open("w", encoding="utf-8", errors="replace") as output:
        code = subprocess.run(command, env=environ, stdout=output, stderr=subprocess.STDOUT).returncode
    if code != 0:
        say(log.read_text(encoding="utf-8", errors="replace")[-1500:])
        raise Failure(f"Blender did not succeed (exit code {code}); its words are above and in {log}.")
    stamp.write_text(digest)


def _source_digest() -> str:
    """A hash of everything that goes into the zip, so that an unchanged extension is not installed again."""
    total = hashlib.sha256(WHEEL_PINS.read_bytes())
    for path in (Path("blender_manifest.toml"), *shipped()):
        total.update(path.as_posix().encode())
        total.update((ROOT / path).read_bytes())
    return total.hexdigest()
