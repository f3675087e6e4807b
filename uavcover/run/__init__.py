"""The run folder: its files, provenance, inputs of a verdict; the user's messages; scheduling of long tasks.

Begin with ``folder.py`` and ``provenance.py``; ``user.py`` is the interface to the user, ``scheduling.py`` to the workers.
"""
