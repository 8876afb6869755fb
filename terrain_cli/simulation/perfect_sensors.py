"""From the true load and slip on the soil to the measurements of sensors without noise."""
# Laws on load and slip go from what is measured to what is felt: here they are solved for the former.

from collections import ChainMap
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from terrain_cli.errors import ConfigurationError, InputError
from terrain_cli.mechanics import past, rates
from terrain_cli.mechanics.dual import seed, slopes, value
from terrain_cli.mechanics.wheel_model import Model, Prediction, predict
from terrain_cli.simulation.course import STEP, Ride, plan, ride, standing
from terrain_cli.simulation.scenario import Scenario
from terrain_cli.telemetry import derived_channels
from terrain_cli.telemetry.effect_inputs import RUT, missing
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.channels import CHANNELS

_RATE = "_rate"
_RATE_ROUNDS = 3
#: Points of the time base on either side of the one whose slope is taken: 0.1 s, the pace of a log.
_REACH = 10
#: Turned round while the wheel drives backwards: the soil sees the same wheel as forwards.
_MIRRORED = frozenset({"pitch", "roll", "acceleration"})
_STOPPING = ("torque", "drawbar_pull")
_UNKNOWN = "(measured value sought)"
#: Rounds until measured values and predictions agree; a few are enough.
_ROUNDS = 60
_CLOSE = 1e-11
_CLOSE_ENOUGH = 1e-6
_DEEP = 0.4  # Sinkage as a share of the radius that a drive of no further wishes is planned for


def check_needs(scenario: Scenario, channels: Iterable[str]) -> None:
    """Refuse an effect that needs what the drive does not have."""
    wheel = scenario.geometry
    constants = {"grouser_count": wheel.grouser_count, "grouser_height": wheel.grouser_height}
    known = {*channels, "time", "slip", *(name for name, size in constants.items() if size)}
    for chosen in scenario.effects:
        lacking = missing(chosen.effect, known)
        if lacking:
            raise ConfigurationError(
                f"effect {chosen.effect.id} needs {' and '.join(lacking)}, which the drive does not have",
                hint="grousers are given in [wheel] of DRIVE.toml" if constants.keys() & lacking else "",
            )


class Physics:
    """What one wheel shows, at any time of its ride; InputError where the soil does not carry the load."""

    def __init__(self, scenario: Scenario, ride: Ride) -> None:
        self.scenario, self.ride = scenario, ride
        # Load and slip are already what the soil feels.
        self.felt = _without(scenario.base, scenario.model.effects, "load", "slip")
        self.effect_values = scenario.effect_values()
        self.angle = np.zeros(len(ride.time))
        reads = {name for chosen in scenario.effects for name in chosen.effect.reads}
        # The yaw rate is a channel of its own.
        wanted = sorted(name for name in reads - CHANNELS.keys() if name == RUT or name.endswith(_RATE))
        # What is measured depends on what is predicted, and the other way round.
        changed = map(scenario.model.changes, ("load", "slip"))
        self.coupled = any(changed) or bool(reads & {"torque", "drawbar_pull"})
        self.rates: dict[str, Array] = {name: np.zeros(len(ride.time)) for name in wanted}
        self.past: dict[str, Any] = {}
        if wanted or "wheel_angle" in reads:
            self._along(wanted)
        if scenario.model.remembers:
            # Without a past nothing is late.
            true = self._travelling(ride.time)
            shown = {name: true[name] for name in ("torque", "drawbar_pull", "sinkage")}
            velocity = self._as_shown(true)["velocity"]
            self.past = past.along(ride.time, np.zeros(len(ride.time), dtype=np.intp), velocity, shown)

    def _along(self, wanted: list[str]) -> None:
        """Find the rates of what is shown, and the angle that the wheel has turned, along the whole ride."""
        stretch = np.cumsum(np.diff(self.ride.soil, prepend=self.ride.soil[:1]) != 0)
        # A law on a channel may read the rate of what it gives itself: each round brings it closer.
        for _ in range(_RATE_ROUNDS if wanted else 1):
            travelling = self._travelling(self.ride.time)
            shown = self._as_shown(travelling)
            for name in wanted:
                if name == RUT:
                    radius, velocity = self.scenario.geometry.radius, shown["velocity"]
                    self.rates[name] = rates.rut_slope(
                        self.ride.time, stretch, shown["sinkage"], velocity, radius=radius
                    )
                    continue
                channel = name.removesuffix(_RATE)
                # What stops and turns round with the wheel does so in no time, and has no rate there.
                series = (travelling if channel in _STOPPING else shown)[channel]
                self.rates[name] = rates.rate(self.ride.time, stretch, series, reach=_REACH)
            turns = 0.5 * (shown["angular_velocity"][1:] + shown["angular_velocity"][:-1]) * STEP
            self.angle = np.concatenate([[0.0], np.cumsum(turns)])

    def at(self, time: Array) -> dict[str, Array]:
        """Return what perfect sensors show, slip NaN where the wheel stands, and what the soil has."""
        return self._as_shown(self._travelling(time))

    def _travelling(self, time: Array) -> dict[str, Array]:
        """Return the ride and what is shown of it, as if the wheel always drove forwards, and never stood."""
        # A standing wheel has the sinkage that it would have if it moved at the mean speed.
        here = self.ride.at(time)
        still = standing(here["velocity"], self.scenario.geometry.radius)
        sign = np.where(here["velocity"] < 0.0, -1.0, 1.0)
        pace = np.where(still, abs(self.scenario.speed), np.abs(here["velocity"]))
        known: dict[str, Any] = {**here, "time": time, "velocity": pace}
        known |= {name: sign * here[name] for name in _MIRRORED}
        known["wheel_angle"] = np.interp(time, self.ride.time, self.angle)
        for name, series in self.rates.items():
            rate = np.interp(time, self.ride.time, series)
            turned = name.removesuffix(_RATE) in {*_MIRRORED, "velocity", "angular_velocity"}
            known[name] = sign * rate if turned else rate
        place = np.interp(time, self.ride.time, np.arange(len(self.ride.time)))
        known |= {name: past.Past(one.series, place) for name, one in self.past.items()}
        return {**here, **self._settle(known, self._values(here["soil"].astype(int)))}

    def _as_shown(self, travelling: dict[str, Array]) -> dict[str, Array]:
        """Turn round what does so in reverse, and stop what stops."""
        velocity, slip = travelling["velocity"], travelling["slip"]
        radius = self.scenario.geometry.radius
        still = standing(velocity, radius)
        sign = np.where(still, 0.0, np.where(velocity < 0.0, -1.0, 1.0))
        return {
            **travelling,
            **{name: sign * travelling[name] for name in _STOPPING},
            "angular_velocity": sign * wheel_speed(np.abs(velocity), slip, radius),
            "velocity": np.where(still, 0.0, velocity),
            "slip": np.where(still, np.nan, slip),
            "true_slip": np.where(still, np.nan, travelling["true_slip"]),
        }

    def _values(self, soil: Index) -> dict[str, Array]:
        rows = [s.values(self.scenario.geometry.width) for s in self.scenario.soils]
        soils = {name: np.array([row[name] for row in rows])[soil] for name in rows[0]}
        return soils | {name: np.asarray(number) for name, number in self.effect_values.items()}

    def _settle(self, known: dict[str, Array], values: dict[str, Array]) -> dict[str, Array]:
        """Find measured load and slip, torque and pull that agree with each other."""
        felt_load, felt_slip = known["load"], known["slip"]
        radius = self.scenario.geometry.radius
        shown = {"load": felt_load, "slip": felt_slip}
        change = np.inf
        for number in range(_ROUNDS):
            known["angular_velocity"] = wheel_speed(known["velocity"], shown["slip"], radius)
            # Nothing is measured yet that a law could read.
            model = self.felt if number or not self.coupled else Model(self.scenario.base)
            seen = {name: shown[name] for name in _STOPPING} if number else {}
            after = self._forces(model, {**known, **seen}, values)
            after["load"] = self._solve("load", felt_load, {**known, **after, "slip": felt_slip}, values)
            after["slip"] = self._solve("slip", felt_slip, {**known, **after}, values)
            if not self.coupled:
                change = 0.0
            elif number > 1:
                change = max(_change(shown[name], after[name]) for name in shown)
            shown = after
            if change <= _CLOSE:
                break
        if change > _CLOSE_ENOUGH:
            what = "the effects have no values of load, slip, torque and pull that agree with each other"
            raise InputError(what, hint="make them smaller")
        return {**shown, "true_load": felt_load, "true_slip": felt_slip}

    def _forces(self, model: Model, known: dict[str, Array], values: dict[str, Array]) -> dict[str, Array]:
        wheel = self.scenario.geometry
        pressing = Model("wong-reece", model.effects)
        prediction: Prediction = predict(pressing, wheel, known, values, given="load")
        lost = np.flatnonzero(np.isnan(prediction.sinkage))
        if len(lost):
            soil = self.scenario.soils[int(known["soil"][lost[0]])]
            felt = f"{known['load'][lost[0]]:.3g} N at slip {known['slip'][lost[0]]:.2f}"
            hint = "give a smaller --load, a wider wheel, less slip or another soil"
            raise InputError(f"{soil.name} does not carry {felt}: the wheel sinks to its axle", hint=hint)
        sinkage = true = np.asarray(prediction.sinkage)
        if model.changes("sinkage"):
            unseen = _without("wong-reece", model.effects, "sinkage")
            true = np.asarray(predict(unseen, wheel, known, values, given="load").sinkage)
        if model.base == "linear":
            prediction = predict(model, wheel, {**known, "sinkage": sinkage}, values)
        torque, pull = np.asarray(prediction.torque), np.asarray(prediction.drawbar_pull)
        return {"torque": torque, "drawbar_pull": pull, "sinkage": sinkage, "true_sinkage": true}

    def _solve(
        self, quantity: str, felt: Array, known: Mapping[str, Any], values: Mapping[str, Array]
    ) -> Array:
        """Return the measured value that the laws on a quantity turn into the one felt (Newton)."""
        laws = [e for e in self.scenario.model.effects if quantity in e.laws]
        if not laws:
            return felt
        own = {e.id: {p.name: values[e.qualified(p)] for p in e.parameters} for e in laws}
        start = {name: number for name, number in known.items() if name not in {"torque", "drawbar_pull"}}
        start |= {f"measured_{name}": known[name] for name in ("torque", "drawbar_pull")}
        start |= self.scenario.geometry._asdict()
        start["wheel_radius"] = start.pop("radius")
        guess: Array = np.array(felt, dtype=float)
        for _ in range(_ROUNDS):
            q: dict[str, Any] = {**start, quantity: seed(guess, _UNKNOWN)}
            for effect in laws:
                q[quantity] = effect.laws[quantity](ChainMap(own[effect.id], q))
            steep = slopes(q[quantity]).get(_UNKNOWN, 0.0)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = np.asarray((value(q[quantity]) - felt) / steep)
            if not np.all(np.isfinite(step)):
                break
            guess = np.asarray(guess - step)
            if _change(guess, guess + step) <= _CLOSE:
                return guess
        what = f"no measured {quantity} gives the {quantity} that the soil is to feel"
        with_these = f"with the effects {', '.join(e.id for e in laws)}"
        raise InputError(f"{what}, {with_these}", hint="make them smaller")


def _without(base: Any, effects: Iterable[Any], *quantities: str) -> Model:
    kept = (replace(e, laws={q: law for q, law in e.laws.items() if q not in quantities}) for e in effects)
    return Model(base, tuple(kept))


def wheel_speed(velocity: Array, slip: Array, radius: float) -> Array:
    """Return ω (rad/s) of a wheel that moves at V with a slip i, of which a search may pass the full one."""
    return derived_channels.angular_velocity(velocity, np.minimum(slip, 0.999), radius)


def _change(before: Array, after: Array) -> float:
    scale = np.max(np.abs(after), initial=1e-12)
    return float(np.max(np.abs(after - before), initial=0.0) / scale)


def bearable(scenario: Scenario, loads: Iterable[float]) -> float:
    """Return the first mean load (N) under which no wheel sinks too deep, effects left out; or the last."""
    way = plan(scenario)
    rides = [ride(scenario, way, place) for place in scenario.wheels]
    most = max(float(r.smooth["load"].max()) for r in rides) / scenario.load
    slips = [bound(r.smooth["slip"]) for r in rides for bound in (np.min, np.max)]
    wheel = scenario.geometry
    load = scenario.load
    for load in loads:
        channels = {"slip": np.array(slips), "load": np.full(len(slips), most * load)}
        values = [soil.values(wheel.width) for soil in scenario.soils]
        depths = [predict(Model(), wheel, channels, own, given="load").sinkage for own in values]
        if np.all(np.asarray(depths) <= _DEEP * wheel.radius):
            break
    return load
