"""What any pictures show of an area, whoever took them, and what is missing; flights judged by their pictures.

In: pictures, lists of them, logs, an area with elevation data. Out: pictures per point, gaps, the flight for them.
Begin with ``command.py``, then ``judge_photos.py``; ``verify --photos`` and ``--area`` begin in ``any_flight.py``.
"""

COMMANDS = {
    "After": {
        "judge-photos": (
            "uavcover.extras.photos.command",
            "what any pictures show of an area, and what is missing",
            (
                "uavcover judge-photos DCIM/ --area area.kml --dem dem.tif --overlap 75/70 -o verdict",
                "uavcover judge-photos DCIM/ --scenario RUN --takeoff 46.5,7.9",
            ),
        ),
    },
}
