"""What `estimate` says of soils where the model misses the data."""

from __future__ import annotations

import numpy as np
import pytest

from terrain_cli.presentation import summary


def table(strength, error, status="not-separable"):
    n = len(strength)
    return {
        "status": [status] * n,
        "strength_at_stress_kPa": np.array(strength),
        "strength_at_stress_se_kPa": np.array(error),
    }


@pytest.mark.parametrize(
    ("strength", "error", "says"),
    [
        ([3.0, 2.0], [0.1, 0.3], "k is uncertain; the strength is reliable within its error"),
        ([3.0, 2.0], [0.1, 2.3], "k is uncertain; the strength is reliable where its error is small"),
        ([3.0, -2.0], [9.0, 0.3], "k is uncertain; the strength is not known either"),
        ([np.nan], [np.nan], "k is uncertain; the strength is not known either"),
    ],
)
def test_the_strength_holds_only_where_it_is_known(strength, error, says):
    document = {
        "inputs": [],
        "settings": {"segments": "terrain"},
        "terrains": [],
    }
    rows = table(strength, error)
    document["terrains"] = [
        {
            "terrain": "sand",
            "wheel": "w",
            "segments": len(strength),
            "separable": 0,
            "samples": 9,
            "distance_m": None,
            "status": {"not-separable": len(strength)},
            "pooled": dict.fromkeys(
                (
                    "c_kPa",
                    "c_se_kPa",
                    "phi_deg",
                    "phi_se_deg",
                    "strength_at_stress_kPa",
                    "strength_at_stress_se_kPa",
                    "stress_kPa",
                )
            ),
        }
    ]
    text = summary.text(
        document, {**rows, "terrain": ["sand"] * len(strength), "wheel": ["w"] * len(strength)}
    )
    assert text.splitlines()[-1].endswith(says)
