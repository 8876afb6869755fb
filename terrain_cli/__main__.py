"""``python -m terrain_cli`` is ``terrain-est``."""

import sys
from pathlib import Path

# Python puts the working folder first, unless it is told not to: a user's numpy.py would stand in the way.
if not sys.flags.safe_path and Path(sys.path[0]).resolve() != Path(__file__).resolve().parent.parent:
    del sys.path[0]

from terrain_cli.app import main

main()
