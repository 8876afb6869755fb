"""What a model file holds, and its history, as a person reads them and as JSON."""

from typing import Any

from terrain_cli.models import ModelFile
from terrain_cli.models.model_file import SOIL
from terrain_cli.presentation.terminal import aligned
from terrain_cli.vocabulary.quantities import counted

FORMAT = "terrain-est/model-description/1"
HISTORY_FORMAT = "terrain-est/model-history/1"


def document(name: str, file: ModelFile) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "model": name,
        "base": file.model.base,
        "effects": [
            {
                **{key: getattr(effect, key) for key in ("id", "title", "kind", "formula")},
                "needs": list(effect.needs),
                "any_of": list(effect.any_of),
                "origin": effect.origin,
            }
            for effect in file.model.effects
        ],
        "parameters": {name: _parameter(name, unit, file) for name, unit in file.units.items()},
        "needs": list(file.model.needs),
        "uses": list(dict.fromkeys(name for effect in file.model.effects for name in effect.reads)),
        "history": list(file.history),
    }


def _parameter(name: str, unit: str, file: ModelFile) -> dict[str, Any]:
    own = file.model.parameters.get(name)
    prior, factor = file.priors.get(name), file.factor(name)
    return {
        "unit": unit,
        "meaning": own.meaning if own else SOIL[name][1],
        "held": file.fixed[name] / factor if name in file.fixed else None,
        "prior": {"mean": prior.mean / factor, "sd": prior.sd / factor} if prior else None,
        "per": "wheel" if own or name in file.shared else "window",
        "null": own.null / factor if own else None,
    }


def text(document: dict[str, Any]) -> list[str]:
    """Say what such a document holds, line by line."""
    lines = [f"{document['model']}: base {document['base']}"]
    for effect in document["effects"]:
        lines.append(f"  + {effect['id']} ({effect['kind']}): {effect['title']}")
        lines += [f"      {effect['formula']}"] * bool(effect["formula"])
    rows = [("parameter", "unit", "", "meaning")]
    for name, entry in document["parameters"].items():
        state = f"estimated for each {entry['per'].replace('window', 'segment')}"
        if entry["held"] is not None:
            state = f"held at {entry['held']:g}"
        elif entry["prior"]:
            state += f", known as {entry['prior']['mean']:g} ± {entry['prior']['sd']:g}"
        rows.append((name, entry["unit"], state, entry["meaning"]))
    lines += aligned(rows, "  ")
    if document["uses"]:
        names = (name if name in document["needs"] else f"{name} (if there)" for name in document["uses"])
        lines.append(f"channels that the effects use: {', '.join(names)}")
    if document["history"]:
        from terrain_cli.improvement import model_history  # Most models have none

        lines.append("history:")
        lines += [
            f"  {rung.number}. " + ": ".join(filter(None, [rung.label, rung.because]))
            for rung in model_history.rungs(document["history"])
        ]
        lines += [f"  {one}" for one in model_history.refusals(document["history"])]
    return lines


def history(path: str, file: ModelFile) -> dict[str, Any]:
    """Return all changes of a model file for JSON."""
    return {
        "format": HISTORY_FORMAT,
        "file": path,
        "base": file.model.base,
        "effects": [effect.id for effect in file.model.effects],
        "steps": [dict(entry) for entry in file.history],
    }


def history_text(path: str, file: ModelFile) -> list[str]:
    """Show all changes of a model file, line by line."""
    from terrain_cli.improvement import model_history
    from terrain_cli.presentation import change_text

    rungs = model_history.rungs(file.history)
    name = " + ".join([file.model.base, *(effect.id for effect in file.model.effects)])
    lines = [f"{path}: {name}, after {counted(len(rungs), 'change')} on record"]
    if rungs:
        head, rows = change_text.ladder(rungs)
        lines += ["", *aligned([head, *rows]), "", *change_text.remarks(rungs)]
    if refusals := model_history.refusals(file.history):
        lines += ["", "tried, and not added:", *refusals]
    return lines
