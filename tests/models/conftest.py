"""Model files as a user keeps them."""

from __future__ import annotations

import pytest


@pytest.fixture
def write(tmp_path):
    def write(text, name="model.toml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write
