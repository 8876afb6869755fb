"""The functions of `terrain_cli`, for a notebook.

`logs` reads and cuts, `soil_estimates` makes tables of soils, and each other module has a function
with its result.
"""

from terrain_cli.api.comparison_result import ComparisonResult, compare, report
from terrain_cli.api.diagnosis_result import DiagnosisResult, diagnose
from terrain_cli.api.effect_trial import EffectTrial, add_effect
from terrain_cli.api.logs import from_frame, load_model, load_rover, read, segment
from terrain_cli.api.simulated_drive import SimulatedDrive, simulate
from terrain_cli.api.soil_estimates import estimate, summarise, trace
from terrain_cli.models import ModelFile
from terrain_cli.telemetry import Samples
from terrain_cli.windows.cut_windows import Windows

__all__ = [
    "ComparisonResult",
    "DiagnosisResult",
    "EffectTrial",
    "ModelFile",
    "Samples",
    "SimulatedDrive",
    "Windows",
    "add_effect",
    "compare",
    "diagnose",
    "estimate",
    "from_frame",
    "load_model",
    "load_rover",
    "read",
    "report",
    "segment",
    "simulate",
    "summarise",
    "trace",
]
