"""``python -m terrain_cli`` is ``terrain-est``."""

from terrain_cli.app import main

main()
