"""Tracks from the logs of other software."""
