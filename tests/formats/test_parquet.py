"""Parquet: types, parts and partitions, and damaged files."""

from __future__ import annotations

import datetime as dt
import decimal
import threading
from functools import partialmethod

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from formats import DamagedError, FormatError, Labels, open_source, page_claims


@pytest.fixture
def make(tmp_path):
    def write(columns, name="log.parquet", **options):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(pa.table(columns), path, **options)
        return str(path)

    return write


def kinds(source):
    return {field.name: field.kind for field in source.streams()[0].fields}


def one(source, *fields):
    (batch,) = source.read("", fields)
    return batch


def texts(labels):
    return [labels.names[code] if code >= 0 else None for code in labels.codes]


NUMBERS = [
    (pa.array([1.5, None, float("nan")]), [1.5, np.nan, np.nan]),
    (pa.array([1.5, 2.5, 3.5], pa.float32()), [1.5, 2.5, 3.5]),
    (pa.array([1, None, 3], pa.int16()), [1, np.nan, 3]),
    (pa.array([1, 2, 2**53 - 1]), [1, 2, 2**53 - 1]),
    (pa.array([True, None, False]), [1, np.nan, 0]),
    (pa.array([decimal.Decimal("1.25"), None, decimal.Decimal("-2.50")]), [1.25, np.nan, -2.5]),
    (pa.array([None, None, None]), [np.nan] * 3),
    (pa.array([1_500_000, None, -5], pa.duration("us")), [1.5, np.nan, -5e-6]),
    (pa.array([7, 7, 9]).dictionary_encode(), [7, 7, 9]),
    (pa.array([0, 1, 2**64 - 1], pa.uint64()), [0, 1, float(2**64 - 1)]),
]


@pytest.mark.parametrize(("array", "expected"), NUMBERS, ids=[str(array.type) for array, _ in NUMBERS])
def test_numbers_of_every_type(make, array, expected):
    source = open_source(make({"x": array}))
    assert kinds(source) == {"x": "number"}
    values = one(source, "x")["x"]
    assert values.dtype == np.float64
    np.testing.assert_array_equal(values, expected)


def test_integers_that_float64_cannot_hold(make):
    stamps = [1714564800123456789, 1714564800123456790]
    source = open_source(make({"time_ns": pa.array(stamps, pa.int64())}))
    values = one(source, "time_ns")["time_ns"]
    assert values.dtype == np.int64
    assert values.tolist() == stamps


@pytest.mark.parametrize(
    "array",
    [
        pa.array(["sand", " rock ", None, "nan", "sand", ""]),
        pa.array(["sand", " rock ", None, "nan", "sand", ""], pa.large_string()),
        pa.array(["sand", " rock ", None, "nan", "sand", ""]).dictionary_encode(),
    ],
    ids=["string", "large_string", "dictionary"],
)
def test_labels(make, array):
    source = open_source(make({"terrain": array}))
    assert kinds(source) == {"terrain": "text"}
    labels = one(source, "terrain")["terrain"]
    assert isinstance(labels, Labels)
    assert texts(labels) == ["sand", "rock", None, None, "sand", None]


NOON = dt.datetime(2024, 5, 1, 12, tzinfo=dt.UTC)


@pytest.mark.parametrize(
    "array",
    [
        pa.array([NOON, None], pa.timestamp("us", "UTC")),
        pa.array([NOON, None], pa.timestamp("ms", "Europe/Berlin")),
        pa.array([NOON.replace(tzinfo=None), None], pa.timestamp("ns")),
        pa.array([NOON.replace(tzinfo=None), None], pa.timestamp("s")),
    ],
    ids=lambda array: str(array.type),
)
def test_times(make, array):
    source = open_source(make({"time": array}))
    assert kinds(source) == {"time": "time"}
    times = one(source, "time")["time"]
    assert times.dtype == np.dtype("datetime64[ns]")
    assert times[0] == np.datetime64("2024-05-01T12:00:00", "ns")
    assert np.isnat(times[1])


def test_batches_and_count(make):
    path = make({"a": np.arange(1000.0), "b": np.arange(1000)}, row_group_size=300)
    source = open_source(path)
    assert source.kind == "parquet"
    assert source.streams()[0].count == 1000
    batches = list(source.read("", ["a"], 128))
    assert max(len(batch["a"]) for batch in batches) <= 128
    assert all(list(batch) == ["a"] for batch in batches)
    np.testing.assert_array_equal(np.concatenate([batch["a"] for batch in batches]), np.arange(1000.0))


def test_columns_that_are_no_numbers_texts_or_times(make):
    source = open_source(make({"a": [1.0], "list": [[1, 2]], "bytes": [b"x"], "wrench.force.z": [2.0]}))
    assert kinds(source) == {"a": "number", "wrench.force.z": "number"}
    assert source.remarks == ["columns passed over, being neither numbers, texts nor times: list, bytes"]
    assert one(source, "wrench.force.z")["wrench.force.z"].tolist() == [2.0]


def test_hive_partitions_in_natural_order(make, tmp_path):
    for run in (10, 2):
        for part in (10, 9):
            make({"a": [float(part)]}, f"drive/run={run}/terrain=loose%20sand/part-{part}.parquet")
    make({"a": [0.0]}, "drive/run=1/terrain=__HIVE_DEFAULT_PARTITION__/part-0.parquet")
    source = open_source(str(tmp_path / "drive"))
    assert kinds(source) == {"a": "number", "run": "number", "terrain": "text"}
    assert source.streams()[0].count == 5
    batches = list(source.read("", ["run", "a", "terrain"]))
    assert [batch["run"].tolist() for batch in batches] == [[1], [2], [2], [10], [10]]
    assert [batch["a"].tolist() for batch in batches] == [[0], [9], [10], [9], [10]]
    assert [texts(batch["terrain"]) for batch in batches] == [[None], *[["loose sand"]] * 4]


def test_parts_written_by_pyarrow_read_back_the_same(tmp_path):
    table = pa.table({"a": np.arange(50.0), "wheel": ["left", "right"] * 25})
    pq.write_to_dataset(table, tmp_path / "drive", partition_cols=["wheel"])
    source = open_source(str(tmp_path / "drive"))
    found = {texts(batch["wheel"])[0]: batch["a"].tolist() for batch in source.read("", ["a", "wheel"])}
    assert found == {"left": list(range(0, 50, 2)), "right": list(range(1, 50, 2))}


def test_part_without_a_column(make, tmp_path):
    make({"a": [1.0], "label": ["x"]}, "drive/part-1.parquet")
    make({"a": [2.0]}, "drive/part-2.parquet")
    first, second = open_source(str(tmp_path / "drive")).read("", ["label", "a"])
    assert texts(first["label"]) == ["x"]
    assert texts(second["label"]) == [None]
    assert second["a"].tolist() == [2.0]


def test_parts_that_disagree(make, tmp_path):
    make({"a": [1.0]}, "drive/part-1.parquet")
    make({"a": ["x"]}, "drive/part-2.parquet")
    with pytest.raises(FormatError, match=r"part-2.parquet: a is text, but not in the parts before it"):
        open_source(str(tmp_path / "drive"))


def test_no_rows(make):
    with pytest.raises(FormatError, match="has columns but no rows"):
        open_source(make({"a": pa.array([], pa.float64())}))


def test_unknown_column(make):
    with pytest.raises(FormatError, match="has no column 'b'"):
        list(open_source(make({"a": [1.0]})).read("", ["b"]))


@pytest.mark.parametrize("damage", ["cut", "magic", "footer"])
def test_damaged_footer(make, tmp_path, damage):
    path = tmp_path / "log.parquet"
    make({"a": np.arange(1000.0)})
    data = bytearray(path.read_bytes())
    if damage == "cut":
        del data[len(data) // 2 :]
    elif damage == "magic":
        data[-4:] = b"XXXX"
    else:
        data[-60:-8] = b"\xff" * 52
    path.write_bytes(data)
    with pytest.raises(DamagedError, match="footer is missing or corrupt") as caught:
        open_source(str(path))
    assert caught.value.exit_code == 65


def test_damaged_page(make, tmp_path):
    path = tmp_path / "log.parquet"
    make({"a": np.arange(100_000.0)}, compression="snappy", use_dictionary=False)
    data = bytearray(path.read_bytes())
    data[1000:5000] = b"\xff" * 4000
    path.write_bytes(data)
    with pytest.raises(DamagedError, match="is corrupt"):
        list(open_source(str(path)).read("", ["a"]))


def lists(batch):
    """Return columns as lists, texts as they are."""
    return {
        name: texts(column) if isinstance(column, Labels) else column.tolist()
        for name, column in batch.items()
    }


@pytest.mark.parametrize(
    ("array", "told"),
    [
        (pa.array([32_503_680_000_000_000], pa.timestamp("us")), "out of bounds timestamp"),
        (
            pa.array([b"clay", b"\xe9"]).view(pa.string()),
            "codec can't decode byte 0xe9",
        ),
    ],
    ids=["time", "text"],
)
def test_values_that_cannot_be(make, array, told):
    with pytest.raises(FormatError, match=f"x cannot be read: .*{told}"):
        list(open_source(make({"x": array})).read("", ["x"]))


ITER_BATCHES = pq.ParquetFile.iter_batches


def read_in(threads, monkeypatch):
    """Have columns read by several threads, or by one."""
    monkeypatch.setattr(pq.ParquetFile, "iter_batches", partialmethod(ITER_BATCHES, use_threads=threads))


@pytest.mark.parametrize("threads", [False, True])
def test_rows_of_columns_that_threads_read_stay_together(make, monkeypatch, threads):
    """Batches of a column of dictionaries end with its row groups."""
    n = 1_000
    terrain = ["sand" if i % 3 else "rock" for i in range(n)]
    path = make(
        {
            "i": np.arange(n),
            "terrain": pa.array(terrain).dictionary_encode(),
            "x": pa.array([None if i % 7 == 0 else i / 8 for i in range(n)]),
            "text": [f"{i % 5}" for i in range(n)],
        },
        row_group_size=300,
    )
    read_in(threads, monkeypatch)
    names = ["text", "x", "terrain", "i"]
    batches = [lists(batch) for batch in open_source(path).read("", names, 128)]
    assert all(list(batch) == names for batch in batches)
    assert all(1 <= len({len(column) for column in batch.values()}) == 1 for batch in batches)
    whole = {name: [value for batch in batches for value in batch[name]] for name in names}
    assert whole["i"] == list(range(n))
    assert whole["terrain"] == terrain
    np.testing.assert_array_equal(whole["x"], [np.nan if i % 7 == 0 else i / 8 for i in range(n)])
    assert whole["text"] == [f"{i % 5}" for i in range(n)]


def test_nothing_but_a_partition(make, tmp_path):
    make({"a": np.arange(5.0)}, "drive/run=3/part-0.parquet")
    assert one(open_source(str(tmp_path / "drive")), "run")["run"].tolist() == [3.0] * 5


def test_no_thread_outlives_a_reading_that_is_given_up(make):
    source = open_source(make({"a": np.arange(1000.0), "b": np.arange(1000.0)}))
    before = threading.active_count()
    reading = source.read("", ["a", "b"], 10)
    next(reading)
    reading.close()
    assert threading.active_count() == before


def test_damage_is_told_of_after_what_comes_before_it(make, tmp_path):
    path = make(
        {"a": np.arange(3_000.0), "b": np.arange(3_000.0)}, row_group_size=1_000, write_page_checksum=True
    )
    data = bytearray((tmp_path / "log.parquet").read_bytes())
    at = pq.ParquetFile(path).metadata.row_group(2).column(1).data_page_offset + 200
    data[at] ^= 1
    (tmp_path / "log.parquet").write_bytes(data)
    reading = open_source(path).read("", ["a", "b"], 500)
    assert np.concatenate([next(reading)["b"] for _ in range(4)]).tolist() == list(range(2_000))
    with pytest.raises(DamagedError, match="is corrupt"):
        next(reading)


@pytest.mark.parametrize(
    "options", [{}, {"data_page_version": "2.0"}, {"write_page_checksum": True}], ids=str
)
def test_damage_is_told_of_as_by_one_thread(make, tmp_path, monkeypatch, options):
    path = tmp_path / "log.parquet"
    rng = np.random.default_rng(1)
    make({"a": rng.random(3_000), "b": rng.integers(0, 9, 3_000)}, row_group_size=1_000, **options)
    whole = path.read_bytes()

    def told():
        try:
            return repr([lists(batch) for batch in open_source(str(path)).read("", ["a", "b"], 700)])
        except FormatError as error:
            return f"fails: {error}"

    found = []
    for at in rng.integers(4, len(whole), 60):
        data = bytearray(whole)
        data[at : at + 8] = rng.bytes(len(data[at : at + 8]))
        path.write_bytes(data)
        both = []
        for threads in (False, True):
            read_in(threads, monkeypatch)
            both.append(told())
        assert both[0] == both[1]
        found.append(both[0])
    failures = [outcome for outcome in found if outcome.startswith("fails: ")]
    assert failures
    assert len(failures) < len(found) or "write_page_checksum" in options


@pytest.mark.parametrize(
    "options",
    [{}, {"data_page_version": "2.0"}, {"write_page_checksum": True}, {"use_dictionary": False}],
    ids=str,
)
def test_heads_of_pages_have_a_checksum_only_among_their_fields(make, tmp_path, options):
    path = make(
        {"a": np.arange(9_000.0), "i": np.arange(9_000), "b": [True] * 9_000, "t": ["x"] * 9_000},
        data_page_size=4_000,
        **options,
    )
    data = (tmp_path / "log.parquet").read_bytes()
    group = pq.ParquetFile(path).metadata.row_group(0)
    places = [group.column(j).data_page_offset for j in range(4)]
    rng = np.random.default_rng(2)
    changed_head = tmp_path / "head"
    told = 0
    for place in places:
        for changed in (None, *rng.integers(0, 40, 200)):
            begin = bytearray(data[place : place + 256])
            if changed is not None:
                begin[changed] = rng.integers(256)
            changed_head.write_bytes(begin)
            try:
                fields, length = page_claims._struct(bytes(begin), 0, 0)
            except (IndexError, ValueError):
                continue
            if isinstance(fields.get(2), int) and isinstance(fields.get(3), int):
                with changed_head.open("rb") as file:
                    *found, checksum = page_claims._head(file.fileno(), 0)
                assert found == [fields[2], fields[3], length]
                assert checksum <= (4 in fields)
                told += 1
    assert told > 400
