"""Elevation data for an area, terrain heights for a vehicle, files on its card.

In: an area, elevation data, a link, files. Out: DAT tiles, answers to terrain requests, files sent and read back.
Begin with the command's own module.
"""

COMMANDS = {
    "Plan": {
        "terrain": (
            "uavcover.extras.vehicle_files.terrain",
            "find elevation data for an area, or send it",
            ("uavcover terrain area.kml", "uavcover terrain area.kml --dem tiles/ --dat TERRAIN"),
        ),
    },
    "Vehicle": {
        "send-file": (
            "uavcover.extras.vehicle_files.get_file",
            "send files to the vehicle, or download one",
            (
                "uavcover send-file TERRAIN/N36W085.DAT --to udp:127.0.0.1:14550",
                "uavcover send-file script.lua --folder /APM/scripts --to tcp:127.0.0.1:5760",
            ),
        ),
        "get-file": (
            "uavcover.extras.vehicle_files.get_file",
            "",
            (
                "uavcover get-file /APM/LOGS/ --to udp:127.0.0.1:14550",
                "uavcover get-file @MISSION/mission.dat --to tcp:127.0.0.1:5760 -o mission.dat",
            ),
        ),
        "terrain-server": (
            "uavcover.extras.vehicle_files.terrain",
            "",
            (
                "uavcover terrain-server --dem dem.tif --to udp:127.0.0.1:14550",
                "uavcover terrain-server --dem tiles/ --to tcp:127.0.0.1:5760",
            ),
        ),
    },
}
