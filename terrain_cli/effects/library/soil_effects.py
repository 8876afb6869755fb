"""Effects on what the soil is."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from terrain_cli.effects.laws.grammar import Law
from terrain_cli.effects.library import parameter
from terrain_cli.mechanics.effect import Effect, Quantities

#: What a pass changes as a share of what the one before it did, where nothing else is known.
_FURTHER = math.exp(-1.0)


def _packed(quantity: str, q: Quantities) -> Any:
    """Change a quantity of the soil by a share at the first pass, and by less at each further one."""
    share = _FURTHER + q["further"]
    geometric = np.expm1(np.maximum(q["pass_number"], 0.0) * np.log(share)) / (share - 1.0)
    return q[quantity] * (1.0 + q[f"{quantity}_gain"] * geometric)


MULTI_PASS = Effect(
    id="multi-pass",
    title="Soil that has been driven over",
    kind="soil",
    parameters=(
        parameter(
            "stiffness_gain",
            0.5,
            "change of the stiffness by the first pass, as a share",
            (-0.6, 10.0),
            side=1,
        ),
        parameter("cohesion_gain", 0.3, "change of the cohesion by the first pass, as a share", (-0.6, 10.0)),
        parameter(
            "shear_modulus_gain",
            0.3,
            "change of the shear modulus by the first pass, as a share",
            (-0.6, 10.0),
        ),
        parameter(
            "further",
            0.3,
            "by how much more than 37 % of what the pass before it did each further pass does, as a share",
            (-0.35, 0.6),
            shape=True,
        ),
    ),
    laws={name: partial(_packed, name) for name in ("stiffness", "cohesion", "shear_modulus")},
    needs=("pass_number",),
    formula="keq, c, k each times 1 + gain (1 − f^N)/(1 − f), f = 0.37 + further, N passes before",
    explanation=(
        "The first wheel compacts the soil, and the next in its rut finds it stiffer, mostly by 10 to 100 %, "
        "more cohesive, and sheared over a shorter way. The first pass does most; each later one adds a "
        "share of the one before, and after three or four nothing changes. Sinkage falls and drawbar pull "
        "rises in a step where the pass number changes, between front and rear wheels or where the rover "
        "crosses its own track. "
        "Load-transfer also tells front from rear wheels, but follows pitch and acceleration; a change of "
        "soil along the way makes a step too, and not at the same place for every wheel."
    ),
    shows="sinkage and drawbar pull, in a step at the pass number; rear wheels against front ones",
    reference=(
        "Abebe et al. (1989), Soil compaction by multiple passes of a rigid wheel relevant for optimization "
        "of traffic, Journal of Terramechanics 26(2), 139, doi 10.1016/0022-4898(89)90003-7; after Holm "
        "(1969), Multi-pass behaviour of a pneumatic tire, Journal of Terramechanics 6"
    ),
    settled_by="the same track driven twice",
)

SINKAGE_RELAXATION = Effect(
    id="sinkage-relaxation",
    title="A wheel has to roll on before it has sunk",
    kind="soil",
    parameters=(
        parameter(
            "length",
            0.03,
            "distance over which the sinkage comes two thirds of the way to its steady value",
            (-0.5, 1.0),
            unit="m",
            side=1,
        ),
    ),
    laws={"sinkage": Law("sinkage - length * rut_slope")},
    needs=("rut_slope",),
    formula="length · dz/ds = z steady − z, ds = |V| dt",
    explanation=(
        "After a change of slip or load a wheel stands in a rut that was made before. It has to roll on, "
        "over some part of its contact, until the ground under it has seen nothing but the new slip. So "
        "sinkage comes to its steady value over a distance, as the side force of a tyre does over its "
        "relaxation length. While the wheel stands, its sinkage stays as it is. The length is of the order "
        "of the contact, the radius times the entry angle: in a simulation of sand as a continuum it is half "
        "to all of that. Torque and drawbar pull follow at once. Sinkage over slip becomes a loop, as it "
        "does where the sensor is late, but a lag is a time and this is a distance: at half the speed it "
        "lasts twice as long. At one speed nobody can tell it from sensor-lag. Slip-sinkage says how deep "
        "the wheel stands in the end, this effect over which distance it gets there."
    ),
    shows="sinkage, against its own change over the distance driven",
    reference=(
        "by analogy with the relaxation length of tyres: Pacejka (2012), Tire and Vehicle Dynamics, 3rd "
        "edition, Butterworth-Heinemann, chapter 7, ISBN 978-0-08-097016-5; that a rut slopes where a wheel "
        "goes from static to dynamic sinkage: Rutting Caused by Grouser Wheel of Planetary Rover in "
        "Single-Wheel Testbed (2025), Aerospace 12(1), 71, doi 10.3390/aerospace12010071"
    ),
    settled_by="the same changes of slip at two speeds",
)


#: m: over this distance to either side of its top the layer sets in.
_ROUND = 5e-4


def _on_a_layer(q: Quantities) -> Any:
    over = q["depth"] - q["top"]
    # A parabola between two straight lines: no kink, and exact away from the top.
    within = np.minimum(np.maximum(over + _ROUND, 0.0), 2.0 * _ROUND)
    into = within * within / (4.0 * _ROUND) + np.maximum(over - _ROUND, 0.0)
    return q["normal_stress"] + q["modulus"] * into


HARDPAN = Effect(
    id="hardpan",
    title="A firmer layer below",
    kind="soil",
    parameters=(
        parameter("modulus", 2e6, "pressure that the layer adds per depth into it", (0.0, 1e9), unit="Pa/m"),
        parameter(
            "top",
            0.01,
            "depth of the layer below the surface",
            (0.001, 0.3),
            unit="m",
            null=0.01,
            shape=True,
            along="sinkage",
        ),
    ),
    laws={"normal_stress": _on_a_layer},
    formula="σ += modulus · (depth − top), where that is positive",
    explanation=(
        "Loose soil over a firm layer, ice or rock is soft until the wheel reaches it, 10 to 100 mm down, "
        "and then takes more load at little more sinkage. Sinkage rises with load and slip and then "
        "saturates, and the load sits on the lowest part of the rim, which raises drawbar pull. Loads that "
        "never reach the layer show nothing. A larger exponent n also stiffens with depth, but from the "
        "surface on, without a bend; crust is stiff first and soft below, just the other way round."
    ),
    shows="sinkage, saturating as load and slip grow",
    reference="Wong (2008), Theory of Ground Vehicles, 4th edition, Wiley: layered terrain",
    settled_by="a wide range of load, beyond the one that reaches the layer",
)


def _under_a_crust(q: Quantities) -> Any:
    return q["normal_stress"] - q["strength"] * np.expm1(-q["depth"] / q["thickness"])


CRUST = Effect(
    id="crust",
    title="A crust over soft soil",
    kind="soil",
    parameters=(
        parameter("strength", 2e3, "pressure that the crust bears before it breaks", (0.0, 1e6), unit="Pa"),
        parameter(
            "thickness",
            0.003,
            "depth over which it takes up that pressure",
            (0.0005, 0.05),
            unit="m",
            null=0.005,
            shape=True,
        ),
    ),
    laws={"normal_stress": _under_a_crust},
    formula="σ += strength (1 − exp(−depth/thickness))",
    explanation=(
        "Salts, moisture or frost cement the surface to a crust of 0.5 to 10 kPa over soft soil, as at Troy, "
        "where Spirit broke through. The ground is stiff until the pressure reaches that of the crust and "
        "soft beyond: little sinkage up to a load, and much for a little more. As the crust's strength "
        "changes from place to place, sinkage and torque jump between two values, and their residuals have "
        "two peaks. A smaller exponent n has the same shape, without the threshold; hardpan is soft first "
        "and stiff below."
    ),
    shows="sinkage and torque in jumps, with two peaks in their residuals",
    reference=(
        "Arvidson et al. (2010), Spirit Mars Rover Mission: Overview and selected results from the northern "
        "Home Plate Winter Haven to the side of Scamander crater, Journal of Geophysical Research 115, doi "
        "10.1029/2010JE003633"
    ),
    settled_by="load steps from a light wheel on, on fresh ground",
)
