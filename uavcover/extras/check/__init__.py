"""Check any mission against the terrain before the flight.

In: a mission file, elevation data, limits. Out: findings of every leg, a verdict, a map, a repaired mission.
Begin with ``command.py``, then ``mission_file.py``; ``check.py`` calls one module for each kind of check.
"""

COMMANDS = {
    "Plan": {
        "check": (
            "uavcover.extras.check.command",
            "check any mission against the terrain before flight",
            (
                "uavcover check mission.plan --dem dem.tif --no-fly zones.json --return-height 60m",
                "uavcover check survey.waypoints --dem tiles/ --vehicle dji-m350-rtk --battery 30min --map found.geojson",
            ),
        ),
    },
}
