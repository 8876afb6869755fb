"""What the tests know of each effect of the catalogue: one row, from which all of them take it.

The values and the signatures were worked out elsewhere, from the sources that the effects name.
"""

from __future__ import annotations

from dataclasses import dataclass

UP, DOWN, SAME, MOVED = "up", "down", "same", "moved"


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownEffect:
    """What must hold of one effect.

    Parameters
    ----------
    kind : str
        Where it enters the model.
    values : dict of str to float
        A typical size of every parameter: the truth that a fit has to find again.
    found_within : float
        How near the fit must come, as a share of a parameter's scale.
    signature : tuple of str
        What becomes of sinkage, torque and drawbar pull under a load of 80 N, at a slip of 0.3.
    shown : dict of str to float, optional
        The values with which it does, where `values` hide it: parameters may work against each other.
    same_within : float
        How far program and simulator may differ: more than by their integrals where bends are
        rounded or rates are taken from samples.
    fast : bool
        Its truth needs samples that follow each other closely.
    on_the_line : bool
        The linear base can have it.
    with_constants : bool
        Its law has a constant in SI units, and so does not scale when units do.
    """

    kind: str
    values: dict[str, float]
    found_within: float
    signature: tuple[str, str, str]
    shown: dict[str, float] | None = None
    same_within: float = 1e-6
    fast: bool = False
    on_the_line: bool = True
    with_constants: bool = False


KNOWN_EFFECTS = {
    "slip-sinkage": KnownEffect(
        kind="stress",
        values={"n1": 0.4, "n2": 0.3, "S": 0.2, "bend": 0.4},
        found_within=0.001,
        signature=(UP, UP, MOVED),
        on_the_line=False,
    ),
    "max-stress-angle": KnownEffect(
        kind="contact",
        values={"c1": 0.4, "c2": 0.25},
        found_within=0.0001,
        signature=(UP, MOVED, DOWN),
        shown={"c2": 0.32},
    ),
    "rear-contact": KnownEffect(
        kind="contact",
        values={"c3": 0.25},
        found_within=0.0001,
        signature=(DOWN, MOVED, UP),
    ),
    "grousers": KnownEffect(
        kind="contact",
        values={"lambda_s": 0.7},
        found_within=0.0001,
        signature=(MOVED, UP, UP),
    ),
    "bulldozing": KnownEffect(
        kind="force",
        values={"factor": 0.15},
        found_within=0.0001,
        signature=(SAME, SAME, DOWN),
        with_constants=True,
    ),
    "side-slip": KnownEffect(
        kind="stress",
        values={"k_growth": 1.2, "lateral": 4.0},
        found_within=0.05,
        signature=(MOVED, DOWN, DOWN),
        same_within=0.001,
        on_the_line=False,
        with_constants=True,
    ),
    "multi-pass": KnownEffect(
        kind="soil",
        values={"stiffness_gain": 0.4, "cohesion_gain": 0.2, "shear_modulus_gain": -0.2, "further": 0.2},
        found_within=0.001,
        signature=(DOWN, MOVED, UP),
        on_the_line=False,
    ),
    "drivetrain-friction": KnownEffect(
        kind="sensor",
        values={"Tc": 0.6, "Bv": 0.3},
        found_within=0.001,
        signature=(SAME, UP, SAME),
    ),
    "gear-efficiency": KnownEffect(
        kind="sensor",
        values={"eta": 0.8},
        found_within=0.0001,
        signature=(SAME, UP, SAME),
    ),
    "motor-temperature": KnownEffect(
        kind="sensor",
        values={"alpha": -0.0011},
        found_within=0.0001,
        signature=(SAME, UP, SAME),
        with_constants=True,
    ),
    "rate-dependence": KnownEffect(
        kind="stress",
        values={"beta": 0.06},
        found_within=0.0001,
        signature=(MOVED, UP, UP),
        with_constants=True,
    ),
    "slope": KnownEffect(
        kind="force",
        values={"factor": 1.0},
        found_within=0.0001,
        signature=(DOWN, MOVED, DOWN),
    ),
    "load-transfer": KnownEffect(
        kind="force",
        values={"ratio": 0.25, "slope_ratio": 0.15},
        found_within=0.0001,
        signature=(UP, UP, MOVED),
    ),
    "load-bias": KnownEffect(
        kind="sensor",
        values={"gain": 0.96, "offset": 12.0},
        found_within=0.001,
        signature=(DOWN, DOWN, MOVED),
    ),
    "sinkage-bias": KnownEffect(
        kind="sensor",
        values={"offset": 0.003},
        found_within=0.0001,
        signature=(UP, SAME, SAME),
    ),
    "drawbar-bias": KnownEffect(
        kind="sensor",
        values={"offset": -2.5},
        found_within=0.0001,
        signature=(SAME, SAME, UP),
        shown={"offset": 3.0},
    ),
    "wheel-radius": KnownEffect(
        kind="sensor",
        values={"relative_error": 0.04, "whole": 1.0},
        found_within=0.0001,
        signature=(MOVED, UP, UP),
    ),
    "sinkage-relaxation": KnownEffect(
        kind="soil",
        values={"length": 0.03},
        # Lines through the rut are as long as a contact, and the length comes out longer by a sixteenth.
        found_within=0.07,
        signature=(DOWN, SAME, SAME),
        same_within=0.01,
        fast=True,
    ),
    "sensor-lag": KnownEffect(
        kind="sensor",
        values={"torque_lag": 0.15, "drawbar_pull_lag": 0.1, "sinkage_lag": 0.05, "filtered": 0.0},
        found_within=0.05,
        signature=(SAME, DOWN, SAME),
        shown={"torque_lag": 0.2},
        same_within=0.01,
        fast=True,
    ),
    "acceleration-torque": KnownEffect(
        kind="sensor",
        values={"J": 0.8},
        found_within=0.05,
        signature=(SAME, UP, SAME),
        same_within=0.001,
        fast=True,
    ),
    "shear-modulus": KnownEffect(
        kind="stress",
        values={"k1": 1.5},
        found_within=0.0001,
        signature=(MOVED, DOWN, DOWN),
    ),
    "post-peak-softening": KnownEffect(
        kind="stress",
        values={"loss": 0.4, "length": 0.03},
        found_within=0.001,
        signature=(MOVED, DOWN, DOWN),
        on_the_line=False,
    ),
    "strength-curvature": KnownEffect(
        kind="stress",
        values={"B": 0.12},
        found_within=0.0001,
        signature=(MOVED, MOVED, MOVED),
        on_the_line=False,
        with_constants=True,
    ),
    "hardpan": KnownEffect(
        kind="soil",
        values={"modulus": 4000000.0, "top": 0.016},
        found_within=0.0001,
        signature=(DOWN, MOVED, UP),
        shown={"modulus": 2000000.0},
        on_the_line=False,
        with_constants=True,
    ),
    "crust": KnownEffect(
        kind="soil",
        values={"strength": 2000.0, "thickness": 0.004},
        found_within=0.001,
        signature=(DOWN, MOVED, MOVED),
        on_the_line=False,
    ),
    "flexible-wheel": KnownEffect(
        kind="contact",
        values={"deflection": 0.06},
        found_within=0.001,
        signature=(DOWN, MOVED, UP),
    ),
    "grouser-ripple": KnownEffect(
        kind="sensor",
        values={
            "torque_sine": 0.03,
            "torque_cosine": -0.02,
            "pull_sine": 0.05,
            "pull_cosine": 0.02,
            "sinkage_sine": -0.04,
            "sinkage_cosine": 0.03,
        },
        found_within=0.05,
        signature=(SAME, SAME, UP),
        shown={"pull_sine": 0.05},
        same_within=0.001,
        fast=True,
    ),
}
