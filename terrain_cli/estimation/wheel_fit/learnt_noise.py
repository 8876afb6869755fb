"""Noise of the sensors, learnt from the data: from differences of neighbours, or by likelihood.

`ScaledDifferences` is for `comparison` and `diagnosis`, which whiten residuals by the part of them that is
not smooth, so that what a model misses does not pass for noise.

`LikelyNoise` is for estimates with errors: restricted maximum likelihood. The residuals of a sample have the
covariance S = Σ_c s_c² v_c v_cᵀ, one term for each noisy channel c: v_c is the derivative of the residuals by
that channel, an input or an output. s_c is the standard deviation of the channel's noise. The channels differ
in how their v_c change with load, sinkage and slip, which tells the s_c apart. At the best s_c

    Σ (v_cᵀ S⁻¹ g)² = Σ tr(P v_c v_cᵀ),    P = S⁻¹ − S⁻¹ A (Aᵀ S⁻¹ A + 1)⁻¹ Aᵀ S⁻¹,

with the residuals g and their derivatives A by the unknowns (Patterson & Thompson 1971). A step is one of
Fisher scoring in log s_c. A channel has two such terms, noise that is a share of its value and noise that is
constant: torque that errs by the same amount at any slip, taken for a share of it, would pass for slip
that errs. Noise that lasts for several samples tells less of itself than so many independent ones: the
likelihood then counts for so much less beside the prior. The true values of the inputs are those of the
fit (`linearised`), so that a load that really varies from sample to sample does not pass for noise.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from terrain_cli.estimation.line.moments import segment_sum, window_products
from terrain_cli.estimation.wheel_fit.channel_series import LargestNoise
from terrain_cli.estimation.wheel_fit.excess_scatter import MISSED, NORMAL_MEDIAN, memory
from terrain_cli.estimation.wheel_fit.fit_data import BALANCE, CHANNELS, FitData, Noise, level
from terrain_cli.estimation.wheel_fit.linearised import Equations, solve_lower
from terrain_cli.estimation.wheel_fit.normal_equations import covariance, inverse
from terrain_cli.estimation.wheel_fit.unknowns import Unknowns
from terrain_cli.vocabulary.arrays import Array, Bounds, Index, Mask, ratio

USUAL = 0.03  # What is assumed of a channel of which nothing else is known
#: Channels that pass through zero: their noise is no share of their value.
_ABSOLUTE = frozenset({"drawbar_pull"})
_LEAST_DIFFERENCES = 1e-6  # Least noise of noise-free data, as a share
#: Rounds at the most, and the change of the noise that is the last.
ROUNDS, _SETTLED = 12, 0.03
#: What sensors usually are: a share of the value, or of its root mean square; of the slip, a ratio of
#: speeds, in its own unit. Judged.
_USUAL, _USUAL_SLIP = 0.02, 0.01
#: How far the quality of all sensors together, and of one beside the others, may be from that: standard
#: deviations of the logarithm. Judged: a factor of 20, and of e.
_ALL, _EACH = 3.0, 1.0
#: Longest step of a logarithm; least change of the level of all in one step, and least noise, as a share.
_LONGEST, _LEAST = 1.5, 1e-6
#: Rounds at the most, samples of all windows together, and the length in standard errors of a step that is
#: the last. So many know the noise of a channel by 3 %, and no error changes by more; near is enough to
#: tell what is none.
_WHOLE, _NEAR = (20, 3_000, 0.05), (8, 600, 0.5)
_UPHILL = 8  # Steps uphill in each round, where channels say something of their noise themselves
_SURE = 0.1  # A noise known better than by a tenth changes no error noticeably
_SHORTEST = 0.1  # Least share of a step
_LOWEST = float(np.log(_LEAST / _USUAL))  # That of noise-free data, in logarithms from the prior's centre


class ScaledDifferences:
    """Scales the noise until the residuals are as large as it says.

    The noise is one for all windows, as the sensors are. Of samples in time only the white part of
    the residuals counts: what is left of them follows from the model.
    """

    rounds, lasting = ROUNDS, 1.0
    samples = 6_000  # Of all windows together, enough to know the noise by 2 %

    def __init__(self, data: FitData, *, ordered: bool) -> None:
        self._ordered = ordered
        self.noise = from_differences(data.channels, data.bounds) if ordered else assumed(data.channels)

    def begin(self, data: FitData) -> None:
        self._data, self._residual = data, np.zeros_like(data.measured)

    def add(self, block: Index, _: FitData, found: Equations) -> None:
        bounds = self._data.bounds
        self._residual[:, bounds[block[0]] : bounds[block[-1] + 1]] = found.bounded

    def settled(self, misfit: float, dof: float, _: tuple[Array, Array, Array]) -> bool:
        """Change the noise, and tell whether it has settled."""
        variance = misfit / dof
        if self._ordered:
            variance = min(variance, _white(self._residual, self._data))
        finest = min((share for share in self.noise.relative.values() if share > 0.0), default=1.0)
        factor = max(float(np.sqrt(variance)), _LEAST_DIFFERENCES / finest, 1e-3)
        self.noise = self.noise.scaled(factor)
        return abs(factor - 1.0) < _SETTLED or finest * factor <= 1.01 * _LEAST_DIFFERENCES

    def others(self) -> tuple[tuple[Noise, Noise], ...]:
        """Return no other noise: it is taken for known."""
        return ()


def assumed(channels: Mapping[str, Array]) -> Noise:
    """Noise of steady test points, the same share in all, to be scaled by the residuals about the fit."""
    size = {name: level(channels[name]) for name in CHANNELS if name in channels}
    return Noise(
        {name: USUAL for name in size if name not in _ABSOLUTE},
        {name: USUAL * level for name, level in size.items() if name in _ABSOLUTE},
    )


def from_differences(channels: Mapping[str, Array], bounds: Bounds) -> Noise:
    """White part of each channel, from second differences within the windows.

    Samples are in their order in time, NaN where not measured. A true value that varies from sample to sample
    passes for noise here; the residuals of a fit tell by how much.
    """
    relative: dict[str, float] = {}
    absolute: dict[str, float] = {}
    inside = inner(bounds)
    for name in CHANNELS:
        if name not in channels:
            continue
        column = channels[name]
        size = np.abs(column[1:-1][inside]) if name not in _ABSOLUTE else None
        second = np.abs(column[:-2] - 2.0 * column[1:-1] + column[2:])[inside] / np.sqrt(6.0)
        if size is not None:
            second = ratio(second, size, np.nan)
        second = second[np.isfinite(second)]
        usual = USUAL * (level(column) if size is None else 1.0)
        deviation = float(np.median(second)) / NORMAL_MEDIAN if len(second) else usual
        (absolute if size is None else relative)[name] = deviation
    # One channel of which the file gives few digits, or a constant, is not without noise.
    return Noise({name: max(share, 1e-3) for name, share in relative.items()}, absolute)


def inner(bounds: Bounds) -> Mask:
    """Tell which of the samples 1 to n − 2 have a neighbour of their own window on either side."""
    n = int(bounds[-1])
    window = np.repeat(np.arange(len(bounds) - 1), np.diff(bounds))
    return np.asarray(window[2:] == window[:-2]) if n > 2 else np.zeros(0, dtype=bool)


def _white(residual: Array, data: FitData) -> float:
    """Return the variance of neighbours' differences in the residuals; infinite where there are none."""
    if residual.shape[1] < 3:
        return np.inf
    whole = np.asarray(data.seen.all(axis=0))
    neighbours = inner(data.bounds) & whole[1:-1]
    if neighbours.sum() < 10:
        return np.inf
    second = (residual[:, :-2] - 2.0 * residual[:, 1:-1] + residual[:, 2:])[:, neighbours]
    return float(np.mean(second**2) / 6.0)


@dataclass(frozen=True)
class LevelPrior:
    """What is known of the noise before the data: normal in the logarithms of the standard deviations."""

    terms: tuple[tuple[str, str], ...]  # Channel, and "relative" or "absolute"
    centre: Noise  # What is usual
    precision: Array  # Shape (terms, terms)

    def at(self, steps: Array) -> Noise:
        """Return the noise that is so far from the centre, in logarithms, shape (terms,)."""
        parts: dict[str, dict[str, float]] = {"relative": {}, "absolute": {}}
        for (name, kind), factor in zip(self.terms, np.exp(steps), strict=True):
            parts[kind][name] = getattr(self.centre, kind)[name] * float(factor)
        return Noise(**parts)

    def steps_to(self, noise: Noise) -> Array:
        """Return how far from the centre a noise is, in logarithms, shape (terms,)."""
        to, centre = (
            np.array([getattr(of, kind)[name] for name, kind in self.terms]) for of in (noise, self.centre)
        )
        # A channel that is always 0 has no constant noise at any number of steps.
        return np.asarray(np.log(ratio(to, centre, 1.0)))


def usual_noise(measured: Mapping[str, Array]) -> LevelPrior:
    """Return what is known of the noise of the channels that are measured."""
    relative: dict[str, float] = {}
    absolute: dict[str, float] = {}
    for name in CHANNELS:
        if name in measured:
            size = level(measured[name])
            constant = _USUAL_SLIP if name == "slip" else _USUAL * size
            absolute[name] = constant / np.sqrt(2.0)
            relative[name] = absolute[name] / size if size > 0.0 else _USUAL
    terms = tuple((name, "relative") for name in relative) + tuple((name, "absolute") for name in absolute)
    spread = _EACH**2 * np.eye(len(terms)) + _ALL**2
    return LevelPrior(terms, Noise(relative, absolute), inverse(spread))


class LikelyNoise:
    """Steps towards the most likely noise."""

    def __init__(
        self,
        data: FitData,
        sought: Unknowns,
        *,
        ordered: bool,
        second: float,
        near: bool = False,
        begun: Noise | None = None,
    ) -> None:
        """Begin with what is usual, or with what was `begun`: learnt from other samples of these sensors.

        `ordered` says that samples follow each other in time, so many in a `second`, and `near` that nearly
        right is enough.
        """
        self._ordered = ordered
        self.rounds, self.samples, self._last_step = _NEAR if near else _WHOLE
        channels = {**data.channels, **dict(zip(data.outputs, data.measured, strict=True))}
        names = (*data.inputs, *(name for name in data.outputs if name != BALANCE))
        self._prior = usual_noise({name: channels[name] for name in names})
        self._sizes = np.array(
            [
                segment_sum(
                    channels[name] ** 2 if kind == "relative" else np.ones(len(channels[name])), data.bounds
                )
                for name, kind in self._prior.terms
            ]
        ) / np.maximum(data.count, 1)
        steady = dict(zip(data.inputs, data.steady, strict=True))
        never = np.zeros(len(data.windows), dtype=bool)
        self._largest = {
            name: LargestNoise.of(channels[name], data, steady.get(name, never), second)
            for name in names
            if ordered
        }
        self._size, self._steps = len(sought.local) + len(sought.shared), np.zeros(len(self._prior.terms))
        self._known, self._last = inverse(self._prior.precision), np.zeros(len(self._steps))
        self._share = 1.0
        if begun is not None:
            self._steps = self._prior.steps_to(begun)
        self.noise = self._prior.at(self._steps)

    def begin(self, data: FitData) -> None:
        number, windows = len(self._prior.terms), len(data.windows)
        self._data, self._residual = data, np.zeros_like(data.measured)
        self._found, self._expected = np.zeros(number), np.zeros(number)
        self._shared = np.zeros((number, number))
        self._taken = np.zeros((number, windows, self._size, self._size))

    def add(self, block: Index, data: FitData, found: Equations) -> None:
        bounds = self._data.bounds
        self._residual[:, bounds[block[0]] : bounds[block[-1] + 1]] = found.bounded
        vectors = self._vectors(data, found)
        along = np.einsum("can,an->cn", vectors, found.bounded)
        self._found += np.einsum("cn,cn->c", along, along)
        self._expected += np.einsum("can,can->c", vectors, vectors)
        between = np.einsum("can,dan->cdn", vectors, vectors)
        self._shared += np.einsum("cdn,cdn->cd", between, between)
        by = np.einsum("can,apn->cpn", vectors, found.design)[:, None]
        self._taken[:, block] = np.swapaxes(window_products(by, by, data.bounds), 0, 1)

    def _vectors(self, data: FitData, found: Equations) -> Array:
        """Return S^(-1/2) v_c per standard deviation of the noise, shape (terms, outputs, n)."""
        outputs, n = found.residual.shape
        excess = np.repeat(data.excess, data.count)
        vectors = np.zeros((len(self._prior.terms), outputs, n))
        for row, (name, kind) in enumerate(self._prior.terms):
            if name in data.inputs:
                at = data.inputs.index(name)
                whole, variance = found.inward[:, at], found.spread[at] ** 2
            else:
                at = data.outputs.index(name)
                only = np.zeros((outputs, 1, n))
                only[at, 0] = np.where(data.seen[at], np.sqrt(found.own[at]), 0.0)
                whole, variance = solve_lower(found.factor, only)[:, 0], found.own[at]
            constant = excess * self.noise.absolute.get(name, 0.0) ** 2
            share = np.divide(constant, variance, out=np.zeros(n), where=variance > 0.0)
            share = np.clip(share if kind == "absolute" else 1.0 - share, 0.0, 1.0)
            vectors[row] = whole * np.sqrt(share)
        return vectors

    def settled(self, _: float, __: float, known: tuple[Array, Array, Array]) -> bool:
        """Change the noise by the covariances of the unknowns, and tell whether it has settled."""
        prior, whole = self._prior, covariance(*known)
        expected = self._expected - np.einsum("wab,cwba->c", whole, self._taken)
        # A level that is wrong in all channels alike is found at once: it only scales the sum of squares.
        larger = max(self._found.sum() / max(expected.sum(), 1.0), _LEAST**2)
        scale = 0.5 * np.log(larger)
        independent = 1.0 / self.lasting
        told = independent * (self._found / larger - expected)
        to, information = self._uphill(
            self._steps + scale, told, 2.0 * independent * self._shared, independent
        )
        self._known, step = inverse(information), to - self._steps
        # Scoring overshoots where two terms of a channel are hard to tell apart: steps that swing to and
        # fro are shortened, as those of the search.
        swings = step @ information @ self._last < 0.0
        self._share = float(np.clip((0.5 if swings else 2.0) * self._share, _SHORTEST, 1.0))
        self._last = step
        self._steps = np.maximum(self._steps + self._share * step, _LOWEST)
        self.noise = prior.at(self._steps)
        return bool(step @ information @ step < self._last_step**2)

    def _uphill(self, start: Array, told: Array, known: Array, independent: float) -> tuple[Array, Array]:
        """Return the best logarithms by slope and information of the residuals, and the information there.

        Beside them stand the prior and what the channels say themselves: that is no parabola, and takes
        several steps, each of which rises.
        """
        precision = self._prior.precision

        def height(to: Array) -> float:
            way = to - start
            log, _, _ = self._beyond_largest(to)
            return float(told @ way - 0.5 * (way @ known @ way + to @ precision @ to) + independent * log)

        to = start
        for _ in range(_UPHILL if self._largest else 1):
            _, beyond, stiff = self._beyond_largest(to)
            information = known + precision + independent * stiff
            slope = told - known @ (to - start) - precision @ to + independent * beyond
            step = np.clip(np.linalg.solve(information, slope), -_LONGEST, _LONGEST)
            # Where no channel says anything, the first step has found it.
            if np.abs(step).max() < _LEAST:
                break
            here = height(to)
            while np.abs(step).max() > _SHORTEST * _SURE and height(to + step) < here:
                step = 0.5 * step
            to = to + step
        return to, information

    def _beyond_largest(self, steps: Array) -> tuple[float, Array, Array]:
        """Return the log likelihood of what channels say of their noise, its slope and information.

        It is that of a variance with its degrees of freedom, where the noise exceeds it or must equal it.
        """
        log, score, information = 0.0, np.zeros(len(steps)), np.zeros((len(steps), len(steps)))
        noise = self._prior.at(steps)
        squares = np.array([getattr(noise, kind)[name] ** 2 for name, kind in self._prior.terms])
        parts = squares[:, None] * self._sizes
        for name, largest in self._largest.items():
            rows = [row for row, (other, _) in enumerate(self._prior.terms) if other == name]
            whole = parts[rows].sum(axis=0)
            there = (largest.degrees > 0.0) & (largest.steady | (whole > largest.variance)) & (whole > 0.0)
            share, degrees = parts[rows][:, there] / whole[there], largest.degrees[there]
            left = largest.variance[there] / whole[there]
            score[rows] = share @ (degrees * (left - 1.0))
            information[np.ix_(rows, rows)] = 2.0 * (share * degrees) @ share.T
            log += 0.5 * float(np.sum(degrees * (np.log(left) + 1.0 - left)))
        return log, score, information

    @property
    def lasting(self) -> float:
        """Samples of which the squares of the residuals are worth an independent one.

        A first-order process of autocorrelation ρ is worth 1 of τ = (1 + ρ)/(1 − ρ) samples, and its squares,
        with ρ² in the place of ρ, 1 of (τ + 1/τ)/2.
        """
        if not self._ordered or self._residual.shape[1] == 0:
            return 1.0
        longest = float(memory(self._residual, self._data.bounds, together=True).max())
        # What lasts longer than noise of any sensor is a misfit, and belongs to its own channel.
        longest = min(longest, MISSED)
        return 0.5 * (longest + 1.0 / longest)

    @property
    def log_weight(self) -> float:
        """Logarithm of what prior and channels make of this noise, and of how many others are as good."""
        squares = self._steps @ self._prior.precision @ self._steps
        log, _, _ = self._beyond_largest(self._steps)
        return 0.5 * float(np.linalg.slogdet(self._known)[1] - squares) + log

    def others(self) -> tuple[tuple[Noise, Noise], ...]:
        """Return noise one standard error to either side, along the axes in which it is not known well."""
        variances, axes = np.linalg.eigh(self._known)
        errors = np.sqrt(np.maximum(variances, 0.0))
        ways = (axes * errors).T[errors > _SURE]
        return tuple((self._prior.at(self._steps + way), self._prior.at(self._steps - way)) for way in ways)
