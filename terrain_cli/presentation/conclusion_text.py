"""What a verb says at its end, for a person and as JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from terrain_cli.diagnosis.conclusion import Asked, conclude, looked

if TYPE_CHECKING:
    from terrain_cli.comparison import Comparison
    from terrain_cli.diagnosis.conclusion import Conclusion, Evidence


def of(evidence: Evidence, comparison: Comparison, asked: Asked | None = None) -> Conclusion:
    """Conclude what evidence says; of the files and the model of a comparison if no more is known."""
    return conclude(evidence, asked or _asked(comparison))


def looked_at(conclusion: Conclusion, comparison: Comparison, asked: Asked | None = None) -> str:
    """Return the command that looks further where a conclusion has none: the soil of a model that fits."""
    return looked("estimate" if conclusion.state == "fits" else "diagnose", asked or _asked(comparison))


def document(conclusion: Conclusion) -> dict[str, Any]:
    """Return a conclusion as it is written to JSON."""
    return {
        "state": conclusion.state,
        "sentence": conclusion.sentence,
        "command": conclusion.command or None,
        "record": list(conclusion.record),
        "drive": conclusion.drive or None,
    }


def _asked(comparison: Comparison) -> Asked:
    sources = [one for wheel in comparison.wheels for one in wheel.source.split(", ")]
    model = "model.toml" if comparison.model["effects"] else comparison.model["base"]
    return Asked(inputs=tuple(dict.fromkeys(sources)), model=model)
