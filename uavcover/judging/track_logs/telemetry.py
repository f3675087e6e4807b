"""Telemetry logs of ground stations (``.tlog``): MAVLink packets with their times of arrival, read by pymavlink."""

from collections import Counter, defaultdict
from pathlib import Path

import numpy as np

from uavcover.errors import TrackError
from uavcover.judging.track_logs.assembly import LoggedRows

_Source = tuple[int, int]
_Rows = dict[_Source, list[tuple[float, ...]]]


def read_telemetry(path: Path) -> LoggedRows:
    """Read positions (GLOBAL_POSITION_INT) and attitudes (ATTITUDE) of the only vehicle in a log, on its own clock.

    Raises:
        TrackError: not such a log, without positions, or with positions of several vehicles.
    """
    # Importing pymavlink takes a moment; other kinds of logs do not need it.
    from pymavlink import mavutil
    from pymavlink.dialects.v20 import common as mavlink

    positions: _Rows = defaultdict(list)
    attitudes: _Rows = defaultdict(list)
    autopilots: set[_Source] = set()
    log = mavutil.mavlogfile(str(path), robust_parsing=True)
    try:
        while (message := log.recv_match(type=["GLOBAL_POSITION_INT", "ATTITUDE", "HEARTBEAT"])) is not None:
            source = (message.get_srcSystem(), message.get_srcComponent())
            if message.get_type() == "HEARTBEAT":
                if message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
                    autopilots.add(source)
                continue
            time_s = message.time_boot_ms * 1e-3
            if message.get_type() == "ATTITUDE":
                angles = np.degrees([message.roll, message.pitch, message.yaw])
                attitudes[source].append((time_s, *map(float, angles)))
            else:
                positions[source].append((time_s, message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3))
    finally:
        log.close()
    if not positions:
        raise TrackError(f"{path}: has no GLOBAL_POSITION_INT messages, so no positions; is it a telemetry log?")
    systems = sorted({system for system, _ in positions})
    if len(systems) > 1:
        raise TrackError(
            f"{path}: has positions of {len(systems)} vehicles (systems {', '.join(map(str, systems))}); give a log of one"
        )
    # Only the autopilot's positions count; in a log without heartbeats it is the component that sends most.
    speaking = {key: len(rows) for key, rows in positions.items() if key in autopilots} or {
        key: len(rows) for key, rows in positions.items()
    }
    source = Counter(speaking).most_common(1)[0][0]
    return LoggedRows(np.array(positions[source]), np.array(attitudes[source]).reshape(-1, 4))
