"""Localisation tables: where the rover was, by clock or by site, drive and pose.

Such a table comes from whoever localises the rover: a total station, motion capture, or the PLACES
archive of a Mars mission (PDS bundles msl_places and mars2020_rover_places). Nothing is
extrapolated, and no sample is placed where the table says two things.
"""

from __future__ import annotations

from terrain_cli.places.join import Placed, locate
from terrain_cli.places.table import KEYS, Places, load

__all__ = ["KEYS", "Placed", "Places", "load", "locate"]
