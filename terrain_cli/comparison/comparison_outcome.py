"""The result of a comparison of a model with measurements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

    from terrain_cli.estimation.estimators import EstimateRequest
    from terrain_cli.estimation.wheel_fit import Fit
    from terrain_cli.mechanics.wheel_model import Model
    from terrain_cli.telemetry import Samples
    from terrain_cli.vocabulary.arrays import Array
    from terrain_cli.windows.cut_windows import Windows


#: Channels that a model predicts, with their units.
UNITS = {"torque": "N m", "drawbar_pull": "N", "sinkage": "m"}


@dataclass(frozen=True, kw_only=True)
class ChannelErrors:
    """How well one channel is predicted, of one wheel or of all together.

    Parameters
    ----------
    name, unit : str
        Unit of the values below: SI.
    n : int
        Samples that are measured and predicted.
    rmse, bias : float
        Root mean square and mean of measured less predicted.
    nrmse : float
        `rmse` over the root mean square of what is measured.
    noise : float
        Standard deviation of what changes from sample to sample without following the drive, the
        noise of slip, load and sinkage that reaches the prediction included; NaN where the data do
        not tell.
    heldout_rmse, heldout_low, heldout_high : float
        On blocks that were left out of the fit, with a 95 % interval from resampled blocks.
    """

    name: str
    unit: str
    n: int
    rmse: float
    bias: float
    nrmse: float
    noise: float
    heldout_rmse: float
    heldout_low: float
    heldout_high: float


@dataclass(frozen=True)
class Series:
    """One channel of one wheel over its usable samples.

    Parameters
    ----------
    measured, predicted, heldout : ndarray, shape (n,)
        NaN where not measured, or not predictable; `heldout` by a fit without the sample's block.
    se : ndarray or None
        Standard error of the prediction, where known.
    """

    measured: Array
    predicted: Array
    heldout: Array
    se: Array | None = None


@dataclass(frozen=True)
class Driver:
    """Something that a residual may follow.

    Parameters
    ----------
    name, unit : str
        SI unit; empty where it is not known.
    values : ndarray, shape (n,)
        Of the usable samples; NaN where not known. Of a label its code.
    labels : tuple of str
        What the codes mean; empty for a number.
    """

    name: str
    unit: str
    values: Array
    labels: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class WheelComparison:
    """One wheel of one input.

    Parameters
    ----------
    windows : Windows
        Of one soil each; where one predicts as well as several, it joins several segments.
    segments : Windows
        The same samples as they were cut.
    series : dict of str to Series
        By channel.
    blocks : ndarray of int, shape (n,)
        Block of each usable sample, counted over all wheels.
    """

    source: str
    wheel: str
    samples: Samples
    windows: Windows
    segments: Windows
    fit: Fit
    model: Model
    series: dict[str, Series]
    errors: dict[str, ChannelErrors]
    drivers: dict[str, Driver]
    blocks: NDArray[np.intp]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One way in which the model fails.

    Parameters
    ----------
    channel, driver, shape : str
        `driver` is empty for an offset that follows none. Shapes: "constant", "linear", "quadratic",
        "saturating", "step", "periodic", "label".
    p_value : float
        How often chance gives something as strong in any channel, driver and shape.
    share : float
        Part of the misfit that this accounts for: of the squared residuals beyond noise, of all
        channels together, each in terms of its noise. What is wrong in one channel moves the soil
        that is fitted, and is then seen in the others too.
    amplitude : float
        Measured less predicted: positive where the model predicts too little. Difference over the
        driver's range; above a step; half the swing of a periodic shape.
    unit : str
        Of `amplitude`: SI.
    at : float or None
        Threshold of a step, scale of a saturating curve, or period, in the driver's SI unit.
    sentence : str
        The same for a person.
    worst_segments : tuple of (str, str, int)
        Source, wheel and segment (counted from 1) where it is largest, the worst first.
    alternatives : tuple of str
        Drivers that vary so much alike that it may be theirs.
    seen : float
        Part of `amplitude` that shows in the residuals: the fitted parameters take up the rest.
    """

    channel: str
    driver: str
    shape: str
    p_value: float
    share: float
    amplitude: float
    unit: str
    at: float | None
    sentence: str
    worst_segments: tuple[tuple[str, str, int], ...]
    alternatives: tuple[str, ...] = ()
    seen: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Difference:
    """What another model changes.

    Parameters
    ----------
    name, unit : str
        A channel, whose held-out error is compared, or "c" or "phi" of one segment.
    where : tuple of (str, str, int) or None
        Source, wheel and segment (counted from 1); None for errors, which are over all wheels.
    first, second : float
        Values with the two models.
    difference, low, high : float
        Second less first, with a 95 % interval.
    moved : bool
        By more than three standard errors.
    """

    name: str
    unit: str
    where: tuple[str, str, int] | None
    first: float
    second: float
    difference: float
    low: float
    high: float
    se: float
    moved: bool


@dataclass(frozen=True, kw_only=True)
class EffectScores:
    """What the scores say of effects that the model does not have, before any of them is fitted."""

    p_value: float  # How often chance gives any effect such a score, or such a gain on blocks left out
    raised: bool  # That is too rarely for chance
    effects: tuple[str, ...] = ()  # That could be tested, the one that explains most first
    unrecorded: tuple[str, ...] = ()  # Channels that nothing gives; without them some cannot be tested


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A model against all measurements.

    Parameters
    ----------
    model : dict
        "base" and "effects".
    channels : dict of str to ChannelErrors
        Over all wheels.
    failures : list of Finding
        The strongest first.
    soils : EstimateRequest or None
        What `estimate` says of the segments (`segment_soils.of`).
    scores : callable or None
        Returns the scores of effects, which are computed where they are asked for.
    """

    model: dict[str, Any]
    wheels: list[WheelComparison]
    channels: dict[str, ChannelErrors]
    failures: list[Finding]
    warnings: list[str]
    soils: EstimateRequest | None = None
    scores: Callable[[], EffectScores] | None = None

    @property
    def blocks(self) -> int:
        """Number of independent stretches of the data."""
        return 1 + max(int(wheel.blocks.max(initial=-1)) for wheel in self.wheels)
