"""The benchmark of long drives, at a length that a test can wait for."""

from __future__ import annotations

import sys

from benchmarks import long_runs


def test_a_short_one(monkeypatch, capfd):
    # What this process holds must not count for the one that is measured.
    ballast = bytearray(b"x") * 700_000_000
    monkeypatch.setattr(sys, "argv", ["long_runs", "0.2"])
    monkeypatch.setenv("TERRAIN_EST_METHOD", "least-squares")
    long_runs.main()
    minutes, size, _, busy, _, peak, segments = map(float, capfd.readouterr().out.splitlines()[-1].split())
    assert (minutes, size) == (0.2, 2.0)
    assert busy > 0.0
    assert segments > 0
    assert 30.0 < peak < len(ballast) / 1e6
