"""Visibility: cells of the area, sensors, coverage maps."""
