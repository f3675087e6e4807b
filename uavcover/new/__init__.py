"""A scenario from the user's files: ``uavcover new``.

In: an area, elevation data, names of a camera and a vehicle (``data/*.toml``). Out: a commented scenario. Begin with
``command.py``; ``survey.py`` designs and writes, ``terrain_look.py`` examines the ground.
"""
