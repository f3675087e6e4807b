"""The flight of one vehicle: connect, upload, make ready, arm, follow, watch, bring home, resume.

In: a run folder with missions, a link. Out: a track, a recording, the outcome. Begin with ``command.py`` (a run folder),
``connect.py`` (a vehicle) and ``fly.py``.
"""
