"""At low stress the strength is no straight line."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities

#: σ0 in Pa: the stress at which tan φ is the soil's own.
REFERENCE = 10e3
_LEAST = 1.0


def _stress(q: Quantities) -> Any:
    sigma, travel = q["normal_stress"], q["shear_displacement"]
    way = np.where(travel < 0.0, -1.0, 1.0)
    mobilised = -way * np.expm1(-np.absolute(travel) / q["shear_modulus"])
    bent = np.exp(-q["B"] * np.log(np.maximum(sigma, _LEAST) / REFERENCE)) - 1.0
    return q["shear_stress"] + q["tan_phi"] * sigma * bent * mobilised


EFFECT = Effect(
    id="strength-curvature",
    title="The strength envelope is curved",
    kind="stress",
    parameters=(
        Parameter(
            "B", "1", 0.0, 0.1, lower=-0.5, upper=0.6, meaning="how fast friction falls as the stress rises"
        ),
    ),
    laws={"shear_stress": _stress},
    formula="τ = (c + σ tan φ (σ/σ0)^(−B))(1 − exp(−j/k)), σ0 = 10 kPa",
    explanation=(
        "Mohr–Coulomb's straight line is measured at the stresses of buildings. Below some 15 kPa, where "
        "light rovers drive, grains ride up over each other more freely and friction is higher: the "
        "envelope bends towards the origin, with B of 0.05 to 0.2. A straight line fitted to a piece of it "
        "finds a cohesion that is not there, and c rises and φ falls as the load rises. At one load it "
        "cannot be told from cohesion. Hardpan also changes things with load, but in sinkage; here sinkage "
        "stays. tan φ is that at 10 kPa."
    ),
    shows="torque and drawbar pull against load: apparent c and φ drift with it",
    reference=(
        "Senatore, Iagnemma (2011), Direct shear behaviour of dry, granular soils for low normal stress "
        "with application to lightweight robotic vehicle modelling, conference of the International "
        "Society for Terrain-Vehicle Systems"
    ),
    settled_by="load steps over a factor of four or more at one slip",
)
