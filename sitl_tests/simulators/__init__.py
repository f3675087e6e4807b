"""Vehicles that the harness starts, each with a process (or thread), ports and a folder of its own."""
