"""A drive as measured; how the estimate converges along it (Figs. 3, 4, 7 of Iagnemma et al. 2004)."""

from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from terrain_cli.simulation.simulated_log import SimulatedLog, channels
from terrain_cli.views import shown_samples, shown_segments
from terrain_cli.views.chart_style import COLOURS, FAINT, INK, LINES, MARKERS
from terrain_cli.vocabulary import quantities
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.channels import CHANNELS

MOST_SAMPLES = 3_000  # More samples than this are thinned: a line of them is as wide as a page has dots
MOST_LIMITS = 40  # With more segments than this their limits would hide the lines


class Picture(Figure):
    """A figure that a notebook shows although no window manages it."""

    def _repr_png_(self) -> bytes:
        content = BytesIO()
        self.savefig(content, format="png")
        return content.getvalue()


def panels(
    count: int, most: int, width: tuple[float, float], height: tuple[float, float], **shared: Any
) -> tuple[Picture, NDArray[Any]]:
    """Return a figure with so many axes, `most` in a row: inches of each, and of what is around them."""
    columns = min(most, max(count, 1))
    rows = max(-(-count // columns), 1)
    figure = Picture(figsize=(width[0] * columns + width[1], height[0] * rows + height[1]))
    grid = figure.subplots(rows, columns, squeeze=False, **shared)
    for axes in grid.flat[count:]:
        axes.remove()
    return figure, grid


#: What each panel shows: columns of the trace, the label of the axis, and the most it may span.
_QUANTITIES = (
    (("c_kPa", "c_se_kPa"), "cohesion c (kPa)", (-np.inf, np.inf)),
    (("phi_deg", "phi_se_deg"), "friction angle φ (°)", (-90.0, 90.0)),
)


def measured(log: SimulatedLog) -> Figure:
    """Draw each channel of a simulated log against time, wheel by wheel, and where the soil changes."""
    names = channels(log.scenario)
    figure, grid = panels(len(names), 2, (4.3, 0.0), (1.35, 0.8), sharex=True)
    for axes, name in zip(grid.flat, names, strict=False):
        unit = CHANNELS[name].unit
        what = quantities.quantity(name, unit.symbol if unit else "")
        of = {"": log.body} if name in log.body else log.wheels
        for ink, (wheel, series) in zip(COLOURS, of.items(), strict=False):
            shown = shown_samples.some(len(series[name].time))
            values = series[name].values[shown] * what.factor
            axes.plot(series[name].time[shown], values, color=ink, linewidth=0.7, label=wheel)
        for stretches in log.stretches.values():
            for stretch in stretches[1:]:
                axes.axvline(stretch.start, color=FAINT, linewidth=0.7, linestyle=":")
        axes.set_title(what.label)
    for axes in grid.flat[len(names) - 2 : len(names)]:
        axes.set_xlabel("time (s)")
        axes.tick_params(labelbottom=True)
    if len(log.wheels) > 1:
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=len(labels))
    return figure


def convergence(trace: Mapping[str, Any]) -> Figure:
    """Draw c and φ of one wheel, with ± 1.96 standard errors, after every sample or those of "sample"."""
    figure = Picture(figsize=(7.2, 4.8))
    upper, lower = figure.subplots(2, 1, sharex=True)
    number = np.asarray(trace["segment"])
    starts = _starts(number)
    shown = shown_samples.some(len(number), MOST_SAMPLES)
    # A thinned line would else bridge two segments.
    shown = np.union1d(shown, starts)
    place = np.asarray(trace.get("before", 0)) + _own(trace)
    # Rows now and then, of which one may stand alone.
    marker = "." if "sample" in trace else ""
    # Beside pictures of the full model, whose estimate is another one.
    drawn = "estimate" if marker else "recursive estimate of the line"
    for axes, (columns, label, widest), colour in zip((upper, lower), _QUANTITIES, COLOURS, strict=False):
        value, error = (np.asarray(trace[name], float) for name in columns)
        x, low, high, middle = (
            # No line goes from one segment to the next.
            np.insert(column[shown], np.searchsorted(shown, starts[1:]), np.nan)
            for column in (place, value - 1.96 * error, value + 1.96 * error, value)
        )
        # The band of a row that stands alone is as wide as its edge.
        edge = 2.0 if marker else 0.0
        axes.fill_between(x, low, high, color=colour, alpha=0.25, linewidth=edge, label="± 1.96 s.e.")
        axes.plot(x, middle, color=colour, label=drawn, marker=marker, markersize=3.0)
        if len(starts) <= MOST_LIMITS:
            _limits(axes, number, place, starts, name_them=axes is upper)
        _focus(axes, value, error, starts, widest)
        axes.set_ylabel(label)
        axes.legend(loc="lower right", ncols=2)
    lower.set_xlabel("sample")
    lower.set_xlim(1, max(place[-1] if len(place) else 0, 2))
    where = f"{trace['source'][0]}, {quantities.the_wheel(trace['wheel'][0])}" if len(number) else ""
    figure.suptitle(where, fontsize=9.0, x=0.01, ha="left")
    return figure


def convergence_of_all(traces: Sequence[Mapping[str, Any]]) -> Figure | None:
    """Draw c and φ of all segments over one another; None of one alone, or of too many to tell apart."""
    parts = [part for trace in traces for part in _segments(trace)]
    if not 1 < len(parts) <= len(COLOURS):
        return None
    longest = max(_own(part)[-1] for part in parts)
    # Errors stand beside the lines: bands over one another would hide what they are of.
    beside = longest * (1.02 + 0.02 * np.arange(len(parts) + 1))
    figure = Picture(figsize=(7.2, 4.8))
    upper, lower = figure.subplots(2, 1, sharex=True)
    for axes, ((value_of, error_of), label, widest) in zip((upper, lower), _QUANTITIES, strict=True):
        for j, (part, name) in enumerate(zip(parts, _names(parts), strict=True)):
            value = part[value_of]
            shown = shown_samples.some(len(value), MOST_SAMPLES)
            axes.plot(_own(part)[shown], value[shown], color=COLOURS[j], linestyle=LINES[j], label=name)
        last = np.array([part[value_of][-1] for part in parts])
        reach = 1.96 * np.nan_to_num([part[error_of][-1] for part in parts])
        for j in range(len(parts)):
            style = {"color": COLOURS[j], "marker": MARKERS[j], "markersize": 3.0, "capsize": 2.0}
            axes.errorbar(beside[j], last[j], reach[j], **style)
        # A soil that is hardly told is no reason to press the others flat.
        reach = np.minimum(reach, 3.0 * np.median(reach))
        low, high = shown_samples.limits(last - reach, last + reach, np.zeros(1), margin=0.05)
        axes.set_ylim(max(low, widest[0]), min(high, widest[1]))
        axes.axvline(longest, color=FAINT, linewidth=0.8)
        axes.set_ylabel(label)
    above = {"transform": upper.get_xaxis_transform(), "fontsize": 7.5, "color": INK, "ha": "right"}
    upper.text(beside[-1], 1.02, "± 1.96 s.e.", **above)
    lower.set(xlabel="sample of the segment", xlim=(1, beside[-1]))
    figure.legend(*upper.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _segments(trace: Mapping[str, Any]) -> list[dict[str, NDArray[Any]]]:
    columns = {name: np.asarray(values) for name, values in trace.items()}
    rows = np.arange(len(columns["segment"]))
    parts = np.split(rows, _starts(columns["segment"])[1:])
    return [{name: values[part] for name, values in columns.items()} for part in parts if len(part)]


def _names(parts: Sequence[Mapping[str, Any]]) -> list[str]:
    rows = [
        (str(part["source"][0]), str(part["wheel"][0]), f"segment {part['segment'][0]}") for part in parts
    ]
    differs = [len(set(column)) > 1 for column in zip(*rows, strict=True)]
    return [" ".join(text for text, told in zip(row, differs, strict=True) if told) for row in rows]


def _own(part: Mapping[str, Any]) -> Array:
    """Return which sample of its segment each row of a part of a trace is."""
    return np.array(part.get("sample", np.arange(len(part["segment"])) + 1.0), dtype=np.float64)


def _limits(axes: Axes, number: Any, place: Array, starts: Index, *, name_them: bool) -> None:
    ends = np.append(starts[1:], len(number))
    for start, end in zip(starts, ends, strict=True):
        if start:
            axes.axvline(place[start - 1] + 0.5, color=FAINT, linewidth=0.8, linestyle="--")
        begin = place[start - 1] + 1.0 if start else 1.0
        if name_them and place[end - 1] - begin > 0.02 * place[-1]:
            name = f"segment {number[start]}" if len(starts) <= 8 else f"{number[start]}"
            above: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "fontsize": 7.5, "color": INK}
            axes.text(begin + 0.005 * place[-1], 1.02, name, **above)


def _focus(axes: Axes, value: Array, error: Array, starts: Index, widest: tuple[float, float]) -> None:
    """Show where the segments end up; what their first samples say lies far beyond."""
    ends = np.append(starts[1:], len(value)) - 1
    last, spread = value[ends], np.nan_to_num(error[ends])
    known = np.isfinite(last)
    if not known.any():
        return
    last, spread = last[known], spread[known]
    room = 2.5 * spread + 0.25 * np.abs(np.median(last))
    reach = np.minimum(room, 3.0 * np.median(room))
    low, high = shown_segments.usual(np.concatenate([last - reach, last + reach]))
    axes.set_ylim(max(low, widest[0]), min(high, widest[1]))


def _starts(number: NDArray[Any]) -> Index:
    return np.flatnonzero(np.diff(number, prepend=number[0] - 1)) if len(number) else np.empty(0, int)
