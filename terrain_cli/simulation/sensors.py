"""Simulated sensors: noise, drift, outliers, dropouts, steps and clocks."""

import math
import re
import tomllib
import zlib
from dataclasses import asdict, dataclass, field
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np

from terrain_cli.errors import ConfigurationError
from terrain_cli.vocabulary import toml_files, units
from terrain_cli.vocabulary.arrays import Array, Mask
from terrain_cli.vocabulary.channels import CHANNELS, unit_hint
from terrain_cli.vocabulary.toml_files import Rule

KEYS: dict[str, Any] = tomllib.loads(Path(__file__).with_name("drive_keys.toml").read_text("utf-8"))
#: Channels that a drive has, in the order of the table.
CHANNELS_WRITTEN = (
    *("load", "torque", "sinkage", "angular_velocity", "velocity", "drawbar_pull"),
    *("pitch", "roll", "x", "y", "elevation"),
    *("yaw_rate", "acceleration", "slip_angle", "motor_temperature", "pass_number"),
)
#: Measured once, for all wheels.
OF_BODY = frozenset(
    {"velocity", "pitch", "roll", "x", "y", "elevation", "yaw_rate", "acceleration", "slip_angle"}
)
#: A slip sensor does not exist: its noise is put into the wheel speed.
SLIP = "slip"
NOISY = (*CHANNELS_WRITTEN, SLIP)
#: What a share of noise without a channel is for: W, T, z and i of the paper, and DP.
USUAL = ("load", "torque", "sinkage", "drawbar_pull", SLIP)

_AMOUNT = re.compile(r"\s*([-+]?[\d.]+(?:e[-+]?\d+)?)\s*(\S.*)?", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class SensorAmount:
    """How large an error is."""

    share: float = 0.0  # Of the true value
    absolute: float = 0.0  # In the unit of the channel, SI

    def at(self, true: Array) -> Array:
        return np.hypot(self.share * true, self.absolute)

    def __bool__(self) -> bool:
        return bool(self.share or self.absolute)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """How a channel errs; all that is given here adds up."""

    # Standard deviation of noise that has no memory
    white: SensorAmount = field(default_factory=SensorAmount)
    # Standard deviation of first-order autoregressive noise
    correlated: SensorAmount = field(default_factory=SensorAmount)
    correlation_time: float = 1.0  # Of that, in s
    # How far off the channel is at the end of the drive; it grows evenly
    drift: SensorAmount = field(default_factory=SensorAmount)
    outliers: float = 0.0  # Share of the samples that are wild
    # How far those are off, either way
    outlier_size: SensorAmount = field(default_factory=lambda: SensorAmount(share=2.0))
    dropouts: float = 0.0  # Share of the samples that are lost
    dropout_length: float = 0.0  # Mean duration of a loss in s; single samples if 0
    quantum: float = 0.0  # Step in which the channel is reported, in its unit

    def error(self, time: Array, true: Array, duration: float, seed: int, key: str) -> Array:
        """Return what is added to true values at evenly spaced times (s); NaN where the sample is lost."""
        n = len(time)
        total = np.zeros(n)
        if self.white:
            total += self.white.at(true) * generator(seed, f"{key} white").normal(size=n)
        if self.correlated:
            memory = math.exp(-_interval(time) / self.correlation_time)
            draws = generator(seed, f"{key} correlated").normal(size=n)
            total += self.correlated.at(true) * _autoregressive(draws, memory)
        if self.drift:
            total += self.drift.at(true) * time / duration
        if self.outliers:
            rng = generator(seed, f"{key} outliers")
            wild = rng.random(n) < self.outliers
            total += np.where(wild, rng.choice([-1.0, 1.0], n) * self.outlier_size.at(true), 0.0)
        if self.dropouts:
            total[self._lost(n, _interval(time), generator(seed, f"{key} dropouts"))] = np.nan
        return total

    def _lost(self, n: int, interval: float, rng: np.random.Generator) -> Mask:
        """Draw which samples are lost: a chain of two states whose long-run share is the one asked for."""
        length = max(self.dropout_length / interval, 1.0)
        draws = rng.random(n)
        if length == 1.0:
            return np.asarray(draws < self.dropouts)
        ends = 1.0 / length
        begins = min(ends * self.dropouts / (1.0 - self.dropouts), 1.0)
        first = bool(draws[0] < self.dropouts) if n else False
        states = accumulate(draws[1:], lambda lost, u: u >= ends if lost else u < begins, initial=first)
        return np.fromiter(states, dtype=bool, count=max(n, 1))[:n]

    def rounded(self, values: Array) -> Array:
        """Return values as the sensor reports them: in whole steps, or with ten digits."""
        if self.quantum:
            digits = max(0, 1 - math.floor(math.log10(self.quantum)))
            # The second rounding takes off the dust of the product, 81.30000000000001.
            return np.asarray(np.round(np.round(values / self.quantum) * self.quantum, digits + 3))
        return ten_digits(values)

    def describe(self) -> dict[str, Any]:
        """Return what differs from a perfect sensor, for the truth: SI, amounts as {"share", "absolute"}."""
        perfect = asdict(Sensor())
        return {name: value for name, value in asdict(self).items() if value != perfect[name]}


def generator(seed: int, key: str) -> np.random.Generator:
    """Return random numbers for `key` that stay the same when others are drawn or not."""
    return np.random.default_rng([seed, zlib.crc32(key.encode())])


def _interval(time: Array) -> float:
    return float(time[1] - time[0]) if len(time) > 1 else 1.0


def _autoregressive(white: Array, memory: float) -> Array:
    """Give white noise of deviation 1 a memory, and keep its deviation."""
    if len(white) == 0:
        return white
    fresh = math.sqrt(1.0 - memory**2)
    chain = accumulate(white[1:].tolist(), lambda x, w: memory * x + fresh * w, initial=float(white[0]))
    return np.fromiter(chain, dtype=float, count=len(white))


def ten_digits(values: Array) -> Array:
    """Round to ten significant digits: what two machines may compute differently is not written."""
    mantissa, exponent = np.frexp(values)
    power = np.floor(np.log10(2.0) * exponent)
    scale = 10.0 ** np.clip(10.0 - power, -300.0, 300.0)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.round(mantissa * np.exp2(exponent) * scale) / scale)


def clock(rate: float, duration: float) -> Array:
    """Return the times (s) at which a channel is sampled, in whole microseconds; one at least."""
    return np.round(np.arange(max(math.floor(duration * rate + 1e-9), 1)) / rate, 6)


def amount_rule(channel: str) -> Rule:
    """Return the rule for an amount: ``0.02`` in the channel's unit, ``"1 mm"`` or ``"3%"``."""
    number = toml_files.number(f"an amount in {CHANNELS[channel].unit.symbol}, at least 0", 0.0)  # type: ignore[union-attr]

    def rule(value: Any, place: str) -> SensorAmount:
        if not isinstance(value, str):
            return SensorAmount(absolute=number(value, place))
        size, text = _parts(value, place)
        if text == "%":
            return SensorAmount(share=size / 100.0)
        if not text:
            return SensorAmount(absolute=size)
        unit = units.parse(text, CHANNELS[channel].dimension)
        if unit is None:
            what, hint = f"{value!r} is no amount of {channel}", f"{unit_hint(channel)}, or a share in %"
            raise ConfigurationError(f"{place}: {what}", hint=hint)
        # A difference: the zero of the unit does not matter.
        return SensorAmount(absolute=size * unit.factor)

    return rule


def _parts(value: str, place: str) -> tuple[float, str]:
    match = _AMOUNT.fullmatch(value)
    try:
        size = float(match[1]) if match else math.nan
    except ValueError:
        size = math.nan
    if match is None or not 0.0 <= size < math.inf:
        raise ConfigurationError(f"{place}: {value!r} is no amount", hint='write 0.02, "1 mm" or "3%"')
    return size, (match[2] or "").strip()


def share_rule(value: Any, place: str) -> float:
    """Read a share: ``0.02`` or ``"2%"``, below 1."""
    if isinstance(value, str):
        size, text = _parts(value, place)
        value = size / 100.0 if text == "%" else size if not text else value
    share: float = toml_files.number('a share such as 0.02 or "2%", below 1', 0.0, 1.0 - 1e-9)(value, place)
    return share


def sensor_rule(channel: str) -> Rule:
    """Return the rule for the sensor of a channel: an amount of white noise, or a table."""
    amount = amount_rule(channel)

    def quantum(value: Any, place: str) -> float:
        step: SensorAmount = amount(value, place)
        if step.share:
            raise ConfigurationError(f"{place}: a step is no share of the value")
        return step.absolute

    known: dict[str, Rule] = {"amount": amount, "share": share_rule, "quantum": quantum}
    table = toml_files.rules(KEYS["sensor"], known)

    def rule(value: Any, place: str) -> Sensor:
        if isinstance(value, dict):
            return Sensor(**table(value, place))
        return Sensor(white=amount(value, place))

    return rule


_SENSORS = toml_files.table({name: sensor_rule(name) for name in NOISY})


def sensors_rule(value: Any, place: str) -> dict[str, Sensor]:
    """Read the noise of all channels: one share for those that are usual, or a table by channel."""
    if isinstance(value, dict):
        sensors: dict[str, Sensor] = _SENSORS(value, place)
        return sensors
    return dict.fromkeys(USUAL, Sensor(white=SensorAmount(share=share_rule(value, place))))
