"""What a mission team reads first: the soils by terrain and wheel, and what was set aside."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from terrain_cli import estimation
from terrain_cli.estimation import PooledEstimate, WindowEstimates
from terrain_cli.estimation.strength import strength_at, stress_of_all
from terrain_cli.presentation.segment_table import SOIL, Table, in_units
from terrain_cli.presentation.terminal import aligned
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.quantities import counted, known, short

FORMAT = "terrain-est/summary/1"
#: Of a table, what `document` looks at.
COLUMNS = ("terrain", "wheel", "distance_m", "n_samples", "n_rejected")


def document(
    table: Table, estimates: WindowEstimates, accounts: Sequence[dict[str, Any]], settings: dict[str, Any]
) -> dict[str, Any]:
    """Summarise segments: means of windows that tell c from φ; `pooled` is of all of a terrain and wheel."""
    return {
        "format": FORMAT,
        "settings": settings,
        "inputs": list(accounts),
        "terrains": terrains(table, estimates),
    }


def terrains(table: Table, estimates: WindowEstimates) -> list[dict[str, Any]]:
    groups: dict[tuple[str, str], list[int]] = {}
    for row, key in enumerate(zip(table["terrain"], table["wheel"], strict=True)):
        groups.setdefault(key, []).append(row)
    # Inputs of a batch have a stress each; soils are compared at that of the first.
    stress = stress_of_all(estimates)
    return [_group(*key, table, estimates, np.array(rows), stress) for key, rows in sorted(groups.items())]


def _group(
    terrain: str, wheel: str, table: Table, estimates: WindowEstimates, rows: Index, stress: float
) -> dict[str, Any]:
    found = estimates.status[rows]
    status = found.tolist()
    distance = table["distance_m"][rows]
    pooled = estimation.pool(estimates, rows)
    mapped, mapped_se = map(float, strength_at(stress, pooled))
    long = rows[found != "too-few-samples"]
    separable = rows[(found != "too-few-samples") & estimates.separable[rows]]
    return {
        "terrain": terrain,
        "wheel": wheel,
        "segments": len(status),
        "status": {name: status.count(name) for name in dict.fromkeys(status)},
        "samples": int(table["n_samples"][rows].sum()),
        "rejected": int(table["n_rejected"][rows].sum()),
        "distance_m": float(np.nansum(distance)) if np.isfinite(distance).any() else None,
        "separable": len(separable),
        "c_kPa": _mean_and_spread(estimates.c[separable] / 1e3),
        "phi_deg": _mean_and_spread(np.degrees(estimates.phi[separable])),
        "k_mm": _mean_and_spread(estimates.shear_modulus[long] * 1e3),
        "n": _mean_and_spread(estimates.sinkage_exponent[long]),
        "keq_kPa_per_m_n": _mean_and_spread(estimates.stiffness[long] / 1e3),
        "pooled": {
            "windows": pooled.windows,
            **_known(pooled, (*SOIL, "sigma_star_kPa", "strength_kPa", "strength_se_kPa")),
            "stress_kPa": known(stress / 1e3),
            "strength_at_stress_kPa": known(mapped / 1e3),
            "strength_at_stress_se_kPa": known(mapped_se / 1e3),
            **_known(pooled, ("strength_between_kPa", "phi_between_deg")),
        },
    }


def _mean_and_spread(values: Array) -> dict[str, float | None]:
    values = values[np.isfinite(values)]
    return {
        "mean": float(values.mean()) if len(values) else None,
        "spread": float(values.std(ddof=1)) if len(values) > 1 else None,
    }


def _known(pooled: PooledEstimate, columns: Sequence[str]) -> dict[str, float | None]:
    return {name: known(value) for name, value in in_units(pooled, columns).items()}


def text(
    summary: dict[str, Any],
    table: Table,
    *,
    diagnosed: Callable[[], str] | None = None,
    verbose: bool = False,
) -> str:
    """Write a summary; segments of soils that nobody named are listed: what is pooled of them is no soil.

    `diagnosed` returns the command that looks for what a model lacks, for the last line.
    """
    lines = []
    for entry in summary["inputs"]:
        for wheel in entry["wheels"]:
            lines.append(
                f"{entry['source']}  {wheel['wheel']}: {wheel['used']} of {wheel['samples']} samples used"
            )
            lines += [f"  set aside: {count} · {reason}" for reason, count in wheel["set_aside"].items()]
            derived = {
                name: how for name, how in wheel["channels"].items() if verbose or how.startswith("derived")
            }
            lines += [f"  {name}: {how}" for name, how in derived.items()]
            lines += _model_text(wheel["model"])
        if entry["rows_skipped"]:
            lines.append(f"  skipped: {entry['rows_skipped']} incomplete rows")
        lines += [f"  {remark}" for remark in dict.fromkeys(r for w in entry["wheels"] for r in w["remarks"])]
    unnamed = summary["settings"]["segments"] == "auto" and not any(table["terrain"])
    rows = _segment_rows(table) if unnamed else _terrain_rows(summary["terrains"])
    lines += aligned(rows)
    if unnamed and len(table["wheel"]) > LISTED:
        lines.append(f"… and {len(table['wheel']) - LISTED} more segments")
    others = sorted({name for entry in summary["terrains"] for name in entry["status"]} - {"ok"})
    lines += [f"{name}: {MEANINGS[name]}{_addition(name, table)}" for name in others]
    if diagnosed and not _DIAGNOSED.isdisjoint(others):
        lines.append(f"Next: {diagnosed()}")
    return "\n".join(lines)


def _addition(name: str, table: Table) -> str:
    """Say of the rows that do not tell c from φ whether their strength is known."""
    if name not in {"not-separable", "prior-bound"}:
        return ""
    rows = np.array([status == name for status in table["status"]], dtype=bool)
    strength, error = (np.asarray(table[column], dtype=float)[rows] for column in _MAPPED)
    known = error <= _KNOWN * strength
    if known.all():
        return "; the strength is reliable within its error"
    return (
        "; the strength is reliable where its error is small"
        if known.any()
        else "; the strength is not known either"
    )


def _model_text(model: dict[str, Any] | None) -> list[str]:
    """Say what a wheel was fitted with; nothing of the linear model alone."""
    if model is None:
        return []
    lines = [f"  model: {' + '.join([model['base'], *model['effects']])}"]
    for name, entry in model["parameters"].items():
        unit = f" {entry['unit']}" * (entry["unit"] != "1")
        if entry["held"]:
            why = f": {entry['because']}" if entry["because"] else ""
            lines.append(f"    {name} = {entry['value']:.4g}{unit}, held{why}")
        else:
            known = "" if entry["fixed_by_data"] else "; not determined by the data"
            lines.append(f"    {name} = {short(entry['value'], 4)} ± {short(entry['se'], 2)}{unit}{known}")
    if model["rivals"]:
        lines.append(
            "    also fitted, as the data could not tell it from an effect of the model: "
            + ", ".join(model["rivals"])
        )
    lines += [f"    c and φ are as in the law of {name}: {law}" for name, law in model["strength"].items()]
    told = ((counted(model[key], "segment"), text) for key, text in _TOLD.items() if model.get(key))
    return lines + [f"    {text.format(where)}" for where, text in told]


def _terrain_rows(entries: Sequence[dict[str, Any]]) -> list[tuple[str, ...]]:
    return [
        ("terrain", "wheel", "segments", "separable", "samples", "distance", "status", *_HEADS),
        *(
            (
                entry["terrain"] or "–",
                entry["wheel"],
                *(str(entry[name]) for name in ("segments", "separable", "samples")),
                _metres(entry["distance_m"]),
                _statuses(entry["status"]),
                *_estimates(entry["pooled"]),
            )
            for entry in entries
        ),
    ]


def _statuses(counts: Mapping[str, int]) -> str:
    """Write the one status of windows, or how many have which."""
    return ", ".join(counts if len(counts) == 1 else (f"{n} {name}" for name, n in counts.items()))


def _segment_rows(table: Table) -> list[tuple[str, ...]]:
    several = len(set(table["source"])) > 1
    header = ("wheel", "segment", "samples", "distance", "status", *_HEADS)
    rows: list[tuple[str, ...]] = [("source", *header) if several else header]
    for j in range(min(len(table["wheel"]), LISTED)):
        row = {name: values[j] for name, values in table.items()}
        cells = (
            row["wheel"],
            str(row["segment"]),
            str(row["n_samples"]),
            _metres(known(row["distance_m"])),
            row["status"],
            *_estimates({name: known(row[name]) for name in _SHOWN}),
        )
        rows.append((row["source"], *cells) if several else cells)
    return rows


LISTED = 40  # Segments listed for a person at the most; the table has them all
#: What is said of the segments that the account of a fit counts.
_TOLD = {
    "missed": "the residuals of {} are systematic",
    "moved": "the residuals of {} look like a missing effect that shifts c, φ or strength beyond its error",
    "unsettled": "the fit did not converge in {}",
}
_HEADS = ("c [kPa]", "φ [°]", "strength [kPa]")
_MAPPED = ("strength_at_stress_kPa", "strength_at_stress_se_kPa")
_SHOWN = ("c_kPa", "c_se_kPa", "phi_deg", "phi_se_deg", *_MAPPED, "stress_kPa")
#: Error of a strength, as a share of it, up to which it is known.
_KNOWN = 0.5
#: Statuses of what a diagnosis may explain.
_DIAGNOSED = frozenset({"at-bound", "model-misses"})
MEANINGS = {
    "ill-conditioned": "c and φ depend on the ridge penalty δ; only the strength is reliable",
    "not-separable": "c and φ cannot be separated: the load varies too little for the noise, "
    "or k is uncertain",
    "out-of-range": "c is negative or φ is outside 0 to 60°: noise if by less than its error, else "
    "a wrong model",
    "at-bound": "a parameter is at the limit of its plausible range, or far from what rover.toml says of it",
    "prior-bound": "the data do not determine c or φ (left empty)",
    "model-misses": "the soil varies or an effect is missing: c and φ may be off",
    "too-few-samples": "segments with fewer samples than --min-samples",
}


def _plus_minus(value: float | None, error: float | None, digits: int) -> str:
    if value is None or error is None:
        return "–"
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def _metres(distance: float | None) -> str:
    return "–" if distance is None else f"{distance:.2f} m"


def _estimates(found: Mapping[str, float | None]) -> tuple[str, str, str]:
    c, c_se, phi, phi_se, strength, error, stress = (found[name] for name in _SHOWN)
    at = "" if stress is None else f" at {stress:.4g} kPa"
    return _plus_minus(c, c_se, 2), _plus_minus(phi, phi_se, 1), _plus_minus(strength, error, 2) + at
