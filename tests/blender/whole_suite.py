"""All tests of this folder inside a real Blender executable, as dev.py blender --test runs them:

    blender --background --factory-startup --python-exit-code 1 --python tests/blender/whole_suite.py

RLE_SPLAT_PYTEST names a folder with pytest where Blender's own Python has none, RLE_SPLAT_REPORT the report,
RLE_SPLAT_EXTENSION_ZIP the extension's zip with wheels for this Blender's Python.
"""

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent

if os.environ.get("RLE_SPLAT_PYTEST"):
    sys.path.append(os.environ["RLE_SPLAT_PYTEST"])

import pytest  # noqa: E402 (it is lent by the line above)

arguments = ["-q", "-p", "no:cacheprovider", "--rootdir", str(HERE.parents[1]), str(HERE)]
if os.environ.get("RLE_SPLAT_REPORT"):
    arguments.append(f"--report-log={os.environ['RLE_SPLAT_REPORT']}")

# conftest.py ends the process with pytest's exit code; this line is for the case that it did not get that far.
sys.exit(int(pytest.main(arguments)))
