"""``python -m terrain_cli`` is ``terrain-est``."""

import sys
from pathlib import Path

# Python puts the working folder first, where a user's numpy.py or click.py would stand in the way.
if sys.path[0] and Path(sys.path[0]).resolve() != Path(__file__).resolve().parent.parent:
    del sys.path[0]

from terrain_cli.app import main

main()
