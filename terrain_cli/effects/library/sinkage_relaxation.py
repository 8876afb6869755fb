"""A wheel has to roll on before it has sunk: its rut was made by what went before."""

from __future__ import annotations

from typing import Any

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _sinkage(q: Quantities) -> Any:
    """Show the sinkage that comes to its steady value as the wheel moves on."""
    return q["sinkage"] - q["length"] * q["rut_slope"]


EFFECT = Effect(
    id="sinkage-relaxation",
    title="A wheel has to roll on before it has sunk",
    kind="soil",
    parameters=(
        Parameter(
            "length",
            "m",
            0.0,
            0.03,
            lower=-0.5,
            upper=1.0,
            meaning="distance over which the sinkage comes two thirds of the way to its steady value",
            side=1,
        ),
    ),
    laws={"sinkage": _sinkage},
    needs=("rut_slope",),
    formula="length · dz/ds = z steady − z, ds = |V| dt",
    explanation=(
        "After a change of slip or load a wheel stands in a rut that was made before. It has to roll on, "
        "over some part of its contact, until the ground under it has seen nothing but the new slip. So "
        "sinkage comes to its steady value over a distance, as the side force of a tyre does over its "
        "relaxation length. While the wheel stands, its sinkage stays as it is. The length is of the order "
        "of the contact, the radius times the entry angle: in a simulation of sand as a continuum it is "
        "half to all of that. Torque and drawbar pull follow at once. Sinkage over slip becomes a loop, as "
        "it does where the sensor is late, but a lag is a time and this is a distance: at half the speed it "
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
