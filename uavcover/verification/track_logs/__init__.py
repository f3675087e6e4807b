"""Tracks from the logs of other software, one module for each format."""
