"""Frozen dataclasses that pass between the stages. They check only themselves and need only numpy.

Begin with ``scenario.py``, ``route.py``, ``track.py``, ``verdict.py``.
"""
