"""Model files: the base, the effects added to it, and what is known of their parameters."""

from terrain_cli.mechanics.effect import Prior as Prior
from terrain_cli.models.model_change import ASSUMPTIONS as ASSUMPTIONS
from terrain_cli.models.model_change import MODULUS as MODULUS
from terrain_cli.models.model_change import STRESSES as STRESSES
from terrain_cli.models.model_change import Assumption as Assumption
from terrain_cli.models.model_change import Changed as Changed
from terrain_cli.models.model_change import Refused as Refused
from terrain_cli.models.model_change import added as added
from terrain_cli.models.model_change import folder_of as folder_of
from terrain_cli.models.model_change import in_forms as in_forms
from terrain_cli.models.model_change import moved as moved
from terrain_cli.models.model_change import named_from as named_from
from terrain_cli.models.model_change import recorded as recorded
from terrain_cli.models.model_change import refused as refused
from terrain_cli.models.model_change import removed as removed
from terrain_cli.models.model_change import rivals as rivals
from terrain_cli.models.model_file import ModelFile as ModelFile
from terrain_cli.models.model_file import build as build
from terrain_cli.models.model_file import find_effect as find_effect
from terrain_cli.models.model_file import is_path as is_path
from terrain_cli.models.model_file import load as load
from terrain_cli.models.model_file import resolve as resolve
from terrain_cli.models.model_file import save as save
