"""Find the firmware that wrote a log, and its earliest date: a flight is not older than its autopilot's release.

The version stands in every kind of log: as text (ArduPilot's MSG and VER), as a number (``ver_sw_release`` of PX4), and in the
AUTOPILOT_VERSION that a ground station received. A track of ours has its telemetry log beside it.
"""

import re
from dataclasses import dataclass
from datetime import UTC, datetime, time
from pathlib import Path

from mission_io.data_tables import read_document
from uavcover.verification.tuning import CLOCK

_ARDUPILOT = re.compile(rb"Ardu(?:Copter|Plane|Rover|Sub) V(\d+)\.(\d+)\.\d+(-?[a-z]*)")
_PX4 = re.compile(rb"uint32_t ver_sw_release(.{4})", re.DOTALL)
_MESSAGE = re.compile(rb"\xfd[\x14-\xff].{5}\x94\x00\x00.{16}(.{4})", re.DOTALL)
"""AUTOPILOT_VERSION (148) as MAVLink 2: the version comes after two numbers of 64 bits."""
_TELEMETRY = "flight.tlog"


@dataclass(frozen=True, slots=True)
class Firmware:
    """A firmware's version."""

    autopilot: str  # "ardupilot" or "px4"
    major: int  # first number
    minor: int  # second number
    official: bool  # whether it is a release, and not a build on the way to one

    def __str__(self) -> str:
        """Name and version."""
        name = "ArduPilot" if self.autopilot == "ardupilot" else "PX4"
        return f"{name} {self.major}.{self.minor}{'' if self.official else ' (not a release)'}"

    @property
    def released_s(self) -> float | None:
        """Release date of the firmware in seconds since 1970: no earlier flight is possible. None where it is not known."""
        minor = self.minor if self.official else self.minor - CLOCK.unreleased_versions
        released = read_document("uavcover/data/firmware_releases.toml")[self.autopilot].get(f"{self.major}.{minor}")
        return None if released is None else datetime.combine(released, time(), UTC).timestamp()


def firmware_of(log: Path) -> Firmware | None:
    """The firmware that a log, or the telemetry log beside one of our tracks, names; None where it names none."""
    path = log.with_name(_TELEMETRY) if log.suffix.lower() in (".csv", ".rrd") else log
    if not path.is_file():
        return None
    with path.open("rb") as file:
        head = file.read(CLOCK.head_bytes)
    kind = path.suffix.lower()
    if kind == ".bin":
        found = _ARDUPILOT.search(head)
        return None if found is None else Firmware("ardupilot", int(found[1]), int(found[2]), not found[3].strip(b"-"))
    number = {".ulg": _PX4, ".tlog": _MESSAGE}.get(kind)
    found = None if number is None else number.search(head)
    if found is None:
        return None
    level, _, minor, major = found[1]
    autopilot = "px4" if kind == ".ulg" or major == 1 else "ardupilot"
    return Firmware(autopilot, major, minor, level == 255)  # FIRMWARE_VERSION_TYPE_OFFICIAL
