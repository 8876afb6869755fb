"""A document as the text of its JSON."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping


def written(document: Mapping[str, Any]) -> str:
    """Write a document of a result; it holds None, never NaN, where something is not known."""
    return json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False)
