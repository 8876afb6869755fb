"""The functions of `terrain_cli`, for a notebook.

`logs` reads and cuts, `soil_estimates` makes tables of soils, and each other module has a function
with its result.
"""

from terrain_cli.api.comparison_result import ComparisonResult as ComparisonResult
from terrain_cli.api.comparison_result import compare as compare
from terrain_cli.api.comparison_result import report as report
from terrain_cli.api.diagnosis_result import DiagnosisResult as DiagnosisResult
from terrain_cli.api.diagnosis_result import diagnose as diagnose
from terrain_cli.api.effect_trial import EffectTrial as EffectTrial
from terrain_cli.api.effect_trial import add_effect as add_effect
from terrain_cli.api.logs import from_frame as from_frame
from terrain_cli.api.logs import load_model as load_model
from terrain_cli.api.logs import load_rover as load_rover
from terrain_cli.api.logs import read as read
from terrain_cli.api.logs import segment as segment
from terrain_cli.api.simulated_drive import SimulatedDrive as SimulatedDrive
from terrain_cli.api.simulated_drive import simulate as simulate
from terrain_cli.api.soil_estimates import estimate as estimate
from terrain_cli.api.soil_estimates import posterior as posterior
from terrain_cli.api.soil_estimates import summarise as summarise
from terrain_cli.api.soil_estimates import trace as trace
from terrain_cli.models import ModelFile as ModelFile
from terrain_cli.telemetry import Samples as Samples
from terrain_cli.windows.cut_windows import Windows as Windows
