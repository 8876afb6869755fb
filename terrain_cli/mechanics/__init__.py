"""Wheel–soil models: pure functions of arrays, in SI units."""
