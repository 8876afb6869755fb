"""A table of one wheel, as text, to be spoilt by tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np

ROVER = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"
N = 200
TIME = np.arange(N) * 0.05
HEADER = ("time", "load", "torque", "sinkage", "angular_velocity", "velocity")


def good():
    """Return rows of cells: load and slip vary, so that the line of the soil is seen."""
    omega = 1.0 + 0.2 * np.cos(TIME)
    load = 80.0 + 20.0 * np.sin(TIME)
    columns = (
        TIME,
        load,
        2.0 + load / 80.0,
        0.01 + 1e-5 * load,
        omega,
        0.125 * omega * (0.7 + 0.1 * np.sin(3 * TIME)),
    )
    return [[f"{cell:.6g}" for cell in row] for row in zip(*columns, strict=True)]


def text(rows, header=HEADER):
    """Return the text of a table."""
    return "\n".join(",".join(row) for row in [header, *rows]) + "\n"


def write(name, content):
    """Write a file here and return its name."""
    Path(name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return name
