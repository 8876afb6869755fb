"""Equations as MathML, which browsers show by themselves: no script, nothing to fetch."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml

if TYPE_CHECKING:
    from sphinx.application import Sphinx
    from sphinx.writers.html5 import HTML5Translator


#: The thin spaces that TeX sets about sin and its like: behind them, save for a bracket, and before.
BEHIND = re.compile(r"(<mo>&ApplyFunction;</mo>)(?!\s*<m(?:o|row)[^>]*>\s*(?:<mo[^>]*>)?[(\[])")
BEFORE = re.compile(r"(</m(?:i|n|sub|sup)>\s*)(?=(?:<msup>\s*)?<m[io][^>]*>(?:sin|cos|tan|cov|var)</m)")
SPACE = r'\1<mspace width="0.17em"/>'


def mathml(tex: str, *, as_block: bool) -> str:
    """Return an equation as MathML, spaced as TeX does."""
    return BEFORE.sub(SPACE, BEHIND.sub(SPACE, tex2mathml(tex, as_block=as_block)))


def inline(self: HTML5Translator, node: nodes.math) -> None:
    """Write an equation within a line."""
    self.body.append(mathml(node.astext(), as_block=False))
    raise nodes.SkipNode


def block(self: HTML5Translator, node: nodes.math_block) -> None:
    """Write an equation that stands alone."""
    self.body.append(f'<div class="equation">{mathml(node.astext(), as_block=True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Make this the renderer of Sphinx's equations."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
