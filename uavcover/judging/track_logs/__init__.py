"""Tracks from the logs of other software: one format a file."""
