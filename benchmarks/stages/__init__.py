"""The stages, in the order of the table."""

from importlib import import_module

MODULES = ("bags", "tables", "program", "stresses", "segments", "estimators", "model", "diagnosis")
STAGES = {}
#: Modules that an older program, as `benchmarks.compare` measures it, has not what they need for.
MISSING = {}
for _name in MODULES:
    try:
        STAGES |= {stage.name: stage for stage in import_module(f"benchmarks.stages.{_name}").STAGES}
    except ImportError as error:
        MISSING[_name] = error
