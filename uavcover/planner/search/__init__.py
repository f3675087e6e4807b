"""Searches: optimizers over encodings, and local searches over routes."""
