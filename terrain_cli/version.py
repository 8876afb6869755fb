"""The one place where the version stands: packaging and `--version` read it here."""

__version__ = "0.1.0"
