"""The surface: elevation files, the ground they describe, frames, vertical datums.

In: rasters and tiles. Out: ``Ground``, heights in the local frame. Begin with ``terrain_source.py`` and ``ground.py``.
"""
