"""What the tests of files share."""

from __future__ import annotations

import contextlib
import math
import os
import time

import numpy as np
import pytest

from formats import Labels


@pytest.fixture
def unprivileged(tmp_path):
    """Let a test become a user whom permissions bind: root steps down, others stay who they are."""

    @contextlib.contextmanager
    def become():
        tmp_path.chmod(0o777)
        user = os.geteuid()
        if user == 0:
            os.seteuid(65_534)
        try:
            yield
        finally:
            os.seteuid(user)

    return become


@pytest.fixture
def columns():
    """Hold a table with every kind of cell, empty ones included."""
    line = "LINESTRING (137.4 -4.5, 137.4000001 -4.6)"
    return {
        "source": ["run, 1.bag", 'a "b".csv', "c", "d"],
        "terrain": Labels(np.array([0, 1, -1, 0], np.int32), ("sand", "Böschung")),
        "segment": np.arange(4),
        "c_kPa": np.array([0.1, -1 / 3, math.nan, 3.0]),
        "k_mm": np.full(4, math.nan),
        "WKT": [line, "POINT (137.5 -4.7)", None, line],
    }


@pytest.fixture
def soon():
    """Whatever a file holds, it is refused or read within seconds."""
    began = time.perf_counter()
    yield
    assert time.perf_counter() - began < 30.0
