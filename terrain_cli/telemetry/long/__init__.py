"""Logs too long to be held at once."""
