"""Files of effects, and samples on which laws are tried: one wheel, one soil, every channel."""

from __future__ import annotations

import numpy as np
import pytest

from terrain_cli.effects.laws import effect_file
from terrain_cli.errors import ConfigurationError
from terrain_cli.mechanics.past import along
from terrain_cli.mechanics.wheel_model import WheelGeometry

SAMPLES = 7


@pytest.fixture(scope="session")
def wheel():
    return WheelGeometry(radius=0.125, width=0.1, grouser_height=0.01, grouser_count=12)


@pytest.fixture(scope="session")
def soil():
    return {
        "cohesion": 800.0,
        "tan_phi": 0.6,
        "shear_modulus": 0.015,
        "stiffness": 1.5e6,
        "sinkage_exponent": 1.0,
    }


@pytest.fixture(scope="session")
def channels():
    ramp = np.linspace(0.0, 1.0, SAMPLES)
    back = ramp[::-1]
    channels = {
        "slip": np.array([-0.2, 0.03, 0.15, 0.3, 0.5, 0.7, 0.9]),
        "load": 50.0 + 60.0 * back,
        "sinkage": 0.008 + 0.02 * ramp,
        "torque": 1.0 + 4.0 * ramp,
        "drawbar_pull": -5.0 + 25.0 * ramp,
        "angular_velocity": 0.3 + 0.9 * back**2,
        "velocity": 0.02 + 0.4 * back,
        "pitch": -0.2 + 0.5 * ramp,
        "acceleration": -0.1 + 0.3 * ramp**2,
        "slip_angle": -0.3 + 0.63 * back,
        "pass_number": np.array([0.0, 1.0, 2.0, 0.0, 1.0, 3.0, 1.0]),
        "motor_temperature": 5.0 + 65.0 * ramp,
        "wheel_angle": 9.0 * ramp,
        "rut_slope": -0.02 + 0.05 * ramp,
        "angular_velocity_rate": -0.2 + 0.5 * ramp,
        "torque_rate": 1.0 - 1.7 * ramp,
        "drawbar_pull_rate": -2.0 + 3.1 * ramp,
        "sinkage_rate": -0.002 + 0.005 * ramp,
    }
    shown = {name: channels[name] for name in ("torque", "drawbar_pull", "sinkage")}
    one = np.zeros(SAMPLES, dtype=int)
    return channels | along(0.3 * np.arange(SAMPLES), one, channels["velocity"], shown)


@pytest.fixture
def write(tmp_path):
    def write(content):
        path = tmp_path / "effect.toml"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.fixture
def refused(write):
    """Return a function that asserts that a file is refused in one line, and returns the error."""

    def refused(content, *says):
        path = write(content)
        with pytest.raises(ConfigurationError) as error:
            effect_file.load(path)
        assert error.value.exit_code == 78
        message = str(error.value)
        assert message.startswith(f"{path}: ")
        assert "\n" not in message
        assert len(message) < 400 + len(str(path))
        for words in says:
            assert words in message + "\n" + error.value.hint
        return error.value

    return refused
