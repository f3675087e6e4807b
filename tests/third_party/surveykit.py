"""What a third party writes: a command, a format for export, a sensor, a log reader. Only public names of uavcover."""

import csv
import json
from pathlib import Path

import numpy as np

from uavcover.missions.mission_compiler import CompiledMission
from uavcover.verification.track_logs.assembly import LoggedRows

COMMANDS = {"After": {"hello": ("surveykit", "says hello to a file", ("uavcover hello mission.json",))}}


def hello(file: Path) -> int:
    """Say how many points a file of ours has."""
    print(f"{len(json.loads(file.read_text()))} points")  # noqa: T201
    return 0


def write_points(compiled: CompiledMission, *, autopilot: str, name: str) -> bytes:
    """The path as a list of local points, with its title and whom it is for."""
    return json.dumps(
        {
            "name": name,
            "autopilot": autopilot,
            "points": [[round(float(v), 2) for v in point] for point in compiled.path_m],
        }
    ).encode()


def line_scanner(table: dict[str, float]) -> dict[str, object]:
    """A camera that sees a strip across the track: a frame camera whose picture is 20 degrees long."""
    if not 0.0 < table["swath_deg"] < 180.0:
        raise ValueError(f"swath_deg: {table['swath_deg']:g} is outside 0..180 degrees")
    return {
        "kind": "frame-camera", "fov_across_deg": table["swath_deg"], "fov_along_deg": 20.0, "range_m": table["range_m"],
        "mount": "stabilised",
    }  # fmt: skip


def read_xyzt(path: Path) -> LoggedRows:
    """A text of time, latitude, longitude and height above sea level."""
    with path.open(newline="") as file:
        return LoggedRows(np.array([[float(v) for v in row] for row in csv.reader(file)]), np.empty((0, 4)))
