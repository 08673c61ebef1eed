"""The zip that these tests install, checked by the packaging tool of this very Blender."""

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import bpy
import pytest

SCRIPTS = Path(bpy.utils.system_resource("SCRIPTS"))
TOOL = SCRIPTS / "addons_core/bl_pkg/cli/blender_ext.py"
TAGS = SCRIPTS / "modules/_bpy_internal/extensions/tags.py"


def refused(path: Path) -> str:
    """What the tool says against a zip or a folder, or nothing when it accepts it."""
    command = [sys.executable, TOOL, "validate", path, "--valid-tags", TAGS]
    answer = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    return f"code {answer.returncode}: {answer.stdout}{answer.stderr}" if answer.returncode else ""


def test_blenders_own_tool_accepts_the_zip(extension_zip):
    assert not refused(extension_zip)


@pytest.mark.parametrize(
    ("good", "bad"),
    [('"Camera"', '"Medical"'), ('compiled code"', 'compiled code."'), ('version = "0', 'version = "x')],
)
def test_blenders_own_tool_would_refuse_a_bad_manifest(extension_zip, tmp_path, good, bad):
    with zipfile.ZipFile(extension_zip) as archive:
        text = archive.read("blender_manifest.toml").decode()
        (tmp_path / "__init__.py").write_bytes(archive.read("__init__.py"))
    manifest = tmp_path / "blender_manifest.toml"
    text = re.sub(r"^wheels = \[.*?\]$", "", text, flags=re.MULTILINE | re.DOTALL)  # they are not in the folder
    manifest.write_text(text, encoding="utf-8")
    assert good in text and not refused(tmp_path)
    manifest.write_text(text.replace(good, bad), encoding="utf-8")
    assert refused(tmp_path)
