"""Cells of the area, sensors, coverage maps, photos for each point.

In: ``Site``, positions. Out: visible and observed cells. Begin with ``coverage_map.py`` and ``sensors.py``.
"""
