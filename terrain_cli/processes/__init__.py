"""Processes of this machine: their memory, their signals, several side by side."""
