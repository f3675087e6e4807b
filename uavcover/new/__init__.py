"""A scenario from people's own files: ``uavcover new``.

In: an area, elevation data, names of a camera and a vehicle (``data/*.toml``). Out: a commented scenario.
Begin with ``command.py``; ``survey.py`` designs and writes, ``terrain_look.py`` looks at the ground.
"""
