"""How Sphinx builds these pages; ``python3 dev.py docs`` runs it."""

project = "RLE Splat"
author = "RLE Splat contributors"
extensions = ["myst_parser"]
html_theme = "furo"
html_title = "RLE Splat"
html_copy_source = html_show_sphinx = False

myst_enable_extensions = ["deflist"]
myst_heading_anchors = 4
