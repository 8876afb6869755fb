"""A notebook as a page: its text as it is, its cells as Python."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from myst_parser.parsers.sphinx_ import MystParser

if TYPE_CHECKING:
    from docutils import nodes
    from sphinx.application import Sphinx


class NotebookParser(MystParser):
    """Reads the cells of a notebook."""

    supported = ("notebook",)

    def parse(self, inputstring: str, document: nodes.document) -> None:
        """Parse a notebook as the Markdown that says the same."""
        cells = json.loads(inputstring)["cells"]
        name = Path(document["source"]).name
        note = f"Run it in Jupyter: {{download}}`{name}`"
        super().parse("\n\n".join([*map(_markdown, cells), note]), document)


def _markdown(cell: dict[str, Any]) -> str:
    text = "".join(cell["source"])
    return f"```python\n{text}\n```" if cell["cell_type"] == "code" else text


def setup(app: Sphinx) -> dict[str, bool]:
    """Read files of this kind."""
    app.add_source_suffix(".ipynb", "notebook")
    app.add_source_parser(NotebookParser)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
