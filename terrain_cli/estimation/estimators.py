"""The estimator that goes with a model, and the fit of a whole model to the windows of a wheel."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Self, cast

import numpy as np
from numpy.typing import ArrayLike

from terrain_cli import effects, estimation, models, processes
from terrain_cli.errors import InputError, UsageError
from terrain_cli.estimation import WindowEstimates, fit_account, prediction, wheel_fit
from terrain_cli.estimation.assumed import with_assumptions
from terrain_cli.estimation.fit_account import account
from terrain_cli.estimation.further_unknowns import suspects, with_contact, with_rivals, with_stated_errors
from terrain_cli.estimation.joint_grid import JointPosterior
from terrain_cli.estimation.strength import stress_of_all, with_strengths
from terrain_cli.estimation.wheel_fit import Fit, Noise, Prior
from terrain_cli.estimation.wheel_fit.late_channels import behind
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.models import ModelFile
from terrain_cli.rover import NOISY, SensorNoise
from terrain_cli.telemetry import Samples
from terrain_cli.telemetry.wheel_samples import Geometry
from terrain_cli.vocabulary.arrays import Array, Bounds
from terrain_cli.vocabulary.choices import FIT_SAMPLES, LineMethod, Method
from terrain_cli.windows.cut_windows import Windows

#: Samples of a window that are fitted at the most, evenly spread. Judged: more would lower errors below 1 %.
_MOST = 4_000
#: Windows to which the full model is fitted unasked, 5 kB each. Judged: where there are more, they are
#: so short that they separate nothing.
_MOST_WINDOWS = 100_000


@dataclass(frozen=True)
class Fitted:
    """Estimates of the windows of a wheel, and what they were made with."""

    windows: Windows  # Without the cuts that were taken back
    estimates: WindowEstimates
    # The model, its parameters and the noise, as the summary shows them; None for the line
    account: dict[str, Any] | None = None
    joint: list[JointPosterior] = field(default_factory=list)  # Of the windows of which it was asked for
    noise: Noise | None = None  # Of the full model: where a fit of more of these samples may begin


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """What is asked of every fit."""

    min_samples: int | None = None  # Windows with fewer get the status "too-few-samples"; 5 if not given
    folds: int | None = None  # δ of the ridge is chosen over so many blocks, not leaving one sample out
    robust: bool = False  # Wild samples have little weight in the fit of a whole model
    at_stress: float | None = None  # In Pa, at which strengths of all windows are compared


_USUAL = FitOptions()


def common_stress(stress: float | None, estimates: WindowEstimates) -> float | None:
    """Return the stress in Pa at which the next wheel or log is compared: that given, or the last one."""
    if stress is not None or np.isnan(found := stress_of_all(estimates)):
        return stress
    return found


def choose(
    method: Method, model: ModelFile | str | Path | None = None, *, robust: bool = False
) -> ModelFile | None:
    """Return the model that is to be fitted whole: what the caller names, else `full_model`.

    None where the estimators of the line are asked for: by the method, or with the linear model. UsageError
    where model, method and robustness contradict each other.
    """
    file = None
    if model is not None:
        file = models.resolve(str(model)) if isinstance(model, str | Path) else model
    elif method in {"auto", "wong-reece"}:
        return full_model()
    name = str(file.path or file.model.base) if file else "linear"
    if file is not None and method == "wong-reece" and file.model.base != "wong-reece":
        raise UsageError(
            f"--method wong-reece is not for the base {file.model.base} of --model {name}",
            hint="leave out --method: what fits the model is chosen",
        )
    if file is None or file.plain:
        if robust:
            raise UsageError(
                "--robust is for the full model, or a model with effects",
                hint="add --method wong-reece, or --model FILE",
            )
        return None
    if method not in {"auto", "wong-reece"}:
        raise UsageError(
            f"--method {method} is an estimator of the linear model, and --model {name} is another model",
            hint="leave out --method, or --model",
        )
    return file


def full_model() -> ModelFile:
    """Return the full model of Bekker, Janosi–Hanamoto and Wong–Reece without effects."""
    return ModelFile(model=Model("wong-reece"))


def estimate_lines(
    windows: Windows, method: LineMethod = "auto", options: FitOptions = _USUAL
) -> WindowEstimates:
    """Estimate c and φ in every window of a wheel, where it does not skid, by the line."""
    samples, windows = windows.samples, windows.on_line()
    return estimation.estimate_windows(
        windows.line_columns,
        windows.bounds,
        samples.geometry.line,
        method=method,
        min_samples=FIT_SAMPLES if options.min_samples is None else options.min_samples,
        correlated=samples.time is not None,
        folds=options.folds,
    )


def estimate(
    windows: Windows,
    method: Method = "auto",
    file: ModelFile | None = None,
    options: FitOptions = _USUAL,
    *,
    joint: int = 0,
    begun: Noise | None = None,
    needed: Callable[[Windows, ModelFile], Windows] | None = None,
) -> Fitted:
    """Estimate the soil in every window of a wheel, by the line or by the model to fit whole (`choose`).

    Of `joint` windows, evenly spread, the joint posterior of c and φ is found as well. Learning the noise
    begins where it has `begun`: with that of a fit of most of these samples. Where the model misses windows
    that were cut where the soil seems to change, `needed` says which of the cuts it needs
    (`comparison.needed_segments`).
    """
    if (
        file is not None
        and method == "auto"
        and len(windows) > _MOST_WINDOWS
        and not (file.path or file.effects)
    ):
        windows.samples.remarks.append(
            f"{len(windows):,} segments, too many for the full model: c and φ are from the linear "
            "model; --method wong-reece fits the full model in any case"
        )
        file = None
    asked = fit_account.chosen(windows, joint)
    of_line = cast("LineMethod", "auto" if file else method)
    line = estimate_lines(windows, of_line, options)
    if file is None:
        driving = windows.on_line()
        line = with_strengths(with_assumptions(line, driving, of_line), driving, options.at_stress)
        return Fitted(windows, line, joint=fit_account.of_line(line, asked))
    own, whole, windows = file, windows, windows.thinned(_MOST)
    rivals = models.rivals(file)
    file, beside = with_rivals(with_contact(file), windows, rivals)
    channels = {**beside, **_channels(windows)}
    file = with_stated_errors(file, windows.samples, channels)
    held, because = _held(windows.samples.geometry, file, [channels])
    run = partial(_fit, windows, file, options, held=held, joint=asked, begun=begun)

    def past_of(found: Fit) -> dict[str, Any]:
        every = {**with_rivals(with_contact(own), whole, rivals)[1], **_channels(whole)}
        return prediction.past_of_fit(whole, windows, every, found, held)

    def fitted(late: Mapping[str, Array], near: Fit | None, *, errors: bool = True) -> Fit:
        return run({**channels, **late}, near=near, errors=errors)

    passes = (partial(fitted, errors=False), fitted) if file.model.remembers else (fitted, None)
    fit = behind(passes[0], past_of, channels, held, passes[1])
    if needed is not None and whole.by_soil and len(whole) > 1 and fit.missed.any():
        fewer = needed(whole, own)
        if len(fewer) < len(whole):
            return estimate(fewer, method, own, options, joint=joint, begun=begun)
    remarks = windows.samples.remarks
    remarks += [text for text in fit.impossible(held) if text not in remarks]
    estimates = of_fit(fit, line, whole, options.at_stress)
    posteriors = fit_account.of_fit(fit, file, asked)
    told = account(windows, file, fit, held, because)
    told["rivals"] = [rival.id for rival in rivals if rival in file.model.effects]
    return Fitted(whole, estimates, told, posteriors, fit.noise)


def estimate_each(
    wheels: Iterable[Windows],
    method: Method,
    file: ModelFile | None,
    options: FitOptions,
    *,
    joint: int = 0,
    needed: Callable[[Windows, ModelFile], Windows] | None = None,
) -> Iterator[Fitted]:
    """Estimate the soil of one wheel after another, all at one stress; see `estimate`."""
    for windows in wheels:
        fitted = estimate(windows, method, file, options, joint=joint, needed=needed)
        options = replace(options, at_stress=common_stress(options.at_stress, fitted.estimates))
        yield fitted


def _channels(windows: Windows) -> dict[str, Array]:
    """Return what is measured of the usable samples, and what the effects use."""
    samples, rows = windows.samples, windows.rows
    channels = {name: column[rows] for name, column in samples.drivers.items()}
    channels |= windows.measured()
    pull = samples.channels.get("drawbar_pull")
    if pull is not None and np.isfinite(pull[rows]).any():
        channels["drawbar_pull"] = pull[rows]
    return channels


@dataclass(frozen=True)
class FitSettings:
    """How models are fitted where they are compared."""

    fixed: Mapping[str, ArrayLike]  # Parameters held; the others are sought
    priors: Mapping[str, Prior]
    shared: Collection[str]  # Parameters of the soil with one value for all windows of a wheel
    noise: Noise | None  # Of the sensors; learnt from the data if not given

    @classmethod
    def of(cls, wheels: Sequence[Windows], file: ModelFile) -> Self:
        """Return what a model file and rover.toml say of some wheels of one rover.

        Held are the parameters of the file, and those whose channels a wheel lacks. The noise is known if
        rover.toml gives it for every channel that the fit weighs.
        """
        every: list[dict[str, Array]] = []
        measured: set[str] = set()
        for windows in wheels:
            samples, rows = windows.samples, windows.rows
            there = {
                name: column[rows]
                for name, column in {**samples.drivers, **samples.channels}.items()
                if np.isfinite(column[rows]).any()
            }
            every.append(there)
            measured |= there.keys() & set(NOISY)
        samples = wheels[0].samples
        given = {name: noise for name, noise in samples.noise.items() if name in measured and noise.known}
        held, _ = _held(samples.geometry, file, every)
        shared = [name for name in file.shared if name not in held]
        return cls(held, _priors(samples, file), shared, _noise(given) if given.keys() == measured else None)


def _priors(samples: Samples, file: ModelFile) -> dict[str, Prior]:
    geometry = samples.geometry
    return {
        "shear_modulus": Prior.factor(geometry.shear_modulus, geometry.shear_modulus_factor),
        **file.priors,
    }


def _held(
    geometry: Geometry, file: ModelFile, wheels: Sequence[Mapping[str, Array]]
) -> tuple[dict[str, float], dict[str, str]]:
    """Return the parameters held, and why where the file does not say so."""
    held, because = dict(file.fixed), {}
    for name, parameter in file.model.parameters.items():
        idle = parameter.idle(wheels)
        if idle and name not in held:
            held[name] = parameter.null
            because[name] = idle
    said = "shear_modulus" in {*file.fixed, *file.priors, *file.shared}
    if file.model.base == "linear" and not said:
        held["shear_modulus"] = geometry.shear_modulus
    return held, because


def _fit(
    windows: Windows,
    file: ModelFile,
    options: FitOptions,
    channels: Mapping[str, Array],
    *,
    held: Mapping[str, float],
    joint: Collection[int],
    begun: Noise | None,
    near: Fit | None,
    errors: bool,
) -> Fit:
    samples = windows.samples
    priors = _priors(samples, file)
    lacking, further = suspects(file, windows) if errors else (None, {})
    time = None if samples.time is None else samples.time[windows.rows]

    def run(noise: Noise | None, joint: Collection[int]) -> Fit:
        return wheel_fit.fit(
            file.model,
            samples.geometry.wheel,
            {**further, **channels},
            windows.bounds,
            fixed=held,
            priors=priors,
            shared=[name for name in file.shared if name not in held],
            local=[name for name in file.local if name not in held],
            noise=noise,
            robust=options.robust,
            correlated=time is not None,
            second=wheel_fit.samples_a_second(time),
            min_samples=options.min_samples or FIT_SAMPLES,
            joint=joint,
            begun=begun,
            near=near,
            suspects=lacking,
            noise_errors=errors,
        )

    given = {name: noise for name, noise in samples.noise.items() if name in channels and noise.known}
    try:
        if not set(NOISY) & (channels.keys() - given.keys()):
            return run(_noise(given), joint)
        fit = run(None, () if given else joint)
        # What is not known of the sensors is learnt first, with all of them unknown.
        return run(_noise(given, fit.noise), joint) if given else fit
    except InputError as error:
        raise InputError(f"{samples}: {error}", hint=error.hint) from None


def _noise(given: Mapping[str, SensorNoise], others: Noise | None = None) -> Noise:
    others = others or Noise()
    return Noise(
        {**others.relative, **{name: noise.relative for name, noise in given.items()}},
        {**others.absolute, **{name: noise.absolute for name, noise in given.items()}},
    )


def of_fit(
    fit: Fit, line: WindowEstimates, windows: Windows, at_stress: float | None = None
) -> WindowEstimates:
    """Return what the table of windows says of a fit; `line` keeps its columns of least squares and ridge."""
    estimates = with_strengths(wheel_fit.as_window_estimates(fit, line), windows, at_stress)
    # c and φ stay empty where their number is that of the prior, or of a single sample.
    every = np.full(len(fit), fill_value=True)
    c, phi = (fit.told.get(name, every) & (fit.n > 1) for name in ("cohesion", "tan_phi"))
    told = {"c": c, "c_se": c, "phi": phi, "phi_se": phi, "corr": c & phi}
    left = {name: np.where(there, getattr(estimates, name), np.nan) for name, there in told.items()}
    return replace(estimates, **left)


@dataclass(frozen=True, kw_only=True)
class EstimateRequest:
    """Windows, a model, and the options of `estimate`."""

    wheels: Sequence[Windows]  # As they were cut: neither joined nor thinned
    file: ModelFile  # Of which the line is estimated where it is plain
    options: FitOptions = _USUAL
    needed: Callable[[Windows, ModelFile], Windows] | None = None  # As for `estimators.estimate`

    @cached_property
    def estimates(self) -> list[tuple[Bounds, WindowEstimates] | None]:
        """Of each wheel, with the bounds of its windows, of which cuts may have been taken back.

        None without torque or sinkage, where `estimate` has no answer.
        """
        file = choose("auto", self.file, robust=self.options.robust)
        lined = [windows for windows in self.wheels if windows.lined]
        each = estimate_each(lined, "auto", file, self.options, needed=self.needed)
        found = ((fitted.windows.bounds, fitted.estimates) for fitted in each)
        return [next(found) if windows.lined else None for windows in self.wheels]


def estimates_of(asked: Sequence[EstimateRequest]) -> list[list[tuple[Bounds, WindowEstimates] | None]]:
    return [one.estimates for one in asked]


def estimate_beside(asked: Sequence[EstimateRequest]) -> Callable[[], None]:
    """Begin to estimate in another process; return what waits for it, and then has the requests answered."""
    # Both processes need the catalogue, which is read before there are two.
    effects.catalogue()
    waited = processes.beside(partial(estimates_of, asked))

    def answer() -> None:
        for one, found in zip(asked, waited(), strict=True):
            vars(one)["estimates"] = found

    return answer
