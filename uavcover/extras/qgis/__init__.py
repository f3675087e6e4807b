"""A plugin for QGIS with Processing algorithms: ``uavcover qgis-plugin``.

In: nothing. Out: a zip file that QGIS installs; it runs the installed ``uavcover`` and uses none of its Python.
Begin with ``command.py``; ``plugin/`` is the content of the zip.
"""

COMMANDS = {
    "Start": {
        "qgis-plugin": (
            "uavcover.extras.qgis.command",
            "",
            ("uavcover qgis-plugin -o uavcover.zip",),
        ),
    },
}
