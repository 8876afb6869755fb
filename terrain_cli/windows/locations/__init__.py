"""Localisation tables: where the rover was, by clock or by site, drive and pose.

Such a table comes from whoever localises the rover: a total station, motion capture, or the PLACES
archive of a Mars mission (PDS bundles msl_places and mars2020_rover_places). Nothing is
extrapolated, and no sample is placed where the table says two things.
"""

from __future__ import annotations

from terrain_cli.windows.locations.location_table import KEYS, Places, load
from terrain_cli.windows.locations.position_join import Placed, locate

__all__ = ["KEYS", "Placed", "Places", "load", "locate"]
