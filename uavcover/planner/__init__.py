"""From a site to a plan: a Pareto set of routes, the selected one, its files, gap missions.

In: ``Site``, settings of the search. Out: ``Plan`` and a run folder. Begin with ``command.py`` (a plan into a run folder),
then ``planner.py`` (the search itself).
"""
