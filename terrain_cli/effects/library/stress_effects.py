"""Effects on the stress under the rim."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli.effects.laws.grammar import Law
from terrain_cli.effects.library import effect, parameter
from terrain_cli.mechanics.contact import rolling

if TYPE_CHECKING:
    from terrain_cli.mechanics.effect import Quantities

SLIP_SINKAGE = effect(
    id="slip-sinkage",
    title="Sinkage grows with slip",
    kind="stress",
    parameters=(
        parameter("n1", 0.5, "growth of the sinkage exponent from no slip to full slip", (-1.0, 3.0)),
        parameter(
            "n2", 0.5, "further growth of the sinkage exponent to a locked wheel", (-2.0, 3.0), skids=True
        ),
        parameter("S", 0.5, "soil carried away: growth of the sinkage itself, as a share", (-0.8, 10.0)),
        parameter(
            "bend",
            0.5,
            "how that growth bends: 0 as a straight line, 1 as a parabola",
            (-1.0, 2.0),
            shape=True,
        ),
    ),
    laws={
        "sinkage_exponent": Law(
            "sinkage_exponent + n1 * abs(slip) * (1 - bend * (1 - abs(slip))) + n2 * 0.5 * (abs(slip) - slip)"
        ),
        "sinkage": Law("sinkage * (1 + S * abs(slip))"),
    },
    formula="n = n0 + n1 |i| (1 − bend (1 − |i|)) + n2 max(−i, 0); z *= 1 + S |i|",
)


RATE_DEPENDENCE = effect(
    id="rate-dependence",
    title="Strength depends on speed",
    kind="stress",
    parameters=(
        parameter("beta", 0.05, "growth of the shear stress, as a share, per factor e of speed", (-0.5, 0.5)),
    ),
    # At 0.1 m/s the strength is the soil's own.
    laws={
        name: Law(f"{name} * max(1 + beta * log(max(abs(velocity), 0.001) / 0.1), 0.1)")
        for name in ("cohesion", "tan_phi")
    },
    needs=("velocity",),
    formula="τ = τ0 (1 + β ln(V/V0)), V0 = 0.1 m/s: c and tan φ both by that factor",
)


#: m, a grain: less displacement than this along has no direction.
_GRAIN = 3e-4


def _mean_share(x: Any) -> Any:
    """Return (1 − exp(−x))/x."""
    return -np.expm1(-x) / x


def _shared_stress(q: Quantities) -> Any:
    k, along = q["shear_modulus"], q["shear_displacement"]
    across = q["radius"] * rolling(q["slip"]) * (q["entry_angle"] - q["angle"]) * np.tan(q["slip_angle"])
    square = along * along + _GRAIN**2
    alone, both = np.sqrt(square) / k, np.sqrt(square + q["lateral"] * across * across) / k
    return q["shear_stress"] * _mean_share(both) / _mean_share(alone)


SIDE_SLIP = effect(
    id="side-slip",
    title="Sliding sideways takes strength from driving",
    kind="stress",
    parameters=(
        parameter(
            "k_growth", 1.0, "growth of the shear modulus, as a share, per radian", (-1.0, 30.0), unit="1/rad"
        ),
        parameter("lateral", 2.0, "(k/ky)²: how much sooner the soil shears across than along", (0.0, 50.0)),
    ),
    laws={
        "shear_modulus": Law("shear_modulus * (1 + k_growth * abs(slip_angle))"),
        "shear_stress": _shared_stress,
    },
    needs=("slip_angle",),
    formula=(
        "k = k0 (1 + k_growth |β|); τ = τmax (1 − exp(−ρ)) (j/k)/ρ, ρ² = (j/k)² + lateral (jy/k)², jy = r (1 "
        "− i)(θ1 − θ) tan β"
    ),
)

SHEAR_MODULUS = effect(
    id="shear-modulus",
    title="The shear modulus grows with slip",
    kind="stress",
    parameters=(
        parameter(
            "k1", 1.0, "growth of the shear modulus, as a share, from no slip to full slip", (-0.95, 20.0)
        ),
    ),
    laws={"shear_modulus": Law("shear_modulus * (1 + k1 * abs(slip))")},
    formula="k = k0 (1 + k1 |i|)",
)


def _softened(q: Quantities) -> Any:
    sheared = -np.expm1(-np.absolute(q["shear_displacement"]) / q["length"])
    return q["shear_stress"] * (1.0 - q["loss"] * sheared)


POST_PEAK_SOFTENING = effect(
    id="post-peak-softening",
    title="Strength is lost beyond a peak",
    kind="stress",
    parameters=(
        parameter("loss", 0.3, "share of the strength that is lost in the end", (-0.5, 0.95)),
        parameter(
            "length",
            0.03,
            "shear displacement over which it is lost",
            (0.003, 0.5),
            unit="m",
            null=0.05,
            shape=True,
        ),
    ),
    laws={"shear_stress": _softened},
    formula="τ = (c + σ tan φ)(1 − exp(−j/k))(1 − loss (1 − exp(−j/length)))",
)


#: σ0 in Pa: the stress at which tan φ is the soil's own.
_REFERENCE_STRESS = 10e3
_LEAST_STRESS = 1.0


def _curved(q: Quantities) -> Any:
    sigma, travel = q["normal_stress"], q["shear_displacement"]
    way = np.where(travel < 0.0, -1.0, 1.0)
    mobilised = -way * np.expm1(-np.absolute(travel) / q["shear_modulus"])
    bent = np.exp(-q["B"] * np.log(np.maximum(sigma, _LEAST_STRESS) / _REFERENCE_STRESS)) - 1.0
    return q["shear_stress"] + q["tan_phi"] * sigma * bent * mobilised


STRENGTH_CURVATURE = effect(
    id="strength-curvature",
    title="The strength envelope is curved",
    kind="stress",
    parameters=(parameter("B", 0.1, "how fast friction falls as the stress rises", (-0.5, 0.6)),),
    laws={"shear_stress": _curved},
    formula="τ = (c + σ tan φ (σ/σ0)^(−B))(1 − exp(−j/k)), σ0 = 10 kPa",
)
