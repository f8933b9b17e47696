"""The version: here, and nowhere else. setup.cfg reads it from this text, so that nothing need be installed."""

__version__ = "0.2.0"
