"""What an effect is: its parameters, what is known of them beforehand, and its laws."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, Literal, Self, get_args

#: Where an effect enters: what the soil is, the stress under the rim, the shape of the contact, a
#: force on the wheel, or what a sensor shows of it.
Kind = Literal["soil", "stress", "contact", "force", "sensor"]
KINDS: tuple[Kind, ...] = get_args(Kind)

#: Every quantity that a law can change, with its unit, in the order in which the model reaches them.
QUANTITIES: dict[str, str] = {
    "slip": "1",
    "load": "N",
    "sinkage": "m",
    "radius": "m",
    "cohesion": "Pa",
    "tan_phi": "1",
    "shear_modulus": "m",
    "stiffness": "Pa/m^n",
    "sinkage_exponent": "1",
    "max_stress_angle": "rad",
    "exit_angle": "rad",
    "shear_radius": "m",
    "normal_stress": "Pa",
    "shear_stress": "Pa",
    "torque": "N m",
    "drawbar_pull": "N",
}

SKID = 0.05  # Slip below which, with its sign, a wheel skids: nearer to 0 it may be noise

#: What a law reads and gives: arrays, or numbers with derivatives. ``q["slip"]`` is a channel, a
#: quantity as it stands when the law is reached, a parameter of the effect by its own name, or one of
#: the wheel's constants.
Quantities = Mapping[str, Any]
Law = Callable[[Quantities], Any]


CERTAIN = 3.0  # Standard errors from its null at which a parameter is on the wrong side of it
#: Load in N and radius in m of the wheel of Iagnemma et al. (2004), for which sizes of parameters are told.
_PAPER_WHEEL = (98.1, 0.1)
_LARGEST_WHEEL = (1e7, 5.0)  # Those that no wheel exceeds: a haul truck has 1e6 N on each, of a radius of 2 m
_NEAR = 0.01  # Distance from a bound, in typical sizes, that is none
_MULTIPLES = (0.3, 1.0, 3.0)  # Multiples of its null at which a parameter that only shapes an effect is tried
#: And shares of what a drive reaches, where it lies within that. Stress is greatest where a rim has pressed
#: the soil to three quarters of the sinkage: a layer further down shows nothing.
_SHARES = (0.2, 0.35, 0.5, 0.65)


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known of a parameter before any data: normal, or log-normal for k and keq."""

    # mean, sd: mean and standard deviation in the parameter's own unit, of the log-normal distribution itself
    # where it is one
    mean: float
    sd: float

    @classmethod
    def factor(cls, median: float, factor: float) -> Self:
        """Return the log-normal prior "`median`, within a factor of `factor`" (one standard deviation)."""
        import numpy as np

        spread = float(np.log(factor))
        mean = median * float(np.exp(0.5 * spread**2))
        return cls(mean, mean * float(np.sqrt(np.expm1(spread**2))))

    def of_logarithm(self) -> tuple[float, float]:
        """Return mean and standard deviation of the logarithm of a log-normal parameter."""
        import numpy as np

        spread = float(np.sqrt(np.log1p((self.sd / self.mean) ** 2)))
        return float(np.log(self.mean)) - 0.5 * spread**2, spread


def mean_load(channels: Mapping[str, Any]) -> float:
    """Return the mean load in N, 0 where it is not known."""
    import numpy as np

    load = np.asarray(channels.get("load", ()), dtype=float)
    return float(load[np.isfinite(load)].mean()) if np.isfinite(load).any() else 0.0


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number of an effect, which the data can determine.

    Parameters
    ----------
    name : str
    unit : str
        In which a person reads the value; "1" for a plain number.
    null : float
        The value at which the effect is absent.
    scale : float
        A typical size, as a distance from `null`; positive.
    meaning : str
        In a few words.
    lower, upper : float
        Bounds.
    factor : float
        SI value of one `unit`, where a user's effect has another than that of SI; the numbers
        above are SI all the same.
    shape : bool
        It has no influence while the effect's other parameters are at their null values, and its own
        `null` is only where a search starts.
    needs : tuple of str
        Channels without which it has no influence on anything measured.
    skids : bool
        It has none on a wheel that does not skid, either.
    side : {-1, 0, 1}
        Side of the null on which alone nature has it, 0 for both. A fit may go to the other one: there
        it imitates something else.
    along : str
        Channel within whose range alone a parameter that only shapes the effect shows.
    grows : tuple of float
        Powers of the wheel's load and radius with which `scale` and bounds grow, see `under`.
    absolute : bool
        Whether the bounds do not grow: they are those of every wheel.
    held : str
        Why it stays at its null where a model does not hold it elsewhere; empty if it is estimated.
    """

    name: str
    unit: str
    null: float
    scale: float
    meaning: str = ""
    _: KW_ONLY
    lower: float = -math.inf
    upper: float = math.inf
    factor: float = 1.0
    shape: bool = False
    needs: tuple[str, ...] = ()
    skids: bool = False
    side: int = 0
    along: str = ""
    grows: tuple[float, ...] = (0.0, 0.0)
    absolute: bool = False
    held: str = ""

    def under(self, load: float, radius: float) -> Self:
        """Return the parameter with the scale and bounds that it has under a load, N, on a radius, m.

        They are told for the wheel of the paper. Under one with more load or a larger radius they grow; under
        a smaller one they stay, where they are only wider than they need to be.
        """
        sizes = zip((load, radius), _PAPER_WHEEL, self.grows, strict=True)
        larger = math.prod(max(own / usual, 1.0) ** power for own, usual, power in sizes)
        reach = 1.0 if self.absolute else larger
        low, high = (self.null + reach * (end - self.null) for end in (self.lower, self.upper))
        return self if larger == 1.0 else replace(self, scale=larger * self.scale, lower=low, upper=high)

    @property
    def anywhere(self) -> Self:
        """The parameter as it may be under some wheel."""
        return self.under(*_LARGEST_WHEEL)

    def tried(self, several: Sequence[Mapping[str, Any]]) -> tuple[float, ...]:
        """Return the values, SI, at which what it shapes is tried on the channels of some wheels."""
        import numpy as np

        columns = [np.asarray(channels[self.along]) for channels in several if self.along in channels]
        reached = np.concatenate([np.zeros(0), *columns])
        if np.isfinite(reached).any():
            found = np.nanquantile(reached, 0.95) * np.array(_SHARES)
        else:
            found = self.null * np.array(_MULTIPLES)
        return tuple(dict.fromkeys(np.clip(found, self.lower, self.upper).tolist()))

    def imitates(self, value: float, doubt: float) -> bool:
        """Tell whether a value, SI, is where nature has none, or as far as it could go there.

        So far from the null as `doubt` it may be and mean nothing.
        """
        away = (self.null - value) * self.side
        return away > doubt or (away > 0.0 and self.at_bound(value))

    def at_null(self, value: float) -> bool:
        """Tell whether a value, SI, is that at which the effect is absent."""
        return abs(value - self.null) <= _NEAR * self.scale

    def at_bound(self, value: float) -> bool:
        """Tell whether a value, SI, is the least or the most that the parameter can be."""
        near = _NEAR * self.scale
        return value <= self.lower + near or value >= self.upper - near

    def idle(self, several: Sequence[Mapping[str, Any]]) -> str:
        """Say why nothing measured under some wheels depends on it; empty if something does."""
        missing = [need for need in self.needs if any(need not in channels for channels in several)]
        if missing:
            return f"{' and '.join(missing)} not measured"
        if self.held:
            return self.held
        if self.skids and not any(
            (channels["slip"] < -SKID).any() for channels in several if "slip" in channels
        ):
            return "no wheel skids"
        return ""


@dataclass(frozen=True, slots=True)
class Sum:
    """A sum of an effect's parameters that nature bounds, whatever each of them is.

    Parameters
    ----------
    names : tuple of str
        Of the parameters.
    lower, upper : float
        SI.
    rates : mapping of str to str
        Parameters that count times the size of a channel: the sum is bounded from its least to its greatest
        value, not beyond. One that is not estimated does not count.
    """

    names: tuple[str, ...]
    lower: float
    upper: float
    rates: Mapping[str, str] = field(default_factory=dict)

    def weights(self, channels: Mapping[str, Any]) -> list[dict[str, float]]:
        """Return by how much each parameter counts where the rates are least and where they are greatest.

        NaN where the channel of a rate is not known.
        """
        import numpy as np

        sizes = {name: np.abs(channels[of]) for name, of in self.rates.items() if of in channels}
        plain = dict.fromkeys(self.names, 1.0) | dict.fromkeys(self.rates, math.nan)
        ends = (np.nanmin, np.nanmax)
        return [plain | {name: float(end(size)) for name, size in sizes.items()} for end in ends]

    def imitates(self, value: float, doubt: float) -> bool:
        """As `Parameter.imitates`, with how far beyond the bounds it may be and mean nothing."""
        return max(self.lower - value, value - self.upper) > doubt


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """A physical effect that can be added to a model.

    Parameters
    ----------
    id : str
        Lower-case words joined by hyphens.
    title : str
    kind : {"soil", "stress", "contact", "force", "sensor"}
    parameters : tuple of Parameter
    laws : mapping of str to callable
        One of `QUANTITIES` → its changed value. At the null values of all parameters a law returns
        ``q[quantity]``, to rounding.
    needs : tuple of str
        Channels without which the effect cannot be computed. ``NAME_rate`` is the derivative by time
        of a channel or further column, which needs `time`, and so do ``wheel_angle``, the integral
        of the angular velocity, and ``rut_slope``, the derivative of the sinkage by the distance;
        ``grouser_count`` and ``grouser_height`` are of rover.toml.
    any_of : tuple of str
        Channels at least one of which it needs besides.
    formula : str
        The law as a person reads it.
    explanation : str
        One paragraph: what happens in the ground or the drive, and the signature it leaves.
    shows : str
        The residual channels and the drivers it follows, in a few words.
    reference : str
        Who found it: authors, year, title, and doi where there is one.
    settled_by : str
        The manoeuvre that tells it from its neighbours.
    sums : tuple of Sum
        Of its parameters. A fit may go beyond their bounds: there it imitates something else.
    others : tuple of mapping of str to callable
        The same effect, with the same parameters, as others write it: what stands in place of `laws`.
        A model has `laws`; a diagnosis names the effect whichever of them the data follow.
    remembers : bool
        Whether its laws read what the model predicts before a sample (`past.Past`).
    """

    id: str
    title: str
    kind: Kind
    parameters: tuple[Parameter, ...]
    laws: Mapping[str, Law]
    needs: tuple[str, ...] = ()
    any_of: tuple[str, ...] = ()
    formula: str = ""
    explanation: str = ""
    shows: str = ""
    reference: str = ""
    settled_by: str = ""
    sums: tuple[Sum, ...] = ()
    others: tuple[Mapping[str, Law], ...] = ()
    remembers: bool = False
    origin: str = field(default="catalogue", compare=False)

    @property
    def empirical(self) -> bool:
        """Whether it was drafted from data: the scales of its parameters are then for searches alone."""
        return self.reference.startswith("empirical")

    @property
    def reads(self) -> tuple[str, ...]:
        """Channels that make a difference to the effect: what it needs, and what it uses if it is there."""
        further = (name for parameter in self.parameters for name in parameter.needs)
        every = dict.fromkeys((*self.needs, *self.any_of, *further))
        # What is late is predicted.
        return tuple(name for name in every if not (self.remembers and name in self.laws))

    @property
    def forms(self) -> tuple[Self, ...]:
        """The effect, and the same with its laws as others write them."""
        return (self, *(replace(self, laws=laws, others=()) for laws in self.others))

    def made_up_by(self, others: Iterable[Self]) -> bool:
        """Tell whether a drafted law of the same quantity and channel is there: nature bounds their sum."""
        return any(
            other.empirical and other.laws.keys() & self.laws.keys() and {*other.reads} & {*self.reads}
            for other in others
            if other.id != self.id
        )

    @property
    def limits(self) -> list[tuple[tuple[str, ...], Parameter | Sum]]:
        """What nature bounds, with the names of the parameters that are added up."""
        # Where a rate is never 0, the sum has its sign, and a part of it need not.
        within = {name for one in self.sums if one.rates for name in one.names}
        alone = [((one.name,), one) for one in self.parameters if one.side and one.name not in within]
        return [*alone, *((one.names, one) for one in self.sums)]

    def qualified(self, parameter: Parameter) -> str:
        """Return the name of a parameter among those of all effects: ``slip-sinkage.n1``."""
        return f"{self.id}.{parameter.name}"

    def limited(
        self,
        values: Mapping[str, float],
        covariance: Any,
        channels: Mapping[str, Any],
        under: tuple[float, float] = (0.0, 0.0),
    ) -> Iterator[tuple[tuple[str, ...], Parameter | Sum, float, float]]:
        """Yield what nature bounds: parameters that are added up, the bound, and the sum with its error.

        `values` are what was fitted, by qualified names, SI, with their `covariance`, to a wheel with such
        `channels`, of which `under` are the load, N, and the radius, m.
        """
        places = {name: place for place, name in enumerate(values)}
        for short, limit in self.limits:
            several = limit.weights(channels) if isinstance(limit, Sum) else [dict.fromkeys(short, 1.0)]
            rates = limit.rates if isinstance(limit, Sum) else ()
            known = {name: f"{self.id}.{name}" for name in short if f"{self.id}.{name}" in places}
            if any(name not in known and name not in rates for name in short):
                continue
            ends = []
            for weights in several:
                own = [(places[full], weights[name]) for name, full in known.items()]
                value = sum(weights[name] * values[full] for name, full in known.items())
                variance = sum(v * w * float(covariance[i][j]) for i, v in own for j, w in own)
                ends.append((value, math.sqrt(max(variance, 0.0))))
            worst = max(ends, key=lambda end: max(limit.lower - end[0], end[0] - limit.upper))
            bound = limit.under(*under) if isinstance(limit, Parameter) else limit
            yield tuple(known.values()), bound, *worst

    def imitations(
        self,
        wheels: Iterable[tuple[Any, ...]],
        errors: float = CERTAIN,
        least: float = 0.0,
    ) -> Iterator[tuple[int, tuple[str, ...], float, float]]:
        """Yield what came out where nature has none, and so stands for another effect.

        Of several wheels, each as for `limited`; beyond so many standard `errors` there is no doubt. Of a
        wheel without the effect, noise that lasts may leave little of it on the wrong side: less than the
        share `least` of what another wheel has means nothing. Yielded are the place of the wheel, the names
        of the parameters that are added up, and their sum with its standard error.
        """
        found = [(place, *one) for place, wheel in enumerate(wheels) for one in self.limited(*wheel)]
        sizes: dict[tuple[str, ...], float] = {}
        for _, names, _, value, _ in found:
            sizes[names] = max(abs(value), sizes.get(names, 0.0))
        for place, names, limit, value, error in found:
            if limit.imitates(value, errors * error) and abs(value) >= least * sizes[names]:
                yield place, names, value, error
