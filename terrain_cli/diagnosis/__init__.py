"""Which physical effect a model lacks: alarm, ranking, families, and what no catalogue knows."""

from terrain_cli.diagnosis.diagnose import diagnose
from terrain_cli.diagnosis.diagnosis_outcome import (
    Alarm,
    Candidate,
    Diagnosis,
    Hypothesis,
    NextDrive,
    NotTestable,
    Size,
    UnknownEffect,
)

__all__ = [
    "Alarm",
    "Candidate",
    "Diagnosis",
    "Hypothesis",
    "NextDrive",
    "NotTestable",
    "Size",
    "UnknownEffect",
    "diagnose",
]
