"""Coverage of an area by photos of any origin, and its gaps; verification of flights by their photos.

In: photos, lists of them, logs, an area with elevation data. Out: photos per point, gaps, a flight for the gaps.
Begin with ``command.py``, then ``judge_photos.py``; ``verify --photos`` and ``--area`` begin in ``any_flight.py``.
"""

COMMANDS = {
    "After": {
        "judge-photos": (
            "uavcover.extras.photos.command",
            "check whether photos cover an area",
            (
                "uavcover judge-photos DCIM/ --area area.kml --dem dem.tif --overlap 75/70 -o verdict",
                "uavcover judge-photos DCIM/ --scenario RUN --takeoff 46.5,7.9",
            ),
        ),
    },
}
