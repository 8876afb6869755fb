"""The choices of `terrain-est estimate` with their defaults, and how a criterion is declared."""

import math
from typing import Literal, TypeVar, get_args

#: Estimators of the line y = c + x tan φ.
LineMethod = Literal["auto", "least-squares", "ridge", "recursive"]
Method = Literal[LineMethod, "wong-reece"]
METHODS: tuple[Method, ...] = get_args(Method)
Segments = Literal["auto", "fixed", "terrain", "none"]
SEGMENTS: tuple[Segments, ...] = get_args(Segments)
#: Models that need no file.
Base = Literal["linear", "wong-reece"]
BASES: tuple[Base, ...] = get_args(Base)
CUT_SAMPLES = 10  # Fewest samples of a window that is cut where the soil changes
FIT_SAMPLES = 5  # Fewest samples that say something of a line and of the scatter about it
#: In m. A window of soil shorter than this is no terrain of its own (Iagnemma et al. 2004, section II).
MIN_DISTANCE = 0.10
#: Segments of a wheel in one picture of what is known of c and φ: more would be too small to read.
MOST_VALLEYS = 12
#: Within which k of rover.toml is expected to be right unless it says otherwise (one standard deviation).
K_FACTOR = 2.0
LARGEST_PHI = math.radians(60.0)  # φ in rad beyond which no soil is known
#: Least and greatest value of each parameter of the soil, in SI units: what is fixed, expected or found is
#: within them. They enclose all published soils by a factor of ten or more (judged), snow and rock too; a c
#: below 0 may be noise about it, or shows that the model is wrong.
SOIL_BOUNDS = {
    "cohesion": (-1e6, 1e6),
    "tan_phi": (0.0, math.tan(LARGEST_PHI)),
    "shear_modulus": (1e-4, 1.0),
    "stiffness": (1e3, 1e10),
    "sinkage_exponent": (0.1, 3.0),
}
#: A parameter of an effect is within so many of its typical sizes, those under its wheel, from where it has
#: no effect (judged): a fit takes at most 60 steps of two.
MOST_SCALES = 1e3
#: A standard deviation of a prior is between these shares of the range of its parameter (judged): below the
#: one the parameter is as good as fixed, above the other nothing is known of it.
PRIOR_SHARES = (1e-9, 1e3)
Number = TypeVar("Number", int, float)
#: The evidence of a number chosen by whoever wrote it: no study tells whether another value would do better.
JUDGED = "judged"


def criterion(value: Number, meaning: str, evidence: str = JUDGED) -> Number:  # noqa: ARG001 - see below
    """Declare a number that decides. What is said of it is read from the source, by man/criteria_page.py."""
    return value
