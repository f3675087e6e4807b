"""Plan, watch and judge on a map in a browser: ``uavcover serve``.

In: a folder with scenarios, areas, elevation data and run folders. Out: the same files as the commands write, through them. Begin
with ``command.py``; ``server.py`` has the routes, ``jobs.py`` starts the commands, ``page/`` has the files of the browser.
"""

COMMANDS = {
    "Start": {
        "serve": (
            "uavcover.extras.app.command",
            "plan, fly and judge on a map in the browser",
            ("uavcover serve", "uavcover serve RUN", "uavcover serve area.kml --port 8800 --no-browser"),
        ),
    },
    "Plan": {
        "edit": (
            "uavcover.extras.app.command",
            "",
            ("uavcover edit RUN waypoints.json -o RUN2",),
        ),
    },
}
