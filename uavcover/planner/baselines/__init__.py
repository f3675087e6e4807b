"""Constructed routes: starting points of a search, and baselines for its result."""
