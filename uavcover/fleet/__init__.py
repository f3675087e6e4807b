"""Several vehicles at the same time: jobs, traffic between them, losses, one recording of all.

In: a run folder planned for several vehicles, their links. Out: a track for each sortie, a board of their states.
Begin with ``command.py``; ``flight.py`` flies one vehicle's sorties. How work is divided is the planner's.
"""
