"""Make the sample drives afresh: python sample_data/make.py [FOLDER].

Two front wheels cross dry sand, upland sandy loam and wet clayey soil in a minute. The simulator of
tests/ drives them with the full Wong–Reece wheel, which none of the linear estimators assumes.

The logs of the tutorial, each with something missing, are what `terrain-est simulate` makes of `TUTORIAL`.
"""

from __future__ import annotations

import csv
import math
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "tests"), str(HERE.parent)]

from simulator import (  # noqa: E402 - found through the path above
    CHANNELS,
    DRY_SAND,
    UPLAND_SANDY_LOAM,
    WET_CLAYEY_SOIL,
    Clock,
    Drive,
    Run,
    Sensor,
    Track,
    mean_stress,
    simulate,
    steps,
    undulation,
)
from simulator.logs import write_csv, write_parquet, write_ros1, write_ros2  # noqa: E402

START = 1_754_000_000.0
RATE = 20.0
#: The whole log is silent for a moment, and one sinkage sensor is blind for a moment.
SILENCE = (27.0, 28.0)
BLIND = (47.0, 48.5)
STANDING = (12.0, 2.0)

#: Logs of docs/tutorial.md: how each is driven, and what is hidden in it.
TUTORIAL = {
    "sinks.csv": "--drive slip-sweep --drive load-steps --duration 80 --seed 3 --effect slip-sinkage:n1=0.4",
    "cable.csv": "--drive turns --drive mixed --duration 80 --seed 3 --effect {tutorial}/cable-drag.toml",
    "doubt.csv": "{tutorial}/bench.toml --seed 8",
}


def drive() -> Drive:
    """Return the sample drive: every topic on one clock, so that all formats give one table."""
    clock = Clock(RATE, gaps=(SILENCE,))
    speed = steps([(0.1, STANDING[0]), (0.0, STANDING[1]), (0.1, 60.0)])
    return Drive(
        tracks=[
            Track(
                "front-left",
                [(DRY_SAND, 20.0), (UPLAND_SANDY_LOAM, 20.0), (WET_CLAYEY_SOIL, 20.0)],
                load=undulation(80.0, 0.2, 9.0, seed=1),
                slip=undulation(0.35, 0.4, 13.0, seed=2),
            ),
            Track(
                "front-right",
                [(DRY_SAND, 21.5), (UPLAND_SANDY_LOAM, 20.0), (WET_CLAYEY_SOIL, 18.5)],
                load=undulation(76.0, 0.2, 8.0, seed=3),
                slip=undulation(0.33, 0.35, 11.0, seed=4),
            ),
        ],
        speed=speed,
        clocks={
            **dict.fromkeys(("joints", "load", "sinkage", "odometry"), clock),
            "front-right/sinkage": Clock(RATE, gaps=(SILENCE, BLIND)),
        },
        sensors={
            # Reported in steps, as sensors do: the files then do not depend on the last bit of a sine.
            "load": Sensor(relative=0.015, quantum=0.01),
            "torque": Sensor(relative=0.015, absolute=0.005, quantum=0.001),
            "drawbar_pull": Sensor(absolute=1.0, quantum=0.01),
            "sinkage": Sensor(relative=0.015, quantum=1e-5),
            "angular_velocity": Sensor(relative=0.005, quantum=1e-4),
            "velocity": Sensor(relative=0.005, quantum=1e-4),
            "x": Sensor(absolute=0.001, quantum=1e-4),
            "y": Sensor(absolute=0.001, quantum=1e-4),
        },
        channels=(*CHANNELS, "drawbar_pull"),
        start=START,
        heading=math.radians(30.0),
        seed=2004,
    )


def write_truth(run: Run, path: Path) -> None:
    """Write what the estimates are to be compared with, one row per wheel and soil."""
    header = ("wheel", "t_start_s", "t_end_s", "terrain", "c_kPa", "phi_deg", "sigma_kPa", "strength_kPa")
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for log in run.wheels.values():
            for number, stretch in enumerate(log.stretches):
                here = log.truth["soil"] == number
                load = float(log.truth["load"][here].mean())
                slip = float(log.truth["slip"][here & (log.truth["velocity"] > 0.0)].mean())
                stress = mean_stress(stretch.soil, run.drive.wheel, load, slip)
                numbers = (
                    stretch.soil.cohesion / 1e3,
                    math.degrees(stretch.soil.friction_angle),
                    stress / 1e3,
                    stretch.soil.strength(stress) / 1e3,
                )
                writer.writerow(
                    (log.name, stretch.start, stretch.end, stretch.soil.name, *(f"{n:.4g}" for n in numbers))
                )


def write_tutorial(folder: Path) -> None:
    """Write the logs of the tutorial, and the rover file that fits them."""
    folder.mkdir(exist_ok=True)
    for name, options in TUTORIAL.items():
        # At 10 Hz, and with 3 % of noise, a log stays small enough to be kept here.
        words = options.format(tutorial=HERE / "tutorial").split()
        command = [sys.executable, "-m", "terrain_cli", "simulate", *words]
        command += ["--rate", "10", "--noise", "3%", "-q", "--force", "-o", str(folder / name)]
        subprocess.run(command, cwd=HERE.parent, check=True)  # noqa: S603 - this program


def main(folder: Path = HERE) -> None:
    """Write run.csv, run.parquet, run.bag, run.mcap, truth.csv and tutorial/ into a folder."""
    run = simulate(drive())
    for name in ("run.bag", "run.mcap"):
        (folder / name).unlink(missing_ok=True)
    write_csv(run, folder / "run.csv")
    write_parquet(run, folder / "run.parquet")
    write_ros1(run, folder / "run.bag", compression="lz4")
    write_ros2(run, folder / "run.mcap", compression="storage")
    write_truth(run, folder / "truth.csv")
    write_tutorial(folder / "tutorial")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
