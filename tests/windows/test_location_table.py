"""Localisation tables: columns known by their names, units, and what latitudes count."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from formats import NotFoundError
from terrain_cli.errors import InputError, UsageError
from terrain_cli.windows import locations

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
    assert locations.load(path) is locations.load(path)
    write(tmp_path, "time,x,y\n1,22,3\n")
    assert locations.load(path).position["x"].tolist() == [22.0]
    with pytest.raises(NotFoundError):
        locations.load(str(tmp_path / "missing.csv"))
