"""Dashes where Sphinx parts a parameter from its meaning by two hyphens."""

from __future__ import annotations

from typing import TYPE_CHECKING

from docutils import nodes

if TYPE_CHECKING:
    from sphinx.application import Sphinx


def dashed(_app: Sphinx, page: nodes.document, _name: str) -> None:
    """Replace them: they would be typographic dashes if Sphinx were let change all that is to be typed."""
    for text in page.findall(nodes.Text):
        if text.startswith(" -- "):
            text.parent.replace(text, nodes.Text(text.replace(" -- ", " – ", 1)))


def setup(app: Sphinx) -> dict[str, bool]:
    """Do so on every page."""
    app.connect("doctree-resolved", dashed)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
