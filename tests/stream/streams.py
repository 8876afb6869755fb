"""A stream to follow: drives of the simulator as lines of CSV, and who is told what becomes of it."""

from __future__ import annotations

import io
from functools import cache

import numpy as np
from simulator import CLAYEY_SOIL, DRY_SAND, base_contact, one_wheel, simulate, undulation, wave

from formats.text.arriving_rows import ArrivingRows
from terrain_cli.presentation import segment_table
from terrain_cli.rover import rover_file
from terrain_cli.run.settings import Settings
from terrain_cli.stream.follow import Follow

ROVER_TEXT = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"
ROVER = rover_file.of_text(ROVER_TEXT)
RATE = 20.0


@cache
def lines(seconds=(60.0, 60.0), wheels=("wheel",), seed=1):
    """Return a header and rows over sand and clay, with 3 % of noise; a name of the wheel stands first."""
    tables = []
    for number, name in enumerate(wheels):
        soils = list(zip(map(base_contact, (DRY_SAND, CLAYEY_SOIL)), seconds, strict=False))
        drive = one_wheel(
            soils,
            load=undulation(80.0, 0.25, 7.0, seed=seed + number),
            slip=wave(0.3, 0.4, 11.0),
            noise=0.03,
            rate=RATE,
            seed=seed + number,
        )
        tables.append((name, simulate(drive).columns()))
    names = [column for column in tables[0][1] if column != "wheel"]
    rows = [
        (row[names.index("time")], name, ",".join([name, *(f"{cell!r}" for cell in row)]))
        for name, table in tables
        for row in zip(*(np.asarray(table[column]).tolist() for column in names), strict=True)
    ]
    rows.sort(key=lambda row: row[0])
    return [",".join(["wheel", *names]), *(row[2] for row in rows)]


def text(some):
    return ("\n".join(some) + "\n").encode()


class Told:
    """Who is told."""

    def __init__(self):
        self.rows, self.opened, self.said_again, self.remarks, self.states = [], [], [], [], []

    def closed(self, row):
        self.rows.append(row)

    def open(self, rows):
        self.opened.append(rows)

    def now(self, state):
        self.states.append(state)

    def again(self, row):
        self.said_again.append(row)

    def remark(self, remark):
        self.remarks.append(remark)

    @property
    def table(self):
        return segment_table.join(self.rows)


def followed(data, *, block=4096, every=None, again=False, told=None, **settings):
    """Follow bytes that come in blocks, and return what was told."""
    told = told or Told()
    stream = io.BytesIO(data)
    follow = Follow(ROVER, Settings(**settings), told, every=every, again=again)
    follow.run(iter(lambda: stream.read(block), b""), "-")
    return told


def begun(head):
    """Return rows that are ready to be taken, after these lines."""
    rows = ArrivingRows("-")
    assert rows.prepare(text(head), hurry=True)
    return rows
