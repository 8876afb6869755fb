"""The normal stress is greatest at a share of the entry angle that grows with slip."""

from __future__ import annotations

from typing import Any

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities, Sum


def _angle(q: Quantities) -> Any:
    return q["max_stress_angle"] + (q["c1"] - 0.5 + q["c2"] * q["slip"]) * q["entry_angle"]


EFFECT = Effect(
    id="max-stress-angle",
    title="The greatest stress moves forward with slip",
    kind="contact",
    parameters=(
        Parameter("c1", "1", 0.5, 0.1, lower=0.02, upper=0.98, meaning="share of the entry angle at no slip"),
        Parameter(
            "c2",
            "1",
            0.0,
            0.3,
            lower=-0.9,
            upper=0.9,
            meaning="growth of that share from no slip to full slip",
        ),
    ),
    # Shares at full slip that were published lie between 0.5 and 0.8; near 1 the rim carries nothing, and
    # any wheel sinks.
    sums=(Sum(("c1", "c2"), 0.0, 0.85),),
    laws={"max_stress_angle": _angle},
    formula="θm = (c1 + c2 i) θ1",
    explanation=(
        "Where two bodies of soil part, one flowing forward and one backward, the stress on the rim is "
        "greatest. The base models put that point half-way to the entry angle. Wong and Reece found it "
        "moving forward with slip: c1, c2 of 0.18, 0.32 in loose and 0.43, 0.32 in compact sand. A stress "
        "further forward leans against the motion and carries less: at one load drawbar pull falls with "
        "slip and sinkage rises somewhat, while torque hardly changes. The excess of T/r over DP, close to "
        "W tan θm, grows with slip; the parasitic torque of drivetrain-friction makes an excess too, but a "
        "constant one. Slip-sinkage raises sinkage far more, and torque with it; shear-modulus lowers "
        "torque and pull together. Shares at full slip, c1 + c2, were found from 0.5 to 0.8: "
        "where a fit needs more, it stands for something else."
    ),
    shows="drawbar pull against slip, and T/r − DP most of all",
    reference=(
        "Wong, Reece (1967), Prediction of rigid wheel performance based on the analysis of soil-wheel "
        "stresses, part I: Performance of driven rigid wheels, Journal of Terramechanics 4(1), 81–98"
    ),
    settled_by="a slip sweep at one load, with sinkage and drawbar pull measured together",
)
