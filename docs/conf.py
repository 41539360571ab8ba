"""How the docs are built: `make docs` runs Sphinx on this folder and fails at the first warning.

A broken link, a missing picture and a page without a place in the menu (`index.md`) are warnings.
Nothing is fetched: fonts, search and diagrams are files of the site.
"""

import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

project = "Stickbench"
author = "the Stickbench authors"
project_copyright = author
extensions = ["myst_parser"]
exclude_patterns = ["_*"]

myst_enable_extensions = ["attrs_block", "colon_fence", "deflist"]
myst_heading_anchors = 3
"""Headings down to this level can be linked: `page.md#the-heading`."""

html_theme = "furo"
html_title = "Stickbench"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
smartquotes = False
"""Options keep both hyphens."""


def setup(app: Any) -> None:
    """Write the pages that are made from the program before Sphinx looks for pages."""
    from _pages import write

    app.connect("builder-inited", lambda app: write(HERE))
