"""A slipping wheel digs itself in: the sinkage exponent grows with slip."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _exponent(q: Quantities) -> Any:
    skid = 0.5 * (np.absolute(q["slip"]) - q["slip"])
    return q["sinkage_exponent"] + q["n1"] * np.absolute(q["slip"]) + q["n2"] * skid


def _sinkage(q: Quantities) -> Any:
    return q["sinkage"] * (1.0 + q["S"] * np.absolute(q["slip"]))


EFFECT = Effect(
    id="slip-sinkage",
    title="Sinkage grows with slip",
    kind="stress",
    parameters=(
        Parameter(
            "n1",
            "1",
            0.0,
            0.5,
            lower=-1.0,
            upper=3.0,
            meaning="growth of the sinkage exponent from no slip to full slip",
        ),
        Parameter(
            "n2",
            "1",
            0.0,
            0.5,
            lower=-2.0,
            upper=3.0,
            meaning="further growth of the sinkage exponent to a locked wheel",
            skids=True,
        ),
        Parameter(
            "S",
            "1",
            0.0,
            0.5,
            lower=-0.8,
            upper=10.0,
            meaning="soil carried away: growth of the sinkage itself, as a share",
        ),
    ),
    laws={"sinkage_exponent": _exponent, "sinkage": _sinkage},
    formula="n = n0 + n1 |i| + n2 max(−i, 0); z *= 1 + S |i|",
    explanation=(
        "A slipping wheel carries soil backwards from under itself and sinks into the hole: at a slip of "
        "0.6 it stands three to seven times as deep as at rest. Ding et al. let the exponent of the "
        "pressure–sinkage law grow with slip; n1 is 0.3 to 1 in loose soil: all of the contact is longer "
        "then. Lyasko lets the sinkage alone grow, z = z0 (1 + S i)/(1 − 0.5 S i), by soil that is carried "
        "away without bearing more; here z0 (1 + S |i|), as on a smooth wheel in dry sand S = 1 does. One "
        "drive hardly tells n1 from S. A skidding wheel ploughs, and sinks more than one that slips as much: "
        "n2 is what comes to the exponent there, and is left out where nothing skids. Sinkage at one load "
        "rises with slip, and through the longer contact torque rises too, while drawbar pull falls at high "
        "slip. Without sinkage it is easily taken for grousers or max-stress-angle. Grousers and "
        "shear-modulus hardly move the sinkage; max-stress-angle moves it less, and leaves torque as it was."
    ),
    shows="sinkage, then torque and drawbar pull, against slip",
    reference=(
        "Ding, Gao, Deng, Tao (2010), Wheel slip-sinkage and its prediction model of lunar rover, Journal "
        "of Central South University of Technology 17(1), 129–135, doi 10.1007/s11771-010-0021-7; Lyasko "
        "(2010), Slip sinkage effect in soil–vehicle mechanics, Journal of Terramechanics 47(1), 21–31, "
        "doi 10.1016/j.jterra.2009.08.005; growth of its own in skids: Pavlov (2024), on dry sand"
    ),
    settled_by="a slip sweep at one load, with sinkage and drawbar pull measured together",
)
