"""Shapes in which a residual may follow a driver."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from terrain_cli.vocabulary.arrays import Array, Index

#: Quantiles of a driver at which a step or a bend is tried.
_THRESHOLDS = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9])
#: The longest stretch that is tried, in tenths of the samples: what is longer is a step or two.
_LONGEST_STRETCH = 4
_SCALES = (0.1, 0.25)  # Parts of a driver's range within which a saturating curve levels off
_FEW_LEVELS = 6  # A driver of so few values is taken as steps between them
#: Periods in a turn of the wheel: grousers, teeth and lobes of gears may be of any number up to these.
HARMONICS = tuple(range(1, 37))


@dataclass(frozen=True, kw_only=True)
class Shape:
    """One function of one driver, of a size of about 1."""

    driver: str = ""  # Of an offset none
    # "constant", "linear", "quadratic", "saturating", "step", "stretch", "periodic" or "label"
    name: str
    # Threshold of a step, beginning of a stretch, scale of a saturating curve, period, code of a label
    at: float | None = None
    until: float = np.inf  # End of a stretch
    low: float = 0.0  # 2nd percentile of the driver, or the least of a few values
    high: float = 1.0  # 98th percentile of the driver, or the greatest of a few values
    # Difference that a coefficient of 1 makes over this range; of a periodic shape its amplitude
    span: float = 1.0
    partner: int = 0  # Of a periodic shape 0 for the cosine and 1 for the sine

    def __call__(self, values: Array) -> Array:
        inside = np.clip(values, self.low, self.high)
        if self.name == "constant":
            result = np.ones_like(values)
        elif self.name == "periodic":
            angle = 2.0 * np.pi * values / (self.at or 1.0)
            result = np.sin(angle) if self.partner else np.cos(angle)
        elif self.name == "label":
            result = np.where(values == self.at, 1.0, 0.0)
        elif self.name == "step":
            result = np.where(values > (self.at or 0.0), 1.0, 0.0)
        elif self.name == "stretch":
            result = np.where((values >= (self.at or 0.0)) & (values <= self.until), 1.0, 0.0)
        elif self.name == "saturating":
            result = 1.0 - np.exp(-(inside - self.low) / (self.at or 1.0))
        else:
            result = (inside - self.low) / (self.high - self.low)
            if self.name == "quadratic":
                result = (2.0 * result - 1.0) ** 2
        return np.asarray(result)


def of_number(driver: str, values: Array) -> list[Shape]:
    """List the shapes in which a residual may follow a number, NaN if unknown; none if it is constant."""
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return []
    low, high = (float(v) for v in np.quantile(known, [0.02, 0.98]))
    levels = np.unique(known[:: max(1, len(known) // 20_000)])
    if len(levels) <= _FEW_LEVELS:
        shape = partial(Shape, driver=driver, low=float(levels[0]), high=float(levels[-1]))
        steps = [shape(name="step", at=float(at)) for at in 0.5 * (levels[1:] + levels[:-1])]
        return [*steps, shape(name="linear")] if len(levels) > 2 else steps
    if not high - low > 1e-6 * max(abs(low), abs(high)):
        return []
    shape = partial(Shape, driver=driver, low=low, high=high)
    return [
        shape(name="linear"),
        shape(name="quadratic"),
        *(
            shape(name="saturating", at=part * (high - low), span=1.0 - float(np.exp(-1.0 / part)))
            for part in _SCALES
        ),
        *(shape(name="step", at=float(at)) for at in np.unique(np.quantile(known, _THRESHOLDS))),
    ]


def of_stretches(driver: str, values: Array, segments: Index) -> list[Shape]:
    """List stretches between the first and the last value in which a residual may differ from the others.

    They are those between any two of the steps of `of_number` that are not far apart, and the segments.
    Where a segment begins may also be a step: a zero that jumps cuts a drive as another soil does.
    """
    known = np.isfinite(values)
    edges = np.quantile(values[known], _THRESHOLDS) if known.any() else np.zeros(1)
    if not edges[-1] > edges[0]:
        return []
    pairs = [(low, high) for j, low in enumerate(edges) for high in edges[j + 1 : j + 1 + _LONGEST_STRETCH]]
    each = [values[known & (segments == one)] for one in np.unique(segments[known])]
    spans = [(inside.min(), inside.max()) for inside in each]
    whole = values[known].min(), values[known].max()
    steps = [
        values[known & (values < low)].max() for low in sorted({low for low, _ in spans}) if low > whole[0]
    ]
    return [
        Shape(driver=driver, name="stretch", at=float(low), until=float(high))
        for low, high in dict.fromkeys([*pairs, *spans])
        if whole[0] < low < high < whole[1]
    ] + [Shape(driver=driver, name="step", at=float(at)) for at in steps]


def of_label(driver: str, codes: Array) -> list[Shape]:
    """List the shapes in which a residual may follow a label, given by its codes: other at one of them."""
    present = np.unique(codes[np.isfinite(codes)])
    if not 1 < len(present) <= 50:
        return []
    return [Shape(driver=driver, name="label", at=float(code)) for code in present]


def of_turning(driver: str, angles: Sequence[Array], counts: Sequence[int] = HARMONICS) -> list[Shape]:
    """List the periods in which a residual may follow the angle of the wheel, in rad.

    Cosine and sine of each; none for wheels that do not turn twice, and none that has fewer than two and a
    half samples in a period, which would show as another one. `counts` are periods in a turn.
    """
    known = [angle[np.isfinite(angle)] for angle in angles]
    known = [angle for angle in known if len(angle) > 1]
    if not known or max(float(np.ptp(angle)) for angle in known) < 4.0 * np.pi:
        return []
    steps = np.abs(np.concatenate([np.diff(angle) for angle in known]))
    step = float(np.median(steps[steps > 0.0]))
    return [
        Shape(driver=driver, name="periodic", at=2.0 * np.pi / count, high=2.0 * np.pi, partner=part)
        for count in counts
        if step < 0.4 * 2.0 * np.pi / count
        for part in (0, 1)
    ]
