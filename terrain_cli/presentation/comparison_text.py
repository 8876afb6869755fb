"""A comparison, and what a verb says at its end, as JSON and for a person."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.comparison.comparison_outcome import (
    ChannelErrors,
    Comparison,
    Difference,
    Finding,
    WheelComparison,
    as_estimated,
    segment_soils,
)
from terrain_cli.diagnosis.conclusion import Conclusion, conclude
from terrain_cli.diagnosis.evidence import Evidence
from terrain_cli.estimation import WindowEstimates
from terrain_cli.estimation.fit_account import CommonParameters
from terrain_cli.presentation.segment_table import SOIL, in_units
from terrain_cli.presentation.terminal import aligned, in_line
from terrain_cli.vocabulary.next_commands import Asked
from terrain_cli.vocabulary.quantities import counted, entries, known, listed, quantity, short

FORMAT = "terrain-est/comparison/1"
_PLACE = ("source", "wheel", "segment")  # What tells a segment from others
_MOST = 0.5  # Share of the misfit, above which findings explain most of it
_WORST = 3  # Segments that a finding names, and a person reads


def conclusion_of(evidence: Evidence, comparison: Comparison, asked: Asked | None = None) -> Conclusion:
    """Conclude what evidence says; of the files and the model of a comparison if no more is known."""
    return conclude(evidence, asked or _asked(comparison))


def looked_at(found: Conclusion, comparison: Comparison, asked: Asked | None = None) -> str:
    """Return the command that looks further where a conclusion has none: the soil of a model that fits."""
    return (asked or _asked(comparison)).looked("estimate" if found.state == "fits" else "diagnose")


def conclusion_document(conclusion: Conclusion) -> dict[str, Any]:
    return entries(conclusion, "state", "sentence", "command", "record", "drive")


def _asked(comparison: Comparison) -> Asked:
    sources = [one for wheel in comparison.wheels for one in wheel.source.split(", ")]
    model = "model.toml" if comparison.model["effects"] else comparison.model["base"]
    return Asked(inputs=tuple(dict.fromkeys(sources)), model=model)


def document(
    comparison: Comparison,
    second: Comparison | None = None,
    differences: Sequence[Difference] = (),
    asked: Sequence[Asked] = (),
) -> dict[str, Any]:
    """Return a comparison as it is written to JSON, a `second` model under the key "against"."""
    comparison = as_estimated(comparison)
    result = {
        "format": FORMAT,
        "model": comparison.model,
        "data": data_document(comparison),
        **_outcome(comparison, asked[0] if asked else None),
    }
    if second is not None:
        second = as_estimated(second)
        result["against"] = {"model": second.model, **_outcome(second, asked[1] if asked else None)}
        result["differences"] = [_difference(one) for one in differences]
    return result


def data_document(comparison: Comparison) -> dict[str, Any]:
    """Say of how much data a comparison is."""
    return {
        "sources": list(dict.fromkeys(wheel.source for wheel in comparison.wheels)),
        "samples": sum(len(wheel.windows.rows) for wheel in comparison.wheels),
        "segments": sum(len(wheel.segments) for wheel in comparison.wheels),
        "blocks": comparison.blocks,
    }


def _outcome(comparison: Comparison, asked: Asked | None) -> dict[str, Any]:
    wheels = list(zip(comparison.wheels, segment_soils(comparison), strict=True))
    return {
        "conclusion": conclusion_document(concluded(comparison, asked)),
        "channels": {name: _errors(errors) for name, errors in comparison.channels.items()},
        "failures": [_finding(finding) for finding in comparison.failures],
        "parameters": [_parameters(wheel, soils.common) for wheel, soils in wheels if wheel.fit.shared],
        "segments": [row for wheel, soils in wheels for row in _segments(wheel, soils.estimates)],
        "warnings": list(comparison.warnings),
    }


def _errors(errors: ChannelErrors) -> dict[str, Any]:
    return {
        "unit": errors.unit,
        "samples": errors.n,
        **entries(errors, "rmse", "bias", "nrmse", "noise", "heldout_rmse"),
        "heldout_interval": [known(errors.heldout_low), known(errors.heldout_high)],
    }


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        **entries(finding, "channel", "driver", "shape", "p_value", "share", "amplitude", "seen"),
        **entries(finding, "unit", "at", "until", "sentence", "alternatives"),
        "worst_segments": [dict(zip(_PLACE, place, strict=True)) for place in finding.worst_segments],
    }


def _parameters(wheel: WheelComparison, found: CommonParameters) -> dict[str, Any]:
    own, sought = wheel.model.parameters, [name for name in found.values if name in wheel.fit.shared]
    factor = {name: own[name].factor if name in own else 1.0 for name in sought}
    return {
        "source": wheel.source,
        "wheel": wheel.wheel,
        **{
            name: {
                "value": known(found.values[name] / factor[name]),
                "se": known(found.errors[name] / factor[name]),
                "unit": own[name].unit if name in own else "",
            }
            for name in sought
        },
    }


def _segments(wheel: WheelComparison, soils: WindowEstimates) -> Iterator[dict[str, Any]]:
    bounds, soil = wheel.segments.bounds, in_units(soils, SOIL[:4])
    for j in range(len(wheel.segments)):
        part = slice(bounds[j], bounds[j + 1])
        yield {
            "source": wheel.source,
            "wheel": wheel.wheel,
            "segment": j + 1,
            "samples": int(bounds[j + 1] - bounds[j]),
            "status": str(soils.status[j]),
            **{name: known(values[j]) for name, values in soil.items()},
            **{
                name: _of_segment(series.measured[part] - series.predicted[part])
                for name, series in wheel.series.items()
            },
        }


def _of_segment(error: Any) -> dict[str, float | None]:
    error = error[np.isfinite(error)]
    if len(error) == 0:
        return {"rmse": None, "bias": None}
    return {"rmse": float(np.sqrt(np.mean(error**2))), "bias": float(np.mean(error))}


def _difference(one: Difference) -> dict[str, Any]:
    return {
        **entries(one, "name", "unit"),
        **dict(zip(_PLACE, one.where or (None, None, None), strict=True)),
        **entries(one, "first", "second", "difference"),
        "interval": [known(one.low), known(one.high)],
        "se": known(one.se),
        "moved": bool(one.moved),
    }


def concluded(comparison: Comparison, asked: Asked | None = None) -> Conclusion:
    return conclusion_of(Evidence.of_comparison(comparison), comparison, asked)


def named(comparison: Comparison) -> str:
    """Return the name of a model: its base and what was added."""
    return " + ".join([comparison.model["base"], *comparison.model["effects"]])


def text(
    comparison: Comparison,
    second: Comparison | None = None,
    differences: Sequence[Difference] = (),
    asked: Sequence[Asked] = (),
) -> str:
    """Write a comparison for a person, as `document` does for a program."""
    of_first, of_second = (*asked, None, None)[:2]
    parts = [_text_of_one(comparison, of_first)]
    if second is not None:
        parts += [_text_of_one(second, of_second), _text_of_two(comparison, second, differences)]
    return "\n\n".join(parts)


def _text_of_one(comparison: Comparison, asked: Asked | None) -> str:
    """Write errors by channel, then where the model fails, and what follows from it."""
    lines = [title(comparison), ""]
    head = ["channel", "unit", "rmse", "bias", "noise", "rmse/rms", "held-out rmse", "95 %"]
    rows = [
        [
            what.words,
            what.unit,
            *(short(value * what.factor) for value in (errors.rmse, errors.bias, errors.noise)),
            f"{errors.nrmse:.1%}" if math.isfinite(errors.nrmse) else "–",
            short(errors.heldout_rmse * what.factor),
            f"{short(errors.heldout_low * what.factor)} … {short(errors.heldout_high * what.factor)}",
        ]
        for name, errors in comparison.channels.items()
        for what in [quantity(name, errors.unit)]
    ]
    lines += [*aligned([head, *rows]), ""]
    if comparison.failures:
        told = [_told(finding, comparison) for finding in comparison.failures]
        lines += ["where it fails, the strongest first:", *told, *_off_too(comparison), ""]
    lines += [f"note: {warning}" for warning in comparison.warnings]
    lines += [concluded(comparison, asked).sentence]
    return "\n".join(lines)


def _off_too(comparison: Comparison) -> Iterator[str]:
    """Say why a channel is off in the table that no finding names."""
    there = {finding.channel for finding in comparison.failures}
    off = [
        name.replace("_", " ")
        for name, one in comparison.channels.items()
        if name not in there and one.heldout_rmse > criteria.ABOVE_NOISE * one.noise
    ]
    if off:
        are = "is" if len(off) == 1 else "are"
        share = min(sum(finding.share for finding in comparison.failures), 1.0)
        # Only what they explain may have spread.
        why = ": the fitted soil spreads an error of one channel over the others. These findings explain"
        why = why if share > _MOST else ", and no finding tells why: these explain only"
        yield f"  {listed(off)} {are} off too{why} {share:.0%} of the whole misfit"


def title(comparison: Comparison) -> str:
    """Name the model, and say with how much data it was compared."""
    data = data_document(comparison)
    where = f"{counted(data['samples'], 'sample')} in {counted(data['segments'], 'segment')}"
    return f"model {named(comparison)} against {where}"


def _told(finding: Finding, comparison: Comparison) -> str:
    several = sum(len(wheel.segments) for wheel in comparison.wheels) > 1
    named = len({wheel.windows.samples.wheel for wheel in comparison.wheels}) > 1
    worst = ", ".join(
        f"{in_line(wheel)} segment {segment}" if named else f"segment {segment}"
        for _, wheel, segment in finding.worst_segments[:_WORST]
    )
    chance = f"p {finding.p_value:.3f}" if finding.p_value >= 0.001 else "p < 0.001"
    parts = [f"{finding.share:.0%} of the misfit" if math.isfinite(finding.share) else "", chance]
    parts += [f"worst in {worst}"] if several and worst else []
    return f"  {finding.sentence} ({', '.join(filter(None, parts))})"


def _text_of_two(first: Comparison, second: Comparison, differences: Sequence[Difference]) -> str:
    """Write held-out errors of two models; ``*`` marks what moved by over three standard errors."""
    lines = [f"A  {named(first)}", f"B  {named(second)}", ""]
    head = ["held-out rmse", "unit", "A", "B", "B − A", "95 %", ""]
    errors = [one for one in differences if one.where is None]
    rows = [
        [
            what.words,
            what.unit,
            short(one.first * what.factor),
            short(one.second * what.factor),
            f"{short(one.difference * what.factor)} ± {short(one.se * what.factor)}",
            f"{short(one.low * what.factor)} … {short(one.high * what.factor)}",
            "*" if one.moved else "",
        ]
        for one in errors
        for what in [quantity(one.name, one.unit)]
    ]
    lines += [*aligned([head, *rows]), ""]
    soil = [one for one in differences if one.where is not None]
    moved = [one for one in soil if one.moved]
    if moved:
        shown = {"c": ("c", "kPa", 1e-3), "phi": ("φ", "°", math.degrees(1.0))}
        lines.append("soil that moved by more than three standard errors:")
        for one in moved:
            name, unit, factor = shown[one.name]
            _, wheel, segment = one.where or ("", "", 0)
            lines.append(
                f"  wheel {in_line(wheel)} segment {segment}: {name} "
                f"{one.first * factor:.2f} → {one.second * factor:.2f} {unit}"
            )
    else:
        lines.append(
            f"no c or φ of {counted(len(soil) // 2, 'segment')} moved by more than three standard errors"
        )
    return "\n".join(lines)
