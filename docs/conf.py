"""How Sphinx builds these pages; ``python3 dev.py docs`` runs it."""

import re
from pathlib import Path

project = "RLE Splat"
author = "RLE Splat contributors"
extensions = ["myst_parser"]
html_theme = "furo"
html_title = "RLE Splat"
html_copy_source = html_show_sphinx = False

myst_heading_anchors = 4

# The sidebar's order; in a folder it is that of the links of its index, or of the page of the folder's name beside it.
# It is not in the pages, which are also read as they are, where a toctree would be shown as code.
CHAPTERS = {
    "For users": ("tutorial/index", "how-to/index", "gallery", "reference/index", "glossary"),
    "For developers": ("explanation/index",),
}
LINK = re.compile(r"\]\(([\w/-]+)\.md(?:#[\w-]+)?\)")


def add_contents(_app, name: str, source: list) -> None:
    """Append what the sidebar lists to the source of an index."""
    chapters = CHAPTERS if name == "index" else {"": dict.fromkeys(LINK.findall(source[0]))}
    if name.rpartition("/")[2] == "index" or (Path(__file__).parent / name).is_dir():
        for caption, pages in chapters.items():
            heading = f":caption: {caption}\n" if caption else ""
            source[0] += "\n```{toctree}\n:hidden:\n:maxdepth: 2\n" + heading + "\n" + "\n".join(pages) + "\n```\n"


def setup(app) -> None:
    app.connect("source-read", add_contents)
