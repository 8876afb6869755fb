"""What each effect of the catalogue leaves behind, for the gallery of the site: docs/gallery.json.

Every effect is put into the same simulated drive. The model without it is fitted, its residuals are
averaged along one driver, and `diagnose` is asked what is missing.

    python -m benchmarks.effect_gallery [EFFECT…]
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

import terrain_cli as terrain
from terrain_cli.effects import catalogue

PAGE = Path(__file__).resolve().parent.parent / "docs" / "gallery.json"
#: Of `terrain-est simulate`; the same for all but those that it would not show.
DRIVE = {"drive": "mixed", "duration": 240.0, "rate": 5.0, "noise": "3%", "seed": 1}
OTHERWISE = {
    # What changes within a fifth of a second, and a trace that rises as fast as the slip
    "sinkage-relaxation": {"rate": 10.0},
    "sensor-lag": {"rate": 10.0, "duration": 120.0},
    "slip-sinkage": {"rate": 10.0, "duration": 120.0},
    "multi-pass": {"drive": "passes"},  # "mixed" never comes back to its own track
    "grouser-ripple": {"rate": 20.0, "duration": 60.0},  # a grouser passes in 0.7 s
}
#: The driver along which the trace of an effect is drawn, where it is neither the first that its law reads nor
#: else the slip.
DRIVERS = {
    "bulldozing": "sinkage",
    "load-transfer": "pitch",
    "drawbar-bias": "load",
    "sinkage-relaxation": "acceleration",
    "sensor-lag": "acceleration",
    "acceleration-torque": "acceleration",
    "strength-curvature": "load",
    "hardpan": "sinkage",
    "crust": "sinkage",
    "flexible-wheel": "load",
    "grouser-ripple": "wheel_angle",
}
#: Means along the driver, of as many samples each.
BINS = 16
GROUSERS = 12


def averaged(driver, residual):
    """Return where bins along the driver lie, their means, and two standard errors of these."""
    known = np.isfinite(driver) & np.isfinite(residual)
    driver, residual = driver[known], residual[known]
    levels = np.unique(driver)
    # A driver of a few values, such as the number of passes, has a bin for each.
    ends = (
        (levels[1:] + levels[:-1]) / 2
        if len(levels) <= BINS
        else np.quantile(driver, np.arange(1, BINS) / BINS)
    )
    bin_of = np.searchsorted(ends, driver)
    groups = [bin_of == j for j in np.unique(bin_of)]
    return [
        [
            float(f"{number:.4g}")
            for number in (driver[g].mean(), residual[g].mean(), 2 * residual[g].std() / np.sqrt(g.sum()))
        ]
        for g in groups
    ]


def entry(effect):
    """Drive with an effect, and return its trace and what `diagnose` says."""
    drive = {**DRIVE, **OTHERWISE.get(effect, {})}
    found = terrain.diagnose(terrain.simulate(effects=effect, **drive).samples)
    comparison = found.found.comparison
    (wheel,) = comparison.wheels
    read = next((name for name in catalogue()[effect].reads if name in wheel.drivers), "slip")
    driver = wheel.drivers[DRIVERS.get(effect, read)]
    values = np.mod(driver.values, 2 * np.pi / GROUSERS) if driver.name == "wheel_angle" else driver.values
    return {
        "drive": drive,
        "driver": driver.name,
        "unit": driver.unit,
        "channels": {
            name: {
                "unit": errors.unit,
                "noise": float(f"{errors.noise:.4g}"),
                "bins": averaged(values, wheel.series[name].measured - wheel.series[name].predicted),
            }
            for name, errors in comparison.channels.items()
        },
        "diagnosis": str(found),
    }


def main(effects):
    """Write the entries of some effects afresh; of all, where none is named."""
    for effect in effects or catalogue():
        known = json.loads(PAGE.read_text("utf-8")) if PAGE.exists() else {}
        known[effect] = entry(effect)
        lines = [
            f"{json.dumps(name)}: {json.dumps(known[name], ensure_ascii=False)}"
            for name in catalogue()
            if name in known
        ]
        PAGE.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")
        print(effect, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
