"""The type checker, with a ratchet: no more errors than are known, and the number follows when there are fewer."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from devtools.docs import python_of

pytestmark = pytest.mark.slow  # dev.py lint runs it
ROOT = Path(__file__).resolve().parents[2]

# Most are fields that are None until something is made, which the code knows and the checker does not.
KNOWN_ERRORS = 342


def count_errors(*words) -> int:
    """The number of errors that the checker finds in files of the clone."""
    command = [sys.executable, "-m", "ty", "check", "--output-format", "concise", "--python", sys.executable, *words]
    checked = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert checked.returncode in (0, 1), checked.stderr
    found = re.search(r"^Found (\d+) diagnostics?$", checked.stdout, re.MULTILINE)
    return int(found[1]) if found else 0


def test_there_are_no_new_type_errors():
    assert count_errors() == KNOWN_ERRORS, "python -m ty check lists them; where there are fewer, lower KNOWN_ERRORS"


@pytest.mark.parametrize("page", ["README.md", "docs/tutorial/first-figure-from-python.md"])
def test_the_code_of_pages_has_no_type_errors(page, tmp_path):
    code = tmp_path / "page.py"
    code.write_text(python_of(ROOT / page))
    assert count_errors(str(code)) == 0


def test_the_checker_sees_an_error(tmp_path):
    wrong = tmp_path / "wrong.py"
    wrong.write_text("from rle_splat.scene import Scene\n\n\ndef width(scene: Scene) -> str:\n    return scene.width\n")
    assert count_errors(str(wrong)) == 1
