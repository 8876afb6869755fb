"""Parts of pages that are made from something else: a line such as <!-- commands --> stands for them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import command_pages
import gallery_page

if TYPE_CHECKING:
    from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parent.parent.parent


def getting_started() -> str:
    """Return what the README says to somebody who begins, with its links as they are from here."""
    readme = (ROOT / "README.md").read_text("utf-8")
    first = readme.index("## Install")
    return re.sub(r"\]\(docs/", "](", readme[first : readme.index("## Where to read on")])


def changes() -> str:
    """Return the changelog without its heading."""
    return (ROOT / "CHANGELOG.md").read_text("utf-8").partition("\n")[2]


PARTS = {
    "getting started": getting_started,
    "changes": changes,
    "commands": command_pages.markdown,
    "effect gallery": gallery_page.markdown,
}


def fill(_app: Sphinx, _name: str, content: list[str]) -> None:
    """Put the parts into a page as it is read."""
    for name, markdown in PARTS.items():
        mark = f"<!-- {name} -->"
        if mark in content[0]:
            content[0] = content[0].replace(mark, markdown())
    # Files beside docs/ go with the site; a page of Markdown would be looked for among its pages.
    content[0] = re.sub(r"\]\((\.\./[^)]+\.md)\)", r"](path:\1)", content[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Fill every page that has a mark."""
    app.connect("source-read", fill)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
