"""Estimators of the line y = c + x tan φ."""
