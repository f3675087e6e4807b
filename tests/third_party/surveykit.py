"""What a third party writes: a command, a format for export, a sensor, a log reader. Only public names of uavcover."""

import csv
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from uavcover.kernels.sight import Sight
from uavcover.missions.mission_compiler import CompiledMission
from uavcover.model.sensor import FrameCamera
from uavcover.model.sensor_base import Rays
from uavcover.verification.track_logs.logged_rows import LoggedRows

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
        raise ValueError(f"swath_deg: must be between 0 and 180 degrees, not {table['swath_deg']:g}")
    return {
        "kind": "frame-camera", "fov_across_deg": table["swath_deg"], "fov_along_deg": 20.0, "range_m": table["range_m"],
        "mount": "stabilised",
    }  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class TwinCamera(FrameCamera):
    """Two cameras side by side, one tilted to the left and one to the right: the keys of a frame camera are those of each."""

    kind: Literal["twin-camera"]  # type: ignore[assignment]
    tilt_deg: float

    def __post_init__(self) -> None:
        """Check the keys."""
        FrameCamera.__post_init__(self)
        if not 0.0 < self.tilt_deg < 45.0:
            raise ValueError(f"tilt_deg: {self.tilt_deg:g} is outside 0..45 degrees")

    @property
    def sight(self) -> Sight:
        """Planned as one camera, as wide as both, whose photos are as long as theirs are in the middle."""
        one, tilt = FrameCamera.sight.fget(self), math.radians(self.tilt_deg)
        wide = math.tan(tilt + math.radians(0.5 * self.fov_across_deg))
        return one._replace(tan_half_fov=wide, tan_half_along=one.tan_half_along * math.cos(tilt))

    def in_view(self, rays: Rays) -> np.ndarray:
        """Whether either camera has a place in its photo."""
        one, observed = FrameCamera.sight.fget(self), np.zeros(rays.depth.shape, dtype=bool)
        for turn in (math.radians(self.tilt_deg), -math.radians(self.tilt_deg)):
            depth = math.cos(turn) * rays.depth + math.sin(turn) * rays.across
            across = math.cos(turn) * rays.across - math.sin(turn) * rays.depth
            observed |= (np.abs(across) <= depth * one.tan_half_fov) & (
                np.abs(rays.along) <= depth * one.tan_half_along
            )
        return observed & (rays.distance2 <= self.range_m**2)


def read_xyzt(path: Path) -> LoggedRows:
    """A text of time, latitude, longitude and height above sea level."""
    with path.open(newline="") as file:
        return LoggedRows(np.array([[float(v) for v in row] for row in csv.reader(file)]), np.empty((0, 4)))
