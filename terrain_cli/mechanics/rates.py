"""What follows from the order of samples: rates, slopes of the rut, and the angle of the grousers.

Every stretch of a log begins at an unknown angle of the wheel, so that over several of them the ripple of
one amplitude would cancel. The phase is read off the channel that ripples most. To be told a phase by the
very samples that are then fitted by it would find a ripple in any noise: each stretch is cut in three, and
each part is told by the next one, the last by the first. Three are the fewest with which the differences
between parts are unrelated where there is no ripple, two by two, so that nothing adds up.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from terrain_cli.vocabulary.arrays import Array, Index

#: Neighbours on either side among which is chosen, and samples that are enough to choose by.
_REACHES = (2, 4, 8, 16, 32)
_TELLING = 20_000
#: Half of the line through a rut, in radii of the wheel, and the places in it. A wheel follows nothing
#: shorter than its contact, but sinkage wanders there: in sand simulated as a continuum, of a relaxation of
#: 0.04 m, lines of no length find 0.025 m, of a quarter 0.034, of a half 0.038, of a whole radius 0.047.
_CONTACT, _PLACES = 0.5, 8
_PARTS = 3  # Parts of a stretch
#: Samples and turns from grouser to grouser that tell a phase.
_FEWEST, _TURNS = 12, 1.5
_ROUNDING = 1e-9  # Least noise of a channel, as a share of its size
_KNOWN = 0.5  # Share of its samples that a channel has to have
#: Seen from the other one of two samples, what each of the sums of lines gets of this one.
_TURNED = np.array([[1.0], [-1.0], [-1.0], [1.0], [1.0]])
_STANDS_OUT = 4.0  # Times its power in noise at which a ripple stands out: below, there is nothing to align


def rate(
    time: ArrayLike, stretch: ArrayLike, values: ArrayLike, *, reach: int | None = None, least: int = 0
) -> Array:
    """Differentiate a channel by time in s: the slope of a line through each sample and its neighbours.

    Time rises within a stretch; samples of different stretches are no neighbours. `reach` is the number of
    neighbours on either side; fewer at the ends of a stretch. If not given, it is as many, `least` at least,
    as let the line predict best the samples that it passes (leave-one-out): the noisier the channel, the
    more. NaN where a stretch has a single sample.
    """
    time, values = np.asarray(time, dtype=float), np.asarray(values, dtype=float)
    stretch = np.asarray(stretch)
    return _lines(time, stretch, values, reach or _telling(time, stretch, values, least))[1]


def level(time: Array, stretch: Index, values: Array) -> Array:
    """Return a channel without its noise: the lines of `rate` at each sample."""
    reach = _telling(time, stretch, values, 0)
    found, _ = _lines(time, stretch, values, reach)
    # A line cuts off what bends, in proportion to reach (reach + 1): so much less than one twice as long.
    longer, _ = _lines(time, stretch, values, 2 * reach)
    return np.asarray(found + (reach + 1.0) / (3.0 * reach + 1.0) * (found - longer))


def _telling(time: Array, stretch: Index, values: Array, least: int) -> int:
    """Return on how many neighbours on either side the lines tell a sample best that they have not seen."""
    some, reaches = slice(0, _TELLING), [near for near in _REACHES if near >= least]
    nested = _sums(time[some], stretch[some], values[some], reaches)
    return reaches[int(np.argmin([_left_out(sums) for sums in nested]))]


def _lines(time: Array, stretch: Index, values: Array, reach: int) -> tuple[Array, Array]:
    """Return level and slope of the line through each sample and its neighbours."""
    ((count, st, sv, stt, stv),) = _sums(time, stretch, values, [reach])
    spread = count * stt - st * st
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.where(spread > 0.0, (count * stv - st * sv) / spread, np.nan)
        return np.asarray(values + (sv - slope * st) / count), np.asarray(slope)


def _sums(time: Array, stretch: Index, values: Array, reaches: Sequence[int]) -> Iterator[Array]:
    """Yield number of neighbours and Σ t, Σ v, Σ t², Σ t v about each sample, so that nothing cancels.

    One array, to which each of the rising `reaches` adds further neighbours.
    """
    sums = np.zeros((5, len(time)))
    sums[0] = np.isfinite(values)
    for before, reach in pairwise([0, *reaches]):
        for shift in range(before + 1, min(reach, len(time) - 1) + 1):
            dv = values[shift:] - values[:-shift]
            near = (stretch[shift:] == stretch[:-shift]) & np.isfinite(dv)
            dt = np.where(near, time[shift:] - time[:-shift], 0.0)
            dv = np.where(near, dv, 0.0)
            terms = np.stack([near, dt, dv, dt * dt, dt * dv])
            sums[:, :-shift] += terms
            sums[:, shift:] += _TURNED * terms
        yield sums


def _left_out(sums: Array) -> float:
    """Return the mean square by which lines through the neighbours alone miss the samples."""
    count, st, sv, stt, stv = sums
    spread = count * stt - st * st
    enough = (count >= 4.0) & (spread > 0.0)
    if not enough.any():
        return np.inf
    count, st, sv, stt, stv, spread = (part[enough] for part in (*sums, spread))
    level, leverage = (stt * sv - st * stv) / spread, stt / spread
    return float(np.mean((level / (1.0 - leverage)) ** 2))


def rut_slope(
    time: ArrayLike, stretch: ArrayLike, sinkage: ArrayLike, velocity: ArrayLike, *, radius: float
) -> Array:
    """Differentiate the sinkage by the distance that the wheel moves, whichever way: the slope of its rut.

    Lines are laid as in `rate`, through places instead of samples, and over no less than a contact. The
    samples of a place count as one, so that a wheel that stands has the slope of the rut on both sides of it,
    however long it stands. Time in s rises within a stretch, and stretches rise. NaN where not known, and in
    a stretch in which the wheel stays where it is.
    """
    stretch, sinkage = np.asarray(stretch), np.asarray(sinkage, dtype=float)
    distance = wheel_angle(time, stretch, np.abs(np.asarray(velocity, dtype=float)))
    slope = np.full(len(distance), np.nan)
    known = np.flatnonzero(np.isfinite(sinkage))
    if not len(known):
        return slope
    number = np.floor(distance[known] / (_CONTACT * radius / _PLACES))
    begins = np.concatenate([[True], (np.diff(number) != 0) | (np.diff(stretch[known]) != 0)])
    place = np.cumsum(begins) - 1
    at, depth = (np.bincount(place, column[known]) / np.bincount(place) for column in (distance, sinkage))
    slope[known] = rate(at, stretch[known][begins], depth, least=_PLACES)[place]
    return slope


def wheel_angle(time: ArrayLike, stretch: ArrayLike, angular_velocity: ArrayLike) -> Array:
    """Integrate the angle (rad) that the wheel turned since its stretch began, by the trapezoidal rule."""
    time, omega = np.asarray(time, dtype=float), np.asarray(angular_velocity, dtype=float)
    stretch = np.asarray(stretch)
    if len(time) == 0:
        return np.zeros(0)
    follows = stretch[1:] == stretch[:-1]
    turned = np.where(follows, 0.5 * (omega[1:] + omega[:-1]) * np.diff(time), 0.0)
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(turned))])
    first = np.flatnonzero(np.concatenate([[True], ~follows]))
    lengths = np.diff(np.append(first, len(time)))
    return np.asarray(total - np.repeat(total[first], lengths))


def aligned(
    angle: Array, stretch: Index, grousers: int, shown: Sequence[Array], beside: Sequence[Array]
) -> Array:
    """Count the wheel's angle, rad, in every stretch from where a grouser is at the crest of the ripple.

    `angle` is from the beginning of each stretch; stretches rise. `grousers` is their number round the wheel,
    Ng; `shown` are channels that may ripple, and `beside` what these follow besides, a straight line within
    each part: time, load, slip. The angle stays as it was where there is one stretch alone, whose phase the
    ripple's sine and cosine are; where none ripples; and in stretches that are too short to tell.
    """
    cuts = np.flatnonzero(np.diff(stretch)) + 1
    if not len(cuts) or not grousers:
        return angle
    shown = [column for column in shown if np.isfinite(column).mean() > _KNOWN]
    if not shown:
        return angle
    psi, table, columns = grousers * angle, np.stack(shown, axis=1), np.stack(beside, axis=1)
    found: list[tuple[list[slice], list[tuple[Array, Array]]]] = []
    for first, end in pairwise([0, *cuts.tolist(), len(angle)]):
        bounds = np.linspace(first, end, _PARTS + 1).astype(int).tolist()
        parts = [slice(i, j) for i, j in pairwise(bounds)]
        ripples = [_ripple(psi[part], table[part], columns[part]) for part in parts]
        known = [one for one in ripples if one is not None]
        if len(known) == _PARTS:
            found.append((parts, known))
    if not found:
        return angle
    power = np.mean([own for _, known in found for _, own in known], axis=0)
    # Which channel, and whether any, is chosen by how much they ripple: that says nothing of phases.
    channel = int(np.argmax(power))
    if power[channel] < _STANDS_OUT:
        return angle
    result = angle.copy()
    for parts, known in found:
        for part, (phase, _) in zip(parts, [*known[1:], known[0]], strict=True):
            result[part] -= phase[channel] / grousers
    return result


def _ripple(psi: Array, shown: Array, beside: Array) -> tuple[Array, Array] | None:
    """Return phase and power over noise of the ripple of each channel in a part; None if it is too short."""
    known = np.isfinite(shown).all(axis=1) & np.isfinite(beside).all(axis=1) & np.isfinite(psi)
    psi, shown, beside = psi[known], shown[known], beside[known]
    count = len(psi)
    if count < _FEWEST or np.ptp(psi) < 2.0 * np.pi * _TURNS:
        return None
    beside = beside - beside.mean(axis=0)
    size = np.abs(beside).max(axis=0)
    lines = beside / np.where(size > 0.0, size, 1.0)
    design = np.column_stack([np.cos(psi), np.sin(psi), np.ones(count), lines])
    fit = np.linalg.lstsq(design, shown, rcond=None)[0]
    noise = ((shown - design @ fit) ** 2).sum(axis=0) / (count - design.shape[1])
    cosine, sine = fit[:2]
    # A channel that never changes is not noise-free but without a ripple.
    noise = np.maximum(noise, (_ROUNDING * np.abs(shown).max(axis=0)) ** 2 + np.finfo(float).tiny)
    power = (cosine**2 + sine**2) * count / (4.0 * noise)
    return np.arctan2(sine, cosine), power
