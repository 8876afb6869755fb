"""The mission table, of which only some inputs are held at a time."""

from __future__ import annotations

import json
import re
import textwrap
from pathlib import Path

import missions
import pyarrow.parquet as pq
import pytest
from wheel_table import HEADER, good, text

from terrain_cli.app import main
from terrain_cli.batch import batch_run

ROOT = Path(__file__).resolve().parent.parent.parent


def track(columns, shift):
    """Return the text of a drive with positions of its own."""
    # In degrees a step is as long as in metres.
    step = 1e-4 if columns == ("x", "y") else 1e-9
    rows = [[*row, f"{step * n + shift:.9f}", f"{2 * step * n:.9f}"] for n, row in enumerate(good()[:80])]
    return text(rows, (*HEADER, *columns))


@pytest.mark.parametrize("at_once", [1, 2, 3])
def test_it_does_not_matter_how_many_are_held(batch, source, monkeypatch, at_once):
    # In the order of the names: without positions, in a site frame, on the Earth, in a site frame.
    (source / "c.csv").write_text(track(("x", "y"), 3.0))
    (source / "d.csv").write_text(track(("longitude", "latitude"), 4.0))
    (source / "e.csv").write_text(track(("x", "y"), 5.0))
    monkeypatch.setattr(batch_run, "_AT_ONCE", at_once)
    batch("in", also=("csv",))
    names = [f"in/{name}.csv" for name in ("b", "c", "copy", "d", "e")]
    for kind in ("parquet", "csv"):
        with pytest.raises(SystemExit):
            main(["estimate", *names, "-q", "-o", f"all.{kind}", "--summary", "all.json"])
    assert pq.read_table("out/segments.parquet").equals(pq.read_table("all.parquet"))
    assert Path("out/segments.csv").read_bytes() == Path("all.csv").read_bytes()
    geo = [
        json.loads(pq.read_schema(path).metadata[b"geo"]) for path in ("out/segments.parquet", "all.parquet")
    ]
    assert geo[0] == geo[1]
    document, whole = (json.loads(Path(name).read_text()) for name in ("out/summary.json", "all.json"))
    assert {key: document[key] for key in whole} == whole


def test_sites_alone(batch, source):
    (source / "c.csv").write_text(track(("x", "y"), 3.0))
    batch("in/c.csv")
    (column,) = json.loads(pq.read_schema("out/segments.parquet").metadata[b"geo"])["columns"].values()
    assert column["crs"] is None
    assert missions.sources() == ["in/c.csv"]
    assert all(pq.read_table("out/segments.parquet")["WKT"].to_pylist())


def test_folders_by_month_are_one_dataset(batch, source):
    batch("in/b.csv", output="mission/rover=a/month=2026-07")
    batch("in/copy.csv", output="mission/rover=a/month=2026-08")
    text = (ROOT / "docs/batch.md").read_text()
    (snippet,) = re.findall(r"```python\n(.*?) *```", text, re.DOTALL)
    names = {}
    exec(textwrap.dedent(snippet), names)  # noqa: S102 - what users are told to type
    august = names["august"]
    assert set(august["source"].to_pylist()) == {"in/copy.csv"}
    assert {name: set(august[name].to_pylist()) for name in ("rover", "month")} == {
        "rover": {"a"},
        "month": {"2026-08"},
    }
    assert names["mission"].count_rows() > len(august) > 0
