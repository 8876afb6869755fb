"""Single wheels in soil bins, digitised from papers: five and six steady points each at one load."""

import csv
import json
from pathlib import Path

import pytest

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "digitised-smooth-wheels.csv"
COLUMNS = {
    "load": "vertical_load_n",
    "slip": "slip",
    "drawbar_pull": "meas_drawbar_pull_n",
    "sinkage": "meas_sinkage_m",
    "torque": "meas_torque_nm",
}

pytestmark = pytest.mark.skipif(not DATA.is_file(), reason="../shared/data is not there")


@pytest.fixture
def points(tmp_path, monkeypatch):
    """Return a function that writes the points of a source with its rover."""

    def write(source):
        with DATA.open(encoding="utf-8") as file:
            rows = [row for row in csv.DictReader(file) if row["source"].startswith(source)]
        one = rows[0]
        lines = [",".join(COLUMNS)] + [",".join(row[name] for name in COLUMNS.values()) for row in rows]
        (tmp_path / "points.csv").write_text("\n".join(lines) + "\n", "utf-8")
        (tmp_path / "rover.toml").write_text(
            f"[wheel]\nradius = {one['wheel_radius_m']}\nwidth = {one['wheel_width_m']}\n"
            f"[soil]\nshear_modulus = {one['soil_shear_modulus_k_m']}\n",
            "utf-8",
        )
        monkeypatch.chdir(tmp_path)

    return write


def asked(terrain_est_here, *args):
    done = terrain_est_here(*args, "--json", "-q")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_wheel_of_ding_sinks_as_it_slips(points, terrain_est_here):
    """From 5 mm at rest to 17.5 mm at a slip of 0.6: no noise, though there are six points only."""
    points("ding2011")
    found = asked(terrain_est_here, "diagnose", "points.csv")
    assert found["alarm"]["raised"]
    # Six points do not earn a name.
    assert (found["verdict"], found["family"]) == ("family", ["slip-sinkage"])
    best = found["candidates"][0]["heldout_rmse"]["sinkage"]
    assert best < found["channels"]["sinkage"]["heldout_rmse"] / 5.0
    terrain_est_here("model", "new", "model.toml")
    wrong = asked(
        terrain_est_here, "model", "add", "model.toml", "drivetrain-friction", "--data", "points.csv"
    )
    assert not wrong["pays"]
    right = asked(terrain_est_here, "model", "add", "model.toml", "slip-sinkage", "--data", "points.csv")
    assert right["pays"]
    assert right["channels"]["sinkage"]["heldout_after"] < 0.001


def test_the_wheel_of_wang_and_han_has_a_parasitic_torque(points, terrain_est_here):
    """T/r less the pull is 8 to 11 N more than the soil takes, at every slip."""
    points("wang_han")
    found = asked(terrain_est_here, "diagnose", "points.csv")
    assert (found["verdict"], found["family"]) == ("family", ["drivetrain-friction"])
    first = found["candidates"][0]["parameters"]["Tc"]
    # 8 to 11 N at a radius of 85 mm.
    assert 0.6 < first["value"] < 1.0
    assert "too few to be sure" in found["sentence"]
