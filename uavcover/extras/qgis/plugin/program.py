"""The command that runs uavcover; ``uavcover qgis-plugin`` writes that of its own installation here."""

PROGRAM = ["uavcover"]
