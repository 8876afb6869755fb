"""Estimators of the line y = c + x tan φ, window by window, with errors that noise and time allow."""
