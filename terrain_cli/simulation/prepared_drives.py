"""Prepared drives, each of which settles one question, ready to use.

Each part is written as in a user's own file. Load and speed are shares of the wheel's mean load
and of the mean speed; angles are in degrees.
"""

from __future__ import annotations

from typing import Any

#: What is not said of a part.
CALM: dict[str, Any] = {
    "slip": {"mean": 0.3, "swing": 0.1, "period": 11.0},
    "load": {"mean": 1.0, "swing": 0.15, "period": 7.0},
    "speed": 1.0,
    "pitch_deg": 0.0,
    "roll_deg": 0.0,
    "slip_angle_deg": 0.0,
    "yaw_rate": 0.0,
    "motor_temperature": [20.0, 45.0, 38.0, 55.0],
}

#: Preset → what differs from `CALM`.
PRESETS: dict[str, dict[str, Any]] = {
    # From almost none to the verge of getting stuck, and back.
    "slip-sweep": {"slip": [0.02, 0.7, 0.05]},
    # Ballast on and off: the one way to tell c from φ, and a load cell from a torque sensor.
    "load-steps": {"load": {"steps": [0.7, 1.0, 1.3, 0.85, 1.15, 0.6]}},
    "slope": {
        "pitch_deg": [0.0, 12.0, 4.0, -8.0, 0.0],
        "slip": [0.2, 0.45, 0.3, 0.08, 0.2],
    },
    # Everything at once, each on a period of its own.
    "mixed": {
        "slip": {"mean": 0.32, "swing": 0.28, "period": 13.0},
        "load": {"mean": 1.0, "swing": 0.3, "period": 7.0},
        "speed": {"mean": 1.0, "swing": 0.6, "period": 17.0},
        "pitch_deg": {"mean": 2.0, "swing": 8.0, "period": 23.0},
        "roll_deg": {"mean": 0.0, "swing": 3.0, "period": 19.0},
        "slip_angle_deg": {"mean": 0.0, "swing": 8.0, "period": 15.0},
        "yaw_rate": {"mean": 0.0, "swing": 0.05, "period": 15.0},
    },
    # Out, back in reverse on the same track, and out again.
    "passes": {"speed": {"steps": [1.0, 1.0, 1.0, 0.0, -1.0, -1.0, -1.0, 0.0, 1.0, 1.0, 1.0]}},
    "reverse": {"speed": {"steps": [1.0, 1.0, 1.0, 0.0, -1.0, -1.0]}},
    # At almost one slip, so that what changes is due to the speed.
    "speed-steps": {
        "speed": {"steps": [0.5, 1.0, 2.0, 0.7, 1.5, 0.3]},
        "slip": {"mean": 0.3, "swing": 0.03, "period": 9.0},
    },
    "turns": {
        "slip_angle_deg": {"steps": [0.0, 6.0, 12.0, 0.0, -6.0, -12.0]},
        "yaw_rate": {"steps": [0.0, 0.04, 0.08, 0.0, -0.04, -0.08]},
    },
    # Four wheels, unless it is said how many.
    "multi": {"slip": {"mean": 0.3, "swing": 0.2, "period": 13.0}},
}
#: Wheels of a drive that is about several.
WHEELS = {"multi": 4}
#: s, of a part whose duration is not given.
DURATION = 60.0
