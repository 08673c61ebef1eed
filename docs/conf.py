"""How Sphinx builds these pages; ``python3 dev.py docs`` runs it."""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from devtools import docs_reference  # noqa: E402

project = "RLE Splat"
author = "RLE Splat contributors"
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
html_theme = "furo"
html_title = "RLE Splat"
html_copy_source = html_show_sphinx = False

myst_enable_extensions = ["deflist"]
myst_heading_anchors = 4

# Docstrings say what type a parameter has, for annotations alone give neither shape nor unit.
autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False

GENERATED = re.compile(r"^<!-- generated: ([a-z -]+) -->$", re.MULTILINE)


def fill(app, docname, source):
    """Put what is generated from the code in the place of its mark."""
    source[0] = GENERATED.sub(lambda found: docs_reference.PARTS[found[1]](), source[0])


def setup(app):
    app.connect("source-read", fill)
