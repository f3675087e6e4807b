"""Differences between ArduPilot and PX4, as data."""
