"""Frozen dataclasses that pass between the stages. No behaviour beyond their own rules, no third-party package but numpy.

Begin with ``scenario.py``, ``route.py``, ``track.py``, ``verdict.py``.
"""
