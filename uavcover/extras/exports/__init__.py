"""A route for other software: mission files, DJI's and Litchi's flights, a page for paper.

In: a run folder with a plan. Out: files, each of one checked flight from home to home.
Begin with ``command.py``; ``export.py`` writes flights, formats of third parties come from ``uavcover.exporters``.
"""

COMMANDS = {
    "Plan": {
        "export": (
            "uavcover.extras.exports.command",
            "export the mission to DJI, Litchi, ROS, GPX or paper",
            (
                "uavcover export RUN --format wpml --drone dji-m3e -o survey.kmz",
                "uavcover export RUN --format litchi -o survey.csv",
            ),
        ),
    },
}
