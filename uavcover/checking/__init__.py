"""Anybody's mission, judged over the terrain before it is flown."""
