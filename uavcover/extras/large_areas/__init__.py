"""Planning of large areas by parts: divided, each part planned by itself, joined, and repaired along the seams.

In: a site, a division. Out: one plan. Begin with ``divided_plan.py``, which the group ``uavcover.large_areas`` names;
``planner.py`` does the rounds.
"""
