"""From routes to missions: costs and limits of routes, leg checks, transit, sorties, the compiler.

In: ``Route``. Out: ``CompiledMission`` and its files (``flights.py``). Begin with ``mission_compiler.py``.
``leg_checks.py`` keeps every leg inside the limits; ``failsafe_*`` predicts what autopilots fly by themselves.
"""
