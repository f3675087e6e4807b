"""Missions as text: one module for each file format. Text in, objects out, no file access."""
