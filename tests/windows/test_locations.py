"""Localisation tables: columns known by names and units, what latitudes count, and where samples were."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formats import Labels, NotFoundError
from terrain_cli.errors import InputError, UsageError
from terrain_cli.telemetry import Geometry, Samples
from terrain_cli.windows import locations
from terrain_cli.windows.locations import Placed

MARS = "IAU_2015:49900"
#: The header of the PLACES archive of the Mars Science Laboratory (PDS, localized_interp.csv).
PLACES = (
    "frame,site,drive,pose,landing_x,landing_y,landing_z,northing,easting,planetocentric_latitude,"
    "planetodetic_latitude,longitude,elevation,map_pixel_line,map_pixel_sample,dem_pixel_line,"
    "dem_pixel_sample,roll,pitch,yaw,quat_s,quat_v1,quat_v2,quat_v3,sclk,sol\n"
    "SITE,4,-1,-1,0,0,0,-272100.5,8146900.25,-4.6,-4.654,137.45,-4501.0,2101,23092,526,5773,"
    "0,0,0,1,0,0,0,0,-1\n"
    "ROVER,4,2100,8,1,0,0,-272100.5,8146900.25,-4.59,-4.644,137.442,-4501.5,2101,23095,526,5774,"
    "-2.4,-3.6,45,0.55,0.01,-0.03,0.83,401573000,46\n"
    "ROVER,4,2100,-1,2,0,0,-272200.0,8147000.0,-4.591,-4.645,137.443,-4502.0,2102,23096,527,5775,"
    "-2.3,-3.5,50,0.55,0.01,-0.03,0.83,401573500,46\n"
)
T0 = 1_754_000_000.0


def write(tmp_path, text):
    path = tmp_path / "places.csv"
    path.write_text(text)
    return str(path)


def test_the_table_of_places_without_its_origins_of_sites(tmp_path):
    table = locations.load(write(tmp_path, PLACES), MARS)
    assert {name: values.tolist() for name, values in table.position.items()} == {
        "longitude": [137.442, 137.443],
        "latitude": [-4.59, -4.591],
        "x": [8146900.25, 8147000.0],
        "y": [-272100.5, -272200.0],
    }
    assert {name: values.tolist() for name, values in table.keys.items()} == {
        "site": [4, 4],
        "drive": [2100, 2100],
        "pose": [8, -1],
    }
    origin, time = table.time
    assert (origin + time).tolist() == [401573000, 401573500]


def test_parquet_is_a_table_too(tmp_path):
    columns = {"SITE": [1, 1], "Drive": [2, 4], "lon": [10.0, 11.0], "lat": [50.0, None]}
    pq.write_table(pa.table(columns), tmp_path / "places.parquet")
    table = locations.load(str(tmp_path / "places.parquet"))
    assert table.time is None
    assert table.keys["drive"].tolist() == [2, 4]
    # Half a position is none.
    np.testing.assert_array_equal(table.position["longitude"], [10.0, np.nan])


@pytest.mark.parametrize(
    ("text", "seconds", "position"),
    [
        ("time,longitude,latitude\n0.5,1,2\n", 0.5, {"longitude": 1.0, "latitude": 2.0}),
        ("time_ms,lon,lat\n1500,1,2\n", 1.5, {"longitude": 1.0, "latitude": 2.0}),
        ("t,x_km,y [km]\n0.5,1,2\n", 0.5, {"x": 1000.0, "y": 2000.0}),
        ("time,easting,northing\n0.5,1,2\n", 0.5, {"x": 1.0, "y": 2.0}),
        ("time,easting,northing,x,y\n0.5,7,8,1,2\n", 0.5, {"x": 1.0, "y": 2.0}),
        (
            "utc_time,lon_rad,lat_rad\n2026-11-21T08:00:00.25Z,0.5,0.25\n",
            1795248000.25,
            {"longitude": np.degrees(0.5), "latitude": np.degrees(0.25)},
        ),
    ],
)
def test_names_and_units(tmp_path, text, seconds, position):
    table = locations.load(write(tmp_path, text))
    assert table.time[0] + table.time[1][0] == seconds
    assert {name: values[0] for name, values in table.position.items()} == pytest.approx(position, rel=1e-15)


LATITUDES = {"planetocentric": "-4.589466996", "planetodetic": "-4.643738049"}


@pytest.mark.parametrize(
    ("names", "crs", "taken"),
    [
        (["planetocentric", "planetodetic"], MARS, "planetocentric"),
        (["planetocentric"], "IAU_2015:49902", "planetocentric"),
        (["planetodetic"], MARS, "planetocentric"),
        (["planetodetic"], "iau_2015:49902", "planetocentric"),
        (["planetodetic"], "IAU_2015:30100", "planetodetic"),
        (["planetocentric", "planetodetic"], "EPSG:4326", "planetodetic"),
        (["planetodetic"], "+proj=longlat +a=3396190 +b=3376200", "planetodetic"),
    ],
)
def test_latitude_is_that_of_the_reference_system(tmp_path, names, crs, taken):
    """The two latitudes are one place of the archive, the landing site of Curiosity."""
    header = ",".join(f"{name}_latitude" for name in names)
    values = ",".join(LATITUDES[name] for name in names)
    table = locations.load(write(tmp_path, f"sclk,longitude,{header}\n1,137.4,{values}\n"), crs)
    assert table.position["latitude"][0] == pytest.approx(float(LATITUDES[taken]), abs=2e-9)


@pytest.mark.parametrize(
    ("name", "crs", "message"),
    [
        ("planetocentric", None, "without --crs all longitudes are the Earth's"),
        ("planetodetic", None, "without --crs all longitudes are the Earth's"),
        ("planetocentric", "EPSG:4326", "planetocentric_latitude do not go with EPSG:4326"),
        ("planetocentric", "IAU_2015:49901", "do not go with IAU_2015:49901"),
        ("planetodetic", "IAU_2015:49901", "do not go with IAU_2015:49901"),
        ("planetodetic", "IAU_2015:40100", "do not go with IAU_2015:40100"),
    ],
)
def test_latitude_of_another_system_is_refused(tmp_path, name, crs, message):
    path = write(tmp_path, f"sclk,longitude,{name}_latitude\n1,137.4,-4.5\n")
    with pytest.raises(UsageError, match=message):
        locations.load(path, crs)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,longitude\n1,2\n", "no columns of positions; there are time, longitude"),
        ("time,x,latitude\n1,2,3\n", "no columns of positions"),
        ("longitude,latitude\n1,2\n", "nothing to find positions by; there are longitude, latitude"),
        ("drive,pose,longitude,latitude\n1,2,3,4\n", "nothing to find positions by"),
        ("time,lon,lng,lat\n1,2,3,4\n", "columns 'lon' and 'lng' can all be longitude"),
        ("time,longitude [kg],latitude\n1,2,3\n", "'kg' is a unit of mass; longitude takes deg"),
        ("time,longitude,latitude\nnoon,2,3\n", "holds texts that are no times, such as 'noon'"),
    ],
)
def test_what_is_no_localisation_table(tmp_path, text, message):
    path = write(tmp_path, text)
    with pytest.raises(InputError, match=message) as caught:
        locations.load(path)
    assert path in str(caught.value)
    assert caught.value.hint


def test_a_bag_is_none(tmp_path):
    from formats.output.bag_writer import Topic, write_bag

    path = str(tmp_path / "run.bag")
    time = np.arange(1, 3, dtype=np.int64) * 10**9
    write_bag([Topic("/fix", "sensor_msgs/msg/NavSatFix", time)], path, "ros1")
    with pytest.raises(InputError, match="a localisation table is CSV or Parquet"):
        locations.load(path)


def test_a_table_that_has_changed_is_read_again(tmp_path):
    path = write(tmp_path, "time,x,y\n1,2,3\n")
    assert locations.load(path).position["x"].tolist() == [2.0]
    write(tmp_path, "time,x,y\n1,22,3\n")
    assert locations.load(path).position["x"].tolist() == [22.0]
    with pytest.raises(NotFoundError):
        locations.load(str(tmp_path / "missing.csv"))


def samples(time=None, *, origin=T0, channels=None, **counter):
    columns = [*([] if time is None else [time]), *counter.values()]
    n = len(columns[0])
    return Samples(
        source="run.csv",
        wheel="fl",
        geometry=Geometry(0.1, 0.1, 0.018),
        origin=origin,
        time=None if time is None else np.array(time, dtype=float),
        channels={name: np.array(values, dtype=float) for name, values in (channels or {}).items()},
        labels={},
        stretch=np.zeros(n, dtype=np.intp),
        distance=None,
        set_aside=Labels(np.full(n, -1, dtype=np.int32), ()),
        drivers={name: np.array(values, dtype=float) for name, values in counter.items()},
    )


def table(tmp_path, text):
    path = tmp_path / "places.csv"
    path.write_text(text)
    return locations.load(str(path))


def by_clock(tmp_path, rows, of):
    text = "time,longitude,latitude\n" + "".join(f"{t!r},{lon},{lat}\n" for t, lon, lat in rows)
    placed = locations.locate(of, table(tmp_path, text))
    return placed, of.channels["longitude"].tolist(), of.channels["latitude"].tolist()


nan = pytest.approx(np.nan, nan_ok=True)


def test_between_two_entries_and_never_beyond(tmp_path):
    of = samples([0.0, 1.0, 1.25, 3.0, 3.5], channels={"longitude": [9.0] * 5, "latitude": [9.0] * 5})
    rows = [(T0 + 1, 10.0, 50.0), (T0 + 2, 11.0, 51.0), (T0 + 3, 12.0, 50.0)]
    placed, longitude, latitude = by_clock(tmp_path, rows, of)
    assert placed == Placed("clock", 3, 2, 0)
    # Where the table is silent the log's own positions do not stand in for it.
    assert longitude == [nan, 10.0, 10.25, 12.0, nan]
    assert latitude == [nan, 50.0, 50.25, 50.0, nan]
    assert of.origins["longitude"].endswith("places.csv, by clock")
    assert of.remarks == ["wheel fl: 3 of 5 samples placed by clock; 2 are outside the table or in its gaps"]


def test_not_across_a_gap_of_the_table(tmp_path):
    rows = [(float(t), t, t) for t in (0, 1, 2, 3, 7, 8, 9)]
    placed, longitude, _ = by_clock(tmp_path, rows, samples([2.5, 3.0, 5.0, 7.0, 7.5], origin=0.0))
    assert longitude == [2.5, 3.0, nan, 7.0, 7.5]
    # Of 3.5 median intervals, as for every channel.
    rows = [(float(t), t, t) for t in (0, 1, 2, 3, 6.5, 7.5, 8.5)]
    placed, longitude, _ = by_clock(tmp_path, rows, samples([5.0], origin=0.0))
    assert longitude == [5.0]
    assert placed.missed == 0


def test_a_fix_a_day_is_no_track(tmp_path):
    """However rare the entries are: in more than five minutes a rover does not go straight on."""
    rows = [(0.0, 0.0, 0.0), (300.0, 1.0, 1.0), (601.0, 2.0, 2.0), (86_400.0, 3.0, 3.0)]
    of = samples([150.0, 450.0, 601.0, 43_200.0, 86_400.0], origin=0.0)
    assert by_clock(tmp_path, rows, of)[1] == [0.5, nan, 2.0, nan, 3.0]


def test_an_entry_without_position_is_none(tmp_path):
    rows = [(0.0, 0.0, 0.0), (1.0, "", 5.0), (2.0, 2.0, 2.0)]
    placed, longitude, latitude = by_clock(tmp_path, rows, samples([1.0, 0.5], origin=0.0))
    assert longitude == latitude == [1.0, 0.5]
    assert placed == Placed("clock", 2, 0, 0)


def test_two_places_at_one_time_are_none(tmp_path):
    rows = [
        (0.0, 0.0, 0.0),
        (1.0, 1.0, 1.0),
        (1.0, 1.5, 1.0),
        (2.0, 2.0, 2.0),
        (3.0, 3.0, 3.0),
        (3.0, 3.0, 3.0),
    ]
    placed, longitude, latitude = by_clock(
        tmp_path, rows, samples([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0], origin=0.0)
    )
    assert longitude == [0.0, nan, nan, nan, 2.0, 2.5, 3.0, nan]
    # One of the two contradicts itself, so that neither is known.
    assert latitude == longitude[:1] + [nan] * 3 + longitude[4:7] + [nan]
    assert placed == Placed("clock", 4, 1, 3)
    assert str(placed).endswith("1 are outside the table or in its gaps; 3 have more than one place there")


@pytest.mark.parametrize(
    ("ends", "middle"),
    [((179.9, -179.9), -180.0), ((-179.5, 179.7), -179.9), ((359.8, 0.4), 0.1), ((10.0, 20.0), 15.0)],
)
def test_across_the_date_line_the_shorter_way(tmp_path, ends, middle):
    rows = [(0.0, ends[0], 0.0), (1.0, ends[1], 1.0)]
    _, longitude, _ = by_clock(tmp_path, rows, samples([0.0, 0.5, 1.0], origin=0.0))
    assert longitude == pytest.approx([ends[0], longitude[1], ends[1]], abs=1e-12)
    assert np.cos(np.radians(longitude[1] - middle)) == pytest.approx(1.0, abs=1e-15)
    low = min(ends) < 0
    assert (-180.0 if low else 0.0) <= longitude[1] <= (180.0 if low else 360.0)


def test_clocks_with_other_origins_do_not_meet(tmp_path):
    rows = [(float(t), t, t) for t in range(5)]
    placed, longitude, _ = by_clock(tmp_path, rows, samples([0.0, 1.0]))
    assert longitude == [nan, nan]
    assert placed == Placed("clock", 0, 2, 0)


@given(
    st.lists(st.tuples(st.integers(0, 60), st.integers(0, 3)), min_size=1, max_size=12),
    st.lists(st.integers(-10, 130), min_size=1, max_size=12),
)
def test_a_place_by_clock_is_between_its_neighbours(tmp_path_factory, entries, clock):
    """Against a search of every entry, one sample after the other."""
    rows = [(float(t), float(place), 0.0) for t, place in entries]
    folder = tmp_path_factory.mktemp("places")
    of = samples([t / 2 for t in clock], origin=0.0)
    placed, longitude, _ = by_clock(folder, rows, of)
    times = sorted({t for t, _, _ in rows})
    gap = max(0.5, 3.5 * float(np.median(np.diff(times)))) if len(times) > 1 else 0.5
    counts = {"placed": 0, "missed": 0, "ambiguous": 0}
    for t, got in zip((t / 2 for t in clock), longitude, strict=True):
        before, after = [s for s in times if s <= t], [s for s in times if s >= t]
        near = {before[-1], after[0]} if before and after else set()
        if not near or max(near) - min(near) > gap + 1e-6:
            counts["missed"] += 1
            assert np.isnan(got)
            continue
        there = [{place for s, place, _ in rows if s == time} for time in sorted(near)]
        if any(len(some) > 1 for some in there):
            counts["ambiguous"] += 1
            assert np.isnan(got)
            continue
        counts["placed"] += 1
        ends = [some.pop() for some in there]
        share = (t - min(near)) / (max(near) - min(near)) if len(near) > 1 else 0.0
        assert got == pytest.approx(ends[0] + share * (ends[-1] - ends[0]), abs=1e-12)
    assert placed._asdict() == {"by": "clock", **counts}


COUNTER = """site,drive,pose,longitude,latitude
1,0,0,10.0,50.0
1,0,1,10.1,50.1
1,2,-1,11.0,51.0
1,2,4,11.4,51.4
1,6,1,12.1,52.1
1,6,2,12.2,52.2
1,8,3,13.0,53.0
1,8,3,13.0,53.0
1,9,3,14.0,54.0
1,9,3,14.5,54.0
"""


def test_by_site_drive_and_pose(tmp_path):
    """An entry of pose −1 is of the whole drive, where there is none of the pose itself."""
    keys = [(1, 0, 1), (1, 2, 4), (1, 2, 5), (1, 6, 9), (1, 8, 3), (1, 9, 3), (2, 0, 0), (1, np.nan, 0)]
    site, drive, pose = zip(*keys, strict=True)
    of = samples(np.arange(8.0), SITE=site, Drive=drive, pose=pose)
    placed = locations.locate(of, table(tmp_path, COUNTER))
    assert of.channels["longitude"].tolist() == [10.1, 11.4, 11.0, nan, 13.0, nan, nan, nan]
    assert of.channels["latitude"].tolist() == [50.1, 51.4, 51.0, nan, 53.0, nan, nan, nan]
    assert placed == Placed("site, drive and pose", 4, 3, 1)
    text = "3 are not in the table; 1 have more than one place there"
    assert of.remarks == [f"wheel fl: 4 of 8 samples placed by site, drive and pose; {text}"]


def test_a_log_without_poses(tmp_path):
    """Several poses are several places, unless one entry is of the whole drive."""
    of = samples(site=[1, 1, 1, 1, 1], drive=[0, 2, 6, 8, 77])
    placed = locations.locate(of, table(tmp_path, COUNTER))
    assert of.channels["longitude"].tolist() == [nan, 11.0, nan, 13.0, nan]
    assert placed == Placed("site and drive", 2, 1, 2)


def test_a_table_without_poses(tmp_path):
    of = samples(site=[1, 1, 1], drive=[0, 4, 4], pose=[7, 8, 9])
    text = "site,drive,x,y\n1,0,5,6\n1,4,7,8\n"
    assert locations.locate(of, table(tmp_path, text)) == Placed("site and drive", 3, 0, 0)
    assert of.channels["x"].tolist() == [5.0, 7.0, 7.0]
    assert "longitude" not in of.channels


def test_a_counter_stands_above_the_clock(tmp_path):
    of = samples([0.0, 1.0], origin=0.0, site=[1, 1], drive=[0, 2])
    text = "time,site,drive,x,y\n0,1,2,5,6\n1,1,0,7,8\n"
    assert locations.locate(of, table(tmp_path, text)).by == "site and drive"
    assert of.channels["x"].tolist() == [7.0, 5.0]


def test_long_logs_by_counter_as_by_a_dictionary(tmp_path):
    rng = np.random.default_rng(3)
    entries = {
        (s, d, p): (rng.uniform(0, 9), rng.uniform(0, 9)) for s in (1, 2) for d in range(9) for p in range(3)
    }
    text = "site,drive,pose,x,y\n" + "".join(
        f"{s},{d},{p},{x!r},{y!r}\n" for (s, d, p), (x, y) in entries.items()
    )
    keys = np.repeat(rng.integers([1, 0, 0], [4, 10, 4], (400, 3)), rng.integers(1, 60, 400), axis=0)
    of = samples(site=keys[:, 0], drive=keys[:, 1], pose=keys[:, 2])
    placed = locations.locate(of, table(tmp_path, text))
    expected = [entries.get(tuple(key), (np.nan, np.nan)) for key in keys.tolist()]
    np.testing.assert_array_equal(np.column_stack([of.channels["x"], of.channels["y"]]), expected)
    assert placed.missed == int(np.isnan(expected).any(axis=1).sum()) > 0


@pytest.mark.parametrize(
    ("text", "of", "message"),
    [
        ("site,drive,x,y\n1,2,3,4\n", samples([0.0]), "that has site and drive, the log a clock"),
        ("time,x,y\n1,2,3\n", samples(site=[1], drive=[2]), "that has a clock, the log site and drive"),
        ("site,drive,x,y\n1,2,3,4\n", samples(site=[1]), "that has site and drive, the log site"),
        ("time,x,y\n1,2,3\n", samples(depth=[1]), "the log neither a clock nor site and drive"),
    ],
)
def test_nothing_in_common(tmp_path, text, of, message):
    with pytest.raises(InputError, match=message):
        locations.locate(of, table(tmp_path, text))
