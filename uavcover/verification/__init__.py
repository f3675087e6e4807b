"""From a flown track to a verdict: coverage, safety, gaps. It never imports the planner.

In: tracks (``track_logs/`` reads logs of autopilots), the site. Out: ``VerificationReport``, ``verification.json``.
Begin with ``command.py`` (a run folder), then ``verify.py`` and ``judged_track.py``; ``decision.py`` combines the findings.
"""
