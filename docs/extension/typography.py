"""Pages as a reader wants them: lines that fit, options and quantities in one piece, dashes."""

from __future__ import annotations

import re
import textwrap
from typing import TYPE_CHECKING

from docutils import nodes

if TYPE_CHECKING:
    from sphinx.application import Sphinx

#: Letters of a line of output that fit beside the navigation.
LINE = 88
#: A piece of code of so many letters is not broken at its hyphens.
SHORT = 24
#: Columns stand apart by two spaces.
COLUMNS = re.compile(r"\S {2,}\S")
#: The space between a number and its unit, at which no line ends.
BEFORE_UNIT = re.compile(r"(?<=\d) (?=(?:%|°|[kMG]?B|[kM]?Pa|N|[mcµ]?m|[mµn]?s|Hz|rad|min|h)(?!\w))")


def set_page(_app: Sphinx, page: nodes.document, _name: str) -> None:
    """Set what a page quotes."""
    for block in page.findall(nodes.literal_block):
        if block.get("language") == "text":
            text = "\n".join(map(folded, block.astext().splitlines()))
            block.replace_self(nodes.literal_block(text, text, **block.attributes))
    for code in page.findall(nodes.literal):
        if len(code.astext()) <= SHORT:
            code["classes"].append("short")
    for text in [*page.findall(nodes.Text)]:
        if not isinstance(text.parent, nodes.literal | nodes.literal_block | nodes.math | nodes.math_block):
            kept = BEFORE_UNIT.sub("\N{NO-BREAK SPACE}", text)
            if kept != text:
                text.parent.replace(text, nodes.Text(kept))
        # Sphinx parts a parameter from its meaning so. Its smart quotes would also change what is typed.
        if text.startswith(" -- "):
            text.parent.replace(text, nodes.Text(text.replace(" -- ", " – ", 1)))


def folded(line: str) -> str:
    """Fold a sentence that a command prints; a row of a table stays."""
    if len(line) <= LINE or COLUMNS.search(line):
        return line
    indent = re.match(" *", line)[0]
    return textwrap.fill(line, LINE, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def setup(app: Sphinx) -> dict[str, bool]:
    """Do so on every page."""
    app.connect("doctree-resolved", set_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
