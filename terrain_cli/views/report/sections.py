"""The sections of the page that show a comparison."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from terrain_cli.comparison.comparison_outcome import Comparison
from terrain_cli.diagnosis.diagnosis_outcome import above_noise, over_noise
from terrain_cli.presentation import comparison_text
from terrain_cli.views import shown_samples, shown_segments
from terrain_cli.views.report import drive_charts
from terrain_cli.views.report.page_parts import Chart, Section, Table
from terrain_cli.views.shown_samples import Pairs
from terrain_cli.vocabulary import quantities
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.next_commands import Asked
from terrain_cli.vocabulary.quantities import counted

Choices = list[tuple[str, str]]

#: Rows of the table of segments, and segments to choose from: the worst ones where there are more.
MOST_ROWS, MOST_CHOICES = 1_000, 300
MOST_DRIVERS = 9  # Drivers shown for each channel
MOST_SAMPLES = 6_000  # Samples, over all segments, in the pictures of one segment
#: Characters in the name of a segment.
LONGEST = 48
_NOTE = (
    "In the unit of the channel. Held out: on stretches that were not fitted. Noise: the part of the error "
    "that no model could predict. Bias: the mean of measured less predicted. Normalised: the rms error "
    "divided by the rms of what was measured."
)


@dataclass(frozen=True)
class _Content:
    """A comparison, its segments, and the one marked at first."""

    comparison: Comparison
    #: Columns of `results.COLUMNS`, with "name" and "key" of every segment.
    table: Mapping[str, Any]
    misfits: Mapping[str, Array]
    kept: Index  # The segments to choose from, as rows of the table
    order: Index  # All of them, the worst first

    @property
    def chosen(self) -> str:
        return str(self.table["key"][self.order[0]])

    @property
    def thinned(self) -> dict[str, Any]:
        """The table of the segments that can be chosen."""
        return {name: np.asarray(column)[self.kept] for name, column in self.table.items()}


def of(
    comparison: Comparison, progress: Callable[[str], None], asked: Asked | None = None
) -> tuple[list[Section], Choices, str]:
    """Return the sections of a comparison, key and label of each segment to choose, and the first key."""
    progress("segments")
    content = _content(comparison)
    names, keys, worst = content.table["name"], content.table["key"], content.order[0]
    several = len(content.kept) > 1
    choices = [
        (str(keys[row]), f"{names[row]}{' (largest errors)' if row == worst and several else ''}")
        for row in content.kept
    ]
    sections = []
    for name, make in (
        ("summary", partial(_summary, asked=asked)),
        ("soil", _soil),
        ("measured and predicted", _agreement),
        ("where it fails", _failures),
    ):
        progress(name)
        sections.append(make(content))
    return sections, choices, content.chosen


def _content(comparison: Comparison) -> _Content:
    table = dict(shown_segments.soil_table(comparison))
    # Long paths differ at their ends.
    names = shown_segments.names(table)
    table["name"] = np.array([f"…{n[1 - LONGEST :]}" if len(n) > LONGEST else n for n in names])
    lengths = enumerate(len(wheel.segments) for wheel in comparison.wheels)
    table["key"] = np.array([f"{index}:{row}" for index, length in lengths for row in range(length)])
    shown = shown_samples.channels(comparison)
    misfits = {name: shown_samples.misfit(comparison, name) for name in shown}
    # Of all channels, each in units of its rms error.
    total = np.zeros(len(table["name"]))
    for name, misfit in misfits.items():
        usual = comparison.channels[name].rmse * shown[name].factor
        total += np.nan_to_num(misfit / usual) ** 2 if usual > 0.0 else 0.0
    order = np.argsort(-total, kind="stable")
    return _Content(comparison, table, misfits, np.sort(order[:MOST_CHOICES]), order)


def _summary(content: _Content, asked: Asked | None) -> Section:
    comparison, statuses = content.comparison, list(map(str, content.table["status"]))
    concluded = comparison_text.concluded(comparison, asked)
    effects = comparison.model.get("effects") or []
    with_effects = f" with {', '.join(map(str, effects))}" if effects else " without added effects"
    data = comparison_text.data_document(comparison)
    fitted = (
        f"The model {comparison.model['base']}{with_effects} was fitted to {data['samples']:,} samples of "
        f"{counted(len(comparison.wheels), 'wheel')} from {counted(len(data['sources']), 'input')}, "
        f"in {counted(len(statuses), 'segment')}."
    )
    fine = sum(status == "ok" for status in statuses)
    verb = "has" if fine == 1 else "have"
    usable = f"{fine or 'None'} of {counted(len(statuses), 'segment')} {verb} the status ok."
    if len(statuses) == 1:
        usable = f"The segment has the status {statuses[0]}."
    points = [_sentence(finding.sentence) for finding in comparison.failures[:5]]
    points += [_sentence(f"Note: {warning}") for warning in comparison.warnings]
    return Section(
        id="summary",
        title="Summary",
        text=[f"{usable} {fitted}"],
        points=points,
        parts=[_errors(comparison)],
        lead=concluded.lead,
        command=concluded.command or comparison_text.looked_at(concluded, comparison, asked),
    )


def _errors(comparison: Comparison) -> Table:
    rows = []
    for name, what in shown_samples.channels(comparison).items():
        errors = comparison.channels[name]
        rms, bias, noise, out, low, high = (
            quantities.number(value * what.factor)
            for value in (
                *(errors.rmse, errors.bias, errors.noise),
                *(errors.heldout_rmse, errors.heldout_low, errors.heldout_high),
            )
        )
        interval = out if low == "–" else f"{out} ({low} to {high})"
        ratio = f"{errors.heldout_rmse / errors.noise:.2f} ×" if errors.noise > 0.0 else "–"
        normalised = quantities.number(errors.nrmse)
        rows.append((what.label, ratio, interval, noise, rms, bias, normalised, f"{errors.n:,}"))
    head = (
        *("Channel", "Held out / noise", "Held out (95 %)", "Noise"),
        *("Rms error", "Bias", "Normalised", "Samples"),
    )
    return Table("Errors of the prediction", head, rows, frozenset(range(1, len(head))), _NOTE)


def _sentence(text: str) -> str:
    """Write a text as a sentence: with a capital, and one full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."


def _soil(content: _Content) -> Section:
    shown = content.thinned
    parts: list[Table | Chart] = [
        Chart(
            f"{title} along the drive",
            f"{title} of each segment from its beginning to its end; the table has the numbers.",
            spec,
        )
        for title, spec in drive_charts.of_soil(shown, content.chosen)
    ]
    if any(shown["WKT"]):
        maps = dict([shown_segments.mapped_strength(shown)])
        for name, what in shown_samples.channels(content.comparison).items():
            maps[f"rms error of {what.words}{what.in_unit}"] = content.misfits[name][content.kept]
        parts += [
            Chart(
                f"Track by {label}",
                f"Map of the track of one wheel. Each segment is coloured by its {label}, {_range(values)}.",
                drive_charts.track(shown, values, label, content.chosen),
            )
            for label, values in maps.items()
        ]
    if np.isfinite(shown["c_kPa"]).any():
        parts.append(
            Chart(
                "Cohesion and friction angle, 95 % regions",
                "Estimates of each segment, friction angle over cohesion; the table has the numbers.",
                drive_charts.estimates(shown, content.chosen),
            )
        )
    if len(shown_segments.tested(shown)):
        parts.append(
            Chart(
                "Shear strength over normal stress",
                "Line of shear strength over normal stress for each segment; the table has numbers.",
                drive_charts.strength(shown, content.chosen),
            )
        )
    legend = (
        "Bands and ellipses are 95 % regions. Faint symbols are segments whose status is not ok. The point "
        "on a line of strength is at the stress where this segment determines the strength best."
    )
    return Section(id="soil", title="Soil", text=[legend], parts=[*parts, _segments(content)])


def _segments(content: _Content) -> Table:
    table, names = content.table, content.table["name"]
    kept = np.sort(content.order[:MOST_ROWS])
    rows = [
        (
            names[row],
            str(table["terrain"][row]) or "–",
            f"{int(table['n_samples'][row]):,}",
            *(
                quantities.plus_minus(table[value][row], table[error][row])
                for value, error in (
                    ("c_kPa", "c_se_kPa"),
                    ("phi_deg", "phi_se_deg"),
                    ("strength_at_stress_kPa", "strength_at_stress_se_kPa"),
                )
            ),
            quantities.number(float(table["k_mm"][row])),
            *(quantities.number(float(misfit[row])) for misfit in content.misfits.values()),
            str(table["status"][row]),
        )
        for row in kept
    ]
    strength = shown_segments.mapped_strength(table)[0].replace("strength", "Strength")
    shown = shown_samples.channels(content.comparison)
    head = (
        *("Segment", "Terrain", "Samples", "c (kPa)", "φ (°)", strength, "k (mm)"),
        *(f"Rms error of {what.symbol}{what.in_unit}" for what in shown.values()),
        "Status",
    )
    left_out = len(names) - len(kept)
    note = "Values with their standard errors. Rms errors are those of the prediction."
    if left_out:
        note += f" {left_out:,} segments that are predicted better are left out."
    return Table("Soil under each segment", head, rows, frozenset(range(2, len(head) - 1)), note)


def _agreement(content: _Content) -> Section:
    comparison, keys = content.comparison, content.table["key"]
    parts: list[Table | Chart] = []
    for name, what in shown_samples.channels(comparison).items():
        pooled = shown_samples.pairs(comparison, name)
        if not len(pooled.measured):
            continue
        if any("time" in wheel.drivers for wheel in comparison.wheels):
            along = shown_samples.driver(comparison, "time", pooled)
            noise = comparison.channels[name].noise * what.factor
            chart = drive_charts.residual(
                along, pooled, what.in_unit, noise, keys, content.chosen, height=320
            )
            title = f"Residual of {what.words} along the drive"
            parts.append(Chart(title, _described(along, pooled.residual, what), chart, wide=True))
        few = pooled.take(_few_of_each(pooled.segment, content.kept))
        place, axis, driven = _along(comparison, few)
        parts.append(
            Chart(
                f"Measured and predicted {what.words} in the segment marked",
                f"{what.words} as measured and as predicted along the segment chosen.",
                drive_charts.course(place, axis, few, what.label, keys, content.chosen, driven=driven),
                wide=True,
            )
        )
    legend = (
        "Residuals are measured less predicted: median (line), 5 to 95 % of the samples (band), ± 1.96 times "
        "the noise (dotted). The line of a good model stays at zero."
    )
    return Section(id="agreement", title="Measured and predicted", text=[legend] * bool(parts), parts=parts)


def _few_of_each(segment: NDArray[np.int32], kept: Index) -> Index:
    """Choose samples of the segments kept, about equally many of each."""
    most = max(MOST_SAMPLES // max(len(kept), 1), 20)
    order = np.argsort(segment, kind="stable")
    starts, ends = (np.searchsorted(segment[order], kept, side=side) for side in ("left", "right"))
    chosen = [
        order[start:end][shown_samples.some(int(end - start), most)]
        for start, end in zip(starts, ends, strict=True)
    ]
    return np.concatenate(chosen) if chosen else np.empty(0, dtype=np.intp)


def _along(comparison: Comparison, few: Pairs) -> tuple[Array, str, bool]:
    """Return time, or of steady points the slip, its title, and whether samples were driven in its order."""
    timed = all("time" in wheel.drivers for wheel in comparison.wheels)
    along = shown_samples.driver(comparison, "time" if timed else "slip", few)
    return along.values, along.quantity.label, timed


def _failures(content: _Content) -> Section:
    comparison, keys = content.comparison, content.table["key"]
    several = len({wheel.windows.samples.wheel for wheel in comparison.wheels}) > 1
    rows = [
        (
            _sentence(finding.sentence),
            quantities.quantity(finding.channel, "").words,
            " or ".join(
                quantities.quantity(name, "").words for name in (finding.driver, *finding.alternatives)
            )
            or "–",
            finding.shape,
            f"{100.0 * finding.share:.0f} %",
            quantities.number(finding.p_value, 2),
            ", ".join(f"{wheel} " * several + str(n) for _, wheel, n in finding.worst_segments) or "–",
        )
        for finding in comparison.failures
    ]
    head = ("Finding", "Channel", "Driver", "Shape", "Share of the misfit", "p", "Worst segments")
    parts: list[Table | Chart] = []
    if rows:
        note = (
            "p allows for all channels, drivers and shapes tested. The share is of the misfit beyond noise."
        )
        parts.append(Table("Findings, the strongest first", head, rows, frozenset({4, 5}), note))
    for name, what in shown_samples.channels(comparison).items():
        noise = comparison.channels[name].noise * what.factor
        pooled = shown_samples.pairs(comparison, name)
        for driver in shown_samples.drivers(comparison, name, pooled, MOST_DRIVERS):
            along = shown_samples.driver(comparison, driver, pooled)
            parts.append(
                Chart(
                    f"Residual of {what.words} against {along.quantity.words}",
                    _described(along, pooled.residual, what),
                    drive_charts.residual(along, pooled, what.in_unit, noise, keys, content.chosen),
                )
            )
    text = ["The pictures show the residuals against the quantities that they may depend on."]
    if not rows and above_noise(over_noise(comparison)):
        text.insert(0, "No recorded channel tracks the misfit significantly.")
    return Section(id="failures", title="Where it fails", text=text, parts=parts)


def _described(along: shown_samples.Along, residual: Array, what: quantities.Quantity) -> str:
    driver = along.quantity
    band = shown_samples.band(along.values, residual)
    known = np.isfinite(band.median)
    if not known.any() or along.labels:
        return f"Residual of {what.words} against {driver.words}."
    median, centre = band.median[known], band.centre[known]
    low, high = int(np.argmin(median)), int(np.argmax(median))
    unit = f" {driver.unit}".rstrip()
    least, most = (f"{quantities.number(median[k])} {what.unit} at" for k in (low, high))
    here, there = (f"{quantities.number(centre[k])}{unit}" for k in (low, high))
    return f"The median residual of {what.words} goes from {least} {driver.words} {here} to {most} {there}."


def _range(values: Array) -> str:
    known = values[np.isfinite(values)]
    if not len(known):
        return "not known"
    return f"from {quantities.number(float(known.min()))} to {quantities.number(float(known.max()))}"
