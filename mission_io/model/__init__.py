"""Missions, fences and rally points as data: no bytes, no files, no clock."""
