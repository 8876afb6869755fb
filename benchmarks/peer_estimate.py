"""What `terrain-est estimate` does with a bag, written with what is at hand: the peer of a benchmark.

    python -m benchmarks.peer_estimate run.bag > soil.csv

AnyReader decodes, pandas brings the channels to the clock of the torque, ruptures finds the changes
of soil (binary segmentation on every tenth sample: its PELT would take hours on all of them), numpy
and scikit-learn fit c and φ.
"""

from __future__ import annotations

import itertools
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import ruptures
from rosbags.highlevel import AnyReader
from sklearn.linear_model import RidgeCV

from benchmarks.rover_bag import GEOMETRY, WHEELS
from benchmarks.stages.stresses import straightforward

THINNED, WINDOW = 10, 100
#: In units of the variance about lines through windows of thinned samples.
PENALTY = 100.0
DELTAS = np.logspace(-8.0, 0.0, 17)
TOPICS = ("/joint_states", "/sinkage", "/odom", "/gps", *(f"/{wheel}/wrench" for wheel in WHEELS))


def read(path: Path) -> dict[str, pd.DataFrame]:
    """Return a table for each topic that is needed."""
    rows: dict[str, list] = {topic: [] for topic in TOPICS}
    with AnyReader([path]) as reader:
        wanted = [connection for connection in reader.connections if connection.topic in rows]
        for connection, _, raw in reader.messages(connections=wanted):
            message = reader.deserialize(raw, connection.msgtype)
            rows[connection.topic].append(_row(connection.topic, message))
    return {topic: pd.DataFrame(of_topic) for topic, of_topic in rows.items()}


def _row(topic, message):
    row = {"time": message.header.stamp.sec * 10**9 + message.header.stamp.nanosec}
    if topic == "/joint_states":
        for name, torque, angular in zip(message.name, message.effort, message.velocity, strict=True):
            row[f"torque {name}"], row[f"angular {name}"] = torque, angular
    elif topic == "/sinkage":
        row |= dict(zip(message.name, message.sinkage, strict=True))
    elif topic == "/odom":
        row["speed"] = message.twist.twist.linear.x
    elif topic == "/gps":
        row["longitude"], row["latitude"] = message.longitude, message.latitude
    else:
        row["load"] = message.wrench.force.z
    return row


def channels(topics: dict[str, pd.DataFrame], wheel: str) -> pd.DataFrame:
    """Return torque, load, sinkage, slip and position at the times of the torque."""
    joints = topics["/joint_states"]
    table = pd.DataFrame(
        {"time": joints["time"], "torque": joints[f"torque {wheel}"], "angular": joints[f"angular {wheel}"]}
    )

    def brought(topic, column):
        other = topics[topic]
        return np.interp(table["time"], other["time"], other[column], left=np.nan, right=np.nan)

    table["load"] = brought(f"/{wheel}/wrench", "load")
    table["sinkage"] = brought("/sinkage", wheel)
    table["speed"] = brought("/odom", "speed")
    table["longitude"], table["latitude"] = brought("/gps", "longitude"), brought("/gps", "latitude")
    table["slip"] = 1.0 - table["speed"] / (GEOMETRY["radius"] * table["angular"])
    return table[(table["load"] > 0.0) & (table["sinkage"] > 0.0) & (table["torque"] > 0.0)].reset_index()


def changes(x: np.ndarray, y: np.ndarray) -> list[int]:
    """Return where the line changes."""
    few = slice(THINNED // 2, None, THINNED)
    signal = np.column_stack([y, x, np.ones(len(x))])[few]
    spread = [
        np.linalg.lstsq(signal[a : a + WINDOW, 1:], signal[a : a + WINDOW, 0], rcond=None)[1].item() / WINDOW
        for a in range(0, len(signal) - WINDOW + 1, WINDOW)
    ]
    search = ruptures.Binseg(model="linear", min_size=10, jump=5).fit(signal)
    return [0, *(THINNED * b for b in search.predict(pen=PENALTY * np.median(spread))[:-1]), len(x)]


def main(path: str) -> None:
    """Print a row for each wheel and window."""
    topics = read(Path(path))
    print("wheel,t_start_s,t_end_s,n_samples,c_ls_kPa,phi_ls_deg,c_ridge_kPa,phi_ridge_deg")
    for wheel in WHEELS:
        table = channels(topics, wheel)
        given = (table[name].to_numpy() for name in ("load", "torque", "sinkage", "slip"))
        x, y = straightforward(*given, **GEOMETRY)
        edges = changes(x, y)
        for a, b in itertools.pairwise(edges):
            design = np.column_stack([np.ones(b - a), x[a:b]])
            line = np.linalg.lstsq(design, y[a:b], rcond=None)[0]
            scale = np.sqrt(np.mean(x[a:b] ** 2))
            ridge = (
                RidgeCV(alphas=(b - a) * DELTAS, fit_intercept=False).fit(design / (1.0, scale), y[a:b]).coef_
            )
            begin, end = table["time"].iloc[a] / 1e9, table["time"].iloc[b - 1] / 1e9
            numbers = (
                line[0] / 1e3,
                np.degrees(np.arctan(line[1])),
                ridge[0] / 1e3,
                np.degrees(np.arctan(ridge[1] / scale)),
            )
            print(f"{wheel},{begin},{end},{b - a}," + ",".join(map(repr, map(float, numbers))))


if __name__ == "__main__":
    main(*sys.argv[1:])
