"""Flight recordings for the rerun viewer: writing, reading, listing, showing. The only package that imports rerun.

Its modules load rerun, which takes about a second, so commands import them only where they need them.
"""
