"""The run folder: its files, provenance, what a verdict is bound to; who is told what; who does long tasks.

Begin with ``folder.py`` and ``provenance.py``; ``user.py`` is who commands talk to, ``scheduling.py`` who computes.
"""
