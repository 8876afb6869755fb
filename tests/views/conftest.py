"""Comparisons that are looked at."""

from __future__ import annotations

import pytest
from compared import comparison_of, drive
from simulator.run import simulate


@pytest.fixture(scope="session")
def run():
    return simulate(drive())


@pytest.fixture(scope="session")
def comparison(run):
    return comparison_of(run)
