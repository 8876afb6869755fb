"""Effects on the stress under the rim."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.effects.laws.grammar import Law
from terrain_cli.effects.library import parameter
from terrain_cli.mechanics.contact import rolling
from terrain_cli.mechanics.effect import Effect, Quantities

SLIP_SINKAGE = Effect(
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
    explanation=(
        "A slipping wheel carries soil backwards from under itself and sinks into the hole: at a slip of 0.6 "
        "it stands three to seven times as deep as at rest. Ding et al. let the exponent of the "
        "pressure–sinkage law grow with slip; n1 is 0.3 to 1 in loose soil: all of the contact is longer "
        "then. The growth may bend: with a bend of 1 the exponent rises with the square of slip. "
        "Lyasko lets the sinkage alone grow, z = z0 (1 + S i)/(1 − 0.5 S i), by soil that is carried away "
        "without bearing more; here z0 (1 + S |i|), as on a smooth wheel in dry sand S = 1 does. One drive "
        "hardly tells n1 from S. A skidding wheel ploughs, and sinks more than one that slips as much: n2 is "
        "what comes to the exponent there, and is left out where nothing skids. Sinkage at one load rises "
        "with slip, and through the longer contact torque rises too, while drawbar pull falls at high slip. "
        "Without sinkage it is easily taken for grousers or max-stress-angle. Grousers and shear-modulus "
        "hardly move the sinkage; max-stress-angle moves it less, and leaves torque as it was."
    ),
    shows="sinkage, then torque and drawbar pull, against slip",
    reference=(
        "Ding, Gao, Deng, Tao (2010), Wheel slip-sinkage and its prediction model of lunar rover, Journal of "
        "Central South University of Technology 17(1), 129–135, doi 10.1007/s11771-010-0021-7; Lyasko "
        "(2010), Slip sinkage effect in soil–vehicle mechanics, Journal of Terramechanics 47(1), 21–31, doi "
        "10.1016/j.jterra.2009.08.005; growth of its own in skids: Pavlov (2024), on dry sand"
    ),
    settled_by="a slip sweep at one load, with sinkage and drawbar pull measured together",
)


RATE_DEPENDENCE = Effect(
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
    explanation=(
        "Shear strength grows with the logarithm of the rate of shearing: clearly the cohesion of moist "
        "soils, little the friction of dry sand, β from 0 to 0.15. Beyond 0.2 m/s a wheel in loose sand "
        "loses pull instead, as it throws soil away, and β comes out negative. Torque and drawbar pull "
        "differ between slow and fast at the same slip. In most drives slip changes with speed, and then all "
        "that depends on slip, such as shear-modulus and max-stress-angle, passes for it and it for them. "
        "The viscous part of drivetrain-friction depends on speed too, but leaves drawbar pull alone."
    ),
    shows="torque and drawbar pull against speed at one slip",
    reference=(
        "Stafford, Tanner (1983), Effect of rate on soil shear strength and soil-metal friction I. Shear "
        "strength, Soil and Tillage Research 3(3), 245–260, doi 10.1016/0167-1987(83)90026-0; for fast "
        "wheels Rodríguez-Martínez et al. (2023), arXiv 2306.02167"
    ),
    settled_by="several speeds at one slip and one load",
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


SIDE_SLIP = Effect(
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
    explanation=(
        "In a turn or across a slope the wheel moves at an angle β to its plane. The soil is then sheared "
        "along and across at once. Ishigami et al. find that it gives way over a longer displacement along, "
        "k = 0.043 |β| + 0.036 m, which is a k_growth of 1.2 per radian, and over ky = 0.020 |β| + 0.013 m "
        "across. Beyond that the strength is shared in the direction of the displacement, each part counted "
        "by its own modulus: `lateral` is (k/ky)², 1 for a soil that is the same both ways and some 4 to 8 "
        "with those moduli; 0 leaves the sharing out. Torque and drawbar pull fall with |β|, most at low "
        "slip, where the displacement across outweighs the one along. It looks like a lower strength in "
        "turns. Slope and load-transfer often come together with it, and follow pitch, not β."
    ),
    shows="drawbar pull and torque against |slip angle|, and so against yaw rate",
    reference=(
        "Ishigami, Miwa, Nagatani, Yoshida (2007), Terramechanics-based model for steering maneuver of "
        "planetary exploration rovers on loose soil, Journal of Field Robotics 24(3)"
    ),
    settled_by="the same slip and load at several slip angles, to either side",
)

SHEAR_MODULUS = Effect(
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
    explanation=(
        "The displacement k after which the soil's strength is nearly all there depends on the thickness of "
        "the layer that is sheared: 1 to 40 mm, and under a plate it is not what it is under a wheel. As a "
        "wheel slips it loosens the soil and shears a thicker layer, and k grows. Torque and pull then rise "
        "more slowly with slip than one k allows: the curve is bent below a slip of about 0.2, and flatter "
        "beyond. Sinkage hardly moves, which tells it from slip-sinkage; T/r − DP hardly moves, which tells "
        "it from max-stress-angle. A wrong but constant k is no effect: let k be estimated first. "
        "Post-peak-softening makes the curve fall at high slip, which no k1 does."
    ),
    shows="torque and drawbar pull at slips below 0.2, by their curvature",
    reference=(
        "Wong (2008), Theory of Ground Vehicles, 4th edition, Wiley; Ishigami, Miwa, Nagatani, Yoshida "
        "(2007), Journal of Field Robotics 24(3), for a k that changes with the motion"
    ),
    settled_by="a slip sweep with many points below 0.3 and some near 1, sinkage and drawbar pull measured",
)


def _softened(q: Quantities) -> Any:
    sheared = -np.expm1(-np.absolute(q["shear_displacement"]) / q["length"])
    return q["shear_stress"] * (1.0 - q["loss"] * sheared)


POST_PEAK_SOFTENING = Effect(
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
    explanation=(
        "Dense sand, crusted soil, mats of roots and frozen snow shear through a hump: strength rises to a "
        "peak and falls to a residual of 0.5 to 0.9 of it. With a length equal to k this is the hump that "
        "Wong fits to snow, apart from the name of its constants; a greater length loses strength later. c "
        "and φ are those before the loss. Torque and drawbar pull fall at high slip, where the soil has been "
        "sheared furthest, and a deep wheel shows it sooner. Drawbar pull alone falls with slip-sinkage too, "
        "but there torque keeps rising; shear-modulus flattens the curves and cannot make them fall."
    ),
    shows="torque and drawbar pull, falling together at high slip",
    reference="Wong (2008), Theory of Ground Vehicles, 4th edition, Wiley: shear curves with a hump",
    settled_by="a slip sweep up to 0.8 or more, with sinkage measured",
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


STRENGTH_CURVATURE = Effect(
    id="strength-curvature",
    title="The strength envelope is curved",
    kind="stress",
    parameters=(parameter("B", 0.1, "how fast friction falls as the stress rises", (-0.5, 0.6)),),
    laws={"shear_stress": _curved},
    formula="τ = (c + σ tan φ (σ/σ0)^(−B))(1 − exp(−j/k)), σ0 = 10 kPa",
    explanation=(
        "Mohr–Coulomb's straight line is measured at the stresses of buildings. Below some 15 kPa, where "
        "light rovers drive, grains ride up over each other more freely and friction is higher: the envelope "
        "bends towards the origin, with B of 0.05 to 0.2. A straight line fitted to a piece of it finds a "
        "cohesion that is not there, and c rises and φ falls as the load rises. At one load it cannot be "
        "told from cohesion. Hardpan also changes things with load, but in sinkage; here sinkage stays. tan "
        "φ is that at 10 kPa."
    ),
    shows="torque and drawbar pull against load: apparent c and φ drift with it",
    reference=(
        "Senatore, Iagnemma (2011), Direct shear behaviour of dry, granular soils for low normal stress with "
        "application to lightweight robotic vehicle modelling, conference of the International Society for "
        "Terrain-Vehicle Systems"
    ),
    settled_by="load steps over a factor of four or more at one slip",
)
