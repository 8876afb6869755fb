"""Settings of the site: sphinx-build -W docs build/site."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE / "extension"), str(HERE.parent / "man")]

import ziamath  # noqa: E402 - in one block with the import that needs the path above

from terrain_cli.version import __version__  # noqa: E402

project = "terrain-est"
release = __version__
copyright = "the authors of terrain-est, Apache License 2.0"  # noqa: A001 - Sphinx's name
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "mathml",
    "typography",
    "notebook_page",
    "generated_parts",
]
exclude_patterns = ["extension"]

# Pages read the same where Markdown is shown without Sphinx.
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4

html_theme = "furo"
html_title = f"terrain-est {__version__}"
# The font of equations: without one that is made for them, browsers set MathML badly.
FONT = Path(ziamath.__file__).parent / "fonts" / "STIXTwoMath-Regular.ttf"
html_static_path = ["extension/site.css", str(FONT)]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
# Typographic quotes and dashes would change what is to be typed.
smartquotes = False
pygments_style = "friendly"
pygments_dark_style = "github-dark"

default_role = "py:obj"
autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False
