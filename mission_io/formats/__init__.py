"""Missions as text, one module for each file format: text in, objects out. Only ``files`` opens files."""
